"""Runs that go on from a recording: the rule asked is that of the stage, from where that began."""

from functools import cache

import pytest

from cubepath.coordinator.runs.continuing import what_if
from cubepath.coordinator.tools.comparison.results import RunComparison
from cubepath.coordinator.tools.comparison.run_comparison import diff
from cubepath.protocol.recordings.recording import Recording
from samples.recordings import new_path, recorded

HEX = "hex:n=5"
FROM = 5


@cache
def child(rule: str, *, seed: int | None = None, parent: str = HEX, modules: int = 0) -> Recording:
    """Return what comes of a run with another rule; of all modules, or of the first ones."""
    return what_if(
        origin(parent),
        rule,
        from_round=FROM,
        seed=seed,
        modules=range(modules) if modules else None,
        max_rounds=9,
        processes=0,
        log=new_path(),
    ).recording()


@cache
def origin(spec: str) -> Recording:
    """Return the run that others go on from."""
    rule = "chain" if spec == HEX else "tswap"
    return recorded(spec, rule, seed=4, hesitate=0.3, rounds=9)


def by_rule(found: RunComparison) -> bool:
    """Return whether both choices are what the rules choose that were asked again."""
    assert found.choice is not None
    sides = found.choice.a, found.choice.b
    assert all(side.doubt is not None for side in sides)
    return all(side.by_rule == side.chose for side in sides)


def test_another_rule_is_the_cause_beside_the_parent() -> None:
    """Not that the recording names another: the rule that took over, and since when."""
    found, back = diff(origin(HEX), child("random")), diff(child("random"), origin(HEX))
    assert found.choice is not None
    assert back.choice is not None
    assert found.choice.round >= FROM
    assert found.choice.causes == back.choice.causes == ("rule",)
    assert by_rule(found)
    text = " ".join(str(found).split())
    assert "rule is chain in a, and random, which began in round 5 with no memory, in b" in text
    assert "random for 0-4 from round 5 on (seed 4, hesitate 0.3)" in text
    assert "recorded'" not in text


def test_the_seed_is_the_cause_between_children() -> None:
    """Both follow one rule from one round on, and drew otherwise."""
    found = diff(child("random", seed=3), child("random", seed=4))
    assert found.choice is not None
    assert found.choice.causes == ("seed",)
    assert by_rule(found)
    assert "seed is 3 in a, and 4 in b" in found.choice.why


def test_a_rule_that_begins_anew_is_told() -> None:
    """It draws its first numbers again; with the seed of the parent nothing else differs."""
    found = diff(origin(HEX), child("chain"))
    assert found.choice is not None
    assert found.choice.causes == ("rule",)
    assert by_rule(found)
    assert "rule is chain in a, and chain, which began in round 5 with no memory, in b" in str(
        found
    )


def test_children_of_a_child() -> None:
    """The last stage that has begun counts."""
    middle = child("random", seed=3)
    last = what_if(middle, "random", from_round=7, processes=0, max_rounds=10, log=new_path())
    found = diff(middle, last.recording())
    assert found.choice is not None
    assert found.choice.round >= 7
    assert found.choice.causes == ("rule",)
    assert by_rule(found)
    text = " ".join(str(found).split())
    assert "rule is random, which began in round 5 with no memory, in a" in text


@pytest.mark.parametrize("modules", [0, 2])
def test_rules_that_talk_hear_what_was_noted_before(modules: int) -> None:
    """Notes of the round before are heard, and those of some modules go on: as in the run."""
    spec = "agv:graph=grid4x4,n=6"
    parent = origin(spec)
    found = [
        diff(parent, child("tswap", parent=spec, modules=modules)),
        diff(
            child("tswap", seed=7, parent=spec, modules=modules),
            child("tswap", seed=8, parent=spec, modules=modules),
        ),
    ]
    for each in found:
        if each.choice is not None:
            assert by_rule(each)
            assert "record" not in each.choice.causes
    assert any(each.choice is not None for each in found)


def test_notes_that_are_dropped_are_no_choice_of_the_round_before() -> None:
    """The new rule has no notes, so that those of the round before are not said."""
    spec = "agv:graph=grid4x4,n=6"
    parent, other = origin(spec), child("random", parent=spec)
    for found, name in ((diff(parent, other), "b"), (diff(other, parent), "a")):
        assert found.choice is not None
        assert found.choice.round >= FROM
        assert found.choice.causes in (("rule",), ("together",))
        assert found.message is not None
        assert (found.message.round, found.message.kind) == (FROM, "note")
        note = f"{name}: in round 5 nobody says what was noted before, as another rule begins in it"
        assert any(each.startswith(note) for each in found.notes)


def test_ranks_follow_the_seed_of_the_stage() -> None:
    """A claim that came of otherwise is told with the seed from which ranks then followed."""
    parent = recorded("agv:graph=grid5x5,n=8", "tswap", seed=1, rounds=4)
    log = new_path()
    other = what_if(parent, "tswap", from_round=2, seed=4, max_rounds=3, processes=0, log=log)
    found = diff(parent, other.recording())
    assert found.outcome is not None
    assert (found.outcome.round, found.outcome.a, found.outcome.b) == (2, "granted", "lost")
    one, two, last = found.outcome.why
    assert one.startswith("a: module_6 claims")
    assert one.endswith("ranks below it, and is lost")
    assert two.endswith("outranks it, and is granted")
    assert last == "the claims are the same; ranks follow from the seeds, which differ"
