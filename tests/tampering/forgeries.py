"""Recordings of both clocks that were forged, by what `forgeries.md` calls the forgery."""

import json
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

from changed_values import with_own_schedule
from cubepath.coordinator.verification.transcript import RECOVERED
from cubepath.protocol.recordings.recording import Recording, read_recording
from cubepath.protocol.recordings.stored_messages import Record
from cubepath.protocol.systems.lattice import LatticeSystem
from cubepath.protocol.wire.free_messages import Attempt, Forwards, FreeMessage, Requests, Settled
from samples.free_numbers import numbered
from samples.free_runs import free_recorded, free_run, results, write
from samples.recordings import new_path, recorded
from tampering.tamperings import (
    a_granted_claim_is_called_lost,
    a_lost_claim_is_executed_too,
    a_message_missed,
    a_module_reports_another_site,
    a_move_from_elsewhere,
    a_report_is_missing,
    a_verdict_is_missing,
    another_seed,
    crowd,
    heard_what_nobody_said,
)
from tampering.tamperings_of_certificates import a_chain_that_is_too_short
from tampering.tamperings_of_choices import (
    a_claim_that_the_rule_did_not_make,
    a_note_that_was_forged,
    a_rule_of_another_run,
    hesitation_of_another_run,
)
from tampering.tamperings_of_results import (
    a_goal_that_was_not_reached,
    a_move_of_a_cube_is_missing,
    an_end_before_its_time,
    two_cubes_swapped,
)
from tampering.tamperings_of_runs import (
    a_module_that_never_gave_up,
    a_process_that_did_not_answer,
    a_run_that_was_not_interrupted,
)
from tampering.tamperings_of_schedules import carried_out, fewer_cubes_than_rounds, stopped
from tampering.tamperings_of_stages import the_stages_are_of_another_rule

Forgery = Callable[[], Recording]
Edit = Callable[[Any], Any]
"""Returns another document in place of one, or None to leave it."""
RESULTS = ("edges", "cube", "certificate", "summary")
GOLDEN = Path(__file__).parents[2] / "logs" / "golden" / "hex-free-5.mcap"


def chain() -> Recording:
    """Return a run without rounds that reached its goal."""
    return read_recording(GOLDEN)


def gossip() -> Recording:
    """Return a run without rounds of modules that draw, guard places, and exchange registers."""
    return free_recorded("hex:n=4", moves=12, restarts=1)


def numbered_anew(recording: Recording, records: Iterable[Record]) -> Recording:
    """Return the recording with other messages, without a gap in their order of writing."""
    kept = (replace(record, sequence=number) for number, record in enumerate(records))
    return replace(recording, records=tuple(kept))


def bytes_of(document: Any) -> bytes:
    """Return a document as a message has it."""
    return json.dumps(document, separators=(",", ":")).encode()


def edited(recording: Recording, kind: str, edit: Edit, *, last: bool = False) -> Recording:
    """Return the recording with the first message of a kind changed that `edit` changes."""
    records = list(recording.records)
    places = range(len(records) - 1, -1, -1) if last else range(len(records))
    for place in places:
        if records[place].kind == kind:
            document = edit(json.loads(records[place].data))
            if document is not None:
                records[place] = replace(records[place], data=bytes_of(document))
                return replace(recording, records=tuple(records))
    raise AssertionError(f"there is no such {kind}")


def summing(recording: Recording, **changes: Any) -> Recording:
    """Return the recording with another summary."""
    return edited(recording, "summary", lambda summary: summary | changes)


def without(recording: Recording, where: Callable[[Record], bool]) -> Recording:
    """Return the recording without some messages, and without a gap."""
    return numbered_anew(recording, [each for each in recording.records if not where(each)])


def told(recording: Recording, **changes: str | None) -> Recording:
    """Return the recording with other parameters, or without those that are None."""
    parameters = {**recording.parameters, **changes}
    kept = {key: value for key, value in parameters.items() if value is not None}
    return replace(recording, parameters=kept)


def inserted(recording: Recording, place: int, kind: str, document: Any) -> Recording:
    """Return the recording with one more message of the coordinator, or of a process."""
    process = document.get("process")
    who = "coordinator" if process is None else f"process_{process}"
    records = list(recording.records)
    at = records[place].round
    records.insert(place, Record(f"{kind}/{who}", bytes_of(document), at, 0, 0))
    return numbered_anew(recording, records)


