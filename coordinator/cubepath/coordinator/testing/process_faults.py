"""What a test does to the processes of a run: it kills, pauses and cuts them off on command."""

from __future__ import annotations

import os
import re
import signal
import threading
from collections.abc import Callable, Collection
from contextlib import suppress
from typing import TypeAlias

from cubepath.coordinator.runs.run import Run
from cubepath.coordinator.testing.checks import check_name, check_seconds, check_whole
from cubepath.coordinator.testing.commands import Command
from cubepath.coordinator.testing.log import pattern_of
from cubepath.coordinator.testing.rules import Pattern
from cubepath.coordinator.testing.wire import PlannedFault, Wire
from cubepath.coordinator.testing.wire_messages import WireMessage
from cubepath.protocol.core.errors import CubepathError, InputError
from cubepath.protocol.wire.credentials import COORDINATOR

_MODULE = re.compile(r"module_(\d+)")

When: TypeAlias = "Pattern | str | int | None"
"""Now (None), in a round or at a level, or at the first message of a kind or a pattern."""
Who: TypeAlias = "str | int"
"""A process by its name, or by the number of one of its modules."""


class ProcessFaults(Wire):
    """The processes of a run under test, ours and those of others, by their names."""

    run: Run
    commands: dict[str, Command]

    def __init__(self, *, links: bool | Collection[str]) -> None:
        """Do nothing to anyone yet."""
        super().__init__(links=links)
        self._planned: list[PlannedFault] = []
        self._wounded: set[str] = set()
        self._paused: dict[str, int] = {}
        self._timers: dict[tuple[str, str], threading.Timer] = {}
        self._known: dict[str, int] = {}
        self._modules: dict[str, tuple[int, ...]] = {}

    # Who there is.

    @property
    def pids(self) -> dict[str, int]:
        """Return the process ids by name, those of commands included; none of a run that ended.

        One of the run's own that has died is there until the run has noticed.
        """
        found: dict[str, int] = {}
        with suppress(CubepathError):
            found = self.run.pids
        return found | {
            name: command.pid
            for name, command in self.commands.items()
            if command.returncode is None
        }

    def name_of(self, who: Who) -> str:
        """Return the name of a process that is given by its name, or by one of its modules.

        InputError for a name or a module that is not there.
        """
        found = _MODULE.fullmatch(who) if isinstance(who, str) else None
        if isinstance(who, str) and found is None:
            return check_name("", who, (*self._known, *self._speakers - self._known.keys()))
        module = int(found[1]) if found is not None else who
        self._check_module(module)
        for name, modules in self._modules.items():
            if module in modules:
                return name
        raise InputError(f"module_{module}: has no process of its own name, expected a name")

    @property
    def _speakers(self) -> set[str]:
        return {link.speaks_as for link in self.links.values()}

    def _check_module(self, module: object) -> None:
        most = len(self.run.scene.start) - 1
        if module is not None and check_whole("module", module) > most:
            raise InputError(f"module_{module}: expected module_0 to module_{most}")

    def _check_speaker(self, sender: str) -> None:
        known = {*self._known, *self._speakers, COORDINATOR} - {"router"}
        check_name("sender=", sender, sorted(known))

    def _is_region(self, name: str) -> bool:
        scene = self.run.scene
        regions = map(scene.system.region, (*scene.start, *(scene.goal or ())))
        return super()._is_region(name) or name in regions

    def _named(self, who: str | int | None) -> str | None:
        if who is None or (isinstance(who, str) and _MODULE.fullmatch(who) is None):
            return who
        return self.name_of(who)

    # What is done to them.

    def kill(self, who: Who, at: When = None) -> PlannedFault:
        """Kill a process, now, in a round or at a level, or at a message.

        A run with rounds ends by that: they tolerate pauses and loss, not death. Without rounds the
        others continue.
        """
        name = self.name_of(who)
        return self._do(at, lambda: self._signal(name, signal.SIGKILL))

    def pause(self, who: Who, at: When = None, *, seconds: float | None = None) -> PlannedFault:
        """Have a process stand still, for some seconds, or until it is resumed.

        With rounds no other process continues meanwhile: without `seconds` the next round waits in
        vain.
        """
        name = self.name_of(who)
        if seconds is not None:
            check_seconds("seconds", seconds)

        def act() -> None:
            pid = self._pid(name)
            self._cancel("resume", name)
            self.guard.watch(pid)  # who stands still does not notice that all others have ended
            self._paused[name] = pid
            self._signal(name, signal.SIGSTOP)
            self._after(seconds, lambda: self._resume(name), "resume", name)

        return self._do(at, act)

    def _after(
        self, seconds: float | None, act: Callable[[], object], what: str, name: str
    ) -> None:
        """Have something happen to the one of a name, unless that is called off before."""
        if seconds is not None:
            timer = self._timers[what, name] = threading.Timer(seconds, act)
            timer.daemon = True
            timer.start()

    def _cancel(self, what: str, name: str) -> None:
        timer = self._timers.pop((what, name), None)
        if timer is not None:
            timer.cancel()

    def resume(self, who: Who, at: When = None) -> PlannedFault:
        """Have a process that was paused continue; no other is changed."""
        name = self.name_of(who)

        def act() -> None:
            self._cancel("resume", name)
            self._resume(name)

        return self._do(at, act)

    def _resume(self, name: str) -> None:
        pid = self._paused.pop(name, None)
        if pid is not None:
            with suppress(ProcessLookupError):
                os.kill(pid, signal.SIGCONT)

    def cut_off(
        self, who: Who, at: When = None, *, seconds: float | None = None, keep: bool = False
    ) -> PlannedFault:
        """Cut the link of a process, for some seconds or until it is healed.

        Nothing gets through, and neither side is notified. Messages sent meanwhile are lost; with
        `keep` it comes when the link is healed, as over a connection that outlives the cut.
        """
        link = self.link_of(self.name_of(who))
        if seconds is not None:
            check_seconds("seconds", seconds)

        def act() -> None:
            self._cancel("heal", link.name)
            link.cut(keep=keep)
            self._after(seconds, link.heal, "heal", link.name)

        return self._do(at, act)

    def heal(self, who: Who | None = None, at: When = None) -> PlannedFault:
        """Heal the link of a process, or all links."""
        links = [self.link_of(self.name_of(who))] if who is not None else [*self.links.values()]

        def act() -> None:
            for link in links:
                self._cancel("heal", link.name)
                link.heal()

        return self._do(at, act)

    def when(self, at: When, act: Callable[[], None]) -> PlannedFault:
        """Have a function called in a round or at a level, or at a message; it may not continue."""
        return self._do(at, act)

    def _do(self, at: When, act: Callable[[], None]) -> PlannedFault:
        if not callable(act):
            raise InputError(f"{act!r}: expected a function")
        if at is None:
            now = PlannedFault(lambda _: False, act)
            now.do()
            return now
        if isinstance(at, int):
            check_whole("at", at)
            return self._plan(lambda seen: (seen.round or 0) >= at, act)
        return self._plan(pattern_of(at).holds, act)

    def _plan(
        self, pattern: Callable[[WireMessage], bool], act: Callable[[], None]
    ) -> PlannedFault:
        planned = PlannedFault(pattern, act)
        self._planned.append(planned)
        return planned

    def _pid(self, name: str) -> int:
        pids = self.pids
        if name not in pids:
            left = f"expected one of {', '.join(pids)}" if pids else "the run has ended"
            raise InputError(f"{name}: has no process any more, {left}")
        return pids[name]

    def _signal(self, name: str, number: int) -> None:
        if number == signal.SIGKILL:
            self._wounded.add(name)
        if name in self.commands:
            self.commands[name].signal(number)
        else:
            os.kill(self._pid(name), number)
