"""The fleet: it starts, paces and ends module processes, and decides nothing for them.

Room: agents. A fleet starts a router on a free loopback port and the processes, and carries out
what its pacing node asks for. A sink, if given, receives every message as it was on the wire.
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
from types import TracebackType
from typing import IO, Self, TypeAlias

import msgspec

from cubepath.agents.processes.dealing import dealt
from cubepath.agents.processes.host import TOLD, host
from cubepath.agents.processes.judge import Judge
from cubepath.agents.processes.orders import OUTSIDE, Orders
from cubepath.agents.processes.pacer import PATIENCE_S, Check, Pacer, ProcessDied
from cubepath.agents.rules.registry import rule_named
from cubepath.protocol.core.errors import CubepathError, InputError
from cubepath.protocol.core.names import GeneratorPlacement
from cubepath.protocol.core.system import Scene
from cubepath.protocol.path_files.schedules import OwnMoves
from cubepath.protocol.scenes.toml import scene_to_toml
from cubepath.protocol.wire.messages import Act, Message
from cubepath.protocol.wire.nodes import Effect, Keep
from cubepath.protocol.wire.router import Router
from cubepath.protocol.wire.shell import Shell

Sink: TypeAlias = Callable[[Message, bytes, int], None]
"""Receives each message, its bytes on the wire and the wall time in nanoseconds."""

_POLL_S = 0.05
_LOOK_S = 0.5
_STDERR = 2
_END_S_MAX = 5.0
_HURRY_S_MAX = 0.5
_RESTARTS_MAX = 10


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
        patience_s: float = PATIENCE_S,
        sink: Sink | None = None,
        check: Callable[[], None] | None = None,
        plausible: Check | None = None,
    ) -> None:
        """Plan the fleet; `processes` 0 keeps the modules in a thread here, still on a session.

        With a `schedule`, each module makes its own moves in their rounds, and follows the rule
        after `end_schedule`. A phase in which nothing comes of anyone for `patience_s` ends the
        run.

        With `sink` None the fleet listens only to the answers of processes. `check` is called while
        waiting and may raise to end the run between two messages. `plausible` may refuse what
        modules say or report.
        """
        if processes < 0:
            raise InputError(f"processes={processes}: expected 0 or more")
        self.scene = scene
        self.processes = min(processes, len(scene.start))
        self.run = uuid.uuid4().hex[:12]
        self._rule = rule
        self._seed = seed
        self._hesitate = hesitate
        self._note_length = note_length
        self._schedule = schedule
        self._sink = sink
        self._check = check
        self._joined = False
        self.endpoint = ""
        """Where the router listens; other sessions can join there."""
        self.modules_of = dealt(scene, max(1, self.processes))
        self._judge = Judge(self.run, self.modules_of, scene.system)
        self._judge.note_length = 0 if schedule is not None else self._rule_note_length()
        self._pacer = Pacer(
            self.run,
            self.modules_of,
            judge=self._judge,
            check=plausible,
            patience_s=patience_s,
            hears_all=sink is not None,
        )
        self._router: Router | None = None
        self._shell: Shell | None = None
        self._children: list[subprocess.Popen[bytes]] = []
        self._complaints: list[IO[bytes]] = []
        self._thread: threading.Thread | None = None
        self._thread_error: list[BaseException] = []
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
        router = self._router = Router(processes=self.processes)
        self._resources.callback(router.close)
        self.endpoint = router.endpoint
        shell = Shell(self._pacer, self.endpoint, self._keep)
        self._resources.callback(shell.close)
        self._shell = shell
        shell.start()
        scene = scene_to_toml(self.scene)
        for process, modules in enumerate(self.modules_of):
            if self._check is not None:
                self._check()
            orders = Orders(
                endpoint=self.endpoint,
                run=self.run,
                process=process,
                modules=modules,
                processes=self.modules_of,
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
        self._wait()
        self._joined = True

    def _rule_note_length(self) -> int:
        if self._rule == OUTSIDE:
            return self._note_length
        return rule_named(self._rule, self.scene.system).note_length(len(self.scene.start))

    def _own(self, modules: list[int]) -> dict[int, dict[int, GeneratorPlacement]] | None:
        if self._schedule is None:
            return None
        return {module: dict(self._schedule.get(module, {})) for module in modules}

    def _host(self, orders: Orders) -> None:
        try:
            host(orders)
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

    def _keep(self, kept: Keep, wall_ns: int) -> None:
        if self._sink is not None:
            self._sink(kept.message, kept.data, wall_ns)

    @property
    def round(self) -> int:
        """Return the number of the round on the wire; it goes on counting after `reset`."""
        return self._pacer.round

    def reset(self, seed: int) -> None:
        """Put every module back at its start, with another seed."""
        self._do(self._pacer.reset(seed))

    def rounds(self, most: int) -> Iterator[int]:
        """Play up to `most` rounds; yield the number of each once all its messages have arrived."""
        for _ in range(most):
            yield self.play_round()

    def play_round(self) -> int:
        """Play a round; return its number once all its messages have arrived."""
        self._do(self._pacer.begin_round())
        return self.round

    def end_schedule(self) -> None:
        """Let all modules follow their rule from the next round on; call it between two rounds."""
        self._judge.note_length = self._rule_note_length()
        self._do(self._pacer.end_schedule())

    def observe(self) -> None:
        """Begin the next round; modules driven from outside send their observations."""
        self._do(self._pacer.begin_round(driven=True))

    def act(self, acts: list[Act]) -> None:
        """Send the actions of modules driven from outside, and finish the round."""
        self._do(self._pacer.act(acts))

    def _do(self, effects: list[Effect]) -> None:
        """Carry out what the pacing node asks for, and wait until it is idle."""
        if self._shell is None:
            raise CubepathError("the fleet has ended: start another")
        self._shell.carry_out(effects)
        self._wait()

    def _wait(self) -> None:
        shell = self._shell
        if shell is None:
            raise CubepathError("the fleet has ended: start another")
        looked = time.monotonic()
        while not self._pacer.idle:
            if self._check is not None:
                self._check()
            came = shell.step(_POLL_S)
            # Also while somebody talks: a message is no sign that all are alive.
            if not came or time.monotonic() - looked > _LOOK_S:
                looked = time.monotonic()
                self._look_for_the_dead()

    def _look_for_the_dead(self) -> None:
        if self._check is not None:
            self._check()  # an interrupt takes precedence over its consequences
        for error in self._thread_error:
            if isinstance(error, CubepathError):
                raise error
            what = f"{type(error).__name__}: {' '.join(str(error).split())}"
            raise self._pacer.died(0, what) from error
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
            raise self._pacer.died(process, how + (f": {last}" if last else ""))
        if self._router is not None and self._router.look_after():
            self._router_died()

    def _router_died(self) -> None:
        """Go on with a router that was started again, unless it dies time and again."""
        if self._router is not None and self._router.restarts > _RESTARTS_MAX:
            raise ProcessDied(f"the router died {self._router.restarts} times")

    @property
    def pids(self) -> list[int]:
        """Return the process ids of the module processes."""
        return [child.pid for child in self._children]

    @property
    def router_pid(self) -> int:
        """Return the process id of the router, which may change if it dies."""
        if self._router is None:
            raise CubepathError("the fleet has ended: start another")
        return self._router.pid

    def _end(self) -> None:
        try:
            if self._shell is not None:
                with contextlib.suppress(Exception):  # the rest must still end
                    self._shell.carry_out(self._pacer.stop())
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
            self._shell = None
            self._resources.close()
