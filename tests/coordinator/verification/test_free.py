"""Runs without rounds are derived again, and what was changed in a recording is found."""

import json
import tracemalloc
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from random import Random
from typing import Any

import pytest
from msgspec import structs

from changed_values import put
from counted_lines import lines_of
from cubepath.coordinator.runs.gathering import gathered
from cubepath.coordinator.verification.findings import Verification
from cubepath.coordinator.verification.free import FREE_CHECKS
from cubepath.coordinator.verification.recording import verify
from cubepath.coordinator.verification.recovery import recover
from cubepath.protocol.recordings.recording import Recording, read_recording
from cubepath.protocol.recordings.stored_messages import Record
from cubepath.protocol.wire.free_messages import Commit, FreeMessage, Turns, decode_free
from samples.free_numbers import numbered
from samples.free_runs import asked, free_recorded, free_run, results, write
from samples.recordings import new_path

SPECS = (
    "agv:graph=grid6x6,n=6",
    "hex:n=7",
    "agv-labelled:graph=grid6x6,n=4",
    "sliding:p=3,q=2,n=4",
    "arm:n=5",
    "words:presentation=free2",
    "triangulation:n=8",
)


def failing(found: Verification) -> set[str]:
    """Return the checks that fail."""
    return {check.name for check in found.checks if not check.ok}


def with_document(recording: Recording, place: int, document: object) -> Recording:
    """Return the recording with another message at a place."""
    data = json.dumps(document, separators=(",", ":")).encode()
    records = list(recording.records)
    records[place] = replace(records[place], data=data)
    return replace(recording, records=tuple(records))


def leaves(value: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[tuple[Any, ...], Any]]:
    """Yield each single value of a document with where it stands."""
    if isinstance(value, dict | list):
        named = value.items() if isinstance(value, dict) else enumerate(value)
        for key, each in named:
            yield from leaves(each, (*path, key))
    else:
        yield path, value


def other(value: Any) -> Any:
    """Return another value of the same form."""
    if isinstance(value, bool):
        return not value
    return {int: lambda: value + 1, str: lambda: value + "x"}.get(type(value), lambda: 1)()


@pytest.mark.few(3)
@pytest.mark.slow
@pytest.mark.parametrize("spec", SPECS)
@pytest.mark.parametrize("seed", [0, pytest.param(1, marks=pytest.mark.thorough)])
def test_a_run_of_keepers_passes_every_check(spec: str, seed: int) -> None:
    """With messages late and doubled, processes that begin anew, registers and exchanges."""
    recording = free_recorded(spec, seed=seed, restarts=2)
    found = asked(recording)
    assert failing(found) == set()
    assert [check.name for check in found.checks] == list(FREE_CHECKS)
    assert all(check.checked for check in found.checks)
    whole = gathered(recording)
    assert (found.complete, found.path_digest, found.rounds) == (True, whole.digest, whole.rounds)
    assert (found.moves, found.cubes) == (whole.heap.moves, whole.heap.cubes)


def test_a_process_that_was_replaced_may_see_more_than_its_successor_did(tmp_path: Path) -> None:
    """It wakes, and chooses in its old epoch at a later version; the successor begins no earlier
    than it entered."""
    scene, messages = free_run("agv:graph=grid6x6,n=6", restarts=1)
    turns = [part for message in messages if isinstance(message, Turns) for part in message.parts]
    last = next(turn for turn in reversed(turns) if turn.epoch > 1)
    own = [turn for turn in turns if turn.module == last.module]
    early, *_, before = [turn for turn in own if turn.epoch == 1]
    assert early.version < before.version < last.version

    def why(messages: Sequence[FreeMessage]) -> str:
        whole = [*numbered(messages), *results(scene, messages, 3)]
        found = verify(read_recording(write(new_path(), scene, whole)))
        return next((check.detail for check in found.checks if check.name == "turns"), "")

    late = structs.replace(last, epoch=1, turn=before.turn + 1, number=last.number and 99)
    assert not why([*messages, Turns(last.module % 2, [late])])
    first = next(turn for turn in own if turn.epoch > 1)
    earlier = Turns(last.module % 2, [structs.replace(early, epoch=first.epoch, turn=1)])
    forged = [
        earlier if isinstance(each, Turns) and each.parts == [first] else each for each in messages
    ]
    assert why(forged).endswith(f"in epoch {first.epoch}: it never entered so")


