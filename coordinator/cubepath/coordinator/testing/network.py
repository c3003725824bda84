"""Your own zenoh processes under test: a private router, and a link before each process."""

from __future__ import annotations

import threading
import time
import warnings
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, fields
from functools import partial
from itertools import count
from pathlib import Path
from typing import Any, Literal, Self, TypeAlias, get_args

from cubepath.coordinator.testing.commands import Command, check_command
from cubepath.coordinator.testing.log import What
from cubepath.coordinator.testing.network_log import KEYS, MessageLog, known_process
from cubepath.coordinator.testing.process_faults import PlannedFault, ProcessFaults, Target, When
from cubepath.coordinator.testing.rules import Direction, Pattern, Rule
from cubepath.coordinator.testing.wire_messages import WireMessage
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.formatting import counted
from cubepath.protocol.core.options import known_name, seconds, whole_number
from cubepath.protocol.wire.credentials import GUEST, ROUTER
from cubepath.protocol.wire.router import Router

__tracebackhide__ = True  # pytest shows no frames of this module
_LOOPBACK = "tcp/127.0.0.1:0"
_POLL_S = 0.01


NetworkFaultKind: TypeAlias = Literal[
    "drop", "double", "delay", "reorder", "cut", "pause", "restart"
]
NETWORK_FAULTS: tuple[NetworkFaultKind, ...] = get_args(NetworkFaultKind)


@dataclass(frozen=True, slots=True, repr=False)
class NetworkFault:
    """One fault of a process or its link, for `NetworkUnderTest.inject`.

    It counts messages that the process puts (``way="up"``) or receives (``"down"``), with `key`
    only those on a key expression. The first `nth` pass. The next `count` are lost (``drop``),
    repeated (``double``) or late (``delay``) by `seconds`, or overtaken by the next (``reorder``);
    a ``cut`` loses as many of both ways together. At the next one the process is stopped for
    `seconds` (``pause``), or is killed and started again (``restart``).
    """

    kind: NetworkFaultKind
    process: str
    nth: int = 0
    count: int = 1
    way: Direction = "up"
    seconds: float = 0.1
    key: str | None = None

    def __repr__(self) -> str:
        """Return how to write it, without what is as by default."""
        given = [(each.name, getattr(self, each.name), each.default) for each in fields(self)[2:]]
        further = "".join(f", {name}={value!r}" for name, value, usual in given if value != usual)
        return f"NetworkFault({self.kind!r}, {self.process!r}{further})"

    def __post_init__(self) -> None:
        """Check it; InputError for what is no fault."""
        Pattern(key=self.key)
        known_name("kind=", self.kind, NETWORK_FAULTS)
        known_name("way=", self.way, get_args(Direction))
        whole_number("nth", self.nth, 0)
        whole_number("count", self.count, 1)


