"""A run under test: awaited, disturbed and queried, with processes of ours and of yours.

With rounds, it advances only when the test says so. Without, modules act when they are ready, and
the test listens. In both cases a test says how far to run, and what should happen on the way.

Commands of yours can join a run under test; the test waits until they have joined, and ends them.
"""

from __future__ import annotations

import math
import re
import time
from collections import deque
from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import ExitStack, suppress
from dataclasses import replace
from pathlib import Path
from typing import Any, NoReturn, Self

from msgspec.json import encode

from cubepath.coordinator.runs.listeners import TappedMessage
from cubepath.coordinator.runs.outcome import Outcome
from cubepath.coordinator.runs.plan import Plan
from cubepath.coordinator.runs.run import Run, start
from cubepath.coordinator.testing.commands import CommandLine, Joiners, lives
from cubepath.coordinator.testing.log import RunLog, What, pattern_of
from cubepath.coordinator.testing.process_faults import ProcessFaults, Target
from cubepath.coordinator.testing.rules import Pattern, Rule
from cubepath.coordinator.testing.wire_messages import RESULTS, WireMessage, short, table
from cubepath.protocol.core.errors import CubepathError, InputError
from cubepath.protocol.core.formatting import did_you_mean
from cubepath.protocol.core.options import known_name, seconds, whole_number
from cubepath.protocol.core.sites import Site
from cubepath.protocol.wire.credentials import COORDINATOR, GUEST, process_name
from cubepath.protocol.wire.free_messages import FREE_KINDS, free_key
from cubepath.protocol.wire.keys import key_of

__tracebackhide__ = True  # pytest shows no frames of this module
TIMEOUT_S = 30.0
HEARD_MAX = 5000
"""The number of last messages that a run remembers for tests."""
_LISTENS = re.compile(r"listening on (\S+) without TLS")
_DIED = re.compile(r"^(\S+) has died")
_MENDED = "and was started again"
_FOR_A_LINK = 5
_FOR_A_COMMAND = 5
"""This many descriptors are open for each at one time, at most."""
_LOOPBACK = "tcp/127.0.0.1:0"
_PROCESS_LIKE = ("process_", "keeper_", "module_", COORDINATOR, "router")
_MODULE = re.compile(r"module_(\d+)")
_REGION = re.compile(r"-?\d+(,-?\d+)*")


