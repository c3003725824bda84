"""A fleet without rounds that begins and is listened to as a test says; see also testing.rig."""

import contextlib
import os
import time
from collections.abc import Callable, Collection, Generator, Iterable
from contextlib import contextmanager
from typing import Any

from cubepath.agents.free.fleet import FreeFleet
from cubepath.coordinator.runs.collector import Collector
from cubepath.coordinator.runs.free_gatherer import FreeGatherer
from cubepath.protocol.core.system import Scene
from cubepath.protocol.wire.free_messages import Commit, FreeMessage, Turns
from cubepath.protocol.wire.messages import Go
from cubepath.protocol.wire.nodes import Keep
from cubepath.protocol.wire.shell import Shell

PATIENCE_S = 60.0


class Watch:
    """What was said in a run so far, and the fleet."""

    def __init__(self, fleet: FreeFleet, scene: Scene) -> None:
        self.fleet = fleet
        self.gatherer = FreeGatherer(scene, fleet.keepers)
        self.collector = Collector(fleet.run, self.gatherer, fleet.keepers, fleet.modules_of)
        self.heard: list[FreeMessage] = []
        self._shell: Shell | None = None

    def keep(self, kept: Keep[Any], _wall_ns: int) -> None:
        self.heard.append(kept.message)

    def until(self, what: Callable[[], bool], patience_s: float = PATIENCE_S) -> None:
        """Listen until something holds."""
        assert self._shell is not None
        end = time.monotonic() + patience_s
        while not what():
            self._shell.step(0.02)
            self.fleet.look()
            assert time.monotonic() < end, f"not within {patience_s} s: {self.state()}"

    def moves(self, more: int) -> None:
        """Listen until there are so many more moves."""
        enough = self.gatherer.moves + more
        self.until(lambda: self.gatherer.moves >= enough)

    def has_moved(self, modules: Iterable[int]) -> bool:
        """Return whether any of these modules was the mover of a move."""
        moved = {each.module for each in self.heard if isinstance(each, Commit)}
        return not moved.isdisjoint(modules)

    def moves_since(self, modules: Collection[int]) -> int:
        """Return how many moves were heard of since the last whose mover is one of these."""
        moves = [each for each in self.heard if isinstance(each, Commit)]
        return next((n for n, each in enumerate(reversed(moves)) if each.module in modules), 0)

    def reached(self) -> bool:
        return self.gatherer.reached

    def state(self) -> str:
        found = self.gatherer
        turns = sum(len(each.parts) for each in self.heard if isinstance(each, Turns))
        return f"{found.moves} moves, {turns} turns, {found.unfinished}"

    def settle(self) -> None:
        """Halt the modules, and wait until everything that was committed is known."""
        assert self._shell is not None
        self._shell.carry_out(self.collector.say(Go(0, "over")))
        self.collector.tails.clear()
        asked = 0.0
        end = time.monotonic() + PATIENCE_S
        while not self.collector.settled:
            assert time.monotonic() < end, self.state()
            if time.monotonic() - asked > 0.3:
                asked = time.monotonic()
                self.collector.tails.clear()
                self._shell.carry_out(self.collector.say(Go(0, "over")))
                self._shell.carry_out(self.collector.fetch())
            self._shell.step(0.02)
            self.fleet.look()


@contextmanager
def watched(
    scene: Scene,
    rule: str,
    *,
    listening: bool = True,
    begin: Iterable[int] | None = None,
    **options: Any,
) -> Generator[Watch]:
    """Start a fleet and listen to it; at the end nothing of it is left."""
    fleet = FreeFleet(scene, rule, **options)
    with fleet:
        watch = Watch(fleet, scene)
        fleet.begin(begin)
        pids = list(fleet.pids.values())
        if listening:
            with listened(watch):
                yield watch
        else:
            yield watch
    for pid in pids:
        with contextlib.suppress(ProcessLookupError):
            os.kill(pid, 0)
            raise AssertionError(f"process {pid} is left")


@contextmanager
def listened(watch: Watch) -> Generator[None]:
    """Listen to the fleet, and tell it to stop at the end."""
    fleet, collector = watch.fleet, watch.collector
    with Shell(collector, fleet.endpoint, watch.keep, credentials=fleet.credentials()) as shell:
        watch._shell = shell
        shell.start()
        try:
            yield
        finally:
            shell.carry_out(collector.say(Go(0, "stop")))
