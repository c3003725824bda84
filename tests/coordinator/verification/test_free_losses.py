"""What is missing on record is counted and not checked; what contradicts the rest still fails."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache, partial

import msgspec
import pytest

from cubepath.coordinator.verification.findings import Verification
from cubepath.protocol.core.system import Scene
from cubepath.protocol.recordings.recording import Recording, read_recording
from cubepath.protocol.wire.free_messages import (
    Attempt,
    Commit,
    Entered,
    FreeMessage,
    Halted,
    Replies,
    Requests,
    TileUpdate,
    Turns,
    decode_free,
)
from cubepath.protocol.wire.messages import Summary, encode
from cubepath.protocol.wire.outgoing_log import INCARNATIONS_OF_A_FLEET
from samples.free_numbers import numbered
from samples.free_runs import asked, free_recorded, free_run, results, write
from samples.recordings import new_path

SPEC, MOVES = "hex:n=4", 10


def without(recording: Recording, is_lost: Callable[[FreeMessage], bool]) -> Recording:
    """Return the recording without some messages, as if they had never come."""
    kept = [each for each in recording.records if not is_lost(decode_free(each.data))]
    records = tuple(replace(each, sequence=number) for number, each in enumerate(kept))
    return replace(recording, records=records)


def failing(found: Verification) -> set[str]:
    """Return the checks that fail."""
    return {check.name for check in found.checks if not check.ok}


def unchecked(found: Verification) -> set[str]:
    """Return the checks that were not made everywhere."""
    return {check.name for check in found.checks if not check.checked}


def in_whole(messages: list[FreeMessage], scene: Scene) -> Recording:
    """Return a recording of these messages, with numbers that have no gap."""
    whole = [*numbered(messages), *results(scene, messages, 3)]
    return read_recording(write(new_path(), scene, whole))


@cache
def said(kind: str) -> int:
    """Return how many messages of a kind a small run has."""
    return sum(1 for _ in free_recorded(SPEC, moves=MOVES, restarts=1).of_kind(kind))


@pytest.mark.few(1)
@pytest.mark.slow
@pytest.mark.parametrize("kind", ["requests", "turns", "forwards", "replies", "tile"])
def test_any_message_may_be_missing(kind: str) -> None:
    """It is counted, nothing fails, and each kind leaves something that cannot be checked."""
    recording = free_recorded(SPEC, moves=MOVES, restarts=1)
    found: set[str] = set()
    for number in range(0, said(kind), 1 + said(kind) // 25):
        lost = list(recording.of_kind(kind))[number].data
        result = asked(without(recording, lambda each, lost=lost: encode(each) == lost))  # type: ignore[misc]
        assert failing(result) == set(), (number, result.checks)
        assert result.missing.messages == 1
        found |= unchecked(result)
    assert found or kind == "forwards"  # whatever is passed on was asked for


@pytest.mark.few(1)
@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3))
def test_many_messages_in_a_row_may_be_missing(seed: int) -> None:
    """A third of the record, but for the commits, which keepers tell again."""
    recording = free_recorded(SPEC, moves=30, seed=seed, restarts=1)
    third = len(list(recording.records)) // 3
    lost = {each.data for each in list(recording.records)[third : 2 * third]}
    result = asked(
        without(recording, lambda each: getattr(each, "sequence", 0) > 0 and encode(each) in lost)
    )
    assert failing(result) == set()
    assert result.missing.messages > 20
    assert {"turns", "choices"} <= unchecked(result)


def attempting(message: FreeMessage) -> bool:
    """Return whether a message asks for a move."""
    return isinstance(message, Requests) and any(
        isinstance(each, Attempt) for each in message.parts
    )


@pytest.mark.parametrize(
    ("check", "is_lost"),
    [
        ("attempts", attempting),
        ("turns", lambda each: isinstance(each, Turns) and each.parts[0].turn == 2),
        ("turns", lambda each: isinstance(each, TileUpdate)),
        (
            "turns",
            lambda each: (
                isinstance(each, Replies) and any(isinstance(part, Entered) for part in each.parts)
            ),
        ),
    ],
)
def test_without_a_gap_in_the_numbers_nothing_may_be_missing(
    check: str, is_lost: Callable[[FreeMessage], bool]
) -> None:
    """Who takes messages out and closes the gap is found."""
    scene, messages = free_run(SPEC, moves=MOVES)
    result = asked(in_whole([each for each in messages if not is_lost(each)], scene))
    assert check in failing(result)
    assert result.missing.messages == 0


def test_a_contradiction_fails_where_messages_are_missing() -> None:
    """A level that is not that of the move, and an attempt that sensed what was not there."""
    recording = without(
        free_recorded(SPEC, moves=MOVES),
        lambda each: isinstance(each, Turns) and each.parts[0].turn == 2,
    )
    assert failing(asked(recording)) == set()
    for kind, change in (("commit", raised), ("requests", elsewhere)):
        changed, records = False, list(recording.records)
        for place, record in enumerate(records):
            message = decode_free(record.data)
            other = None if changed or record.kind != kind else change(message)
            if other is not None:
                changed, records[place] = True, replace(record, data=encode(other))
        assert changed
        assert failing(asked(replace(recording, records=tuple(records))))


def raised(message: FreeMessage) -> FreeMessage | None:
    """Return a move at another level."""
    if isinstance(message, Commit) and message.generator is not None:
        return msgspec.structs.replace(message, level=message.level + 1)
    return None


def elsewhere(message: FreeMessage) -> FreeMessage | None:
    """Return an attempt that sensed nothing where it sensed something."""
    for part in message.parts if isinstance(message, Requests) else ():
        if isinstance(part, Attempt) and any(site for _, site in part.sensed):
            sensed = [(unit, None) for unit, _ in part.sensed]
            return msgspec.structs.replace(
                message, parts=[msgspec.structs.replace(part, sensed=sensed)]
            )
    return None


def test_choices_are_checked_up_to_a_gap() -> None:
    """Another choice is found before it, and after it nobody knows what the rule knew."""
    recording = free_recorded(SPEC, moves=30)
    turns = [
        turn
        for record in recording.of_kind("turns")
        for message in [decode_free(record.data)]
        if isinstance(message, Turns)
        for turn in message.parts
        if turn.module == 0 and turn.number is None
    ]
    early, late = turns[0], turns[-1]
    gap = early.turn + 1
    assert gap < late.turn

    def is_lost(each: FreeMessage) -> bool:
        return isinstance(each, Turns) and (each.parts[0].module, each.parts[0].turn) == (0, gap)

    lost = without(recording, is_lost)
    for turn, fails in ((early, True), (late, False)):
        data, other = encode(turn), encode(msgspec.structs.replace(turn, heeds=[[0, 0]]))
        records = tuple(replace(each, data=each.data.replace(data, other)) for each in lost.records)
        found = asked(replace(lost, records=records))
        assert ("choices" in failing(found)) is fails
        assert "choices" in unchecked(found)


@pytest.mark.parametrize("processes", [{}, {"processes": "3"}, {"processes": None}])
def test_every_process_rests_at_the_end(processes: dict[str, str | None]) -> None:
    """Also one that has said nothing, and where it is not known how many there are."""
    whole = free_recorded(SPEC, moves=MOVES)
    kept = {k: v for k, v in {**whole.parameters, **processes}.items() if v is not None}
    recording = replace(whole, parameters=kept)
    assert failing(asked(recording)) == ({"complete"} if processes.get("processes") else set())
    for number in range(2):
        is_rest = partial(said_by, Halted, number)
        assert failing(asked(without(recording, is_rest))) == {"complete"}


def said_by(kind: type[Halted], process: int, message: FreeMessage) -> bool:
    """Return whether a message is of a kind and a process."""
    return isinstance(message, kind) and message.process == process


@pytest.mark.parametrize("on_crash", ["stop", "continue"])
@pytest.mark.parametrize("ended", ["failed", "max-rounds"])
def test_where_a_process_may_be_dead_its_end_is_not_checked(on_crash: str, ended: str) -> None:
    """It may have died before it could say that it rests, in a run that failed or went on."""
    whole = without(free_recorded(SPEC, moves=MOVES), partial(said_by, Halted, 1))
    (record,) = whole.of_kind("summary")
    error = None if ended == "max-rounds" else "process_1 died"
    summary = decode_free(record.data)
    assert isinstance(summary, Summary)
    changed = replace(
        record, data=encode(msgspec.structs.replace(summary, ended=ended, error=error))
    )
    records = tuple(changed if each == record else each for each in whole.records)
    told = {**whole.parameters, "on_crash": on_crash}
    found = asked(replace(whole, records=records, parameters=told))
    if (on_crash, ended) == ("stop", "max-rounds"):
        assert failing(found) == {"complete"}
    else:
        assert failing(found) == set()
        assert unchecked(found) == {"complete"}


def test_two_messages_with_one_number_are_found() -> None:
    """Each number of a sender has one message, which may come twice."""
    recording = free_recorded(SPEC, moves=MOVES)
    records = list(recording.records)
    place = next(n for n, each in enumerate(records) if each.kind == "turns")
    twice = [*records[:place], records[place], *records[place:]]
    doubled = tuple(replace(each, sequence=number) for number, each in enumerate(twice))
    assert failing(asked(replace(recording, records=doubled))) == set()
    message = decode_free(records[place].data)
    records[place] = replace(
        records[place],
        data=encode(msgspec.structs.replace(message, sequence=getattr(message, "sequence", 0) + 1)),
    )
    assert "messages" in failing(asked(replace(recording, records=tuple(records))))


def test_the_end_of_a_fleet_before_the_last_may_be_cut_off() -> None:
    """A run that was taken up again has incarnations that are much later."""
    scene, messages = free_run(SPEC, moves=MOVES)
    recording = in_whole([each for each in messages if not attempting(each)], scene)
    assert "attempts" in failing(asked(recording))
    records = list(recording.records)
    place = max(n for n, each in enumerate(records) if each.kind == "commits")
    tail = decode_free(records[place].data)
    later = msgspec.structs.replace(tail, incarnation=1 + INCARNATIONS_OF_A_FLEET, sequence=1)
    records[place] = replace(records[place], data=encode(later))
    found = asked(replace(recording, records=tuple(records)))
    assert failing(found) == set()
    assert "attempts" in unchecked(found)
