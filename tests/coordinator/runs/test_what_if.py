"""Runs that go on from any round of a recording, with other rules."""

from collections.abc import Callable
from dataclasses import replace as with_fields
from functools import cache
from hashlib import sha256
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings, strategies as st
from msgspec.structs import replace

from cubepath.agents.environments.world import World
from cubepath.agents.rules.actor import actors_for
from cubepath.agents.rules.registry import rule_named
from cubepath.coordinator.auditing.rule_audit import audit
from cubepath.coordinator.runs.continuing import what_if
from cubepath.coordinator.runs.gathering import gathered
from cubepath.coordinator.runs.outcome import Outcome
from cubepath.protocol.core.errors import CheckError, InputError
from cubepath.protocol.core.sites import site_from_json
from cubepath.protocol.recordings.recording import Recording, read_recording
from cubepath.protocol.wire.messages import Go, encode, kind_of
from marked import some
from processes.command_line import GOLDEN
from samples import noting
from samples.recordings import all_edited, edited, first, new_path, parts, recorded
from samples.schedules import VEHICLES, carry_out as carried_out, original

NOTING = f"{noting.__file__}:noting"
OTHER = f"{noting.__file__}:other"
SYSTEMS = (
    "agv:graph=grid4x4,n=7",
    "agv-labelled:graph=grid4x4,n=6",
    "hex:n=5",
    "arm:n=5",
    "sliding:p=2,q=2,n=3",
    "polygon:n=7",
)
CROWD = SYSTEMS[0]


def gone_on(parent: Recording, rule: str, from_round: int, **options: Any) -> Outcome:
    """Go on from a recording, in a new file and in no other process."""
    given: dict[str, Any] = {"processes": 0, "log": new_path(), "rules": (NOTING, OTHER), **options}
    return what_if(parent, rule, from_round=from_round, **given)


def said(recording: Recording, before: int) -> list[set[bytes]]:
    """Return what modules said and reported in the rounds before one, each round a set of bytes."""
    found: list[set[bytes]] = [set() for _ in range(before)]
    for part in parts(recording, "presence", "note", "claim", "verdict", "report"):
        if part.round < before:
            found[part.round].add(encode(part))
    return found


def checked(outcome: Outcome) -> None:
    """Check that all holds of a recording, and that all was checked."""
    found = audit(outcome.log, rules=(NOTING, OTHER))
    assert [(check.name, check.detail) for check in found.checks if not check.ok] == []
    assert all(check.checked for check in found.checks)
    assert found.path_digest == outcome.path_digest


places = given(st.sampled_from(SYSTEMS), st.integers(0, 2), st.integers(1, 9))


def goes_on_as_before(spec: str, seed: int, from_round: int) -> None:
    """Check that a rule without memory makes exactly the path of the parent, begun anywhere."""
    parent = recorded(spec, NOTING, seed=seed, rounds=8)
    outcome = gone_on(parent, NOTING, min(from_round, gathered(parent).rounds))
    assert outcome.path_digest == first(parent, "summary").path_digest


@pytest.mark.thorough
@settings(max_examples=3)
@places
def test_the_rule_on_record_goes_on_as_before(spec: str, seed: int, from_round: int) -> None:
    """A rule without memory, from any round on: its path is exactly that of the parent."""
    goes_on_as_before(spec, seed, from_round)


@pytest.mark.thorough
@settings(max_examples=60)
@places
def test_the_rule_on_record_goes_on_as_before_everywhere(
    spec: str, seed: int, from_round: int
) -> None:
    """The same with many more examples."""
    goes_on_as_before(spec, seed, from_round)


@pytest.mark.thorough
def test_modules_that_hesitated_do_so_again_where_that_is_on_record() -> None:
    """From the round of the rule on their streams begin anew."""
    parent = recorded(CROWD, NOTING, rounds=8, hesitate=0.4)
    again = gone_on(parent, NOTING, 5)
    assert said(again.recording(), 5) == said(parent, 5)
    checked(again)


