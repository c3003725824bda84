"""Comparing two runs: what differs first, and why.

Recordings of runs with rounds are compared round by round. For runs without rounds, what follows
from versions is compared. For anything else, and for a run with rounds against one without, the
moves are compared. Systems of two families have no places, modules or moves in common, and are
refused. An option that would have no effect is refused in one line.
"""

import re
from collections.abc import Iterator
from contextlib import ExitStack, suppress
from dataclasses import replace
from filecmp import cmp
from pathlib import Path

from cubepath.coordinator.runs.contents import counted_processes
from cubepath.coordinator.tools.comparison.free import compare_free
from cubepath.coordinator.tools.comparison.lockstep import (
    ComparisonScope,
    FoundDifferences,
    SideBySide,
    message_difference,
)
from cubepath.coordinator.tools.comparison.moves import (
    Reading,
    compare_files,
    compare_paths,
    scenes_text,
    states_text,
)
from cubepath.coordinator.tools.comparison.reasons import explain_choice, explain_outcome
from cubepath.coordinator.tools.comparison.results import (
    NAMES,
    NO_ROUNDS,
    ChoiceDifference,
    MessageDifference,
    PathComparison,
    RunComparison,
)
from cubepath.coordinator.verification.round_spans import rounds_text
from cubepath.coordinator.verification.transcript import OutOfOrder
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.formatting import counted
from cubepath.protocol.core.input_files import InputFile, Source, opened
from cubepath.protocol.file_forms import NO_HINTS, PlanHints, form_of
from cubepath.protocol.recordings.recording import Recording, read_recording

COMPARED_KINDS = ("presence", "note", "claim", "verdict", "report", "edges", "cube", "summary")
"""The kinds of messages that are compared, in the order of a round and then of the end."""


def _range(asked: ComparisonScope) -> str:
    """Return the rounds that are asked for, as on the command line."""
    return f"{asked.first}..{'' if asked.last is None else asked.last}"


def check_asked(asked: ComparisonScope) -> None:
    """Check what is asked by itself; InputError."""
    if asked.first < 1 or (asked.last is not None and asked.last < asked.first):
        raise InputError(f"rounds={_range(asked)}: expected 1 or more, up")


def check_use(
    a: Recording | InputFile,
    b: Recording | InputFile,
    asked: ComparisonScope,
    system: str | None,
    hints: PlanHints,
) -> None:
    """Refuse what would make no difference for these two; InputError."""
    recordings = [each for each in (a, b) if isinstance(each, Recording)]
    if system is not None and len(recordings) == 2:
        raise InputError(
            f"system={system}: {a.path} and {b.path} are recordings, which say themselves what"
            " their system is: expected no system"
        )
    if hints != NO_HINTS and len(recordings) == 2:
        raise InputError(f"{a.path}, {b.path}: recordings, expected neither --format nor --with")
    free = next((each for each in recordings if each.clock == "free"), None)
    moves = next((each for each in (a, b) if not isinstance(each, Recording)), None)
    why = None
    if moves is not None:
        why = f"{moves.path} is no recording, so the moves alone are compared"
    elif free is not None:
        why = f"{free.path} is a run without rounds"
    if why is not None and asked.limited:
        raise InputError(f"rounds={_range(asked)}: {why}: expected no rounds")


def check_compared(side_by_side: SideBySide, asked: ComparisonScope) -> None:
    """Refuse two runs of which no round could be compared; InputError, OutOfOrder as for `go`.

    A run that ended before its first round has nothing that could differ, and is compared.
    """
    readings = side_by_side.readings
    none = any(reading.ended and not reading.spans for reading in readings)
    if side_by_side.found.compared or (none and not asked.limited):
        return
    side_by_side.read_on()
    lengths = [f"{reading.recording.path} has {_whole_rounds(reading)}" for reading in readings]
    where = f"rounds={_range(asked)}: " if asked.limited else ""
    raise InputError(f"{where}nothing to compare: {'; '.join(lengths)}")


