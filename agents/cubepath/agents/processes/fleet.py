"""The fleet: it starts, paces and ends module processes, and decides nothing for them.

Room: agents. A fleet opens a router on a free loopback port, starts the processes, and lets each
phase of a round begin when every process has finished the previous one. A sink, if given, receives
every message as it was on the wire.
"""

from __future__ import annotations

import contextlib
import subprocess
import sys
import tempfile
import threading
import time
import uuid
from collections.abc import Callable, Iterator, Mapping
from queue import Empty, SimpleQueue
from types import TracebackType
from typing import IO, Literal, Self

import msgspec
import zenoh

from cubepath.agents.processes.host import TOLD, Host, Orders
from cubepath.protocol.core.errors import CheckError, CubepathError, InputError
from cubepath.protocol.core.names import GeneratorPlacement
from cubepath.protocol.core.system import Scene
from cubepath.protocol.path_files.schedules import OwnMoves
from cubepath.protocol.scenes.toml import scene_to_toml
from cubepath.protocol.wire.keys import everything, key_of, topic_in, topic_key
from cubepath.protocol.wire.messages import Act, Go, Message, Ready, Reset, decode, encode
from cubepath.protocol.wire.sessions import (
    open_client,
    open_router,
    put,
    subscribe,
    wait_for_subscriber,
)

Phase = Literal["sense", "claim", "settle"]
Sink = Callable[[str, bytes, int], None]
"""Receives the topic, the bytes and the wall time in nanoseconds of each message."""

_POLL_S = 0.05
_STDERR = 2
_STALL_S_MAX = 60.0
_END_S_MAX = 5.0
_HURRY_S_MAX = 0.5


class ProcessDied(CheckError):  # noqa: N818 - named for what happened
    """A module process ended before the run did."""


