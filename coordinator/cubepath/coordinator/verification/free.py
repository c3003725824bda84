"""Verifying a run without rounds: everything derived again from the start and the versions.

Part of `cubepath verify`: it uses neither keepers nor the gatherer nor the heap.
"""

from collections import Counter
from collections.abc import Callable
from hashlib import sha256

import numpy as np

from cubepath.coordinator.verification import parameters
from cubepath.coordinator.verification.dependencies import check_dependencies
from cubepath.coordinator.verification.findings import (
    NO_END,
    Failures,
    MissingMessages,
    Progress,
    Verification,
)
from cubepath.coordinator.verification.free_attempts import Attempts
from cubepath.coordinator.verification.free_history import History, LevelPath
from cubepath.coordinator.verification.free_shown import Tails, VisibilityCheck
from cubepath.coordinator.verification.free_transcript import (
    FreeReading,
    FreeTranscript,
    edges_hash,
)
from cubepath.coordinator.verification.free_turns import FreePlayer, TurnsOfModules
from cubepath.coordinator.verification.results import Derived, concluded, without_end
from cubepath.coordinator.verification.transcript import Fail, check_complete, is_cut_off
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.sites import Site
from cubepath.protocol.path_files.durations import schedule_from_jsonl
from cubepath.protocol.recordings.cutting import left_out
from cubepath.protocol.recordings.recording import Recording
from cubepath.protocol.wire import free_messages
from cubepath.protocol.wire.keys import Tiles
from cubepath.protocol.wire.messages import Summary, encode

FREE_CHECKS = {
    "readable": "the file is whole",
    "parameters": "they are those of a run, and fit the scene",
    "messages": "each message decodes, has its own topic and log time, and names real modules",
    "complete": "the run came to its end, unless recovered: a summary, all cubes, all at rest",
    "serials": "the commits of each keeper are numbered without gap, and no number has two",
    "versions": "each version of a unit or a module follows on the one before, and none has two",
    "readers": "a move that overwrites a version counts its readers",
    "order": "all can have happened one after another, each guard while its version stood",
    "units": "a move reads its support and writes its trace, and nothing else",
    "admissible": "every move was admissible when it was made",
    "levels": "a move is one level above the highest of those that it depends on",
    "sites": "modules stand where the moves have taken them",
    "attempts": "each commit answers an attempt, and what that sensed was there at its versions",
    "registers": "registers were as sensed, and became what was asked",
    "decisions": "what keepers say of an attempt, to each other and to modules, is what came of it",
    "entries": "a module acts in the epoch in which it entered, and epochs grow with incarnations",
    "place": "what was shown at a version was there",
    "tails": "keepers count the commits and the versions that are on record",
    "turns": "rules were shown what had been shown, and attempts are what they chose",
    "choices": "each module chose as its rule does, with the seed's randomness",
    "schedule": "the moves are those of the schedule, if there is one, in its order",
    "dependencies": "what is not undone finds its sites at the same versions in levels and cubes",
    "edges": "the coordinator's edges are the moves committed",
    "normal": "no action of a cube is in the cube before or commutes with all of it",
    "ends": "the cubes are admissible from the start on, and end where the moves end",
    "class": "the cubes are the normal form of the moves: the same homotopy class",
    "certificate": "the certificate, if there is one, proves that none in the class is shorter",
    "summary": "the numbers and the digest of the summary are those of the moves",
    "ended": "the run ended as the summary says",
}
"""The checks of a run without rounds by name, with what holds if they pass."""