@pytest.mark.parametrize("spec", some(SYSTEMS, SYSTEMS[:1]))
@pytest.mark.parametrize("rule", ["random", OTHER])
def test_what_was_said_before_is_said_again_byte_by_byte(spec: str, rule: str) -> None:
    """And verification, which asks the rules of both stages, finds nothing else."""
    parent = recorded(spec, NOTING, seed=1, rounds=8)
    outcome = gone_on(parent, rule, 4, seed=5)
    child = outcome.recording()
    assert said(child, 4) == said(parent, 4)
    assert len(said(child, 4)[3]) > len(parent.scene.start)
    heard = {encode(note) for note in parts(child, "note") if note.round == 4}
    on_record = {encode(note) for note in parts(parent, "note") if note.round == 4}
    assert heard == (on_record if rule == OTHER else set())
    checked(outcome)


@pytest.mark.thorough
@settings(max_examples=3)
@given(st.sampled_from(SYSTEMS[:4]), st.integers(1, 6), st.integers(0, 3))
def test_the_rounds_of_the_rule_are_those_of_the_environment(
    spec: str, from_round: int, seed: int
) -> None:
    """Begun where the modules stood then, with new streams, in one process without messages."""
    parent = recorded(spec, NOTING, seed=1, rounds=6)
    steps = gathered(parent).steps[: from_round - 1]
    outcome = gone_on(parent, "random", from_round, seed=seed, max_rounds=from_round + 4)
    scene = parent.scene
    world = World(scene, seed=seed, note_length=0)
    for step in steps:  # the round counts, since ranks follow from it
        moves = {move.module: move for move in step.executed}
        world.step(
            {
                module: _action(world, module, move.generator, move.at)
                for module, move in moves.items()
            },
            {},
        )
    actors = actors_for(
        scene,
        rule_named("random", scene.system),
        seed=seed,
        hesitate=0.0,
        sites=dict(enumerate(world.sites)),
    )
    for step in outcome.steps[from_round - 1 :]:
        choices = {n: actor.act(world.observe(n)).action for n, actor in actors.items()}
        made = world.step(choices, {}).moves
        assert sorted(made) == [move.module for move in step.executed]
    assert tuple(world.sites) == tuple(outcome.gathered.sites)


def _action(world: World, module: int, generator: str, at: Any) -> int:
    moves = world.scene.system.moves(world.sites[module])
    place = site_from_json(at)
    return 1 + next(
        n
        for n, move in enumerate(moves)
        if move is not None and (move.generator, move.at) == (generator, place)
    )


@pytest.mark.thorough
@pytest.mark.parametrize("rule", ["tswap", "random"])
def test_the_digest_does_not_depend_on_processes(rule: str) -> None:
    """The same command gives the same path, in a thread and in processes."""
    parent = recorded(CROWD, "tswap", rounds=10)
    once, again, spread = (
        gone_on(parent, rule, 4, seed=2, max_rounds=12, processes=processes)
        for processes in (0, 0, 2)
    )
    assert once.path_digest == again.path_digest == spread.path_digest
    checked(spread)


@pytest.mark.thorough
def test_another_seed_is_another_continuation() -> None:
    """Of a rule that draws, and of one that does not but whose claims are ranked."""
    for rule in ("random", NOTING):
        parent = recorded(CROWD, NOTING, seed=3, rounds=8)
        found = {gone_on(parent, rule, 3, seed=seed).path_digest for seed in (0, 1)}
        assert len(found) > 1, rule


def test_some_modules_take_the_rule_and_the_others_begin_anew() -> None:
    """Those that are named; the others hear them as before, and all of it is verified."""
    parent = recorded(CROWD, NOTING, seed=1, rounds=8)
    some = gone_on(parent, OTHER, 3, modules=[0, 2, 3])
    checked(some)
    stages = some.recording().parameters["stages"]
    assert f'"{OTHER}":"0,2-3","{NOTING}":"1,4-6"' in stages
    every = gone_on(parent, OTHER, 3)
    none = gone_on(parent, NOTING, 3)
    assert len({some.path_digest, every.path_digest, none.path_digest}) == 3
    with pytest.raises(InputError, match=r"note as many numbers, found .*noting 2, random 0$"):
        gone_on(parent, "random", 3, modules=[0])