class Fleet:
    """The processes of one run, as a context manager that leaves nothing running.

    On exit it releases every process, session and port, whatever happened.
    """

    def __init__(
        self,
        scene: Scene,
        rule: str,
        *,
        seed: int = 0,
        hesitate: float = 0.0,
        processes: int = 2,
        note_length: int = 0,
        schedule: Mapping[int, OwnMoves] | None = None,
        sink: Sink | None = None,
        check: Callable[[], None] | None = None,
    ) -> None:
        """Plan the fleet; `processes` 0 keeps the modules in a thread here, still on a session.

        With a `schedule`, each module makes its own moves in their rounds, and follows the rule
        after `end_schedule`.

        With `sink` None the fleet listens only to `Ready`. `check` is called while waiting and may
        raise to end the run between two messages.
        """
        count = len(scene.start)
        if processes < 0:
            raise InputError(f"processes={processes}: expected 0 or more")
        self.scene = scene
        self.processes = min(processes, count)
        self.run = uuid.uuid4().hex[:12]
        self.round = 0
        self._rule = rule
        self._seed = seed
        self._hesitate = hesitate
        self._note_length = note_length
        self._schedule = schedule
        self._sink = sink
        self._check = check
        self._expect: tuple[int, str] = (0, "join")
        self._joined = False
        self._session: zenoh.Session | None = None
        self.endpoint = ""
        """Where the router listens; other sessions can join there."""
        hosts = max(1, self.processes)
        self.modules_of = [list(range(host, count, hosts)) for host in range(hosts)]
        self._children: list[subprocess.Popen[bytes]] = []
        self._complaints: list[IO[bytes]] = []
        self._thread: threading.Thread | None = None
        self._thread_error: list[BaseException] = []
        self._ready: set[int] = set()
        self._queue: SimpleQueue[tuple[str, bytes, int]] = SimpleQueue()
        self._resources = contextlib.ExitStack()

    def __enter__(self) -> Self:
        """Start everything and wait until every process has joined."""
        try:
            self._start()
        except BaseException:
            self._end()
            raise
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Tell the processes to stop, kill those that do not, and close all sessions."""
        self._end()

    def _start(self) -> None:
        router, self.endpoint = open_router(processes=self.processes)
        self._resources.callback(router.close)
        session = self._session = open_client(self.endpoint)
        self._resources.callback(session.close)
        listen = topic_key(self.run, "ready") if self._sink is None else everything(self.run)
        subscriber = subscribe(session, listen, self._enqueue)
        self._resources.callback(subscriber.undeclare)
        wait_for_subscriber(router, topic_key(self.run, "ready", "process_0"))
        scene = scene_to_toml(self.scene)
        for process, modules in enumerate(self.modules_of):
            orders = Orders(
                endpoint=self.endpoint,
                run=self.run,
                process=process,
                modules=modules,
                scene=scene,
                rule=self._rule,
                seed=self._seed,
                hesitate=self._hesitate,
                note_length=self._note_length,
                schedule=self._own(modules),
            )
            if self.processes:
                self._spawn(orders)
            else:
                self._thread = threading.Thread(target=self._host, args=(orders,), daemon=True)
                self._thread.start()
        self._wait(0, "join")
        self._joined = True

    def _own(self, modules: list[int]) -> dict[int, dict[int, GeneratorPlacement]] | None:
        if self._schedule is None:
            return None
        return {module: dict(self._schedule.get(module, {})) for module in modules}

    def _host(self, orders: Orders) -> None:
        try:
            Host(orders).run()
        except BaseException as error:  # noqa: BLE001 - handed to the thread that waits
            self._thread_error.append(error)

    def _spawn(self, orders: Orders) -> None:
        complaints = tempfile.TemporaryFile()  # noqa: SIM115 - closed with the rest
        self._resources.callback(complaints.close)
        child = subprocess.Popen(
            # -P: modules import nothing from the folder in which the run was started.
            [sys.executable, "-P", "-m", "cubepath.agents.processes.host"],
            stdin=subprocess.PIPE,
            stdout=_STDERR,  # what a rule prints is for people
            stderr=complaints,
            # A terminal's interrupt goes to the coordinator, which ends its processes properly.
            process_group=0,
        )
        self._children.append(child)
        self._complaints.append(complaints)
        if child.stdin is None:  # it was requested above
            raise AssertionError("no pipe to the module process")
        with contextlib.suppress(BrokenPipeError):  # it died at once: noticed when waiting
            child.stdin.write(msgspec.json.encode(orders) + b"\n")
            child.stdin.flush()

    def _enqueue(self, sample: zenoh.Sample) -> None:
        self._queue.put((str(sample.key_expr), sample.payload.to_bytes(), time.time_ns()))

    def reset(self, seed: int) -> None:
        """Put every module back at its start, with another seed; rounds count from 1 again."""
        self.round = 0
        self._say(Reset(0, seed))
        self._wait(0, "join")

    def rounds(self, most: int) -> Iterator[int]:
        """Play up to `most` rounds; yield the number of each once all its messages have arrived."""
        for _ in range(most):
            self.begin_round()
            self._phase("claim")
            self._phase("settle")
            yield self.round

    def end_schedule(self) -> None:
        """Let all modules follow their rule from the next round on; call it between two rounds."""
        self._say(Go(self.round, "over"))

    def begin_round(self) -> None:
        """Begin the next round: every module says that it is here."""
        self.round += 1
        self._phase("sense")

    def ask(self) -> None:
        """Let modules driven from outside send their observations, without waiting for them."""
        self._say(Go(self.round, "claim"))

    def act(self, acts: list[Act]) -> None:
        """Send the actions of modules driven from outside, and finish the round."""
        for act in acts:
            self._say(act)
        self._wait(self.round, "claim")
        self._phase("settle")

    def pump(self, done: Callable[[], bool]) -> None:
        """Hand messages to the sink until `done`; CheckError if a process dies meanwhile."""
        self._take(done, "its observations")

    def _phase(self, phase: Phase) -> None:
        self._ready.clear()
        self._say(Go(self.round, phase))
        self._wait(self.round, phase)

    def _say(self, message: Message) -> None:
        key = key_of(self.run, self.scene.system, message)
        if self._session is None:
            raise CubepathError("the fleet has ended: start another")
        if key is not None:
            put(self._session, key, encode(message))

    def _wait(self, round_number: int, phase: str) -> None:
        everyone = set(range(len(self.modules_of)))
        self._expect = (round_number, phase)
        self._take(lambda: self._ready == everyone, f"phase {phase} of round {round_number}")
        self._ready.clear()

    def _take(self, done: Callable[[], bool], what: str) -> None:
        quiet_since = time.monotonic()
        while not done():
            if self._check is not None:
                self._check()
            try:
                key, data, wall_ns = self._queue.get(timeout=_POLL_S)
            except Empty:
                self._look_for_the_dead()
                if time.monotonic() - quiet_since > _STALL_S_MAX:
                    late = ", ".join(self._name(process) for process in self._missing())
                    waited = f"no answer within {_STALL_S_MAX:.0f} s"
                    raise ProcessDied(f"{waited} to {what} from {late}") from None
                continue
            quiet_since = time.monotonic()
            topic = topic_in(self.run, key)
            if topic.startswith("ready/"):
                self._tick(data)
            if self._sink is not None:
                self._sink(topic, data, wall_ns)

    def _tick(self, data: bytes) -> None:
        ready = decode(data)
        if isinstance(ready, Ready) and (ready.round, ready.phase) == self._expect:
            self._ready.add(ready.process)

    def _missing(self) -> list[int]:
        return [p for p in range(len(self.modules_of)) if p not in self._ready]

    def _name(self, process: int) -> str:
        modules = ", ".join(f"module_{module}" for module in self.modules_of[process])
        return f"{modules} (process {process})"

    def _look_for_the_dead(self) -> None:
        if self._check is not None:
            self._check()  # an interrupt takes precedence over its consequences
        for error in self._thread_error:
            if isinstance(error, CubepathError):
                raise error
            what = f"{type(error).__name__}: {' '.join(str(error).split())}"
            raise ProcessDied(f"{self._name(0)} died in round {self.round}: {what}") from error
        for process, child in enumerate(self._children):
            code = child.poll()
            if code is None:
                continue
            complaints = self._complaints[process]
            complaints.seek(0)
            last = complaints.read().decode(errors="replace").strip().rpartition("\n")[2]
            if code == TOLD and last:
                raise ProcessDied(last)
            how = f"killed by signal {-code}" if code < 0 else f"exit code {code}"
            raise ProcessDied(
                f"{self._name(process)} died in round {self.round}: {how}"
                + (f": {last}" if last else "")
            )

    @property
    def pids(self) -> list[int]:
        """Return the process ids of the module processes."""
        return [child.pid for child in self._children]

    def _end(self) -> None:
        try:
            if self._session is not None:
                with contextlib.suppress(Exception):  # the rest must still end
                    self._say(Go(self.round, "stop"))
            deadline = time.monotonic() + (_END_S_MAX if self._joined else _HURRY_S_MAX)
            if self._thread is not None:
                self._thread.join(_END_S_MAX)
            for child in self._children:
                with contextlib.suppress(subprocess.TimeoutExpired):
                    child.wait(max(0.0, deadline - time.monotonic()))
        finally:
            for child in self._children:
                if child.poll() is None:
                    child.kill()
                    child.wait()
                if child.stdin is not None:
                    with contextlib.suppress(OSError):
                        child.stdin.close()
            self._children.clear()
            self._session = None
            self._resources.close()
