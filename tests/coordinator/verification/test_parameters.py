"""The check `parameters`: each parameter by its form, and what the scene says of it."""

from dataclasses import replace as with_fields

import pytest

from cubepath.coordinator.verification.parameters import (
    check_parameters,
    hesitation_in,
    max_rounds_in,
    processes_of,
    seed_in,
)
from cubepath.protocol.recordings.recording import Recording
from tampering.tamperings import crowd
from tampering.tamperings_of_schedules import carried_out


def told(recording: Recording, **changes: str) -> list[str]:
    """Return what the check says of a recording with other parameters."""
    found: list[str] = []
    changed = with_fields(recording, parameters={**recording.parameters, **changes})
    check_parameters(changed, lambda _, line: found.append(line))
    return found


NUMBER = "expected a whole number of at least 0"


@pytest.mark.parametrize(
    ("key", "value", "why"),
    [
        ("seed", "-1", NUMBER),
        ("seed", "1e3", NUMBER),
        ("seed", "٣", NUMBER),
        ("seed", "", NUMBER),
        ("seed", "9" * 5000, NUMBER),
        ("max_rounds", "07", NUMBER),
        ("processes", "two", NUMBER),
        ("processes", "8", "expected at most 7, one for each module"),
        ("modules", "6", "expected 7, which start in the scene"),
        ("hesitate", "1.0", "expected at least 0 and less than 1"),
        ("hesitate", "nan", "expected at least 0 and less than 1"),
        ("hesitate", "often", "expected at least 0 and less than 1"),
        ("family", "hex", "expected 'agv', as in the scene"),
        ("invented", "1", "expected no parameter of this name, which no run has"),
        ("keepers", "2", "expected none of this name in a run with clock=lockstep"),
        ("wait_for", "1", "expected none beside processes"),
        ("part", "1", "expected none without attached"),
        ("from_round", "2", "expected none without stages"),
    ],
)
def test_a_parameter_that_does_not_fit_is_named(key: str, value: str, why: str) -> None:
    """By its name and value, with what was expected; and nothing else is wrong."""
    assert told(crowd(), **{key: value}) == [f"{key}={value!r}: {why}"]


def test_what_fits_is_left_alone() -> None:
    """The recorded ones, bounds of each, and none at all."""
    assert told(crowd()) == []
    assert told(carried_out()) == []
    assert told(crowd(), processes="7", seed="0", hesitate="0.999", max_rounds="0") == []
    found: list[str] = []
    check_parameters(with_fields(crowd(), parameters={}), lambda _, line: found.append(line))
    assert found == []


def test_a_schedule_has_its_rule_and_no_hesitation() -> None:
    """It has a round for every cube; what is repaired is a schedule."""
    assert told(carried_out(), rule="tswap") == [
        "rule='tswap': expected 'schedule', since there is one on record"
    ]
    assert told(carried_out(), hesitate="0.5") == [
        "hesitate='0.5': expected 0, since a schedule has a round for every cube"
    ]
    assert told(carried_out(), repair="tswap") == []


def test_what_is_missing_or_malformed_is_not_known() -> None:
    """Neither is taken for a number."""
    for key, read in (
        ("seed", seed_in),
        ("max_rounds", max_rounds_in),
        ("hesitate", hesitation_in),
    ):
        assert read({}) is None
        assert read({key: "x"}) is None
        assert read({key: "0"}) == 0
    for value, count in (("x", None), ("0", 1), ("1", 1), ("7", 7), ("8", None)):
        assert processes_of(with_fields(crowd(), parameters={"processes": value})) == count