def verify_free(
    recording: Recording,
    progress: Progress | None = None,
    player: Callable[[], FreePlayer] | None = None,
) -> Verification:
    """Derive everything in the recording of a run without rounds, and compare.

    `rounds` in the result is the greatest level. Nothing is raised, unless the file is changed
    while it is read. The messages are read twice: for the commits, and what others are compared
    with, and then one by one, when it is known what was where at which version. A commit takes some
    200 bytes meanwhile and any other message some 50, whatever their order. Only turns that stand
    before an earlier one of their module are kept until that comes.
    """
    failures = Failures(FREE_CHECKS)
    for problem in recording.problems:
        failures.stage(0)("readable", problem)
    parameters.check_parameters(recording, failures.stage(0))
    transcript = FreeReading(recording, failures.stage(0)).read(recording)
    results = transcript.results
    if results.gap:
        failures.stage(0)("complete", f"{results.gap} messages are missing before the last")
    history = History(recording.scene, transcript.commits, failures.stage(1))
    _check_serials(transcript, failures.stage(1))
    playing = None if player is None else player()
    rests = _check_messages(recording, history, transcript, failures, playing)
    path = history.path()
    levels = int(path.levels[-1]) if len(path.levels) else 0
    if progress is not None:
        progress(levels)
    cut_off = is_cut_off(recording)
    check_complete(results, failures.stage(0), f"level {levels}", cut_off=cut_off)
    actions = path.actions
    fail = failures.stage(3)
    digest = _check_edges(path, transcript, fail)
    carried_out = _check_schedule(recording, path, results.summary, fail)
    reached = recording.scene.reached(history.sites)
    if results.summary is not None:
        arrived = reached if recording.schedule is None else carried_out
        _check_ended(recording, transcript, results.summary, fail, arrived=arrived, rests=rests)
    why = "the rules were not asked again" if playing is None else playing.unchecked()
    unchecked = dict(transcript.losses.unchecked)
    if why is not None:
        unchecked["choices"] = f"not checked: {why}"
    if not transcript.edges and without_end(results, cut_off=cut_off):
        unchecked["edges"] = NO_END
    # A level above the number of moves was found to be wrong already.
    steps = np.arange(1, min(levels, len(actions)) + 1)
    ends = np.searchsorted(path.levels, steps, side="right").tolist()
    end = Derived(actions, ends, levels, history.state, reached, digest)
    missing = MissingMessages(0, max(results.gap + transcript.losses.count, left_out(recording)))
    return concluded(
        recording, results, end, failures, stage=3, missing=missing, unchecked=unchecked
    )


def _check_serials(transcript: FreeTranscript, fail: Fail) -> None:
    for keeper in transcript.commits.keepers:
        for number, serial in enumerate(transcript.commits.serials(keeper), 1):
            if serial != number:
                fail("serials", f"keeper_{keeper}: commit {serial} comes where {number} is due")
                break


def _check_messages(
    recording: Recording,
    history: History,
    transcript: FreeTranscript,
    failures: Failures,
    playing: FreePlayer | None,
) -> bool:
    """Check all that follows from what was where at which version, message by message.

    Return whether everybody rests at the end, and everything is known.
    """
    fail = failures.stage(2)
    keepers = parameters.keepers_of(recording)
    if keepers is None:
        fail("attempts", "without their number it is not known which keeper has what")
        return False
    tiles = Tiles(recording.scene.system, keepers)
    attempts = Attempts(history, transcript, tiles, failures.stage(2))
    shown = VisibilityCheck(history, transcript, tiles, failures.stage(2))
    tails = Tails(history, transcript, tiles, failures.stage(2))
    turns = TurnsOfModules(history, transcript, tiles, playing, failures.stage(2))
    for record in recording.records:
        try:
            message = free_messages.decode_free(record.data)
        except InputError:
            continue  # it is reported already
        match message:
            case free_messages.Turns():
                turns.turns(message)
            case free_messages.Requests():
                attempts.asked(message)
                shown.looks(record, message)
            case free_messages.Replies() | free_messages.Forwards():
                attempts.take(record, message)
            case free_messages.TileUpdate():
                shown.shows(record, message)
            case free_messages.CommitLog():
                tails.tail(record, message)
            case _:
                pass
    attempts.end()
    shown.end()
    summary = transcript.results.summary
    has_end = summary is not None and not is_cut_off(recording) and not _never_began(recording)
    # A run that fails does not wait for what keepers have at the end.
    settled = summary is not None and summary.ended in ("goal", "max-rounds")
    # A process that is dead and not started again does not tell how it ends; nobody starts one
    # that has joined from elsewhere.
    told = recording.parameters
    unwatched = ("continue", "restart") if "wait_for" in told else ("continue",)
    open_end = told.get("on_crash") in unwatched or transcript.broken_off
    whole = tails.end(keepers, whole=has_end and settled, open_end=open_end)
    losses = transcript.losses
    known = parameters.processes_of(recording)
    processes = losses.processes if known is None else range(known)
    awake = [each for each in processes if not losses.at_rest(each)]
    for process in awake if has_end else ():
        why = f"process_{process} does not say that it rests: its last messages may be missing"
        losses.lack(fail, "complete", why, excused=open_end)
    turns.end()
    return whole and not awake


