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
from pathlib import Path
from typing import Any, NoReturn, Self, TypeAlias

from msgspec.json import encode

from cubepath.coordinator.runs.launch import start
from cubepath.coordinator.runs.listeners import TappedMessage
from cubepath.coordinator.runs.outcome import Outcome
from cubepath.coordinator.runs.plan import Plan
from cubepath.coordinator.runs.run import Run
from cubepath.coordinator.testing.commands import Command, check_command, lives, started_at
from cubepath.coordinator.testing.log import RunLog, What, pattern_of
from cubepath.coordinator.testing.run_processes import RunProcesses
from cubepath.coordinator.testing.wire import Target
from cubepath.coordinator.testing.wire_messages import RESULTS, WireMessage, short, table
from cubepath.protocol.core.errors import CheckError, InputError
from cubepath.protocol.core.options import seconds, whole_number
from cubepath.protocol.core.sites import Site
from cubepath.protocol.wire.credentials import GUEST, process_name
from cubepath.protocol.wire.free_messages import FREE_KINDS, free_key
from cubepath.protocol.wire.keys import key_of

__tracebackhide__ = True  # pytest shows no frames of this module
CommandLine: TypeAlias = "str | Sequence[str]"


class Joiners:
    """The commands of one run, by their names."""

    def __init__(
        self,
        commands: Mapping[str, CommandLine] | Sequence[CommandLine],
        env: Mapping[str, str] | None,
        timeout_s: float,
    ) -> None:
        """Plan them; unless named they are ``own_0`` and so on. InputError for what is no list."""
        if isinstance(commands, str) or not isinstance(commands, Mapping | Sequence):  # pyright: ignore[reportUnnecessaryIsInstance]
            raise InputError(f"commands={commands}: expected a list, or names with commands")
        numbered = {f"own_{number}": line for number, line in enumerate(commands)}
        self.lines = dict(commands) if isinstance(commands, Mapping) else numbered
        for line in self.lines.values():
            check_command(line)
        if not isinstance(env, Mapping | None):  # pyright: ignore[reportUnnecessaryIsInstance]
            raise InputError(f"env={env!r}: expected names with values")
        self.running: dict[str, Command] = {}
        self._env = dict(env or {})
        self._timeout_s = timeout_s
        self._deadline: float | None = None

    def fit(self, secure: object) -> None:
        """Check that they can join a run with these certificates; InputError if not."""
        if secure is not None:
            raise InputError(
                f"commands with secure={secure}: they join a run without TLS, expected one of both"
            )

    def begin(self) -> None:
        """Let the time begin within which all are there."""
        self._deadline = time.monotonic() + self._timeout_s

    def start(self, way: Callable[[str], str]) -> None:
        """Start all; the way is where the one of a name finds the run."""
        for name, line in self.lines.items():
            self.running[name] = started_at(line, way(name), name=name, env=self._env)

    def over(self) -> None:
        """Have it that all are there: who ends from now on, ends in the run."""
        self._deadline = None

    def check(self) -> None:
        """Raise CheckError if one has ended before the run began, or the time is over."""
        if self._deadline is None or not self.lines:
            return
        for name, command in self.running.items():
            code = command.returncode
            if code is not None:
                command.wait()  # until all that it said is read
                raise CheckError(
                    f"{name} ended before it joined, exit code {code}; {command.last_lines}"
                )
        if time.monotonic() > self._deadline:
            processes = [f"{name}: {each.last_lines}" for name, each in self.running.items()]
            outputs = "; ".join(processes) or "none was started"
            raise CheckError(
                f"not within {self._timeout_s:g} s: the commands have joined; {outputs}"
            )


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


class RunUnderTest(RunProcesses):
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
        """End everything."""
        self.close(check=kind is None)

    def _end(self) -> None:
        with ExitStack() as stack:
            stack.callback(self.run.__exit__, None, None, None)
            stack.callback(self._heal_all)

    def _heal_all(self) -> None:
        for link in self.links.values():  # who is told to stop is to hear it
            link.up.rules = link.down.rules = []
            link.heal()

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