NOT_PROVED = {
    # A question that changes nothing could have been another, and so could a reason.
    "requests: keeper",
    "requests: parts module",
    "requests: parts incarnation",
    "requests: parts tile",
    "requests: parts serial",
    "replies: parts reason",
    "forwards: parts reason",
    # A refusal, or what is acknowledged, could be that of another attempt with the same outcome.
    "replies: parts number",
    "forwards: parts epoch",
    "forwards: parts number",
    # Two versions of a place look alike.
    "turns: parts sensed",
    "turns: parts received",
    # A number that nothing else tells.
    "tile: serial",
    "tile: whole",
    "commits: prepared",
    "commits: refused",
    # A message with another number is one that is missing, and as many as were said in its
    # incarnation.
    *(
        f"{kind}: incarnation"
        for kind in ("requests", "forwards", "replies", "tile", "turns", "halted", "commits")
    ),
    # So is one that now has the number of the next one, which says the same.
    *(
        f"{kind}: sequence"
        for kind in ("requests", "forwards", "replies", "tile", "turns", "halted", "commits")
    ),
}


def is_found(recording: Recording, number: int, step: int) -> Iterator[str]:
    """Yield what is not found of every `step`-th change of a single value."""
    for place, record in enumerate(recording.records):
        document = json.loads(record.data)
        for leaf, (path, value) in enumerate(leaves(document)):
            if (place + leaf) % step == number:
                changed = with_document(recording, place, put(document, path, other(value)))
                if asked(changed).ok:
                    yield f"{record.kind}: {' '.join(key for key in path if isinstance(key, str))}"


@pytest.mark.slow
@pytest.mark.parametrize(
    "spec", ["agv:graph=grid6x3,n=3", pytest.param("hex:n=3", marks=pytest.mark.thorough)]
)
def test_a_single_value_that_was_changed_is_found(spec: str) -> None:
    """Whatever it is, but for what a recording does not prove."""
    recording = free_recorded(spec, moves=4, keepers=2, restarts=1)
    assert set(is_found(recording, 3, 17)) <= NOT_PROVED


@pytest.mark.nightly
@pytest.mark.timeout(400)
@pytest.mark.parametrize("spec", ["agv:graph=grid6x3,n=3", "hex:n=3"])
def test_in_a_longer_run_a_single_value_that_was_changed_is_found(spec: str) -> None:
    """A twelfth of all values."""
    # In shorter ones some epochs are told once only.
    recording = free_recorded(spec, moves=6, keepers=2, restarts=1)
    assert set(is_found(recording, 5, 12)) <= NOT_PROVED


def first_move(recording: Recording, where: Any = lambda _: True) -> tuple[int, Any]:
    """Return the place of the first move of which `where` holds, and its document."""
    for place, record in enumerate(recording.records):
        if record.kind == "commit":
            document = json.loads(record.data)
            if "generator" in document and where(document):
                return place, document
    raise AssertionError("no such move")


def every_moved(recording: Recording, old: Any, new: Any) -> Recording:
    """Return the recording with a commit changed wherever it is told."""
    before, after = (json.dumps(each, separators=(",", ":")).encode() for each in (old, new))
    records: list[Record] = []
    for record in recording.records:
        data = record.data.replace(before, after)
        if record.kind == "commit" and data == before:
            data = after
        records.append(replace(record, data=data))
    return replace(recording, records=tuple(records))


@pytest.mark.few(4)
@pytest.mark.parametrize(
    ("check", "change"),
    [
        ("levels", lambda moved: moved | {"level": moved["level"] + 1}),
        ("levels", lambda moved: moved | {"level": 1 << 40}),
        ("serials", lambda moved: moved | {"serial": moved["serial"] + 100}),
        ("attempts", lambda moved: moved | {"number": moved["number"] + 100}),
        ("sites", lambda moved: moved | {"motion": [[*moved["motion"][0][:2], [9, 9], 1]]}),
        ("versions", lambda moved: moved | {"read": [[u, v + 9] for u, v in moved["read"]]}),
        (
            "readers",
            lambda moved: moved | {"written": [[u, v, r + 1] for u, v, r in moved["written"]]},
        ),
        ("units", lambda moved: moved | {"read": moved["read"][1:]}),
        ("attempts", lambda moved: moved | {"turn": moved["turn"] + 1}),
    ],
)
def test_a_commit_that_was_changed_wherever_it_is_told_is_found(check: str, change: Any) -> None:
    """Keepers that agree on what cannot be are found, by the check that is for it."""
    recording = free_recorded("hex:n=7", moves=12)
    _, old = first_move(recording, lambda moved: moved.get("read"))
    assert check in failing(asked(every_moved(recording, old, change(old))))


