"""Gathering: from the reports of modules, in any order of arrival, to the edge path of a run.

A round is released when every module has reported it, so the result depends on no clock and no
order of arrival; a report that arrives twice counts once. What no module can have done, given where
all of them stood, is not gathered.
"""

from __future__ import annotations

from collections.abc import Callable

from cubepath.coordinator.normal_form.compiled_heap import FastHeap
from cubepath.coordinator.runs.edge_path import EdgePath, Gathered, PathDigest, Step
from cubepath.coordinator.runs.plausibility import Plausibility
from cubepath.protocol.core.errors import CheckError
from cubepath.protocol.core.system import Scene
from cubepath.protocol.wire.messages import Executed, Report


class Gatherer(Gathered):
    """Gathers reports into the edge path and keeps its normal cube path as moves come in.

    Each complete round is passed to `watch` as a `Step`. The moves of a round commute, so their
    order within the round does not change the homotopy class of the path.
    """

    def __init__(self, scene: Scene, watch: Callable[[Step], None] | None = None) -> None:
        """Begin at the start of the scene."""
        self.scene = scene
        self._heap = FastHeap(telling=True)
        self._path = EdgePath(scene)
        self.sites = list(scene.start)
        self._digest = PathDigest()
        self._watch = watch
        self._waiting: dict[int, dict[int, Report]] = {}
        self.plausibility = Plausibility(scene)

    @property
    def _edges(self) -> EdgePath:
        return self._path

    @property
    def heap(self) -> FastHeap:
        """Return the heap of the moves so far; they are added to it only when it is asked for."""
        actions, names = self._path.actions, self._path.names
        self._heap.extend(actions[names[place]] for place in range(self._heap.moves, len(names)))
        return self._heap

    @property
    def digest(self) -> str:
        """Return the digest of the edge path so far."""
        return self._digest.text()

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

    @property
    def unfinished(self) -> str | None:
        """Return which round is not complete although a later one was begun; None if none is."""
        if self.begun <= self.rounds + 1:
            return None
        return (
            f"round {self.rounds + 1} is not complete, but there are reports of round"
            f" {self.begun}: expected all rounds up to the last"
        )

    @property
    def ahead(self) -> int | None:
        """Return the first round that is whole although the one before it is not; None if none."""
        if self.begun <= self.rounds + 1:
            return None
        whole = (n for n, each in self._waiting.items() if len(each) == len(self.sites))
        return min(whole, default=None)

    def waiting(self) -> list[Report]:
        """Return the reports of the rounds that are not released yet, in the order of rounds."""
        rounds = (reports for _, reports in sorted(self._waiting.items()))
        return [reports[module] for reports in rounds for module in sorted(reports)]

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
