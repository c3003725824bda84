"""Comparing two runs: what differs first, and why.

Room: coordinator. Recordings of runs with rounds are gone through round by round; of runs without
rounds what follows from versions is compared; of anything else, and of a run with rounds and one
without, the moves are.
"""

from __future__ import annotations

import re
from collections.abc import Collection
from dataclasses import replace
from pathlib import Path

import msgspec

from cubepath.coordinator.comparison.lockstep import Asked, Parting, SideBySide
from cubepath.coordinator.comparison.moves import (
    compare_files,
    compare_paths,
    scenes_text,
)
from cubepath.coordinator.comparison.reading import Reading
from cubepath.coordinator.comparison.reasons import NAMES, explain_choice, explain_outcome
from cubepath.coordinator.comparison.results import (
    ChoiceDifference,
    Compared,
    MessageDifference,
    Paths,
)
from cubepath.coordinator.verification.transcript import OutOfOrder
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.input_files import STANDARD_INPUT, Source, opened
from cubepath.protocol.recordings.recording import Recording, is_recording, read_recording
from cubepath.protocol.wire.messages import KINDS, Summary

_OF_PROCESSES = re.compile(r"process_\d+")
_RESULTS = ("ended", "rounds", "moves", "reduced_moves", "cubes", "max_cube_dimension",
            "goal_reached", "path_digest")  # fmt: skip
"""What the coordinator says of a run, and does not depend on the machine."""


def diff(
    a: Recording | Source,
    b: Recording | Source,
    *,
    ignore: Collection[str] = (),
    context: int = 0,
    rounds: tuple[int, int | None] = (1, None),
    system: str | None = None,
) -> Compared:
    """Return where two runs part, and why.

    The order is that of the run: by round, phase, kind and module, never by arrival, and not by how
    modules were dealt to processes. As the choices of a round can differ only by what differs
    before it, by the rule, or by what was drawn, the first choice that differs is where the runs
    part; its cause is found by asking the rule again.

    >>> found = diff("logs/golden/agv-6.mcap", "logs/golden/agv-6.mcap")
    >>> found.same, found.message, found.paths.moves
    (True, None, (38, 38))

    Args:
        a: a recording or its file, or any file of moves that `shorten` takes.
        b: the other one.
        ignore: parameters that are not listed, and kinds of messages that are not compared.
        context: so many messages before and after the first that differs are told, of its round.
        rounds: the first and the last round to be compared; None is the last there is. Of runs
            without rounds these are levels.
        system: the system that moves of a file of moves name.

    InputError if a file cannot be read, or is neither; CheckError as for `shorten`. A damaged
    recording is compared as far as it can be read, and `notes` says so.
    """
    _check_asked(context, rounds)
    one, two = (_recording(each) for each in (a, b))
    if not isinstance(one, Recording) or not isinstance(two, Recording):
        return _moves_alone(one, two, system)
    if one.clock != two.clock:
        return replace(_moves_alone(one, two, system), parameters=_parameters(one, two, ignore))
    found = _compared_runs(one, two, ignore, context, rounds)
    return replace(
        found,
        identical=_identical(one.path, two.path),
        parameters=_parameters(one, two, ignore),
        scene=scenes_text(one.scene, two.scene),
    )


def _compared_runs(
    one: Recording,
    two: Recording,
    ignore: Collection[str],
    context: int,
    rounds: tuple[int, int | None],
) -> Compared:
    """Compare two runs under one clock."""
    if one.clock == "free":
        from cubepath.coordinator.comparison.free import compare_free  # noqa: PLC0415 - seldom

        return compare_free(one, two, rounds)
    asked = Asked(rounds[0], rounds[1], frozenset(ignore) & KINDS.keys(), context)
    try:
        return _lockstep(one, two, asked, in_order=True)
    except OutOfOrder:
        return _lockstep(one, two, asked, in_order=False)


def _check_asked(context: int, rounds: tuple[int, int | None]) -> None:
    first, last = rounds
    if context < 0:
        raise InputError(f"context={context}: expected 0 or more")
    if first < 1 or (last is not None and last < first):
        raise InputError(f"rounds={first}..{'' if last is None else last}: expected 1 or more, up")


def _recording(source: Recording | Source) -> Recording | Source:
    """Return a recording that was read already, or read it; what is none stays as it is."""
    if isinstance(source, Recording):
        return source
    with opened(source) as file:
        return read_recording(file) if is_recording(file) else source


def _name(source: Recording | Source) -> str:
    path = (
        source if isinstance(source, str) else source if isinstance(source, Path) else source.path
    )
    return "standard input" if path == STANDARD_INPUT else str(path)


def _moves_alone(a: Recording | Source, b: Recording | Source, system: str | None) -> Compared:
    move, paths, scene = compare_files(a, b, system)
    return Compared(
        _name(a),
        _name(b),
        clock="moves",
        same=paths.identical,
        identical=False,
        parameters={},
        scene=scene,
        compared="the moves, in their order; nothing else is in both",
        notes=(),
        move=move,
        paths=paths,
    )


def _parameters(
    a: Recording, b: Recording, ignore: Collection[str]
) -> dict[str, tuple[str | None, str | None]]:
    one = {"format": a.format, **a.parameters}
    two = {"format": b.format, **b.parameters}
    return {
        key: (one.get(key), two.get(key))
        for key in {**one, **two}
        if one.get(key) != two.get(key) and key not in ignore
    }


