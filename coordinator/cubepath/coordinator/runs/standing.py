"""How a run under way stands, and its processes.

Looking at a run changes nothing.
"""

from __future__ import annotations

import os
import signal
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Protocol, TypeAlias

from cubepath.agents.free.fleet import FreeFleet
from cubepath.agents.processes.fleet import Fleet
from cubepath.coordinator.runs.asking import Status
from cubepath.coordinator.runs.conductor import Ending
from cubepath.coordinator.runs.edge_path import Gathered
from cubepath.coordinator.runs.outcome import Outcome
from cubepath.coordinator.runs.plan import Plan
from cubepath.protocol.core.errors import CheckError, InputError
from cubepath.protocol.core.given import whole_number
from cubepath.protocol.core.sites import Site
from cubepath.protocol.core.system import Scene
from cubepath.protocol.recordings.writing import RecordingWriter
from cubepath.protocol.wire.credentials import COORDINATOR, Credentials, process_name

Watch: TypeAlias = Callable[[Gathered], None]
Pace: TypeAlias = Callable[[], float]


def _at_once() -> float:
    return 0.0


class Driver(Protocol):
    """A run of either clock."""

    @property
    def gathered(self) -> Gathered:
        """Return what was gathered so far."""
        ...

    @property
    def fleet(self) -> Fleet | FreeFleet:
        """Return the processes; CheckError if there are none."""
        ...

    def begin(self, check: Callable[[], None]) -> Ending | None:
        """Start the processes; `check` is called between messages and may raise."""
        ...

    def advance(self) -> Ending | None:
        """Go on by a round, or by a message; return how the run has ended."""
        ...

    def interrupted(self) -> Ending:
        """Let what is under way come to its end, for a short while; return how the run ends."""
        ...

    def announce(self, ending: Ending) -> None:
        """Tell whoever listens what came of the run."""
        ...

    def end(self) -> None:
        """End the processes."""
        ...

    def failed(self, error: str) -> Ending:
        """Return the end of a run that failed."""
        ...

    def conclude(self, ending: Ending) -> None:
        """Write what came of the run."""
        ...

    def tidy(self, ending: Ending) -> None:
        """Take away what is no longer needed."""
        ...

    def figures(self) -> Mapping[str, Any]:
        """Return what the outcome says beside what all outcomes say."""
        ...


class Standing:
    """What can be said of a run, and done to its processes, between two rounds and in one."""

    def __init__(self, plan: Plan, scene: Scene) -> None:
        """Say that it has not begun."""
        self.plan = plan
        self.scene = scene
        self.pace: Pace = _at_once
        """Asked before each round how many seconds it is to wait yet, until that is 0."""
        self._watches: list[Watch] = []
        self._opened: tuple[RecordingWriter, Driver] | None = None
        self._concluded = False
        """Whether its results were written, or were to be."""
        self._outcome: Outcome | None = None

    @property
    def _driver(self) -> Driver:
        return self._begun()[1]

    def _begun(self) -> tuple[RecordingWriter, Driver]:
        if self._opened is None:
            raise CheckError("the run has not begun: expected 'with start(...) as run:'")
        return self._opened

    def attend(self, watch: Watch) -> None:
        """Have a function called with what was gathered after each round, from now on."""
        self._watches.append(watch)

    def _left(self) -> float:
        return self.pace()  # which may be another by now

    # How it stands.

    @property
    def goes_on(self) -> bool:
        """Return whether the run has not ended."""
        return self._outcome is None and not self._concluded

    @property
    def outcome(self) -> Outcome:
        """Return the outcome; CheckError before the run, and while it goes on."""
        if self._outcome is None:
            self._begun()
            how = "was broken off while it ended" if self._concluded else "goes on"
            raise CheckError(f"the run {how}: expected it to have ended")
        return self._outcome

    @property
    def gathered(self) -> Gathered:
        """Return what was gathered so far: the edge path, its heap, and who stands where."""
        return self._driver.gathered

    @property
    def status(self) -> Status:
        """Return where the run stands."""
        gathered = self.gathered
        heap = gathered.live
        return Status(
            gathered.rounds,
            tuple(gathered.sites),
            gathered.moves,
            heap.cubes,
            gathered.reached,
            None if self._outcome is None else self._outcome.ended,
        )

    @property
    def round(self) -> int:
        """Return the last complete round, or the greatest level."""
        return self.gathered.rounds

    @property
    def sites(self) -> tuple[Site, ...]:
        """Return where each module stands."""
        return tuple(self.gathered.sites)

    @property
    def goal_reached(self) -> bool:
        """Return whether the modules are at the goal."""
        return self.gathered.reached

    @property
    def log(self) -> Path:
        """Return the path of the recording; it is whole when the run has ended."""
        if self._opened is None:
            raise CheckError("the run has not begun, and has no recording yet")
        return self._opened[0].path

    # Its processes.

    @property
    def pids(self) -> dict[str, int]:
        """Return the process ids by name: ``process_0``, ``keeper_0``, ``router``."""
        return self._driver.fleet.pids

    def process_of(self, module: int | str) -> str:
        """Return the name of the process that has a module: 3, or ``module_3``."""
        name = f"module_{module}" if isinstance(module, int) else str(module)
        for number, modules in enumerate(self._driver.fleet.modules_of):
            if name in map("module_{}".format, modules):
                return process_name(number)
        name = f"module_{name.removeprefix('module_')}"
        raise InputError(f"{name}: expected module_0 to module_{len(self.sites) - 1}")

    def modules_of(self, process: str) -> tuple[int, ...]:
        """Return the modules of a process; none of a keeper, or of the router."""
        for number, modules in enumerate(self._driver.fleet.modules_of):
            if process_name(number) == process:
                return tuple(modules)
        return ()

    def signal(self, process: str, number: int = signal.SIGKILL) -> None:
        """Send a signal to a process of the run by name; InputError if it has no such process.

        A process that stands still (SIGSTOP) is killed when the run ends, if nobody lets it go on.
        """
        pids = self.pids
        if process not in pids:
            raise InputError(f"{process}: expected one of {', '.join(pids)}")
        number = whole_number("signal", number)
        if number not in signal.valid_signals():
            raise InputError(f"signal={number}: expected the number of a signal, as signal.SIGSTOP")
        os.kill(pids[process], number)

    def restart(self, process: str) -> None:
        """Start a process again that has died.

        InputError for one that lives, or is unknown, and for runs with rounds, which then fail.
        """
        fleet = self._driver.fleet
        if not isinstance(fleet, FreeFleet):
            raise InputError(f"{process}: started again only in runs without rounds (clock=free)")
        fleet.start_again(process)

    def credentials(self, name: str = COORDINATOR) -> Credentials:
        """Return by what the one of this name shows who speaks, at a private router."""
        return self._driver.fleet.credentials(name)
