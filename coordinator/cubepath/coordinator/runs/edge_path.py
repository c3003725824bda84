"""The edge path of a run as it was gathered, and its normal cube path.

Runs with and without rounds are gathered differently and read alike: levels take the place of
rounds.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from array import array
from bisect import bisect_right
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from hashlib import sha256
from typing import Any, TypeVar, overload

import msgspec
import numpy as np
from numpy.typing import NDArray

from cubepath.coordinator.normal_form.admissibility import InadmissibleMove, carried_out
from cubepath.coordinator.normal_form.compiled_heap import FastHeap
from cubepath.protocol.core.actions import Action, why_inadmissible
from cubepath.protocol.core.catalogue import GeneratorPlacement
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.sites import Site
from cubepath.protocol.core.system import Scene
from cubepath.protocol.path_files.durations import Cubes
from cubepath.protocol.path_files.numbered import NumberedPath, number_names
from cubepath.protocol.wire.messages import Executed

_encode = msgspec.json.Encoder().encode


@dataclass(frozen=True, slots=True)
class Step:
    """One round of the edge path: the moves executed in it, in increasing order of movers.

    Without rounds it is a level, and its moves are ordered by generator and place. `failures` holds
    the modules that gave up in it, in increasing order, each with its reason.
    """

    round: int
    executed: tuple[Executed, ...]
    actions: tuple[Action, ...]
    failures: tuple[tuple[int, str], ...] = ()


class PathDigest:
    """SHA-256 over an edge path in canonical order: by round, then by mover.

    Without rounds the order is that of levels, and in a level by generator and place.

    Each move is one line of compact JSON: ``[round, module, generator, at]`` and a newline.
    """

    def __init__(self) -> None:
        self._hash = sha256()

    def add(self, round_number: int, executed: Iterable[Executed]) -> None:
        """Append the moves of a round."""
        for move in executed:
            line = [round_number, move.module, move.generator, move.at]
            self._hash.update(_encode(line) + b"\n")

    def text(self) -> str:
        """Return the digest so far in hexadecimal."""
        return self._hash.copy().hexdigest()


class EdgePath:
    """The edge path of a run in arrays: for each move its mover and the number of its name.

    A name is a generator and a place as it was reported. There are few of them, so a move takes
    6 bytes, and its action and its name are objects that all moves of that name share.
    """

    def __init__(self, scene: Scene) -> None:
        self._system = scene.system
        self._numbers: dict[bytes, int] = {}
        self.placed: list[GeneratorPlacement] = []
        self.actions: list[Action] = []
        """The name of each number, and its action."""
        self.movers = array("H" if len(scene.start) <= 1 << 16 else "i")
        self.names = array("i")
        self.ends = array("q")
        """The number of moves up to the end of each round."""
        self.failures: dict[int, tuple[tuple[int, str], ...]] = {}
        """The modules that gave up, by the place of the round."""

    def name(self, placed: GeneratorPlacement) -> int:
        """Return the number of a name; InputError if the system has no such move."""
        key = _encode(placed)
        found = self._numbers.get(key)
        if found is None:
            action = self._system.read_action(placed)
            found = self._numbers[key] = len(self.actions)
            self.placed.append(placed)
            self.actions.append(action)
        return found

    def ordered(self, order: NDArray[np.int64], sizes: NDArray[np.int64]) -> EdgePath:
        """Return the path with its moves in another order, in rounds of these sizes."""
        found = EdgePath.__new__(EdgePath)
        found.__dict__.update(self.__dict__, failures={})
        found.movers = array(self.movers.typecode, np.array(self.movers)[order].tobytes())
        found.names = array("i", np.array(self.names, np.int32)[order].tobytes())
        found.ends = array("q", np.cumsum(sizes, dtype=np.int64).tobytes())
        return found

    def numbered(self) -> NumberedPath:
        """Return the path with each distinct action once, however many names it has."""
        moves = np.frombuffer(self.names, dtype=np.int32).copy()
        return number_names(self.placed, self.actions, moves)

    def round_of(self, move: int) -> int:
        """Return the round of a move, by its place from 0."""
        return bisect_right(self.ends, move) + 1

    def step(self, place: int) -> Step:
        """Return a round, by its place from 0."""
        begin, end = self.ends[place - 1] if place else 0, self.ends[place]
        movers, names = self.movers[begin:end], self.names[begin:end]
        executed = tuple(
            Executed(mover, self.placed[name].generator, self.placed[name].at)
            for mover, name in zip(movers, names, strict=True)
        )
        actions = tuple(self.actions[name] for name in names)
        return Step(place + 1, executed, actions, self.failures.get(place, ()))


T_co = TypeVar("T_co", covariant=True)


class _View(Sequence[T_co]):
    """Things that are made when they are asked for, by their place; the last one made is kept."""

    def __init__(self, count: int, make: Callable[[int], T_co]) -> None:
        self._places = range(count)
        self._make = make
        self._kept: tuple[int, T_co] | None = None

    def __len__(self) -> int:
        return len(self._places)

    @overload
    def __getitem__(self, index: int) -> T_co: ...

    @overload
    def __getitem__(self, index: slice) -> Sequence[T_co]: ...

    def __getitem__(self, index: int | slice) -> T_co | Sequence[T_co]:
        if isinstance(index, slice):
            return [self._make(place) for place in self._places[index]]
        place = self._places[index]
        if self._kept is None or self._kept[0] != place:
            self._kept = place, self._make(place)
        return self._kept[1]


class Gathered(ABC):
    """The edge path of a run as far as it was gathered, and what follows from it."""

    scene: Scene
    sites: list[Site]
    """Where each module stands at its end."""

    @property
    @abstractmethod
    def _edges(self) -> EdgePath:
        """Return the edge path in canonical order."""

    @property
    @abstractmethod
    def heap(self) -> FastHeap:
        """Return the heap of the moves so far; they are added to it only when it is asked for."""

    @property
    @abstractmethod
    def digest(self) -> str:
        """Return the digest of the edge path so far."""

    @property
    @abstractmethod
    def failed(self) -> str | None:
        """Return which module gave up, and why; None if none did."""

    @property
    @abstractmethod
    def unfinished(self) -> str | None:
        """Return in one line what is known to be missing in the middle; None if nothing is."""

    @property
    def rounds(self) -> int:
        """Return the number of complete rounds, or the greatest level."""
        return len(self._edges.ends)

    @property
    def moves(self) -> int:
        """Return the number of moves so far."""
        return len(self._edges.names)

    @property
    def live(self) -> FastHeap:
        """Return a heap of the same moves that costs little to ask for while the run continues."""
        return self.heap

    @property
    def steps(self) -> Sequence[Step]:
        """Return the complete rounds, or the levels; each is made when it is asked for."""
        edges = self._edges
        return _View(len(edges.ends), edges.step)

    @property
    def path(self) -> Sequence[Action]:
        """Return the edge path as one sequence of actions, which takes no extra memory."""
        actions, names = self._edges.actions, self._edges.names
        return _View(len(names), lambda place: actions[names[place]])

    @property
    def placed(self) -> Sequence[GeneratorPlacement]:
        """Return the edge path, each move as a generator and a place."""
        placed, names = self._edges.placed, self._edges.names
        return _View(len(names), lambda place: placed[names[place]])

    @property
    def numbered(self) -> NumberedPath:
        """Return the edge path in numbers."""
        return self._edges.numbered()

    def checked_path(self) -> NumberedPath:
        """Return the edge path in numbers, with the local state from which each move goes.

        InputError names the first move that is not admissible, by its round and module.
        """
        edges, path = self._edges, self.numbered
        found = carried_out(path, self.scene.start_state)
        if isinstance(found, InadmissibleMove):
            where = f"round {edges.round_of(found.move)}, module_{edges.movers[found.move]}"
            why = why_inadmissible(path.each_action[found.move], found.state)
            raise InputError(f"{where}: {why}")
        return found

    @property
    def sizes(self) -> tuple[int, ...]:
        """Return the number of moves of each round, or of each level."""
        return tuple(np.diff(self._edges.ends, prepend=0).tolist())

    @property
    def reached(self) -> bool:
        """Return whether the modules are at the goal."""
        return self.scene.reached(self.sites)

    @property
    def figures(self) -> dict[str, Any]:
        """Return the numbers that summaries and outcomes have of the path, by their names there."""
        heap = self.heap
        return {
            "rounds": self.rounds,
            "moves": heap.moves,
            "reduced_moves": heap.reduced_moves,
            "cubes": heap.cubes,
            "max_cube_dimension": heap.max_cube_dimension,
            "goal_reached": self.reached,
            "path_digest": self.digest,
        }

    def cubes(self) -> Iterator[tuple[GeneratorPlacement, ...]]:
        """Yield the normal cube path cube by cube, each move by its generator and its place."""
        path = self._edges
        # Of several names of an action the one that was reported last.
        last = np.zeros(len(path.actions), dtype=np.int64)
        last[np.frombuffer(path.names, dtype=np.int32)] = np.arange(len(path.names))
        placed = {path.actions[name]: path.placed[name] for name in np.argsort(last).tolist()}
        for cube in self.heap.each_cube():
            yield tuple(placed[action] for action in cube)

    def schedule(self) -> Cubes:
        """Return the normal cube path, each move by its generator and its place."""
        return tuple(self.cubes())