@pytest.mark.thorough
def test_a_what_if_can_be_gone_on_from() -> None:
    """Before its round, at it and after it; the rules of all stages are asked again."""
    parent = recorded(CROWD, NOTING, seed=1, rounds=8)
    child = gone_on(parent, OTHER, 4, seed=2).recording()
    for from_round in (2, 4, 6):
        outcome = gone_on(child, NOTING, from_round, seed=3)
        checked(outcome)
        assert said(outcome.recording(), from_round) == said(child, from_round)
    silent = gone_on(parent, "random", 4).recording()
    checked(gone_on(silent, NOTING, 4))
    with pytest.raises(InputError, match=r"in round 4 of .* other rules took over"):
        gone_on(silent, NOTING, 5)


def test_the_parent_is_named() -> None:
    """By the name of its file, the checksum of its bytes, the digest of its path, the round."""
    outcome = gone_on(read_recording(GOLDEN / "agv-6.mcap"), "random", 5, max_rounds=6)
    told = outcome.recording().parameters
    assert (told["rule"], told["what_if"], told["from_round"]) == ("recorded", "random", "5")
    assert told["parent"] == "agv-6.mcap"
    assert told["parent_sha256"] == sha256((GOLDEN / "agv-6.mcap").read_bytes()).hexdigest()
    assert told["parent_path_digest"] == gathered(read_recording(GOLDEN / "agv-6.mcap")).digest
    checked(outcome)


@pytest.mark.thorough
def test_it_begins_anywhere_from_the_start_to_the_end() -> None:
    """In round 1 nothing is taken; after the last round on record nothing was noted."""
    parent = recorded(CROWD, NOTING, rounds=5)
    assert gone_on(parent, NOTING, 1).path_digest == first(parent, "summary").path_digest
    after = gone_on(parent, NOTING, 6, max_rounds=8)
    assert (after.rounds, after.ended) == (8, "max-rounds")
    assert not [note for note in parts(after.recording(), "note") if note.round == 6]
    checked(after)
    for wrong in (0, 7):
        with pytest.raises(
            InputError, match=f"round {wrong}: .* has 5 whole rounds, expected 1 to"
        ):
            gone_on(parent, NOTING, wrong)
    with pytest.raises(InputError, match="max-rounds=3: expected 4 or more"):
        gone_on(parent, NOTING, 4, max_rounds=3)


@pytest.mark.thorough
def test_it_ends_where_the_parent_had_to_or_a_thousand_rounds_later() -> None:
    """If the rule takes over where the parent had to end, it has rounds of its own."""
    parent = recorded("agv:graph=grid3x2,n=2", "random", rounds=5)
    assert gone_on(parent, "random", 5).recording().parameters["max_rounds"] == "5"
    assert gone_on(parent, "tswap", 6).recording().parameters["max_rounds"] == "1005"


