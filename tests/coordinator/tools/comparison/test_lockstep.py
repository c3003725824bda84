"""Two runs with rounds: where they part is named as by decoding everything and sorting it."""

from dataclasses import replace
from typing import Any

import pytest
from hypothesis import assume, given, settings, strategies as st
from msgspec.structs import replace as with_fields

from cubepath.agents.rules.registry import BUILT_IN
from cubepath.agents.rules.uniform import RANDOM
from cubepath.coordinator.tools.comparison.results import RunComparison
from cubepath.coordinator.tools.comparison.run_comparison import diff
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.sites import site_from_json, site_text
from cubepath.protocol.recordings.recording import Recording
from samples.recordings import edited, first, parts, recorded, with_records
from samples.twin_runs import (
    Deviation,
    deviating,
    everything,
    first_choices,
    first_other,
    kind_at,
    shuffled,
    standing,
    twin,
)

SPECS = ("hex:n=5", "agv:graph=grid4x4,n=6", "agv-labelled:graph=K5,n=3", "arm:n=4")
RULES = {"agv:graph=grid4x4,n=6": ("random", "tswap")}
specs = st.sampled_from(SPECS)


def check_place(found: RunComparison, a: Recording, b: Recording) -> None:
    """Compare what differs first with the obvious way."""
    place = first_other(a, b)
    assert found.same == (place is None)
    if place is None:
        assert found.message is None
        assert found.choice is None
        return
    assert found.message is not None
    told = found.message.round, found.message.kind, found.message.module
    assert told == (place[0], kind_at(place), None if place[2] < 0 else place[2])
    one, two = everything(a).get(place), everything(b).get(place)
    assert (found.message.a is None, found.message.b is None) == (one is None, two is None)
    choices = first_choices(a, b)
    assert (found.choice is None) == (choices is None)
    if choices is not None and found.choice is not None:
        assert found.choice.round == choices[0]
        assert sorted([found.choice.module, *found.choice.also]) == choices[1]


def check_inputs(found: RunComparison, a: Recording, b: Recording) -> None:
    """Check what is told of the inputs of the first other choice against what modules said."""
    choice = found.choice
    assert choice is not None
    for side, run in ((choice.a, a), (choice.b, b)):
        there = standing(run, choice.round)
        own = next(site for site, module in there.items() if module == choice.module)
        assert side.site == site_text(own)
        place_of = run.scene.system.place_of
        by_place = {site_text(place_of(site)): module for site, module in there.items()}
        near = [each for each in run.scene.system.sensed(place_of(own)) if each is not None]
        assert sorted(side.sensed) == sorted({site_text(each) for each in near})
        for place, what in side.sensed.items():
            told = f"module_{by_place[place]}" if place in by_place else None
            assert (told is None) == (not what.startswith("module_"))
            assert told is None or what.split()[0] == told
        heard = {
            module
            for (number, _, module), fields in everything(run).items()
            for message in [fields]
            if number == choice.round and isinstance(message, dict) and message["kind"] == "note"
        }
        reach = set(run.scene.system.reach(place_of(own)))
        due = {m for site, m in there.items() if m in heard and place_of(site) in reach}
        assert {int(who.split()[0][7:]) for who in side.received} == due


@settings(max_examples=20)
@given(specs, st.integers(0, 9), st.integers(0, 5), st.integers(1, 6), st.booleans())
def test_a_deviation_is_named_and_nothing_else(
    spec: str, seed: int, module: int, number: int, reverse: bool
) -> None:
    """The module and the round at which a rule once did something else, from either side."""
    rule = RULES.get(spec, ("random",))[seed % len(RULES.get(spec, ("random",)))]
    a = twin(spec, rule, seed=seed)
    assume(module < len(a.scene.start))
    b = twin(spec, rule, seed=seed, deviation=Deviation(module, number))
    assume(first_other(a, b) is not None)
    if reverse:
        a, b = b, a
    found = diff(a, b)
    assert found.choice is not None
    assert (found.choice.round, found.choice.module, found.choice.also) == (number, module, ())
    assert found.choice.causes == ("record",)  # one of them is not what the installed rule does
    assert found.choice.a.sensed == found.choice.b.sensed
    check_place(found, a, b)
    check_inputs(found, a, b)
    assert found.outcome is None or found.outcome.round >= number