class RunUnderTest(ProcessFaults):
    """A run under test, as a context manager that leaves nothing running, whatever happens."""

    def __init__(
        self,
        system: Any = None,
        rule: str | None = None,
        *,
        commands: Mapping[str, CommandLine] | Sequence[CommandLine] = (),
        links: bool | Collection[str] = True,
        timeout_s: float = TIMEOUT_S,
        env: Mapping[str, str] | None = None,
        **options: Any,
    ) -> None:
        """Plan a run; the arguments are those of `cubepath.coordinator.start`, a `Plan` too.

        `commands` are the module processes of others, by names of your own, or named ``own_0`` and
        so on; ``{endpoint}`` in one is where it joins, which is in ``CUBEPATH_ENDPOINT`` too. They
        join runs with rounds. `links` puts a link before every process, or before those named.

        What is awaited must come within `timeout_s` by default, and so must the commands: a
        CheckError names the command that did not join, or ended before, and what it printed.
        InputError for what cannot be run, CubepathError if too few files may be open for all of it.
        """
        super().__init__(links=links)
        seconds("timeout_s", timeout_s)
        self._joiners = Joiners(commands, env, timeout_s)
        self.commands = self._joiners.running
        if self._joiners.lines:
            own = system.secure if isinstance(system, Plan) else None
            self._joiners.fit(options.get("secure", own))
            options.setdefault("listen", _LOOPBACK)
            options.setdefault("wait_for", len(self._joiners.lines))
        if not isinstance(system, Plan):  # which says all of this itself
            if options.get("clock") == "free":
                options.setdefault("on_crash", "continue")
            options.setdefault("processes", 2)
            options.setdefault("patience", timeout_s)
        self.timeout_s = timeout_s
        self.run = start(system, rule, say=self._say, way=self.way, **options)
        self.run.check = self._joiners.check
        self.run.check_files(self._files)
        self.printed: list[str] = []
        """The lines that the run printed: where it listens, who is waited for, who died."""
        self.heard: deque[WireMessage] = deque(maxlen=HEARD_MAX)
        """The messages that were heard last."""
        self._unexpected: list[str] = []
        self._parts: deque[Any] = deque()

    @property
    def _files(self) -> int:
        """Return how many files this process opens for links, commands and their guard."""
        plan, commands = self.run.plan, len(self._joiners.lines)
        own = max(1, min(plan.processes, len(self.run.scene.start)))
        there = own + commands + (plan.keepers if plan.is_free else 0)
        links = len(self._wanted) if isinstance(self._wanted, Collection) else there * self._wanted
        return _FOR_A_LINK * links + _FOR_A_COMMAND * commands + 1

    def __enter__(self) -> Self:
        """Start everything; CheckError or InputError if that fails."""
        try:
            self.run.listen(self._hear)
            self._joiners.begin()
            self.run.__enter__()
            self._joiners.over()
            self._known = self.pids
            self.check_links(self._known)
            self._modules = {
                name: self.run.modules_of(self._process_of(name)) for name in self._known
            }
        except BaseException:
            with suppress(Exception):  # its errors say less than why
                self.close()
            raise
        return self

    def _process_of(self, name: str) -> str:
        """Return the name in keys of a process, which that of a command is not."""
        if name in self.commands and name not in self.links and self.run.plan.wait_for == 1:
            return process_name(0)  # who joins comes first
        return self._speaks_as(name) or name

    def __exit__(self, kind: object, *_: object) -> None:
        self.close(check=kind is None)

    def _end(self) -> None:
        with ExitStack() as stack:
            stack.callback(self.run.__exit__, None, None, None)
            stack.callback(self._heal_all)

    def _heal_all(self) -> None:
        for link in self.links.values():  # who is told to stop is to hear it
            link.up.rules = link.down.rules = []
            link.heal()

    # Its processes.

    @property
    def pids(self) -> dict[str, int]:
        """Return the process ids by name, those of commands included; none of a run that ended.

        One of the run's own that has died is there until the run has noticed.
        """
        found: dict[str, int] = {}
        with suppress(CubepathError):
            found = self.run.pids
        return found | super().pids

    def name_of(self, target: Target) -> str:
        """Return the name of a process that is given by its name, or by one of its modules.

        InputError for a name or a module that is not there.
        """
        found = _MODULE.fullmatch(target) if isinstance(target, str) else None
        if isinstance(target, str) and found is None:
            known = *self._known, *sorted(self._speakers - self._known.keys())
            if not known:
                raise InputError(f"{target}: there is none, the run has not begun or has ended")
            return known_name("", target, known)
        module = int(found[1]) if found is not None else target
        self._check_module(module)
        for name, modules in self._modules.items():
            if module in modules:
                return name
        raise InputError(f"module_{module}: has no process of its own name, expected a name")

    @property
    def _speakers(self) -> set[str]:
        return {link.speaks_as for link in self.links.values()}

    def _check_module(self, module: object) -> None:
        if module is not None:
            whole_number("module", module, 0, len(self.run.scene.start) - 1)

    def _check_speaker(self, sender: str) -> None:
        known = {*self._known, *self._speakers, COORDINATOR} - {"router"}
        known_name("sender=", sender, sorted(known))

    def _is_region(self, name: str) -> bool:
        """Return whether a name may be that of a region or a tile."""
        scene = self.run.scene
        regions = map(scene.system.region, (*scene.start, *(scene.goal or ())))
        return _REGION.fullmatch(name) is not None or name in regions

    def _named(self, target: str | int | None) -> str | None:
        """Return the name of a process that is given by its name or one of its modules."""
        if target is None or (isinstance(target, str) and _MODULE.fullmatch(target) is None):
            return target
        return self.name_of(target)

    def _pattern(self, what: What = "", **options: Any) -> Pattern:
        for key in options.keys() & {"sender", "to"}:
            options[key] = self._named(options[key])
        pattern = super()._pattern(what, **options)
        self._check_module(pattern.module)
        return pattern

    def _place(self, pattern: Pattern, **rule: Any) -> Rule:
        """Add a rule at the link of a receiver, or at all: messages are met at their sender's."""
        if not self.links:
            raise InputError(f"{rule['action']}: no process has a link, expected links=True")
        to, sender = self._named(pattern.to), self._speaks_as(self._named(pattern.sender))
        if to is not None and (to in self.links or to.startswith(_PROCESS_LIKE)):
            if sender is not None:
                self._check_speaker(sender)
            made = Rule(pattern=replace(pattern, to=None, sender=sender), **rule)
            return self.link_of(to).add(made, ("down",))
        if to is not None and not self._is_region(to):
            raise InputError(
                f"to={to}: expected a process, a region or a tile{did_you_mean(to, self.links)}"
            )
        if sender not in (None, COORDINATOR):
            self.link_of(str(sender))  # what it says is met there alone
        receivers = frozenset(link.speaks_as for link in self.links.values())
        made = Rule(pattern=replace(pattern, sender=sender), upstream=receivers, **rule)
        for link in self.links.values():
            link.add(made)
        return made

    def _speaks_as(self, name: str | None) -> str | None:
        """Return the name in keys of a process that is given by that of its link."""
        return self.links[name].speaks_as if name in self.links else name

    # Outgoing messages.

    def _say(self, line: str) -> None:
        self.printed.append(line)
        found = _LISTENS.search(line)
        if found is not None:
            endpoint = found[1]
            self._joiners.start(lambda name: self.way(name, endpoint, GUEST)[0])
        died = _DIED.match(line)
        if died is None:
            return
        if died[1] not in self._wounded:
            self._unexpected.append(line)
        elif line.endswith(_MENDED):
            self._wounded.discard(died[1])

    def _hear(self, overheard: TappedMessage) -> None:
        message = overheard.message
        if self._parts and message is self._parts[0]:  # they follow the message that brings them
            self._parts.popleft()
            return
        self._parts = deque(getattr(message, "parts", ()))
        run = self.run.run or "run"
        kind = overheard.kind
        free = self.run.plan.is_free or kind in FREE_KINDS
        key = free_key(run, message) if free else key_of(run, message)
        seen = WireMessage(key, encode(message), overheard.wall_ns / 1e9)
        self.heard.append(seen)
        self._notice(seen)

    # How it continues.

    def step(self, count: int = 1, *, timeout_s: float | None = None) -> None:
        """Play `count` rounds, or listen until `count` more moves; AssertionError if they fail."""
        whole_number("count", count, 0)
        enough = (self.run.status.moves if self.free else self.run.round) + count
        self.until(
            lambda rig: (rig.moves if rig.free else rig.round) >= enough, timeout_s=timeout_s
        )

    def until(
        self,
        what: Callable[[RunUnderTest], object] | What = "",
        *,
        timeout_s: float | None = None,
        **pattern: Any,
    ) -> WireMessage | None:
        """Go on until something holds, or until a message comes; return the message.

        `what` is a function of the run under test, or a kind or pattern of a message that comes
        from now on, as for `RunLog.messages`. With rounds both are looked at between two rounds.

        AssertionError tells what was seen if the run ends before, a process dies that nobody has
        wounded, or the time is over: the last messages, and how each process is.
        """
        if callable(what):
            self._go_on(what, "what is awaited", timeout_s)
            return None
        meant = pattern_of(what, **pattern)
        planned = self._plan(meant.holds, lambda: None)
        self._go_on(lambda _: planned.done, f"a message with {meant}", timeout_s)
        return planned.at

    def until_round(self, number: int, *, timeout_s: float | None = None) -> None:
        """Go on until a round is over, or a level is reached."""
        whole_number("until_round", number, 0)
        self._go_on(lambda rig: rig.round >= number, f"{self._unit} {number}", timeout_s)

    def until_moves(self, number: int, *, timeout_s: float | None = None) -> None:
        """Go on until there are this many moves in all."""
        whole_number("until_moves", number, 0)
        self._go_on(lambda rig: rig.moves >= number, f"{number} moves", timeout_s)

    def until_goal(self, *, timeout_s: float | None = None) -> None:
        """Go on until the modules are at their goal, where most runs end."""
        self._go_on(lambda rig: rig.goal_reached, "the goal", timeout_s)

    def play(self, *, timeout_s: float | None = None, failing: bool = False) -> Outcome:
        """Go on to the end of the run; return its outcome.

        AssertionError tells what was seen if the run fails (a process dies, a rule raises, nobody
        answers); with `failing`, if it does not. A run that ends away from its goal has not failed.
        """
        self._go_on(lambda rig: not rig.run.goes_on, "the end of the run", timeout_s)
        outcome = self.run.outcome
        if failing and outcome.ended != "failed":
            self._fail("the run did not fail, expected it to (failing=True)")
        if not failing and outcome.ended == "failed":
            self._fail(f"the run failed: {short(outcome.error or 'it does not say why')}")
        return outcome

    def _go_on(
        self, what: Callable[[RunUnderTest], object], name: str, timeout_s: float | None
    ) -> None:
        patience = seconds("timeout_s", self.timeout_s if timeout_s is None else timeout_s)
        end = time.monotonic() + patience
        why = ""

        def over(_: Run) -> bool:
            nonlocal why
            if self._unexpected or self._raised is not None or what(self):
                return True
            if not self.run.goes_on:
                why = f"the run ended before: {name}"
            elif time.monotonic() > end:
                why = f"not within {patience:g} s: {name}"
            return bool(why)

        self.run.until(over, timeout_s=math.inf)  # so that all that it raises is of the test
        self._raise_again()
        if self._unexpected:
            why = f"while waiting for {name}: {self._unexpected[0]}"
        if why:
            self._fail(why)

    def stop(self) -> Outcome:
        """End the run where it stands; return its outcome."""
        for name in list(self._paused):
            self.resume(name)
        self._heal_all()
        return self.run.stop()

    def finish(self) -> RunLog:
        """End the run where it stands, unless it has ended, and return its log."""
        self.stop()
        return RunLog.read(self.path)

    # How it stands.

    @property
    def free(self) -> bool:
        """Return whether the run has no rounds."""
        return self.run.plan.is_free

    @property
    def _unit(self) -> str:
        return "level" if self.free else "round"

    @property
    def round(self) -> int:
        """Return the last complete round, or the greatest level."""
        return self.run.round

    @property
    def moves(self) -> int:
        """Return how many moves were made."""
        return self.run.gathered.moves

    @property
    def sites(self) -> tuple[Site, ...]:
        """Return where each module stands."""
        return self.run.sites

    @property
    def goal_reached(self) -> bool:
        """Return whether the modules are at their goal."""
        return self.run.goal_reached

    @property
    def outcome(self) -> Outcome:
        """Return the outcome; CheckError while the run continues."""
        return self.run.outcome

    @property
    def endpoint(self) -> str:
        """Return where programs of yours may listen in: ``cubepath.protocol.open_client(...)``."""
        return self.run.endpoint

    @property
    def path(self) -> Path:
        """Return the path of the recording."""
        return self.run.log

    # What is done to it.

    def restart(self, target: Target) -> None:
        """Start a process again, in runs without rounds; one that lives is killed before.

        InputError in runs with rounds, which end when a process dies.
        """
        name = self.name_of(target)
        if not self.free:
            self.run.restart(name)
        before = self.pids.get(name)
        if before is not None and lives(before):
            self.kill(name)
        if self.run.plan.on_crash == "restart":
            self._go_on(lambda rig: rig.pids.get(name) not in (None, before), f"{name} again", None)
        else:
            self._go_on(lambda rig: name not in rig.pids, f"the end of {name}", None)
            self.run.restart(name)
        self._wounded.discard(name)

    # The text of a failure.

    def seen(self) -> str:
        """Return what was seen so far: how the run stands, its processes, the last messages."""
        status = self.run.status
        at = "" if status.goal_reached else " not"
        lines = [f"{self._unit} {status.round}, {status.moves} moves, goal{at} reached"]
        if status.ended is not None:
            why = f": {short(self.outcome.error)}" if self.outcome.error else ""
            lines.append(f"the run has ended, {status.ended}{why}")
        lines += [self.about(name, pid) for name, pid in {**self._known, **self.pids}.items()]
        messages = [seen for seen in self.heard if seen.kind not in RESULTS]
        lines.append(table(messages, title="the last messages"))
        return "\n".join(lines)

    def _fail(self, line: str) -> NoReturn:
        raise AssertionError(f"{line}\n{self.seen()}")
