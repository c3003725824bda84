"""Gathering: from the reports of modules, in any order of arrival, to the edge path of a run.

Room: coordinator. A round is released when every module has reported it, so the result depends on
no clock and no order of arrival; a report that arrives twice counts once.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from hashlib import sha256

import msgspec

from cubepath.coordinator.normal_form.compiled_heap import FastHeap
from cubepath.protocol.core.actions import Action
from cubepath.protocol.core.errors import CheckError, CubepathError, InputError
from cubepath.protocol.core.names import GeneratorPlacement
from cubepath.protocol.core.sites import Site, site_from_json
from cubepath.protocol.core.system import Scene
from cubepath.protocol.path_files.schedules import Cubes
from cubepath.protocol.recordings.recording import Recording
from cubepath.protocol.wire.messages import Executed, Report, decode, parts_of

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


class Gatherer:
    """Gathers reports into the edge path and keeps its normal cube path as moves come in.

    Each complete round is passed to `watch` as a `Step`. The moves of a round commute, so their
    order within the round does not change the homotopy class of the path.
    """

    def __init__(self, scene: Scene, watch: Callable[[Step], None] | None = None) -> None:
        """Begin at the start of the scene."""
        self.scene = scene
        self._heap = FastHeap(telling=True)
        self._fallen = 0
        self.sites: list[Site] = list(scene.start)
        self.steps: list[Step] = []
        self._digest = PathDigest()
        self._watch = watch
        self._waiting: dict[int, dict[int, Report]] = {}

    @property
    def heap(self) -> FastHeap:
        """Return the heap of the moves so far; they are added to it only when it is asked for."""
        for step in self.steps[self._fallen :]:
            self._heap.extend(step.actions)
        self._fallen = len(self.steps)
        return self._heap

    @property
    def rounds(self) -> int:
        """Return the number of complete rounds."""
        return len(self.steps)

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
        for module, reason in self.steps[-1].failures if self.steps else ():
            return f"module_{module}: {reason}"
        return None

    @property
    def begun(self) -> int:
        """Return the last round for which any report has arrived."""
        return max(self._waiting, default=self.rounds)

    def schedule(self) -> Cubes:
        """Return the normal cube path, each move by its generator and its place."""
        placed = {
            action: GeneratorPlacement(executed.generator, executed.at)
            for step in self.steps
            for executed, action in zip(step.executed, step.actions, strict=True)
        }
        return tuple(tuple(placed[action] for action in cube) for cube in self.heap.cube_path())

    def receive(self, report: Report) -> None:
        """Take a report; CheckError if two differ, or if the run has no such module."""
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
        number = self.rounds + 1
        executed, actions = [], []
        failures: list[tuple[int, str]] = []
        for module in sorted(reports):
            report = reports[module]
            self.sites[module] = site_from_json(report.site)
            if report.failed is not None:
                failures.append((module, report.failed))
            if report.move is None:
                continue
            placed = report.move
            executed.append(Executed(module, placed.generator, placed.at))
            actions.append(self.scene.system.action(placed.generator, site_from_json(placed.at)))
        self._digest.add(number, executed)
        step = Step(number, tuple(executed), tuple(actions), tuple(failures))
        self.steps.append(step)
        if self._watch is not None:
            self._watch(step)


def gathered(recording: Recording) -> Gatherer:
    """Gather the reports of a recording; incomplete rounds are left out.

    InputError if a message on record is malformed, CheckError as for `Gatherer.receive`.
    """
    gatherer = Gatherer(recording.scene)
    for record in recording.of_kind("reports", "report"):
        where = f"{recording.path}: report {record.sequence} ({record.topic})"
        try:
            for report in parts_of(decode(record.data)):
                if not isinstance(report, Report):
                    raise InputError("another kind of message, expected a report")
                gatherer.receive(report)
        except CubepathError as error:
            raise type(error)(f"{where}: {error}") from None
    return gatherer