class NetworkUnderTest(ProcessFaults):
    """A router and processes of yours, as a context manager that leaves nothing running.

    Each connects, as a client of zenoh, over a link of its own, which a test can cut, and whose
    messages it can lose, delay and repeat. Of messages cubepath reads the key alone.

    >>> with NetworkUnderTest() as network:   # doctest: +SKIP
    ...     network.start("arm", "python arm.py {endpoint}", listens="robot/arm/goal")
    ...     network.drop("robot/arm/pose", times=3)
    ...     network.until("robot/arm/done")
    """

    _of_patterns = KEYS

    def __init__(self, *, timeout_s: float = 30.0) -> None:
        """Plan it; `timeout_s` is how long things are awaited."""
        super().__init__(links=True)
        self.timeout_s = seconds("timeout_s", timeout_s)
        self.commands: dict[str, Command] = {}
        self.log = MessageLog(self.links.keys())
        """All messages so far."""
        self._listening: dict[str, tuple[str, float]] = {}
        self._injected: list[tuple[str, Rule | PlannedFault]] = []
        self._everywhere: list[Rule] = []
        self._router: Router | None = None
        self._launching = threading.Lock()
        self._tap = self._on_message

    def __enter__(self) -> Self:
        self._router = Router(_LOOPBACK)
        return self

    def __exit__(self, kind: object, error: BaseException | None, *_: object) -> None:
        """End everything; an error that ends the block gets the log as a note."""
        if error is not None:
            error.add_note(self.seen())
        self.close(check=kind is None)

    def close(self, *, check: bool = False) -> None:
        """End all processes, links and the router; with `check` as `RunUnderTest.close`.

        Then each rule, and each fault at a message, that has met none is a warning, and each
        process that was a peer. Faults of `inject` are not: as they are counted and often drawn,
        they may come too late.
        """
        with self._launching:
            router, self._router = self._router, None  # from now on nothing is started
        with ExitStack() as stack:
            if router is not None:
                stack.callback(router.close)
            stack.callback(super().close, check=check)
        lines = [f"{name}: {each}" for name, link in self.links.items() if (each := link.warning)]
        for what, fault in self._faults:
            if _standing(fault) in ("to come", "met 0"):
                lines.append(f"{what}: met no message")
        for line in lines if check and router is not None else ():
            warnings.warn(line, stacklevel=2)

    def _running(self) -> Router:
        if self._router is None:
            raise InputError("the network is not open, expected 'with NetworkUnderTest() as ...'")
        return self._router

    # Its processes.

    def endpoint(self, name: str) -> str:
        """Return where the process of a name connects, as ``tcp/127.0.0.1:PORT``: its link.

        `start` gives it to a process; ask for it to connect a session of the test, or a process
        that is started in another way.
        """
        if not isinstance(name, str) or name in ("", ROUTER):  # pyright: ignore[reportUnnecessaryIsInstance]
            raise InputError(f"name={name!r}: expected a name for a process, as 'arm'")
        if name not in self.links:
            self.way(name, self._running().endpoint, GUEST)
            for rule in self._everywhere:
                self.links[name].add(rule, ("up",))
        return self.links[name].endpoint

    def start(
        self,
        name: str,
        command: str | Sequence[str],
        *,
        listens: str = "",
        env: Mapping[str, str] | None = None,
        cwd: Path | None = None,
        timeout_s: float | None = None,
    ) -> Command:
        """Start a command under a name; ``{endpoint}`` in it is where it connects.

        That is in ``CUBEPATH_ENDPOINT`` too. With `listens` wait until it has subscribed to any key
        of that expression: what is put before is lost. CheckError if it ends before, or does not
        within `timeout_s`, by default that of the network; InputError for no command, and a name
        that is taken. What is returned stays that command when it is started again.
        """
        check_command(command)
        patience = seconds("timeout_s", self.timeout_s if timeout_s is None else timeout_s)
        self._pattern(listens)
        endpoint = self.endpoint(name)
        if name in self.commands and self.commands[name].returncode is None:
            raise InputError(f"{name}: runs already, expected another name, or restart({name!r})")
        self._listening[name] = listens, patience
        with self._launching:
            self._running()
            if name in self.commands:
                self.commands[name].close()
            found = self.commands[name] = Command(
                command, name=name, env=env, cwd=cwd, timeout_s=patience, endpoint=endpoint
            )
            self._has_started(name)
        self._wait_until_it_listens(name)
        return found

    def _has_started(self, name: str) -> None:
        self._known[name] = self.commands[name].pid
        self._paused.pop(name, None)
        self._wounded.discard(name)
        self._note(f"{name} started")

    def _wait_until_it_listens(self, name: str) -> None:
        (key, patience), link = self._listening[name], self.links[name]
        if key:
            self.commands[name].until(
                lambda: link.listens(key),
                f"listens to {key}",
                patience,
                lambda: f"; it {link.subscribes}",
            )

    def restart(self, target: Target, at: When = None) -> PlannedFault:
        """Start a process again with its command; one that runs is killed before.

        It waits as `start` does, but not at a message, where others would wait for it.
        """
        name = self.name_of(target)
        return self._do(at, partial(self._restart, name), f"restart {name}")

    def _restart(self, name: str) -> None:
        known_name("restart: ", name, sorted(self.commands))
        key, link = self._listening[name][0], self.links[name]
        waits = threading.get_ident() != self._notices_in
        with self._launching:
            self._running()
            self._wounded.add(name)
            # What the process listened to is known until zenoh notices that it has ended.
            self.commands[name].restart(lambda: not (key and waits and link.listens(key)))
            self._has_started(name)
        if waits:
            self._wait_until_it_listens(name)

    def name_of(self, target: Target) -> str:
        """Return the name of a process that is there; InputError for another."""
        return known_process(target, {*self.pids, *self.links})

    # What is planned.

    def _on_message(self, seen: WireMessage) -> None:
        self._notice(seen)
        self.log.add(seen)

    def _note(self, done: str) -> None:
        self.log.note(done)

    def _pattern(self, what: What = "", **options: Any) -> Pattern:
        return self.log.pattern(what, **options)

    def _do(self, at: When, act: Callable[[], object], what: str) -> PlannedFault:
        if isinstance(at, int):
            raise InputError(f"at={at}: expected a key, as 'robot/**', or a Pattern")
        return super()._do(at, act, what)

    def _place(self, pattern: Pattern, **rule: Any) -> Rule:
        made = super()._place(pattern, **rule)
        if pattern.to is None and pattern.sender is None:
            self._everywhere.append(made)  # processes that start later have it too
        return made

    def clear(self) -> None:
        """Take all rules away, and heal all links."""
        self._everywhere.clear()
        super().clear()

    def inject(self, faults: Iterable[NetworkFault]) -> None:
        """Have faults happen, each at its message, counted from now on."""
        for fault in faults:
            link = self.link_of(self.name_of(fault.process))
            to = link.name if fault.way == "down" else None
            sender = link.name if to is None else None
            at = Pattern(key=fault.key, sender=sender, to=to, where=_after(fault.nth))
            if fault.kind == "pause":
                self.pause(link.name, at, seconds=fault.seconds)
            elif fault.kind == "restart":
                self.restart(link.name, at)
            else:
                rule = Rule(
                    action="drop" if fault.kind == "cut" else fault.kind,
                    pattern=Pattern(key=fault.key),
                    after=fault.nth,
                    times=fault.count,
                    seconds=fault.seconds,
                )
                link.add(rule, ("up", "down") if fault.kind == "cut" else (fault.way,))
                self._faults.append(("", rule))
            self._injected.append((str(fault), self._faults.pop()[1]))

    # What is awaited.

    def until(
        self,
        what: Callable[[NetworkUnderTest], object] | What = "",
        *,
        times: int = 1,
        timeout_s: float | None = None,
        **pattern: Any,
    ) -> None:
        """Wait until a function of the network is true, or until this many messages have come.

        They are those of `MessageLog.count`, from the beginning on. AssertionError if the time is
        over, or if a process fails (an exit code that is not 0) that the test has not killed.
        """
        whole_number("times", times, 0)
        hint: Callable[[], str] = str
        if callable(what):
            holds, name = what, "what is awaited"
        else:
            meant = self._pattern(what, **pattern)
            holds, hint = lambda _: self.log.has(times, meant), lambda: self.log.near(meant)
            name = f"{counted(times, 'message')} with {meant}"
        patience = seconds("timeout_s", self.timeout_s if timeout_s is None else timeout_s)
        deadline = time.monotonic() + patience
        while True:
            self._raise_again()
            late = time.monotonic() > deadline
            if holds(self):
                return
            for died, command in [*self.commands.items()]:
                if command.returncode not in (None, 0) and died not in self._wounded:
                    command.wait()  # until all that it said is read
                    how = f"failed ({command.returncode}); {command.last_lines}"
                    raise AssertionError(f"while waiting for {name}: {died} {how}")
            if late:
                raise AssertionError(f"not within {patience:g} s: {name}{hint()}")
            with self.log.changed:
                self.log.changed.wait(_POLL_S)

    def seen(self) -> str:
        """Return what was seen so far: each process, each fault, and the log."""
        lines = [self.about(name, pid) for name, pid in self._known.items()]
        lines += [f"{name}: {each}" for name, link in self.links.items() if (each := link.warning)]
        faults = [*self._faults, *self._injected]
        lines += ["faults:"] if faults else []
        lines += [f"  {what}: {_standing(fault)}" for what, fault in faults]
        return "\n".join([*lines, str(self.log)])

    def report_lines(self) -> list[str]:
        """Return what the report of a failed test shows."""
        return [self.seen()]


def _standing(fault: Rule | PlannedFault) -> str:
    if isinstance(fault, Rule):
        return f"met {fault.count}"
    return "done" if fault.done else "to come"


def _after(nth: int) -> Callable[[WireMessage], bool]:
    """Return what does not hold of the first messages that it is asked about."""
    met = count()
    return lambda _: next(met) >= nth
