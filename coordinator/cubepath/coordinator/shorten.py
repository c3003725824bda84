"""Shortening a path from a file: a recording, a moves file, or a scenario with its moves.

Room: coordinator. What the file says is checked as far as it can be before anything is made of
it; the normal cube path itself is `cubepath.coordinator.heap`.
"""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any

import msgspec

from cubepath.coordinator.gather import gathered
from cubepath.coordinator.heap import Heap
from cubepath.protocol.actions import Action, apply_in_place
from cubepath.protocol.errors import InputError
from cubepath.protocol.graph_system import GraphSystem
from cubepath.protocol.graphs import scenario_from_json
from cubepath.protocol.messages import Placed
from cubepath.protocol.moves import MoveName, PathMove, id_of, read_moves
from cubepath.protocol.recording import read_recording
from cubepath.protocol.scenes import scene_from_spec
from cubepath.protocol.sites import Site, in_order
from cubepath.protocol.systems import local_only

Progress = Callable[[int], object]
"""Called now and then with how many moves have come in since the last call."""

_MAGIC = b"\x89MCAP0\r\n"
_STARTS = re.compile(rb'"starts"\s*:')
_MOVES_A_TICK = 1000


@dataclass(frozen=True, slots=True)
class Shortened:
    """The normal cube path of a path, and the figures that ``cubepath shorten --json`` gives.

    `named` is the cube path with each move as a cubes file has it: as the input names it.
    """

    moves: int
    reduced_moves: int
    cubes: int
    max_cube_dimension: int
    seconds: float
    cube_path: tuple[tuple[Action, ...], ...]
    named: tuple[tuple[MoveName, ...], ...]

    def document(self) -> dict[str, Any]:
        """Return the keys of ``--json``."""
        keys = ("moves", "reduced_moves", "cubes", "max_cube_dimension", "seconds")
        return {key: getattr(self, key) for key in keys}


def shorten(
    path: Path, *, system: str | None = None, progress: Progress | None = None
) -> Shortened:
    """Return the normal cube path of the path in a file; what the file is, its content tells.

    A recording begins with the magic of MCAP, a scenario is a JSON object with "starts", and all
    else is a moves file, whose generators are those of `system`. An empty file is a path of no
    moves, and that a path of no cubes.

    InputError where the file cannot be read, is damaged, or holds a move that is not admissible;
    CheckError where the reports of a recording contradict each other.
    """
    began = time.perf_counter()
    _, moves = moves_of(path, system)
    heap = Heap()
    placed: dict[Action, Placed] = {}
    for move in moves if progress is None else _told(moves, progress):
        heap.append(move.action)
        if isinstance(move.name, Placed):
            placed.setdefault(move.action, move.name)
    cubes = heap.cube_path()
    # Equal actions may have different ids: each piece that is left bears its own as its label.
    named = tuple(tuple(placed.get(action) or id_of(action) for action in cube) for cube in cubes)
    return Shortened(
        moves=heap.moves,
        reduced_moves=heap.reduced_moves,
        cubes=heap.cubes,
        max_cube_dimension=heap.max_cube_dimension,
        seconds=round(time.perf_counter() - began, 3),
        cube_path=cubes,
        named=named,
    )


def moves_of(path: Path, system: str | None = None) -> tuple[str, Iterator[PathMove]]:
    """Return what a file is, "recording", "scenario" or "moves", and its moves in order.

    Each move is checked when its turn comes; `shorten` says what is refused.
    """
    kind = _kind(path)
    if system is not None and kind != "moves":
        what = "recording" if kind == "recording" else "scenario"
        raise InputError(
            f"{path}: a {what}, which says itself what its system is: expected no --system"
        )
    if kind == "recording":
        return kind, _recorded(path)
    if kind == "scenario":
        return kind, _planned(path)
    scene = None if system is None else local_only(scene_from_spec(system), "shortening")
    return kind, read_moves(path, scene)


def _told(moves: Iterable[PathMove], progress: Progress) -> Iterator[PathMove]:
    rest = iter(moves)
    while some := list(islice(rest, _MOVES_A_TICK)):
        yield from some
        progress(len(some))


def _kind(path: Path) -> str:
    """Return "recording", "scenario" or "moves", by content."""
    try:
        with path.open("rb") as stream:
            head = stream.read(len(_MAGIC))
            # Of a recording that was cut off at once, what is left is the magic's beginning.
            if head and _MAGIC.startswith(head):
                return "recording"
            stream.seek(0)
            first = next((line for line in stream if line.strip()), b"")
            if _STARTS.search(first):
                return "scenario"
            # An object over many lines is no moves file, but may be a scenario.
            if first.lstrip().startswith(b"{") and not _is_json(first):
                return "scenario" if _STARTS.search(stream.read()) else "moves"
    except OSError as error:
        raise InputError(f"{path}: {error.strerror or error}") from None
    return "moves"


def _is_json(text: bytes) -> bool:
    try:
        msgspec.json.decode(text)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError):
        return False
    return True


def _recorded(path: Path) -> Iterator[PathMove]:
    """Yield the moves of the complete rounds of a recording, from its reports."""
    recording = read_recording(path)
    if recording.problems:
        raise InputError(
            f"{path}: {'; '.join(recording.problems)}."
            f" 'cubepath verify {path} --recover OUT' writes what can be read"
        )
    gatherer = gathered(recording)
    if gatherer.begun > gatherer.rounds + 1:
        raise InputError(
            f"{path}: round {gatherer.rounds + 1} is not complete, but there are reports of"
            f" round {gatherer.begun}: expected all rounds up to the last"
        )
    state = set(recording.scene.start_state)
    for step in gatherer.steps:
        for executed, action in zip(step.executed, step.actions, strict=True):
            try:
                apply_in_place(action, state)
            except InputError as error:
                raise InputError(
                    f"{path}: round {step.round}, module_{executed.module}: {error}"
                ) from None
            yield PathMove(action, Placed(executed.generator, executed.at))


def _planned(path: Path) -> Iterator[PathMove]:
    """Yield the moves of a scenario's vehicles, each checked on the grid from the starts on."""
    scenario = scenario_from_json(path)
    taken, free = set(scenario.starts), set(scenario.graph.vertices)
    edges = set(scenario.graph.edges)
    actions: dict[tuple[Site, ...], Action] = {}
    for number, (source, target) in enumerate(scenario.moves, 1):
        try:
            for cell in (source, target):
                _expect(cell in free, f"{_text(cell)} is an obstacle or outside, expected free")
            beside = (source, target) in edges or (target, source) in edges
            _expect(beside, "no edge of the grid, expected a step to a cell beside")
            _expect(source in taken, f"{_text(source)} is empty, expected a vehicle")
            _expect(target not in taken, f"{_text(target)} is occupied, expected it empty")
        except InputError as error:
            where = f"{path}: move {number}, {_text(source)} to {_text(target)}"
            raise InputError(f"{where}: {error}") from None
        taken.remove(source)
        taken.add(target)
        ends = in_order((source, target))
        # The system of one edge says what its action is; that of a large grid takes long to make.
        action = actions.get(ends) or GraphSystem(ends, [(source, target)]).action("edge", ends)
        actions[ends] = action
        yield PathMove(action, Placed("edge", ends))


def _expect(holds: bool, otherwise: str) -> None:  # noqa: FBT001 - reads as a sentence
    if not holds:
        raise InputError(otherwise)


def _text(site: Site) -> str:
    return msgspec.json.encode(site).decode()