def test_a_guard_that_did_not_hold_is_found() -> None:
    """What was sensed is compared with what was there at the version of the commit."""
    recording = free_recorded("hex:n=7", moves=40)
    _, old = first_move(recording, lambda moved: moved.get("guarded"))
    changed = old | {"guarded": [[unit, version + 1] for unit, version in old["guarded"]]}
    assert failing(asked(every_moved(recording, old, changed))) & {"versions", "attempts", "order"}


def test_commits_that_come_each_before_the_other_are_found() -> None:
    """Two guards that each held before the other's move: no order of the two is possible."""
    recording = free_recorded("agv:graph=grid6x6,n=6", moves=20)
    moves = [
        json.loads(record.data)
        for record in recording.records
        if record.kind == "commit" and b'"generator"' in record.data
    ]
    one, two = (
        moves[0],
        next(
            each
            for each in moves[1:]
            if each["keeper"] != moves[0]["keeper"] and each["level"] == 1
        ),
    )
    changed = every_moved(recording, one, one | {"guarded": [two["written"][0][:2]]})
    changed = every_moved(changed, two, two | {"guarded": [one["written"][0][:2]]})
    assert "order" in failing(asked(changed))


def test_another_choice_than_the_rule_makes_is_found() -> None:
    """A turn in which nothing was attempted has only the rule to tell."""
    recording = free_recorded("hex:n=7")
    for place, record in enumerate(recording.records):
        document = json.loads(record.data)
        if record.kind == "turns" and "number" not in document["parts"][0]:
            document["parts"][0]["heeds"] = [[0, 0]]
            found = asked(with_document(recording, place, document))
            assert "choices" in failing(found)
            return
    raise AssertionError("no such turn")


def test_a_rule_that_is_not_installed_is_not_asked() -> None:
    """The check is marked, and does not fail."""
    recording = free_recorded("hex:n=7")
    found = asked(replace(recording, parameters={**recording.parameters, "rule": "unheard-of"}))
    (choices,) = [check for check in found.checks if check.name == "choices"]
    assert (choices.ok, choices.checked, found.ok) == (True, False, True)
    assert not next(c for c in verify(recording).checks if c.name == "choices").checked


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("clock", "lockstep"),
        *(("keepers", each) for each in ("none", "0", "257", "9" * 20)),
        ("log_time", "noon"),
        ("on_crash", "never"),
        *(("jitter", each) for each in ("-1", "nan", "x")),
        *(("speeds", each) for each in ("9=1", "0=0", "0", "0=1,x=2")),
        ("wait_for", "1"),
    ],
)
def test_parameters_of_the_clock_are_checked(key: str, value: str) -> None:
    """The format says which clock there was."""
    recording = free_recorded("hex:n=7")
    changed = replace(recording, parameters={**recording.parameters, key: value})
    assert "parameters" in failing(verify(changed))


def test_a_lockstep_recording_says_so() -> None:
    """A recording of rounds with the clock of another run is found."""
    golden = read_recording(Path(__file__).parents[3] / "logs" / "golden" / "hex-5.mcap")
    changed = replace(golden, parameters={**golden.parameters, "clock": "free"})
    assert failing(verify(changed)) == {"parameters"}


