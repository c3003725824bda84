"""Shortening a path: its normal cube path, from its file and nothing else.

The heap of pieces is built here, once for each path. Cubes, certificate and timetable are read from
the level and the partner that each move got.
"""

import time
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from cubepath.coordinator.normal_form.array_heap import NormalForm
from cubepath.coordinator.normal_form.compiled_heap import cubes_of, normal_form_of
from cubepath.coordinator.plugins import plugin
from cubepath.coordinator.shortening.path_input import HasPath, PathInput, input_of, read_input
from cubepath.protocol.core.actions import Action, apply_in_place
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.system import Bound
from cubepath.protocol.displays import Displayed
from cubepath.protocol.file_forms import NO_HINTS, PlanHints
from cubepath.protocol.path_files.moves import CubeName
from cubepath.protocol.path_files.numbered import NumberedCubes, NumberedPath, Progress

_T = TypeVar("_T")


@dataclass(frozen=True, eq=False)
class Shortened(Displayed):
    """The normal cube path of a path, and the figures that ``cubepath shorten --json`` gives.

    `given` is the input path, `normal_form` says what became of each of its moves, and `left` holds
    the remaining moves, cube by cube. `seconds` is how long reading and shortening took.
    """

    given: PathInput
    normal_form: NormalForm
    left: NumberedCubes
    seconds: float

    @property
    def path(self) -> NumberedPath:
        """The moves of the input."""
        return self.given.numbered

    @property
    def moves(self) -> int:
        """The number of moves in the input."""
        return len(self.path.numbers)

    @property
    def reduced_moves(self) -> int:
        """The number of moves that are left after cancellation."""
        return len(self.left.moves)

    @property
    def cubes(self) -> int:
        """The number of cubes."""
        return len(self.left.starts) - 1

    @property
    def max_cube_dimension(self) -> int:
        """The greatest dimension of a cube, 0 if there is no cube."""
        return int(np.diff(self.left.starts).max(initial=0))

    @property
    def planner_rounds(self) -> int | None:
        """The number of rounds that the planner itself counts, None if the plan does not say."""
        return self.given.planner_rounds

    @cached_property
    def bound(self) -> Bound:
        """How many cubes any path between the same states has at least, and why.

        The cheap bounds of `lower_bound`; `beyond` looks for better ones. 0 where the start is not
        known, as for moves with only a support and a trace.
        """
        start = self.given.start
        if start is None:
            return Bound(0, "the start is not known")
        state = set(start)
        for cube in self.cube_path:
            for action in cube:
                apply_in_place(action, state)
        scene = self.given.scene
        system = None if scene is None else scene.system
        found: Bound = plugin("lower_bound")(system, start, frozenset(state), within=self.cubes)
        return found

    @cached_property
    def cube_path(self) -> tuple[tuple[Action, ...], ...]:
        """The cubes as actions."""
        actions, numbers = self.path.actions, self.path.numbers[self.left.moves]
        return self._cubes([actions[number] for number in numbers.tolist()])

    @cached_property
    def named(self) -> tuple[tuple[CubeName, ...], ...]:
        """The cubes, with each move named as in a cubes file, which is as in the input.

        An id that also stands for other contents is followed by the number of the move.
        """
        return self._cubes(self.path.cube_names(self.left.moves))

    def _cubes(self, each: Sequence[_T]) -> tuple[tuple[_T, ...], ...]:
        starts = self.left.starts.tolist()
        return tuple(tuple(each[begin:end]) for begin, end in pairwise(starts))

    def document(self) -> dict[str, Any]:
        """Return the keys of ``--json``."""
        keys = (
            "moves",
            "reduced_moves",
            "cubes",
            "max_cube_dimension",
            "planner_rounds",
            "seconds",
        )
        return {key: getattr(self, key) for key in keys}


def shorten(
    path: str | Path | HasPath,
    *,
    system: str | None = None,
    format: str | None = None,  # noqa: A002 - the word of the command line
    companions: Sequence[str | Path] = (),
    progress: Progress | None = None,
) -> Shortened:
    """Return the normal cube path of the path in a file.

    An empty file is a path of no moves, which gives a path of no cubes. Instead of a file, the
    path may be that of a run in memory: what `run` or `play` returned.

    Args:
        path: a recording, a moves file, a scenario, or another program's plan.
        system: the system that the moves of a moves file or a plain list name.
        format: of a plan, if its content does not say: ``NAME`` or ``NAME:key=value,...``.
        companions: the files that a plan refers to: its map, benchmark scenario or instance.
        progress: is called with numbers of moves that were read.

    InputError if the file cannot be read, is damaged, or holds a move that is not admissible, and
    if something is given that it has no use for; CheckError if the reports of a recording
    contradict each other.

    >>> from cubepath.agents import play
    >>> played = play("agv:graph=grid4x4,n=4", "random", seed=2, max_rounds=50)
    >>> found = shorten(played)
    >>> found.moves, found.reduced_moves, found.cubes, found.bound.cubes
    (128, 50, 20, 3)
    """
    if not isinstance(format, str | None):  # pyright: ignore[reportUnnecessaryIsInstance]
        raise InputError(f"format={format!r}: expected the name of a format")
    if isinstance(companions, str | Path) or not all(isinstance(f, str | Path) for f in companions):  # pyright: ignore[reportUnnecessaryIsInstance]
        raise InputError(f"companions={companions!r}: expected a list of files")
    hints = PlanHints(format, tuple(map(Path, companions)))
    if path == "":
        raise InputError("path='': expected the path of a file")
    if isinstance(path, str | Path):
        return shortened(read_input(Path(path), system, hints, progress))
    if not isinstance(path, HasPath):  # pyright: ignore[reportUnnecessaryIsInstance]
        raise InputError(f"path={path!r}: expected a file, or what `run` or `play` returned")
    if system is not None or hints != NO_HINTS:
        raise InputError(f"{path.scene.spec}: a path that was played, which needs no other input")
    return shortened(input_of(path, progress))


def shortened(given: PathInput) -> Shortened:
    """Return the normal cube path of a path that has been read."""
    began = time.perf_counter()
    numbered = given.numbered
    found = normal_form_of(numbered)
    left = cubes_of(found, numbered)
    seconds = given.seconds + time.perf_counter() - began
    return Shortened(given, found, left, round(seconds, 3))