@settings(max_examples=12)
@given(specs, st.integers(0, 5), st.integers(0, 5))
def test_seeds_part_where_everything_sorted_does(spec: str, one: int, two: int) -> None:
    """The first message and choice, with inputs as modules told them; both ways the same place."""
    rule = RULES.get(spec, ("random",))[-1]
    a, b = twin(spec, rule, seed=one), twin(spec, rule, seed=two)
    found, back = diff(a, b), diff(b, a)
    check_place(found, a, b)
    assert found.parameters == ({} if one == two else {"seed": (str(one), str(two))})
    if found.choice is None or back.choice is None:
        assert found.choice == back.choice
        return
    check_inputs(found, a, b)
    assert (found.choice.round, found.choice.module) == (back.choice.round, back.choice.module)
    assert found.choice.a == back.choice.b
    assert found.states == back.states
    assert [(at, b, a, both) for at, a, b, both in found.rounds] == list(back.rounds)
    same = found.choice.a.sensed == found.choice.b.sensed
    assert same or {"inputs", "together"} & {*found.choice.causes}


@given(st.integers(0, 3), st.lists(st.floats(0, 1), min_size=5, max_size=9))
@settings(max_examples=10)
def test_arrival_is_no_difference(seed: int, order: list[float]) -> None:
    """Whatever the order of arrival in a round."""
    a = twin("agv:graph=grid4x4,n=6", "tswap", seed=seed)
    b = shuffled(twin("agv:graph=grid4x4,n=6", "tswap", seed=seed), order)
    found = diff(a, b)
    assert found.same
    assert found.paths is not None
    assert found.paths.identical


@pytest.mark.thorough
def test_processes_are_no_difference() -> None:
    """The same seed in one process and in three is the same run, whoever reports first."""
    a, b = (recorded("agv:graph=grid4x4,n=6", seed=3, processes=n, rounds=5) for n in (0, 3))
    found = diff(a, b)
    assert found.same
    assert found.parameters == {"processes": ("0", "3")}
    assert "the same run" in str(found)


def test_what_was_drawn_is_the_cause_of_another_seed() -> None:
    """The same in, another number out: and that number is told."""
    found = diff(twin("hex:n=5", seed=1), twin("hex:n=5", seed=2))
    assert found.choice is not None
    assert found.choice.causes == ("seed",)
    assert found.choice.a.sensed == found.choice.b.sensed
    assert found.choice.a.drew != found.choice.b.drew
    assert found.choice.a.by_rule == found.choice.a.chose != found.choice.b.chose
    assert "it sensed and heard the same in both, in this round and all before" in str(found)


def test_a_rank_is_the_cause_of_another_outcome() -> None:
    """Claims that are the same come of otherwise by ranks; who then senses what is told."""
    spec = "agv:graph=grid5x5,n=8"
    found = diff(twin(spec, "tswap", seed=1), twin(spec, "tswap", seed=4))
    assert found.outcome is not None
    assert found.choice is not None
    assert found.outcome.round < found.choice.round
    assert {found.outcome.a, found.outcome.b} == {"granted", "lost"}
    assert found.outcome.why[-1] == (
        "the claims are the same; ranks follow from the seeds, which differ"
    )
    assert found.choice.causes == ("inputs",)
    assert any("since round 2" in line for line in found.choice.why)
    assert f"they part in round {found.outcome.round}, with the claim" in str(found)


def test_another_rule_is_the_cause_where_seeds_differ_too(monkeypatch: pytest.MonkeyPatch) -> None:
    """With two things that differ, each is tried alone."""
    rule = "other"
    monkeypatch.setitem(BUILT_IN, rule, deviating(RANDOM, Deviation(2, 3)))
    spec = "agv:graph=grid4x4,n=6"
    a, b = twin(spec), twin(spec, deviation=Deviation(2, 3), named=rule)
    found = diff(a, b)
    assert found.choice is not None
    assert (found.choice.round, found.choice.module) == (3, 2)
    assert found.choice.causes == ("rule",)
    other = replace(b, parameters={**b.parameters, "hesitate": "0.0001"})
    found = diff(a, other)
    assert found.choice is not None
    assert found.choice.causes == ("rule",)
    assert "with the rule of b alone it would choose in a what it chose in b" in str(found)


def test_hesitation_is_told() -> None:
    """A module that hesitates drew less than its hesitate."""
    a, b = (twin("hex:n=5", "chain", hesitate=h, rounds=9) for h in (0.0, 0.4))
    found = diff(a, b)
    assert found.choice is not None
    assert found.choice.causes == ("hesitate",)
    assert found.choice.b.doubt is not None
    assert found.choice.b.doubt < 0.4
    assert found.choice.a.doubt is None
    assert "b hesitates" in str(found)