def committed(change: Edit, recording: Recording | None = None) -> Recording:
    """Return a run without rounds with a commit changed wherever it is told."""
    found = gossip() if recording is None else recording
    for record in found.of_kind("commit"):
        old = json.loads(record.data)
        new = change(old)
        if new is not None:
            before, after = bytes_of(old), bytes_of(new)
            records = [
                replace(each, data=each.data.replace(before, after)) for each in found.records
            ]
            return replace(found, records=tuple(records))
    raise AssertionError("there is no such commit")


def with_part(recording: Recording, kind: str, edit: Edit) -> Recording:
    """Return the recording with one part of a message changed."""

    def change(document: Any) -> Any:
        for number, part in enumerate(document["parts"]):
            new = edit(part)
            if new is not None:
                document["parts"][number] = new
                return document
        return None

    return edited(recording, kind, change)


def part_doubled(recording: Recording, kind: str) -> Recording:
    """Return the recording with the first part of a message a second time."""
    return edited(
        recording, kind, lambda each: each | {"parts": [each["parts"][0], *each["parts"]]}
    )


def doubled(recording: Recording, *kinds: str) -> Recording:
    """Return the recording with each message of some kinds twice."""
    records = [each for one in recording.records for each in [one] * (1 + (one.kind in kinds))]
    return numbered_anew(recording, records)


def as_junk(recording: Recording) -> Recording:
    """Return the recording with bytes that are no message."""
    return edited(recording, recording.records[5].kind, lambda _: {"kind": "clam"})


def under_another_name(recording: Recording) -> Recording:
    """Return the recording with a message under the name of another sender."""
    records = list(recording.records)
    records[5] = replace(records[5], topic=f"{records[5].kind}/module_1")
    return replace(recording, records=tuple(records))