def _identical(a: Path, b: Path) -> bool:
    """Return whether two files have the same bytes; False if they are no longer there."""
    try:
        if a.stat().st_size != b.stat().st_size or not (a.is_file() and b.is_file()):
            return False
        with a.open("rb") as one, b.open("rb") as two:
            while (block := one.read(1 << 20)) == two.read(1 << 20):
                if not block:
                    return True
    except OSError:
        pass
    return False


def _lockstep(a: Recording, b: Recording, asked: Asked, *, in_order: bool) -> Compared:
    readings = Reading(a, in_order=in_order), Reading(b, in_order=in_order)
    side_by_side = SideBySide(*readings, asked)
    parting = side_by_side.go()
    notes = list(_notes(readings, parting))
    paths = _paths(side_by_side, notes)
    message = parting.message
    ends = None
    odd = readings[0].odd != readings[1].odd
    if asked.last is None and "summary" not in asked.ignored:
        ends = _ends(readings)
        if message is None and not any(parting.only):
            message = _results(readings)
    same = message is None and not parting.choices and parting.outcome is None
    same = same and ends is None and not any(parting.only) and not odd
    choice = _choice((a, b), readings, parting, in_order=in_order)
    return Compared(
        _name(a),
        _name(b),
        clock="lockstep",
        same=same,
        identical=False,
        parameters={},
        scene=None,
        compared=_compared(asked, parting),
        notes=tuple(notes),
        message=message,
        choice=choice,
        outcome=None if parting.outcome is None else explain_outcome(parting.outcome, a, b),
        move=parting.move,
        parted=dict(sorted(parting.choices.items(), key=lambda each: (each[1], each[0]))),
        states=tuple(parting.states),
        rounds=tuple(parting.rounds),
        ends=ends,
        paths=paths,
    )


def _choice(
    runs: tuple[Recording, Recording],
    readings: tuple[Reading, Reading],
    parting: Parting,
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
        lambda side: Reading(runs[side], in_order=in_order),
        number,
        module,
        (one, two),
        parting.moved_apart,
    )
    others = (other for other, at in parting.choices.items() if at == number and other != module)
    return replace(found, also=tuple(sorted(others)))


def _notes(readings: tuple[Reading, Reading], parting: Parting) -> list[str]:
    notes: list[str] = []
    for name, reading in zip(NAMES, readings, strict=True):
        notes += [f"{name}: {problem}" for problem in reading.recording.problems]
        notes += [f"{name}: {odd}" for odd in reading.odd]
        if reading.cut_off is not None:
            notes.append(f"{name} is cut off: {reading.cut_off}")
    for side, more in enumerate(parting.only):
        if more:
            rounds = "1 more round" if more == 1 else f"{more} more rounds"
            notes.append(f"{NAMES[side]} goes on for {rounds}, which {NAMES[1 - side]} has not")
    if parting.unsaid is not None:
        number, side = parting.unsaid
        notes.append(f"{NAMES[side]} has no edges of round {number}: these were not compared")
    return notes


def _compared(asked: Asked, parting: Parting) -> str:
    if not parting.compared:
        return "no round: there is none that both have whole"
    return f"rounds {asked.first} to {parting.compared}"


def _paths(side_by_side: SideBySide, notes: list[str]) -> Paths | None:
    one, two = side_by_side.paths
    for name, path in zip(NAMES, (one, two), strict=True):
        if path.wrong is not None:
            notes.append(f"{name}: {path.wrong}: the paths are not compared as a whole")
    if one.wrong is not None or two.wrong is not None:
        return None
    scenes = [reading.recording.scene for reading in side_by_side.readings]
    starts = scenes[0].start_state, scenes[1].start_state
    ends = side_by_side.ends()
    return compare_paths(one.actions, two.actions, starts, ends, identical=one.identical(two))


def _ends(readings: tuple[Reading, Reading]) -> tuple[str, str] | None:
    """Return how the runs ended, if otherwise; what a process is called does not count."""
    told: list[str] = []
    for reading in readings:
        summary = reading.transcript.summary
        if summary is None:
            told.append("not on record")
            continue
        error = "" if summary.error is None else f": {summary.error}"
        told.append(f"{summary.ended} after round {summary.rounds}{error}")
    alike = {_OF_PROCESSES.sub("process", each) for each in told}
    return (told[0], told[1]) if len(alike) > 1 else None


def _results(readings: tuple[Reading, Reading]) -> MessageDifference | None:
    """Return what the coordinator says of two runs in which modules said and did the same."""
    one, two = (reading.transcript for reading in readings)
    if one.summary is None or two.summary is None:
        return None
    for cube, other in zip(one.result, two.result, strict=False):
        if cube != other:
            return _message("cube", cube.round, cube, other)
    if any(getattr(one.summary, key) != getattr(two.summary, key) for key in _RESULTS):
        return _message("summary", one.summary.round, one.summary, two.summary)
    return None


def _message(kind: str, number: int, a: msgspec.Struct, b: msgspec.Struct) -> MessageDifference:
    one, two = (msgspec.to_builtins(each) for each in (a, b))
    names = [*one, *(name for name in two if name not in one)]
    if isinstance(a, Summary):
        names = [name for name in names if name in _RESULTS]
    fields = tuple(name for name in names if one.get(name) != two.get(name))
    return MessageDifference(number, kind, None, one, two, fields)