def _never_began(recording: Recording) -> bool:
    """Return whether a run was over before it began, and nothing has been sent."""
    over = recording.scene.reached(recording.scene.start) and recording.schedule is None
    none = all(record.topic.endswith("/coordinator") for record in recording.records)
    return none and (over or parameters.max_rounds_in(recording.parameters) == 0)


def _check_edges(path: LevelPath, transcript: FreeTranscript, fail: Fail) -> str:
    """Compare the recorded edges with the moves; return the digest of the moves."""
    digest = sha256()
    edges, known = transcript.edges, set[int]()
    for level, made in path.by_level():
        for move in made:
            digest.update(encode([level, move.module, move.generator, move.at]) + b"\n")
        known.add(level)
        recorded = edges.get(level)
        if recorded is not None and recorded != edges_hash(made):
            fail("edges", f"level {level}: the edges are not the moves committed")
        elif recorded is None and transcript.results.summary is not None:
            fail("edges", f"level {level}: no edges on record")
    for level in edges:
        if level not in known:
            fail("edges", f"level {level}: edges, but no move was committed")
    return digest.hexdigest()


def _check_schedule(
    recording: Recording, path: LevelPath, summary: Summary | None, fail: Fail
) -> bool:
    """Check that moves are those of the schedule, and wait for those before them.

    Return whether all of it is carried out.
    """
    if recording.schedule is None:
        has_schedule = summary is not None and summary.schedule_cubes is not None
        if has_schedule or "schedule" in recording.parameters:
            fail("schedule", "there was one, but it is not on record")
        return False
    try:
        cubes = schedule_from_jsonl(recording.schedule)
    except InputError as error:
        fail("schedule", str(error))
        return False
    if summary is not None and summary.schedule_cubes != len(cubes):
        counted = summary.schedule_cubes
        fail("schedule", f"the summary counts {counted} cubes, there are {len(cubes)}")
    due = Counter((move.generator, move.at) for cube in cubes for move in cube)
    made = Counter[tuple[str, Site | None]]()
    for number, count in Counter(path.numbers.tolist()).items():
        generator, at, _ = path.known[number]
        made[generator, at] += count
    stray = sorted((made - due).elements(), key=repr)
    if stray:
        fail("schedule", f"{stray[0][0]} at {stray[0][1]!r} is made too often")
    lacking = sorted((due - made).elements(), key=repr)
    if lacking and summary is not None and summary.ended == "goal":
        fail("schedule", f"{lacking[0][0]} at {lacking[0][1]!r} is not made")
    if lacking or stray:
        return False
    actions = [
        recording.scene.system.action(move.generator, site)
        for cube in cubes
        for move in cube
        if (site := move.at) is not None
    ]
    check_dependencies(
        actions,
        [],
        [[each] for each in path.actions],
        lambda _, why: fail("schedule", f"in another order than that of the schedule: {why}"),
        whole=True,
    )
    return True


def _check_ended(
    recording: Recording,
    transcript: FreeTranscript,
    summary: Summary,
    fail: Fail,
    *,
    arrived: bool,
    rests: bool,
) -> None:
    """Check how the run says that it ended: where it `arrived`, and whether everybody `rests`."""
    levels = summary.rounds
    error = summary.error
    if summary.ended in ("goal", "max-rounds") and error is not None:
        fail("ended", f"it says {summary.ended}, and {error!r}")
    if summary.ended == "goal" and not arrived and recording.schedule is None:
        fail("ended", "it says goal, which was not reached")
    most = parameters.max_rounds_in(recording.parameters)
    if summary.ended == "max-rounds" and most is not None and levels < most:
        fail("ended", f"it says max-rounds at level {levels}, of {most}")
    if summary.ended == "interrupted" and error != "interrupted":
        fail("ended", f"it was interrupted, and says {error!r}")
    if summary.ended == "failed" and (not error or "\n" in error):
        fail("ended", f"it failed, and says {error!r}, expected one line")
    if summary.ended != "goal" and arrived and rests and not transcript.gave_up:
        fail("ended", f"it says {summary.ended}, and everybody rests at the goal")
    reason = error or ""
    if reason.startswith("module_") and reason not in transcript.gave_up:
        why = f"it says {reason!r}, which no module says"
        transcript.losses.lack(fail, "ended", why, excused=transcript.losses.of_processes)