def with_a_gap(recording: Recording) -> Recording:
    """Return the recording without a message, whose number is missing."""
    records = list(recording.records)
    del records[len(records) // 2]
    return replace(recording, records=tuple(records))


def less(gone: Callable[[FreeMessage], bool]) -> Recording:
    """Return a run without rounds without some messages, in which no number is missing."""
    scene, messages = free_run("hex:n=4", moves=10)
    kept = [message for message in messages if not gone(message)]
    whole = [*numbered(kept), *results(scene, kept, 3)]
    return read_recording(write(new_path(), scene, whole))


def asks(message: FreeMessage) -> bool:
    """Return whether a message asks for a move."""
    return isinstance(message, Requests) and any(
        isinstance(each, Attempt) for each in message.parts
    )


def acknowledges(message: FreeMessage) -> bool:
    """Return whether a message says that a keeper has taken note of commits, and nothing else."""
    return isinstance(message, Forwards) and all(
        isinstance(each, Settled) for each in message.parts
    )


def refusing(recording: Recording, *, counted: bool) -> Recording:
    """Return the recording with a message that was refused, which nobody sent."""
    place = len(recording.records) // 2
    round_number = recording.records[place].round
    refused = {
        "kind": "refused",
        "round": round_number,
        "key": "bundle/process_0",
        "sender": "process_0",
        "reason": "malformed",
        "detail": "not a cubepath message",
        "count": 1,
        "sample": "x",
    }
    found = inserted(recording, place, "refused", refused)
    return summing(found, refused=1) if counted else found


def waiting(**changes: Any) -> Recording:
    """Return a run with rounds in which a process says that it waits for others."""
    whole = crowd()
    place = next(n for n, each in enumerate(whole.records) if b'"phase":"settle"' in each.data)
    there = json.loads(whole.records[place].data)
    said = {"kind": "waiting", "round": there["round"], "process": 0, "phase": "claim"} | changes
    return inserted(whole, place, "waiting", said)


def cut_off(recording: Recording) -> Recording:
    """Return the recording without its second half."""
    half = len(recording.records) // 2
    return replace(recording, records=tuple(recording.records[:half]))


def explained(recording: Recording) -> Recording:
    """Return the recording without its end, as if it were recovered from a damaged one."""
    return told(cut_off(recording), **{RECOVERED: "some messages of a run"})


def without_rest() -> Recording:
    """Return a run without rounds, without the last message of a process and its rest."""
    whole = gossip()
    of_it = [each.sequence for each in whole.records if each.topic.endswith("/process_1")]
    return without(whole, lambda each: each.sequence in of_it[-2:])


def less_of(topic: str) -> Recording:
    """Return a run without rounds without the first message of a topic."""
    whole = gossip()
    first = next(each for each in whole.records if each.topic == topic)
    return without(whole, lambda each: each.sequence == first.sequence)


def less_behind_the_stop() -> Recording:
    """Return a schedule that stopped, with another cube at its end."""
    recording = stopped()
    *lines, last = (recording.schedule or b"").splitlines(keepends=True)
    cube = json.loads(last)
    schedule = b"".join([*lines, bytes_of({"moves": cube["moves"][::-1][:1]}), b"\n"])
    return replace(recording, schedule=schedule)


def no_schedule(recording: Recording) -> Recording:
    """Return the recording without its schedule and what tells of it, but for the rule."""
    found = summing(recording, schedule_cubes=None)
    return told(replace(found, schedule=None), schedule=None)


def scheduled() -> Recording:
    """Return a run without rounds that says that it carried out its own moves."""
    return with_own_schedule(free_recorded("agv:graph=C4,n=2", moves=4, keepers=2))


def less_of_its_schedule() -> Recording:
    """Return that run with a schedule that lacks its last cube."""
    recording = scheduled()
    lines = (recording.schedule or b"").splitlines(keepends=True)
    return replace(recording, schedule=b"".join(lines[:-1]))


def from_elsewhere(recording: Recording) -> Recording:
    """Return the recording with another start: one module stands where it never was."""
    scene = recording.scene
    near = {each for site in scene.start for each in scene.system.sensed(site) if each}
    free = max(near - {*scene.start}, key=repr)
    return replace(recording, stored_scene=replace(scene, start=(free, *scene.start[1:])))


def to_elsewhere(recording: Recording) -> Recording:
    """Return the recording with another goal: the start."""
    scene = recording.scene
    return replace(recording, stored_scene=replace(scene, goal=frozenset(scene.start), goals=()))


def with_obstacle(recording: Recording) -> Recording:
    """Return the recording with one more obstacle, far away."""
    scene = recording.scene
    system: Any = scene.system
    changed = LatticeSystem(
        system.catalogue,
        workspace=system.workspace,
        filled=system.filled,
        empty={*system.empty, (90, 90)},
    )
    return replace(recording, stored_scene=replace(scene, system=changed))


def spelled(moves: Any) -> Any:
    """Return moves with the numbers of their places as decimals."""
    return [each | {"at": decimal(each["at"])} for each in moves]


def decimal(value: Any) -> Any:
    """Return numbers as decimals, in lists of any depth."""
    return [decimal(each) for each in value] if isinstance(value, list) else float(value)


def at_another_time(recording: Recording) -> Recording:
    """Return the recording with other wall times."""
    records = (replace(each, wall_ns=each.wall_ns + 10**9) for each in recording.records)
    return replace(recording, records=tuple(records))


def in_another_order(recording: Recording, *kinds: str) -> Recording:
    """Return the recording with two messages exchanged that nothing orders."""
    records = list(recording.records)
    for place, (one, two) in enumerate(pairwise(records)):
        if (one.kind, two.kind) == kinds and one.data != two.data and one.round == two.round:
            records[place : place + 2] = [two, one]
            return numbered_anew(recording, records)
    raise AssertionError(f"{kinds} do not stand side by side")


def refused(decision: Any) -> Any:
    """Return a commit that a keeper tells as refused."""
    if decision["kind"] != "decision" or "commit" not in decision:
        return None
    kept = {key: decision[key] for key in ("kind", "module", "epoch", "number")}
    return kept | {"reason": "no"}


def otherwise(decision: Any) -> Any:
    """Return a refusal for another reason."""
    return decision | {"reason": "it was late"} if decision.get("reason") else None


def emptied(shown: Any) -> Any:
    """Return a place that is shown as empty, where a module stands."""
    if shown.get("site") is None:
        return None
    return {key: shown[key] for key in ("kind", "place", "version") if key in shown}


def seen_later(turn: Any) -> Any:
    """Return a turn that was shown a version that never was."""
    if max(turn["sensed"]) < 0:
        return None
    sensed = list(turn["sensed"])
    sensed[sensed.index(max(sensed))] += 50
    return turn | {"sensed": sensed}


def elsewhere(moved: Any) -> Any:
    """Return a commit whose mover ends somewhere else."""
    if "motion" not in moved:
        return None
    (module, source, _, version), *more = moved["motion"]
    return moved | {"motion": [[module, source, [9, 9], version], *more]}


def of_another(moved: Any) -> Any:
    """Return a commit of another module."""
    return moved | {"module": (moved["module"] + 1) % 4} if "motion" in moved else None


def again(moved: Any) -> Any:
    """Return a commit that overwrites a version which is overwritten already."""
    for number, (unit, version, reads) in enumerate(moved.get("written", ())):
        if version:
            written = list(moved["written"])
            written[number] = [unit, version - 1, reads]
            return moved | {"written": written}
    return None


def noted(moved: Any) -> Any:
    """Return a commit that writes another register."""
    for number, (place, module, version, content) in enumerate(moved.get("notes", ())):
        if content:
            notes = list(moved["notes"])
            notes[number] = [place, module, version, [content[0] + 7, *content[1:]]]
            return moved | {"notes": notes}
    return None


def counted(moved: Any) -> Any:
    """Return a commit that counts one reader more."""
    if "written" not in moved:
        return None
    return moved | {"written": [[unit, at, reads + 1] for unit, at, reads in moved["written"]]}


def later(document: Any) -> Any:
    """Return what a keeper tells at the end, with another version of a unit."""
    if not document["units"]:
        return None
    (unit, version, *rest), *more = document["units"]
    return document | {"units": [[unit, version + 1, *rest], *more]}


def born_later(part: Any) -> Any:
    """Return an answer to a module with another epoch."""
    if part["kind"] != "entered":
        return None
    occupant = part["occupant"]
    return part | {"occupant": occupant | {"epoch": occupant["epoch"] + 1}}


def _with_less(document: Any) -> Any:
    return document | {"moves": document["moves"][1:]} if document["moves"] else None


def _swapped(document: Any) -> Any:
    return document | {"index": 2} if document["index"] == 1 else None


def cubes_swapped(recording: Recording) -> Recording:
    """Return the recording with its first two cubes in the other order."""
    found = edited(recording, "cube", _swapped)
    return edited(
        found, "cube", lambda cube: cube | {"index": 1} if cube["index"] == 2 else None, last=True
    )


def less_proof(document: Any) -> Any:
    """Return a certificate with a shorter chain."""
    certificate = document["certificate"]
    return document | {"certificate": certificate | {"chain": certificate["chain"][1:]}}


DIED = "module_3 (process 0) died in round 4: killed by signal 9"
FORGERIES: Mapping[str, tuple[Forgery | None, Forgery | None]] = {
    "bytes that are no message": (lambda: as_junk(crowd()), lambda: as_junk(chain())),
    "the name of another sender": (
        lambda: under_another_name(crowd()),
        lambda: under_another_name(chain()),
    ),
    "a message taken out": (lambda: with_a_gap(crowd()), lambda: with_a_gap(chain())),
    "a message taken out, and all numbers closed: a verdict; attempts": (
        a_verdict_is_missing,
        lambda: less(asks),
    ),
    "the same: what a keeper acknowledged": (None, lambda: less(acknowledges)),
    "the same: a report; a commit": (
        a_report_is_missing,
        lambda: without(
            chain(), lambda each: b'"serial":3,' in each.data and each.topic == "commit/keeper_1"
        ),
    ),
    "a message taken out and its place closed, but not the number of its sender": (
        None,
        lambda: less_of("turns/process_1"),
    ),
    "another number or incarnation of a message of a keeper": (
        None,
        lambda: edited(gossip(), "tile", lambda each: each | {"incarnation": 2}),
    ),
    "a message that stands twice": (
        lambda: doubled(crowd(), "reports"),
        lambda: doubled(gossip(), "requests"),
    ),
    "a part that stands twice in its message": (
        lambda: part_doubled(crowd(), "reports"),
        lambda: part_doubled(gossip(), "turns"),
    ),
    "results that stand twice": (
        lambda: doubled(crowd(), *RESULTS),
        lambda: doubled(chain(), *RESULTS),
    ),
    "a move from where its module does not stand": (
        a_move_from_elsewhere,
        lambda: committed(of_another),
    ),
    "two parallel moves that do not commute": (
        a_lost_claim_is_executed_too,
        lambda: committed(again),
    ),
    "a module that ends elsewhere than its move": (
        a_module_reports_another_site,
        lambda: committed(elsewhere),
    ),
    "a granted claim called lost; a commit called refused": (
        a_granted_claim_is_called_lost,
        lambda: with_part(chain(), "replies", refused),
    ),
    "a delivery that nobody sent; a place shown as it never was": (
        heard_what_nobody_said,
        lambda: with_part(chain(), "tile", emptied),
    ),
    "a delivery left out; a turn that saw what was not shown": (
        a_message_missed,
        lambda: with_part(chain(), "turns", seen_later),
    ),
    "another level of a move": (
        None,
        lambda: committed(
            lambda moved: moved | {"level": moved["level"] + 1} if moved["level"] else None
        ),
    ),
    "another count of readers": (None, lambda: committed(counted)),
    "another note; another register": (a_note_that_was_forged, lambda: committed(noted)),
    "another epoch of a module": (None, lambda: with_part(gossip(), "replies", born_later)),
    "another version in the last `commits`": (
        None,
        lambda: edited(chain(), "commits", later, last=True),
    ),
    "a unit left out of the last `commits`": (
        None,
        lambda: edited(
            chain(),
            "commits",
            lambda tail: tail | {"units": tail["units"][1:]} if tail["units"] else None,
            last=True,
        ),
    ),
    "another choice than the rule makes": (
        a_claim_that_the_rule_did_not_make,
        lambda: with_part(
            gossip(), "turns", lambda turn: None if "number" in turn else turn | {"heeds": [[0, 0]]}
        ),
    ),
    "another seed": (another_seed, lambda: told(gossip(), seed="1")),
    "another seed, where nothing depends on it": (
        lambda: told(recorded("agv:graph=P3,n=1", "tswap", rounds=2), seed="1"),
        lambda: told(chain(), seed="1"),
    ),
    "another probability of hesitation": (
        hesitation_of_another_run,
        lambda: told(gossip(), hesitate="0.5"),
    ),
    "another rule": (a_rule_of_another_run, lambda: told(chain(), rule="random")),
    "other stages": (the_stages_are_of_another_rule, None),
    "a schedule without one of its cubes": (fewer_cubes_than_rounds, less_of_its_schedule),
    "a cube of the schedule behind where it stopped": (less_behind_the_stop, None),
    "no schedule, where the rule is `schedule`": (
        lambda: no_schedule(carried_out()),
        lambda: no_schedule(scheduled()),
    ),
    "`refused` that nobody refused": (
        lambda: refusing(crowd(), counted=False),
        lambda: refusing(chain(), counted=False),
    ),
    "the same, counted in the summary": (
        lambda: refusing(crowd(), counted=True),
        lambda: refusing(chain(), counted=True),
    ),
    "`waiting` in another round, or of no phase": (lambda: waiting(phase="lunch"), None),
    "`waiting` or `retransmit` in its phase, of a process that did not wait": (waiting, None),
    "`refused` of a `commits`": (
        None,
        lambda: edited(chain(), "commits", lambda tail: tail | {"refused": 3}, last=True),
    ),
    "the reason of a refusal": (None, lambda: with_part(gossip(), "replies", otherwise)),
    "whether a tile is shown whole": (
        None,
        lambda: edited(
            gossip(),
            "tile",
            lambda each: each | {"whole": False} if each["parts"] and each.get("whole") else None,
        ),
    ),
    "what a `tile_query` asked for": (
        None,
        lambda: with_part(
            gossip(), "requests", lambda p: p | {"serial": 7} if p["kind"] == "tile_query" else None
        ),
    ),
    "an end that says `interrupted`": (
        a_run_that_was_not_interrupted,
        lambda: summing(chain(), ended="interrupted", error="interrupted"),
    ),
    "an end that says `failed`: a module gave up": (
        a_module_that_never_gave_up,
        lambda: summing(chain(), ended="failed", error="module_3: I was tired"),
    ),
    "an end that says `failed`: a process died": (
        lambda: summing(crowd(), ended="failed", error=DIED),
        lambda: summing(chain(), ended="failed", error="process_1 died: killed by signal 9"),
    ),
    "an end that says `goal`, which was not reached": (
        a_goal_that_was_not_reached,
        lambda: summing(gossip(), ended="goal"),
    ),
    "an end before `max_rounds`": (an_end_before_its_time, lambda: told(gossip(), max_rounds="99")),
    "a number or the digest of the summary": (
        lambda: summing(crowd(), moves=1),
        lambda: summing(chain(), path_digest="0" * 64),
    ),
    "no summary": (
        lambda: without(crowd(), lambda each: each.kind == "summary"),
        lambda: without(chain(), lambda each: each.kind == "summary"),
    ),
    "a cube taken out": (
        lambda: without(crowd(), lambda each: each.kind == "cube" and b'"index":2,' in each.data),
        lambda: without(chain(), lambda each: each.kind == "cube" and b'"index":2,' in each.data),
    ),
    "the last answer of a process taken out; its `halted` and what it said last": (
        a_process_that_did_not_answer,
        without_rest,
    ),
    "everything after some point taken out": (lambda: cut_off(crowd()), lambda: cut_off(chain())),
    "the same, and a parameter that explains it: `recovered`, `attached`": (
        lambda: explained(crowd()),
        lambda: explained(chain()),
    ),
    "a move of a cube": (a_move_of_a_cube_is_missing, lambda: edited(chain(), "cube", _with_less)),
    "two cubes exchanged": (two_cubes_swapped, lambda: cubes_swapped(chain())),
    "edges of other moves": (
        lambda: edited(crowd(), "edges", _with_less),
        lambda: edited(chain(), "edges", _with_less),
    ),
    "a chain of the certificate that is too short": (
        a_chain_that_is_too_short,
        lambda: edited(chain(), "certificate", less_proof),
    ),
    "no certificate": (
        lambda: without(crowd(), lambda each: each.kind == "certificate"),
        lambda: without(chain(), lambda each: each.kind == "certificate"),
    ),
    "a parameter that no run has": (
        lambda: told(crowd(), invented="1"),
        lambda: told(chain(), invented="1"),
    ),
    "a parameter of the other clock": (
        lambda: told(crowd(), jitter="0"),
        lambda: told(chain(), wait_for="1"),
    ),
    "another number of modules, or more processes than modules": (
        lambda: told(crowd(), modules="9"),
        lambda: told(chain(), processes="9"),
    ),
    "another number of keepers": (None, lambda: told(chain(), keepers="3")),
    "another start": (lambda: from_elsewhere(crowd()), lambda: from_elsewhere(chain())),
    "another goal": (lambda: to_elsewhere(crowd()), lambda: to_elsewhere(chain())),
    "a part of the scene that nobody comes near": (
        lambda: with_obstacle(recorded("hex:n=3", "chain", rounds=2)),
        lambda: with_obstacle(chain()),
    ),
    "versions and platform; speeds": (
        lambda: told(crowd(), python="4.0", platform="another"),
        lambda: told(chain(), numpy="9.9", speeds="0=2"),
    ),
    "wall times": (lambda: at_another_time(crowd()), lambda: at_another_time(chain())),
    "another spelling of a number: `1.0` for `1`": (
        lambda: edited(crowd(), "cube", lambda cube: cube | {"moves": spelled(cube["moves"])}),
        lambda: edited(chain(), "cube", lambda cube: cube | {"moves": spelled(cube["moves"])}),
    ),
    "the order of messages that nothing orders": (
        lambda: in_another_order(crowd(), "bundle", "ready"),
        lambda: in_another_order(gossip(), "requests", "requests"),
    ),
    "all of it, by modules that follow the rules": (
        lambda: recorded("agv:graph=grid4x4,n=7", "tswap", seed=5, rounds=10),
        lambda: free_recorded("hex:n=4", seed=5, moves=12),
    ),
}
"""For each forgery a recording with rounds and one without, as far as there are any."""