def _whole_rounds(reading: Reading) -> str:
    """Return in words which rounds a run has."""
    if reading.spans:
        return rounds_text(reading.spans)
    why = [] if reading.cut is None else [reading.cut]
    why += [f"damaged: {problem}" for problem in reading.recording.problems[:1]]
    return ": ".join(["no round that all modules report", *why])


_OF_PROCESSES = re.compile(r"process_\d+")
_RESULTS = ("ended", "rounds", "moves", "reduced_moves", "cubes", "max_cube_dimension",
            "goal_reached", "path_digest")  # fmt: skip
"""What the coordinator says of a run, and does not depend on the machine."""


def diff(
    a: Recording | Source,
    b: Recording | Source,
    *,
    rounds: tuple[int, int | None] = (1, None),
    system: str | None = None,
    hints: PlanHints = NO_HINTS,
) -> RunComparison:
    """Return where two runs part, and why.

    The order is that of the run: by round, phase, kind and module, never by arrival, and not by how
    modules were dealt to processes. As the choices of a round can differ only by what differs
    before it, by the rule, or by what was drawn, the first choice that differs is where the runs
    part; its cause is found by asking the rule again.

    >>> found = diff("logs/golden/agv-6.mcap", "logs/golden/agv-6.mcap")
    >>> found.same, found.message, found.paths.moves
    (True, None, (40, 40))

    Args:
        a: a recording or its file, or any file of moves that `shorten` takes.
        b: the other one.
        rounds: the first and the last round to be compared; None is the last there is. Only of
            runs with rounds.
        system: the system that moves of a file of moves name; by default, beside a recording, that
            of the recording.
        hints: the format and the companion files of a plan, for the one that is a plan.

    A damaged recording, one that begins late, and one from which messages were taken are compared
    as far as they have what the other has, and `notes` says so.

    InputError if a file cannot be read, or is neither, if there is nothing to compare, as of runs
    of two families, and if `rounds` or `system` is of no use for these two; CheckError as for
    `shorten`.
    """
    asked = ComparisonScope(*rounds)
    check_asked(asked)
    with ExitStack() as stack:
        one, two = (_recording(each, stack) for each in (a, b))
        check_use(one, two, asked, system, hints)
        if not isinstance(one, Recording) or not isinstance(two, Recording):
            return compare_files(one, two, system, hints)
        parameters = _parameters(one, two)
        scene = scenes_text(one.scene, two.scene)
        if one.scene.family != two.scene.family:
            raise InputError(
                f"{one.path}, {two.path}: runs of {one.scene.family} and {two.scene.family}, which"
                " have nothing in common: expected two runs of one family"
            )
        if one.clock != two.clock:
            return replace(compare_files(one, two, system, hints), parameters=parameters)
        found = compare_free(one, two) if one.clock == "free" else _with_rounds(one, two, asked)
        # A recording that was read before may be another than the file now is.
        as_files = not isinstance(a, Recording) and not isinstance(b, Recording)
        identical = (found.same or as_files) and _identical(one.path, two.path)
        return replace(
            found,
            same=found.same or identical,
            identical=identical,
            parameters=parameters,
            scene=scene,
        )


def _with_rounds(one: Recording, two: Recording, asked: ComparisonScope) -> RunComparison:
    try:
        return _lockstep(one, two, asked, in_order=True)
    except OutOfOrder:
        return _lockstep(one, two, asked, in_order=False)


def _recording(source: Recording | Source, stack: ExitStack) -> Recording | InputFile:
    """Return a recording that was read already, or read it; of another file, the open file."""
    if isinstance(source, Recording):
        return source
    file = stack.enter_context(opened(source))
    return read_recording(file) if form_of(file).name == "recording" else file


def _parameters(a: Recording, b: Recording) -> dict[str, tuple[str | None, str | None]]:
    one, two = ({"format": each.format, **counted_processes(each)} for each in (a, b))
    return {
        key: (one.get(key), two.get(key)) for key in {**one, **two} if one.get(key) != two.get(key)
    }


