"""Gathering: from the reports of modules, in any order of arrival, to the edge path of a run.

Room: coordinator. A round is released when every module has reported it, so the result depends on
no clock and no order of arrival; a report that arrives twice counts once. What no module can have
done, given where all of them stood, is not gathered.
"""

from __future__ import annotations

from array import array
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from hashlib import sha256
from typing import TypeVar, overload

import msgspec
import numpy as np

from cubepath.coordinator.normal_form.compiled_heap import FastHeap
from cubepath.coordinator.runs.plausibility import Plausibility
from cubepath.protocol.core.actions import Action
from cubepath.protocol.core.errors import CheckError, CubepathError, InputError
from cubepath.protocol.core.names import GeneratorPlacement
from cubepath.protocol.core.sites import Site, site_from_json
from cubepath.protocol.core.system import Scene
from cubepath.protocol.path_files.schedules import Cubes
from cubepath.protocol.recordings.recording import Recording
from cubepath.protocol.wire.messages import Executed, Report, decode

_encode = msgspec.json.Encoder().encode


@dataclass(frozen=True, slots=True)
class Step:
    """One round of the edge path: the moves executed in it, in increasing order of movers.

    `failures` holds the modules that gave up in it, in increasing order, each with its reason.
    """

    round: int
    executed: tuple[Executed, ...]
    actions: tuple[Action, ...]
    failures: tuple[tuple[int, str], ...] = ()


class PathDigest:
    """SHA-256 over an edge path in canonical order: by round, then by mover.

    Each move is one line of compact JSON: ``[round, module, generator, at]`` and a newline.
    """

    def __init__(self) -> None:
        """Begin with the empty path."""
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
        """Begin with the empty path."""
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
            action = self._system.action(placed.generator, site_from_json(placed.at))
            found = self._numbers[key] = len(self.actions)
            self.placed.append(placed)
            self.actions.append(action)
        return found

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


class Gatherer:
    """Gathers reports into the edge path and keeps its normal cube path as moves come in.

    Each complete round is passed to `watch` as a `Step`. The moves of a round commute, so their
    order within the round does not change the homotopy class of the path.
    """

    def __init__(self, scene: Scene, watch: Callable[[Step], None] | None = None) -> None:
        """Begin at the start of the scene."""
        self.scene = scene
        self._heap = FastHeap(telling=True)
        self._path = EdgePath(scene)
        self.sites: list[Site] = list(scene.start)
        self._digest = PathDigest()
        self._watch = watch
        self._waiting: dict[int, dict[int, Report]] = {}
        self.plausibility = Plausibility(scene)

    @property
    def heap(self) -> FastHeap:
        """Return the heap of the moves so far; they are added to it only when it is asked for."""
        actions, names = self._path.actions, self._path.names
        self._heap.extend(actions[names[place]] for place in range(self._heap.moves, len(names)))
        return self._heap

    @property
    def rounds(self) -> int:
        """Return the number of complete rounds."""
        return len(self._path.ends)

    @property
    def steps(self) -> Sequence[Step]:
        """Return the complete rounds; each is made when it is asked for."""
        return _View(self.rounds, self._path.step)

    @property
    def path(self) -> Sequence[Action]:
        """Return the edge path as one sequence of actions, which takes no memory of its own."""
        actions, names = self._path.actions, self._path.names
        return _View(len(names), lambda place: actions[names[place]])

    @property
    def digest(self) -> str:
        """Return the digest of the edge path so far."""
        return self._digest.text()

    @property
    def reached(self) -> bool:
        """Return whether the modules are at the goal."""
        return self.scene.reached(self.sites)

    @property
    def failed(self) -> str | None:
        """Return which module gave up in the last round, and why; None if none did."""
        for module, reason in self._path.failures.get(self.rounds - 1, ()):
            return f"module_{module}: {reason}"
        return None

    @property
    def begun(self) -> int:
        """Return the last round for which any report has arrived."""
        return max(self._waiting, default=self.rounds)

    def cubes(self) -> Iterator[tuple[GeneratorPlacement, ...]]:
        """Yield the normal cube path cube by cube, each move by its generator and its place."""
        path = self._path
        # Of several names of an action the one that was reported last.
        last = np.zeros(len(path.actions), dtype=np.int64)
        last[np.frombuffer(path.names, dtype=np.int32)] = np.arange(len(path.names))
        placed = {path.actions[name]: path.placed[name] for name in np.argsort(last).tolist()}
        for cube in self.heap.each_cube():
            yield tuple(placed[action] for action in cube)

    def schedule(self) -> Cubes:
        """Return the normal cube path, each move by its generator and its place."""
        return tuple(self.cubes())

    def receive(self, report: Report) -> None:
        """Take a report; CheckError if two differ, or if it cannot be."""
        if not 0 <= report.module < len(self.sites):
            raise CheckError(f"a report of module_{report.module}: no such module in this run")
        if report.round <= self.rounds:
            return  # a report of this round was released already
        reports = self._waiting.setdefault(report.round, {})
        known = reports.setdefault(report.module, report)
        if known != report:
            raise CheckError(
                f"module_{report.module} reports round {report.round} twice, and differently"
            )
        while len(self._waiting.get(self.rounds + 1, ())) == len(self.sites):
            self._release(self._waiting.pop(self.rounds + 1))

    def _release(self, reports: dict[int, Report]) -> None:
        path = self._path
        executed: list[Executed] = []
        names: list[int] = []
        failures: list[tuple[int, str]] = []
        self.plausibility.carry_out(reports)
        for module in sorted(reports):
            report = reports[module]
            self.sites[module] = self.plausibility.sites[module]
            if report.failed is not None:
                failures.append((module, report.failed))
            if report.move is not None:
                executed.append(Executed(module, report.move.generator, report.move.at))
                names.append(path.name(report.move))
        self._digest.add(self.rounds + 1, executed)
        if failures:
            path.failures[self.rounds] = tuple(failures)
        path.movers.extend(move.module for move in executed)
        path.names.extend(names)
        path.ends.append(len(path.names))
        if self._watch is not None:
            self._watch(path.step(self.rounds - 1))


def gathered(recording: Recording) -> Gatherer:
    """Gather the reports of a recording; incomplete rounds are left out.

    InputError if a message on record is malformed, CheckError as for `Gatherer.receive`.
    """
    gatherer = Gatherer(recording.scene)
    for record in recording.of_kind("report"):
        where = f"{recording.path}: report {record.sequence} ({record.topic})"
        try:
            report = decode(record.data)
            if not isinstance(report, Report):
                raise InputError("another kind of message, expected a report")
            gatherer.receive(report)
        except CubepathError as error:
            raise type(error)(f"{where}: {error}") from None
    return gatherer