def test_a_rule_that_is_not_installed_gives_all_but_draws() -> None:
    """And it is said; no cause is told but the only thing that differs."""
    a, b = (twin("hex:n=5", seed=seed, named="nobodys") for seed in (1, 2))
    found = diff(a, b)
    assert found.choice is not None
    assert found.choice.a.drew is None
    assert found.choice.a.sensed
    assert found.choice.causes == ("seed",)
    assert "what it drew is not known: unknown rule 'nobodys'" in str(found)


FORGED: dict[str, Any] = {
    "claim": lambda told: with_fields(told, generator="another"),
    "presence": lambda told: with_fields(told, site=[99, 99]),
    "verdict": lambda told: with_fields(told, granted=not told.granted),
    "report": lambda told: with_fields(told, received={}),
    "edges": lambda told: with_fields(told, moves=[]),
    "note": lambda told: with_fields(told, note=[0] * len(told.note)),
}


@pytest.mark.parametrize("kind", FORGED)
def test_a_forged_message_is_named(kind: str) -> None:
    """Any kind, in the third round, by its fields."""
    a = twin("agv:graph=grid4x4,n=6", "tswap", seed=1)
    old = first(a, kind, lambda told: told.round >= 2 and FORGED[kind](told) != told)
    b = edited(a, old, FORGED[kind](old))
    found = diff(a, b)
    assert not found.same
    check_place(found, a, b)
    if kind == "claim":
        assert found.choice is not None
        assert found.choice.causes == ("record",)


def test_a_message_that_comes_twice_and_differs_is_told() -> None:
    """The first is compared; that there is another is a difference."""
    a = twin("hex:n=5")
    claim = first(a, "claim")
    b = edited(a, claim, claim, with_fields(claim, generator="another"))
    found = diff(a, b)
    assert not found.same
    assert "comes twice, and differs" in str(found)


def test_what_is_cut_off_is_compared_as_far_as_it_goes() -> None:
    """Rounds that one run alone has are a difference, unless they are not asked for."""
    a = twin("hex:n=5")
    b = with_records(a, [each for each in a.records if each.round <= 4])
    found = diff(a, b)
    assert not found.same
    assert found.message is None
    assert "a continues for 2 more rounds, which b lacks; they were not compared" in found.notes
    assert found.answer == "b is the beginning of a: the same in rounds 1 to 4, and then b ends"
    assert (found.beginning, diff(b, a).beginning) == ("b", "a")
    part = diff(a, b, rounds=(1, 4))
    assert part.same
    assert part.answer == "the same in rounds 1 to 4"
    assert found.compared == "rounds 1 to 4"
    assert found.paths == part.paths


def test_rounds_that_are_not_asked_for_are_not_compared() -> None:
    """The first difference within them is told."""
    a, b = twin("hex:n=5", seed=1), twin("hex:n=5", seed=2)
    found = diff(a, b, rounds=(4, 5))
    assert found.message is not None
    assert found.message.round == 4
    with pytest.raises(InputError, match="expected 1 or more"):
        diff(a, b, rounds=(0, 5))


def test_scenes_that_differ_are_told() -> None:
    """And what can still be compared is: the first other choice of a module of both."""
    found = diff(twin("agv:graph=grid4x4,n=6"), twin("agv:graph=grid4x4,n=5"))
    assert found.scene == "the numbers of modules differ: 6, 5"
    assert found.states[0].begin == 0


def test_states_that_meet_again_are_told() -> None:
    """From the end of which round to that of which they differ, by the obvious way."""
    a, b = (twin("hex:n=5", "chain", hesitate=0.3, seed=s, rounds=40) for s in (1, 2))
    found = diff(a, b)
    at = [_states(each) for each in (a, b)]
    last = min(len(each) for each in at)  # a run that is over has no states any more
    apart = [number for number in range(last) if at[0][number] != at[1][number]]
    told = {
        number
        for each in found.states
        for number in range(each.begin, last if each.end is None else each.end)
    }
    assert told == set(apart)
    assert found.paths is not None
    assert found.paths.same is None
    assert not found.paths.identical


def _states(recording: Recording) -> list[set[str]]:
    rounds: dict[int, set[str]] = {0: {site_text(site) for site in recording.scene.start}}
    for report in parts(recording, "report"):
        rounds.setdefault(report.round, set()).add(site_text(site_from_json(report.site)))
    return [rounds[number] for number in sorted(rounds)]