def _identical(a: Path, b: Path) -> bool:
    """Return whether two files have the same bytes; False if they are no longer there."""
    with suppress(OSError):
        return cmp(a, b, shallow=False)
    return False


def _lockstep(
    a: Recording, b: Recording, asked: ComparisonScope, *, in_order: bool
) -> RunComparison:
    readings = Reading(a, in_order=in_order), Reading(b, in_order=in_order)
    side_by_side = SideBySide(*readings, asked)
    parting = side_by_side.go()
    check_compared(side_by_side, asked)
    if asked.last is None:
        _lack_results(readings, parting)
    notes = list(_notes(side_by_side))
    paths = _paths(side_by_side, notes)
    message = parting.message
    ends = None
    odd = readings[0].odd != readings[1].odd
    alone = any(parting.only)
    # To a part of a run neither its beginning nor its end counts.
    if asked.last is None:
        ends = _ends(readings)
    if message is None and not alone and not asked.limited:
        message = _results(readings)
    found = message, parting.outcome, parting.move
    differs = bool(parting.choices) or any(each is not None for each in found)
    # What is recorded in one run and was not compared is no difference, and may have been one.
    gaps = any(side_by_side.gaps(side) for side in (0, 1))
    missing = gaps or any(parting.lacking)
    late = readings[0].first != readings[1].first and asked.first < side_by_side.begin
    return RunComparison(
        a=str(a.path),
        b=str(b.path),
        clock="lockstep",
        same=not (differs or ends is not None or alone or odd or late or missing),
        compared=_compared(asked, side_by_side),
        notes=tuple(notes),
        message=message,
        choice=_choice((a, b), readings, parting, in_order=in_order),
        outcome=None if parting.outcome is None else explain_outcome(parting.outcome, a, b),
        move=parting.move,
        states=tuple(parting.states),
        rounds=tuple(parting.rounds),
        ends=ends,
        paths=paths,
        beginning=None if differs or odd or late or gaps else _beginning(readings, parting),
        limited=asked.limited
        or side_by_side.begin > 1
        or not all(reading.ended for reading in readings),
    )


def _choice(
    runs: tuple[Recording, Recording],
    readings: tuple[Reading, Reading],
    parting: FoundDifferences,
    *,
    in_order: bool,
) -> ChoiceDifference | None:
    if not parting.choices:
        return None
    # Of those who chose otherwise in that round first one who did more than note something else.
    number, _, module = min(
        (number, module not in parting.acted, module) for module, number in parting.choices.items()
    )
    one, two = (each.transcript.own_rules.get(module) for each in readings)
    found = explain_choice(
        lambda side: Reading(runs[side], in_order=in_order, first=readings[side].first),
        number,
        module,
        (one, two),
        parting.moved_apart,
    )
    others = (other for other, at in parting.choices.items() if at == number and other != module)
    return replace(found, also=tuple(sorted(others)))


def _lack_results(readings: tuple[Reading, Reading], parting: FoundDifferences) -> None:
    """Take down which results were left out of one run, and the other has."""
    for side, reading in enumerate(readings):
        own, other = (each.transcript for each in (reading, readings[1 - side]))
        if own.cubes:
            parting.present[side].add("cube")
        lacks = {"cube": len(own.cubes) < len(other.cubes)}
        lacks["summary"] = own.summary is None and other.summary is not None
        if reading.by_kind:
            parting.lacking[side].update(kind for kind, lost in lacks.items() if lost)