@pytest.mark.slow
def test_what_is_recovered_of_a_cut_recording_is_right_as_far_as_it_goes(tmp_path: Path) -> None:
    """Nothing fails but that its end is missing, which a recovered one says itself."""
    whole = free_recorded("hex:n=7", moves=60)
    cut = tmp_path / "cut.mcap"
    data = whole.path.read_bytes()
    cut.write_bytes(data[: len(data) // 2])
    damaged = read_recording(cut)
    assert {"readable", "complete"} <= failing(asked(damaged))
    saved = recover(damaged, tmp_path / "saved.mcap")
    found = asked(read_recording(saved.out))
    assert failing(found) == set()
    assert not found.complete
    assert 0 < found.rounds == saved.rounds


def test_a_log_by_wall_time_is_checked_by_it(tmp_path: Path) -> None:
    """Both ways of keeping log time pass; a log time of neither is found."""
    scene, messages = free_run("agv:graph=grid6x6,n=6", moves=10)
    said = numbered(messages)
    recording = read_recording(write(tmp_path / "a.mcap", scene, said, wall=True))
    assert failing(asked(recording)) == {"complete"}
    told = replace(recording, parameters={**recording.parameters, "log_time": "level"})
    assert "messages" in failing(asked(told))


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3))
def test_messages_may_stand_in_any_order(tmp_path: Path, seed: int) -> None:
    """Commits before what was asked, turns before those that they follow: the outcome is equal."""
    scene, messages = free_run("hex:n=5", moves=10, restarts=1)
    whole = [*numbered(messages), *results(scene, messages, 3)]
    recording = read_recording(write(tmp_path / "a.mcap", scene, whole, wall=True))
    found = asked(recording)
    assert found.ok
    records = Random(seed).sample(list(recording.records), len(recording.records))  # noqa: S311
    mixed = tuple(replace(each, sequence=number) for number, each in enumerate(records))
    again = asked(replace(recording, records=mixed))
    # Cubes and the certificate name the greatest level before them.
    assert failing(again) <= {"messages"}
    assert replace(again, ok=True, checks=()) == replace(found, checks=())


def test_a_missing_commit_is_found_by_its_number() -> None:
    """A commit that is nowhere on record leaves a gap, and readers that are not counted."""
    recording = free_recorded("hex:n=7", moves=30)
    lost = next(
        each
        for record in recording.records
        if record.kind == "commit" and isinstance(each := decode_free(record.data), Commit)
    )
    kept = tuple(
        record
        for record in recording.records
        if record.kind not in {"commit", "commits"} or decode_free(record.data) != lost
        if record.kind != "commits"
    )
    found = asked(replace(recording, records=kept))
    assert {"serials", "complete", "tails"} <= failing(found)


@pytest.mark.parametrize("place", [["x", 0], [0], [], "x", None, [0, 0, 0], [[0], 0], [1 << 70, 0]])
def test_a_unit_of_a_tail_that_the_system_does_not_have_is_found(place: object) -> None:
    """Its keeper cannot be derived, so the check fails in one line, whatever the value is."""
    recording = free_recorded("agv-labelled:graph=grid3x3,n=3", moves=4)
    tails = [
        (number, document)
        for number, record in enumerate(recording.records)
        if record.kind == "commits" and (document := json.loads(record.data))["units"]
    ]
    number, document = tails[-1]
    changed = put(document, ("units", 0, 0), place)
    failed = failing(asked(with_document(recording, number, changed)))
    assert failed & {"tails", "messages"}


def longer(moves: int) -> Recording:
    """Return a run of at least so many moves of few modules, in which places change often."""
    return free_recorded("agv:graph=grid2x2,n=2", moves=moves)


def lines_per_message(moves: int) -> float:
    """Return how many lines a message takes to check in a run of at least so many moves."""
    recording = longer(moves)
    return lines_of(lambda: verify(recording)) / len(recording.records)


@pytest.mark.thorough
def test_a_message_takes_as_long_to_check_in_a_longer_run() -> None:
    """However often the places around a module have changed."""
    assert lines_per_message(240) < 1.1 * lines_per_message(40)


def bytes_at_most(recording: Recording) -> int:
    """Return how many bytes are allocated at once while a recording is verified."""
    tracemalloc.start()
    try:
        assert verify(recording).ok
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


@pytest.mark.thorough
def test_a_message_of_a_longer_run_takes_few_bytes() -> None:
    """Messages are not kept: what is kept of them is far less than they are on record."""
    short, long = longer(100), longer(800)
    more = len(long.records) - len(short.records)
    assert bytes_at_most(long) - bytes_at_most(short) < 150 * more