def test_a_recording_that_was_cut_off_goes_on(tmp_path: Path) -> None:
    """As far as whole rounds go, whatever was said of the next one."""
    whole = (GOLDEN / "agv-6.mcap").read_bytes()
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(whole[: len(whole) // 3])
    parent = read_recording(cut)
    rounds = gathered(parent).rounds
    assert 2 < rounds < 20
    outcome = gone_on(parent, "pibt", rounds + 1, max_rounds=rounds + 5)
    checked(outcome)
    assert outcome.rounds == rounds + 5
    with pytest.raises(InputError, match=f"has {rounds} whole rounds, expected 1 to {rounds + 1}"):
        gone_on(parent, "pibt", rounds + 2)


def test_what_is_missing_ends_the_whole_rounds() -> None:
    """A claim that was lost, or a note that was heard, which are not on record."""
    parent = recorded(CROWD, "tswap", rounds=10)
    lost = first(parent, "report", lambda report: report.claim == "lost" and report.round > 2)
    claim = first(
        parent, "claim", lambda each: (each.round, each.module) == (lost.round, lost.module)
    )
    note = first(parent, "note", lambda each: each.round == 4)
    for message in (claim, note):
        with pytest.raises(InputError, match=f"has {message.round - 1} whole rounds"):
            gone_on(edited(parent, message), "tswap", 10)


def test_where_a_module_gave_up_its_round_is_the_last_to_begin_in() -> None:
    """The run ended there, so nothing goes on after it."""
    child = gone_on(recorded("hex:n=5", "chain", rounds=8), "chain", 5).recording()
    assert first(child, "summary").ended == "failed"
    last = first(child, "summary").rounds
    with pytest.raises(InputError, match=f"in round {last} a module gave up, expected 1 to {last}"):
        gone_on(child, "random", last + 1)


@cache
def _forged(what: str) -> Recording:
    parent = recorded(CROWD, "random", rounds=8)
    granted = first(
        parent, "report", lambda report: report.claim == "granted" and report.round == 3
    )
    claim = first(parent, "claim", lambda each: (each.round, each.module) == (3, granted.module))
    if what == "claim":
        return edited(parent, claim, replace(claim, generator="another"))
    report = replace(granted, claim="lost", move=None, site=granted.before)
    kept = all_edited(parent, "report", lambda each: each if each.round < 4 else None)
    return edited(kept, granted, report)


def test_a_forged_parent_is_refused() -> None:
    """A claim that is not what is reported, and reports that do not follow from the claims."""
    with pytest.raises(InputError, match=r"round 3, module_.: it claims another"):
        gone_on(_forged("claim"), "random", 5)
    with pytest.raises(CheckError, match="round 3: its claims lead to other moves than"):
        gone_on(_forged("report"), "random", 4)


@pytest.mark.parametrize(
    ("parent", "why"),
    [
        (lambda: read_recording(GOLDEN / "hex-free-5.mcap"), "a run without rounds"),
        (lambda: carried_out(original(*VEHICLES).path)[1], "carry out a schedule"),
        (lambda: _without("rule"), "names no rule"),
        (lambda: _without("seed"), "names no seed"),
        (lambda: _without("hesitate"), "names no hesitate"),
        (lambda: _without("stages", gone_on(_parent(), "random", 3).recording()), "names no rule"),
    ],
)
def test_what_cannot_be_gone_on_from_is_refused(parent: Callable[[], Recording], why: str) -> None:
    """In one line that says why."""
    with pytest.raises(InputError, match=why) as found:
        gone_on(parent(), "random", 2)
    assert "\n" not in str(found.value)


def _parent() -> Recording:
    return recorded(CROWD, "random", rounds=8)


def _without(key: str, recording: Recording | None = None) -> Recording:
    parent = _parent() if recording is None else recording
    parameters = {name: value for name, value in parent.parameters.items() if name != key}
    return with_fields(parent, parameters=parameters)


@pytest.mark.parametrize(
    ("options", "why"),
    [
        ({"modules": [7]}, "modules=7: no such module, .* has 0-6"),
        ({"modules": []}, "modules: none named"),
        ({"seed": -1}, "seed=-1: expected 0 or more"),
        ({"max_rounds": 2}, "max-rounds=2: expected 3 or more"),
    ],
)
def test_what_cannot_be_asked_for_is_refused(options: dict[str, Any], why: str) -> None:
    """Before anything is started or written."""
    with pytest.raises(InputError, match=why):
        gone_on(_parent(), "random", 3, **options)


def test_it_is_paced_as_a_schedule_that_is_over() -> None:
    """The coordinator says once that the record is over, after the last round of it."""
    child = gone_on(_parent(), "random", 4).recording()
    over = [part for part in parts(child, "go") if isinstance(part, Go) and part.phase == "over"]
    assert [(kind_of(each), each.round) for each in over] == [("go", 3)]
