"""The world on the wire: the same steps as `World`, played by processes that exchange messages.

The modules send observations and masks and receive actions; their reports contain what they did.
"""

from collections.abc import Mapping

import numpy as np

from cubepath.agents.environments.world import Round
from cubepath.agents.local.module import ProtocolError
from cubepath.agents.local.observation import STAY, Note, Observation, is_legal
from cubepath.agents.processes.config import OUTSIDE
from cubepath.agents.processes.fleet import LockstepFleet
from cubepath.protocol.core.catalogue import Move
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.sites import Site
from cubepath.protocol.core.system import Scene
from cubepath.protocol.wire import messages as wire
from cubepath.protocol.wire.nodes import Keep


class WireWorld:
    """All modules of a scene in a fleet, driven from outside."""

    def __init__(
        self, scene: Scene, *, seed: int, note_length: int = 0, processes: int = 2
    ) -> None:
        """Start the fleet and sense for the first time."""
        self.scene = scene
        self.note_length = note_length
        self._observed: dict[int, wire.ModuleObservation] = {}
        self._reports: dict[int, wire.Report] = {}
        self._processes = processes
        self._whole = False
        self._fleet: LockstepFleet | None = None
        self._start(seed)
        self._begin()

    def _start(self, seed: int) -> None:
        self._fleet = LockstepFleet(
            self.scene,
            OUTSIDE,
            seed=seed,
            processes=self._processes,
            note_length=self.note_length,
            sink=self._take,
        )
        self._fleet.__enter__()

    def reset(self, seed: int) -> None:
        """Begin again with the same processes and another seed."""
        fleet = self._running()
        if self._whole:
            fleet.reset(seed)
        else:  # a step was interrupted, and its messages may still be under way
            self.close()
            self._start(seed)
        self._begin()

    def _begin(self) -> None:
        self.round = 0
        self.sites: list[Site] = list(self.scene.start)
        self._sense()

    def _take(self, kept: Keep[wire.Message], _wall_ns: int) -> None:
        match kept.message:
            case wire.Observations(parts=observed):
                self._observed.update((each.module, each) for each in observed)
            case wire.Reports(parts=reports):
                self._reports.update((each.module, each) for each in reports)
            case _:
                pass

    def _running(self) -> LockstepFleet:
        if self._fleet is None:
            raise InputError("the environment is closed: make another")
        return self._fleet

    def _sense(self) -> None:
        fleet = self._running()
        self._observed.clear()
        fleet.observe()
        self._whole = True

    def observe(self, module: int) -> Observation:
        """Return the observation that the module itself sent."""
        sent = self._observed[module]
        found: Observation = {
            "observation": np.array(sent.observation, np.int32),
            "action_mask": np.array(sent.action_mask, np.int8),
        }
        if self.note_length:
            found["notes"] = np.array(sent.notes, np.int32)
        return found

    def step(self, actions: Mapping[int, int], notes: Mapping[int, Note] | None = None) -> Round:
        """Send the actions, let the modules settle them, and sense again."""
        fleet = self._running()
        self._whole = False
        self.round += 1
        self._reports.clear()
        acts = []
        for module, seen in sorted(self._observed.items()):
            action = actions.get(module, STAY)
            legal = is_legal(seen.action_mask, action)
            note = (notes or {}).get(module, ())
            acts.append(
                wire.ChosenAction(fleet.round, module, action if legal else STAY, list(note))
            )
        fleet.act(acts)
        moves: dict[int, Move] = {}
        for module, report in sorted(self._reports.items()):
            made = self._made(report)
            if made is not None:
                moves[module] = made
            self.sites[module] = report.site
        lost = tuple(m for m, report in sorted(self._reports.items()) if report.claim == "lost")
        self._sense()
        return Round(self.round, moves, lost)

    def _made(self, report: wire.Report) -> Move | None:
        if report.move is None:
            return None
        before, at = report.before, report.move.at
        move = self.scene.system.move_named(before, report.move.generator, at)
        if move is None or move.target != report.site:
            raise ProtocolError(
                f"module_{report.module} reports {report.move.generator} at {at!r}, which is no"
                f" move from {before!r} to {report.site!r}"
            )
        return move

    def close(self) -> None:
        """End the processes and close the sessions; the last observations remain."""
        fleet, self._fleet = self._fleet, None
        if fleet is not None:
            fleet.__exit__(None, None, None)
