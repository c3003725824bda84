"""What a test does to processes: it kills, pauses and cuts them off, now or at a message."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Callable, Collection
from contextlib import ExitStack, suppress
from typing import TypeAlias

from cubepath.coordinator.testing.commands import stderr_of
from cubepath.coordinator.testing.rules import SECONDS_MAX, Pattern
from cubepath.coordinator.testing.wire import PlannedFault, Target, Wire
from cubepath.coordinator.testing.wire_messages import WireMessage
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.options import seconds as checked_seconds, whole_number

When: TypeAlias = "Pattern | str | int | None"
"""Now (None), in a round or at a level, or at the first message of a kind, key or pattern."""


class ProcessFaults(Wire):
    """What a test can do to processes, ours and those of others."""

    def __init__(self, *, links: bool | Collection[str]) -> None:
        """Do nothing to anyone yet."""
        super().__init__(links=links)
        self._planned: list[PlannedFault] = []
        self._wounded: set[str] = set()
        self._paused: dict[str, int] = {}
        self._timers: dict[tuple[str, str], threading.Timer] = {}
        self._raised: Exception | None = None
        self._noticing = threading.RLock()

    # What is done to them.

    def kill(self, target: Target, at: When = None) -> PlannedFault:
        """Kill a process, now, in a round or at a level, or at a message.

        A run with rounds ends by that: they tolerate pauses and loss, not death. Without rounds the
        others continue.
        """
        name = self.name_of(target)
        return self._do(at, lambda: self._signal(name, signal.SIGKILL))

    def pause(
        self, target: Target, at: When = None, *, seconds: float | None = None
    ) -> PlannedFault:
        """Have a process stand still, for some seconds, or until it is resumed.

        With rounds no other process continues meanwhile: without `seconds` the next round waits in
        vain.
        """
        name = self.name_of(target)
        if seconds is not None:
            checked_seconds("seconds", seconds, SECONDS_MAX)

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

    def resume(self, target: Target, at: When = None) -> PlannedFault:
        """Have a process that was paused continue; no other is changed."""
        name = self.name_of(target)

        def act() -> None:
            self._cancel("resume", name)
            self._resume(name)

        return self._do(at, act)

    def _resume(self, name: str) -> None:
        pid = self._paused.pop(name, None)
        if pid is not None and name in self.commands:
            self.commands[name].signal(signal.SIGCONT)
        elif pid is not None:
            with suppress(ProcessLookupError):
                os.kill(pid, signal.SIGCONT)

    def cut_off(
        self, target: Target, at: When = None, *, seconds: float | None = None, keep: bool = False
    ) -> PlannedFault:
        """Cut the link of a process, for some seconds or until it is healed.

        Nothing gets through, and neither side is notified. Messages sent meanwhile are lost; with
        `keep` it comes when the link is healed, as over a connection that outlives the cut.
        """
        link = self.link_of(self.name_of(target))
        if seconds is not None:
            checked_seconds("seconds", seconds, SECONDS_MAX)

        def act() -> None:
            self._cancel("heal", link.name)
            link.cut(keep=keep)
            self._after(seconds, link.heal, "heal", link.name)

        return self._do(at, act)

    def heal(self, target: Target | None = None, at: When = None) -> PlannedFault:
        """Heal the link of a process, or all links."""
        links = (
            [self.link_of(self.name_of(target))] if target is not None else [*self.links.values()]
        )

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
            whole_number("at", at, 0)
            return self._plan(lambda seen: (seen.round or 0) >= at, act)
        return self._plan(self._means(self._pattern(at)), act)

    def _means(self, pattern: Pattern) -> Callable[[WireMessage], bool]:
        return pattern.holds

    def _plan(
        self, pattern: Callable[[WireMessage], bool], act: Callable[[], None]
    ) -> PlannedFault:
        planned = PlannedFault(pattern, act)
        self._planned.append(planned)
        return planned

    def _notice(self, seen: WireMessage) -> None:
        """Have that happen which was planned for a message."""
        with self._noticing:
            for planned in tuple(self._planned):
                try:
                    if not planned.done and planned.pattern(seen):
                        self._planned.remove(planned)
                        planned.do(seen)
                except Exception as error:  # noqa: BLE001 - the test's, and no end of what runs
                    self._raised = self._raised or error

    def _raise_again(self) -> None:
        """Raise what something that was planned has raised."""
        error, self._raised = self._raised, None
        if error is not None:
            raise error

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

    def close(self, *, check: bool = False) -> None:
        """End everything: rules, pauses, the run, the commands, the links.

        With `check`, CheckError if a rule raised or a link had too much to carry, and what was
        raised by something that the test has planned.
        """
        with ExitStack() as stack:
            if check:
                stack.callback(self._raise_again)
                for link in self.links.values():
                    stack.callback(link.check)
            self.close_links(stack.callback)
            for command in self.commands.values():
                stack.callback(command.close)
            stack.callback(self._end)
            for name in list(self._paused):
                stack.callback(self.resume, name)
            for timer in list(self._timers):
                stack.callback(self._cancel, *timer)

    def _end(self) -> None:
        """End what is neither a command nor a link."""

    def about(self, name: str, pid: int) -> str:
        """Return how a process is, in a line."""
        paused = " paused," if name in self._paused else ""
        is_there = self.pids.get(name) == pid
        how = f"process id {pid}" if is_there else f"process id {pid}, has ended"
        cut = name in self.links and self.links[name].up.cut
        link = f", its link is cut ({cut})" if cut else ""
        command = self.commands.get(name)
        output = command.last_lines if command is not None else stderr_of(pid) if is_there else ""
        about = f"{name}:{paused} {how}{self._role(name)}{link}"
        return about + (f"; {output}" if output else "")

    def _role(self, name: str) -> str:  # noqa: ARG002 - for those whose processes have one
        return ""
