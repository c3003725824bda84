"""What a test gives of a wrong type is refused in one line, where it is given."""

import re
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from cubepath.coordinator.testing.commands import Command, Joiners
from cubepath.coordinator.testing.fixtures import Listener, RecordingFolder, ReplayFixture
from cubepath.coordinator.testing.link import LinkProxy
from cubepath.coordinator.testing.log import RunLog
from cubepath.coordinator.testing.process_faults import PlannedFault
from cubepath.coordinator.testing.rules import Pattern, Rule
from cubepath.coordinator.testing.strategies import faults, trial_of
from cubepath.protocol.core.errors import InputError

any_of: Any = {"none": None, "five": 5}
NOTHING, FIVE = any_of["none"], any_of["five"]


@cache
def log() -> RunLog:
    return RunLog.read("logs/golden/hex-5.mcap")


def replaying() -> ReplayFixture:
    return ReplayFixture(1.0, RecordingFolder(Path("logs")))


def rule(**options: Any) -> Rule:
    given: dict[str, Any] = {"action": "drop", **options}
    return Rule(**given)


def trial(**options: Any) -> object:
    given: dict[str, Any] = {"system": "hex:n=3", **options}
    return trial_of(**given)


WRONG: list[tuple[Callable[[], object], str]] = [
    (lambda: RunLog(NOTHING), "None: expected a Recording, or Log.read(PATH)"),
    (lambda: RunLog.read(NOTHING), "path=None: expected the path of a file"),
    (lambda: RunLog.read(""), "path='': expected the path of a file"),
    (lambda: log().assert_same_run(NOTHING), "None: expected another Log"),
    (lambda: replaying().into(log(), FIVE), "to=5: expected a function"),
    (lambda: replaying().into_node(log(), NOTHING), "node=None: expected a node"),
    (lambda: Listener(log(), FIVE), "command=5: expected a text, or a program and its arguments"),
    (lambda: Command(NOTHING), "command=None: expected a text, or a program and its arguments"),
    (lambda: Command([FIVE]), "command=[5]: expected a text, or a program and its arguments"),
    (lambda: Command("echo 'a"), "command=echo 'a: No closing quotation"),
    (lambda: Joiners(FIVE, None, 1.0), "commands=5: expected a list, or names with commands"),
    (lambda: Joiners([FIVE], None, 1.0), "command=5: expected a text, or a program"),
    (lambda: Joiners([], FIVE, 1.0), "env=5: expected names with values"),
    (
        lambda: rule(action="dorp"),
        "action=dorp: expected one of drop, delay, double, hold, reorder",
    ),
    (lambda: rule(pattern="bundle"), "pattern='bundle': expected a Pattern"),
    (lambda: rule(seed="x"), "seed='x': expected a whole number"),
    (lambda: rule().wait(FIVE, NOTHING), "timeout_s=None: expected a number"),
    (lambda: rule().wait(NOTHING), "times=None: expected 0 or more"),
    (lambda: LinkProxy("process_0", NOTHING), "endpoint=None: expected where the router is"),
    (lambda: trial(faults=[5]), "fault 5: expected one as fault('loss', 'process_0 up', 3)"),
    (lambda: trial(faults=5), "faults=5: expected a list of faults"),
    (lambda: trial(max_rounds="x"), "max_rounds='x': expected 0 or more"),
    (lambda: trial(keepers="x"), "keepers='x': expected 1 or more"),
    (lambda: trial(moves="x"), "moves='x': expected 0 or more"),
    (lambda: trial(system=None), "system=None: expected a name or a file"),
    (lambda: faults(kinds=FIVE), "kinds=5: expected kinds of faults"),
]


@pytest.mark.parametrize(("act", "told"), WRONG, ids=[told for _, told in WRONG])
def test_what_is_of_a_wrong_type_is_one_line(act: Callable[[], object], told: str) -> None:
    """With what was expected."""
    with pytest.raises(InputError, match=f"^{re.escape(told)}"):
        act()


def test_rules_and_plans_are_told_in_one_line() -> None:
    """The functions in them by their names."""

    class Odd:
        def __call__(self, _: object) -> bool:
            return True

        def __repr__(self) -> str:
            return "of\nlines"

    def mine(_: object) -> bool:
        return True

    assert repr(rule(pattern=Pattern(kind="bundle", where=mine))) == (
        "<drop kind=bundle, where=mine: met 0>"
    )
    assert repr(rule(pattern=Pattern(where=Odd()))) == "<drop where=Odd: met 0>"
    assert repr(PlannedFault(mine, lambda: None)) == "<planned: to come>"