def _notes(side_by_side: SideBySide) -> Iterator[str]:
    parting = side_by_side.found
    for side, (name, reading) in enumerate(zip(NAMES, side_by_side.readings, strict=True)):
        yield from (f"{name} {what}" for what in _odd(reading))
        gaps = side_by_side.gaps(side)
        if gaps:
            yield f"{name} does not have {rounds_text(gaps)} as a whole: not compared"
        kinds = [kind for kind in COMPARED_KINDS if kind in parting.lacking[side]]
        some = [kind for kind in kinds if kind in parting.present[side]]
        none = [kind for kind in kinds if kind not in some]
        if none:
            yield f"{name} has no {', '.join(none)}: these were not compared"
        if some:
            yield f"{name} has not every {', '.join(some)}: those that it lacks were not compared"
    for side, number in sorted(parting.silent):
        yield (
            f"{NAMES[side]}: in round {number} nobody says what was noted before, as another rule"
            " begins in it, with other notes"
        )
    for side, more in enumerate(parting.only):
        if more:
            left = "" if parting.followed else "; they were not compared"
            rounds = counted(more, "more round")
            yield f"{NAMES[side]} continues for {rounds}, which {NAMES[1 - side]} lacks{left}"


def _odd(reading: Reading) -> Iterator[str]:
    """Yield what is odd with a recording, or missing."""
    for problem in reading.recording.problems:
        yield f"is damaged: {problem}"
    if reading.cut is not None:
        yield f"has {reading.cut}"
    for odd in reading.odd:
        yield f"is odd: {odd}"
    if reading.first > 1:
        yield f"begins in round {reading.first}"
    if reading.cut_off is not None and reading.cut is None:
        yield f"is cut off: {reading.cut_off}"


def _beginning(readings: tuple[Reading, Reading], parting: FoundDifferences) -> str | None:
    """Return the run after whose last round the other continues, if nothing of it was lost then."""
    if not any(parting.only):
        return None
    side = 0 if parting.only[1] else 1
    reading = readings[side]
    lost = reading.transcript.summary is not None and not reading.ended
    return None if lost else NAMES[side]


def _compared(asked: ComparisonScope, side_by_side: SideBySide) -> str:
    spans = side_by_side.found.compared
    if not spans:
        return NO_ROUNDS
    both = " (the first that both have)" if side_by_side.begin > asked.first else ""
    return f"{rounds_text(spans)}{both}"


def _paths(side_by_side: SideBySide, notes: list[str]) -> PathComparison | None:
    one, two = side_by_side.paths
    if side_by_side.broken:
        notes.append("rounds are missing in between: the paths are not compared as a whole")
        return None
    for name, path in zip(NAMES, (one, two), strict=True):
        if path.wrong is not None:
            notes.append(f"{name}: {path.wrong}: the paths are not compared as a whole")
    if one.wrong is not None or two.wrong is not None:
        return None
    scenes = [reading.recording.scene for reading in side_by_side.readings]
    starts = side_by_side.starts or (scenes[0].start_state, scenes[1].start_state)
    end = states_text(*side_by_side.ends())
    return compare_paths(one.actions, two.actions, starts, end, identical=one.identical(two))


def _ends(readings: tuple[Reading, Reading]) -> tuple[str, str] | None:
    """Return how the runs ended, if otherwise; what a process is called does not count."""
    endings: list[str] = []
    for reading in readings:
        summary = reading.transcript.summary
        if summary is None:
            endings.append("not on record")
            continue
        error = "" if summary.error is None else f": {summary.error}"
        endings.append(f"{summary.ended} after round {summary.rounds}{error}")
    alike = {_OF_PROCESSES.sub("process", each) for each in endings}
    return (endings[0], endings[1]) if len(alike) > 1 else None


def _results(readings: tuple[Reading, Reading]) -> MessageDifference | None:
    """Return what the coordinator says of two runs in which modules sent and did the same."""
    one, two = (reading.transcript for reading in readings)
    if one.summary is None or two.summary is None:
        return None
    for cube, other in zip(one.result, two.result, strict=False):
        if cube != other:
            return message_difference(cube.round, "cube", None, cube, other)
    if any(getattr(one.summary, key) != getattr(two.summary, key) for key in _RESULTS):
        found = message_difference(one.summary.round, "summary", None, one.summary, two.summary)
        return replace(found, fields=tuple(name for name in found.fields if name in _RESULTS))
    return None
