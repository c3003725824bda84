"""The processes of a run without rounds: a router, keepers and modules. Nothing paces them.

A fleet starts them, watches them, and ends them. When one of them dies, `on_crash` decides what
happens: keepers restart from their logs, and modules are placed again where they were.
"""

import shutil
import tempfile
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import IO

import msgspec

from cubepath.agents.free.config import FreeProcessConfig, OnCrash, OwnMove
from cubepath.agents.keepers.config import KeeperConfig
from cubepath.agents.processes.child_processes import EndedProcess
from cubepath.agents.processes.dealing import dealt
from cubepath.agents.processes.fleet import ProcessFleet
from cubepath.agents.processes.network import Way, straight
from cubepath.agents.processes.pacer import ProcessDied
from cubepath.agents.rules.registry import rule_named
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.formatting import did_you_mean
from cubepath.protocol.core.output_files import unwritable, written_whole
from cubepath.protocol.core.system import Scene
from cubepath.protocol.scenes.toml import scene_to_toml
from cubepath.protocol.wire.credentials import keeper_name, process_name
from cubepath.protocol.wire.outgoing_log import INCARNATIONS_OF_A_FLEET
from cubepath.protocol.wire.router import Router

_KEEPER, _HOST = "cubepath.agents.keepers.process", "cubepath.agents.free.process"
_END_S_MAX = 2.0
"""How long processes may take to end after they were told to; killed they lose nothing either."""
INCARNATIONS = "incarnations"
"""The file in a folder of logs with the run that began them and its last incarnations."""
_RESTARTS_MAX = 100
"""How often processes are restarted in all: one that dies immediately would do so forever."""


@dataclass(frozen=True, slots=True)
class Crash:
    """A process has died: how, and whether it was started again."""

    name: str
    how: str
    restarted: bool


class FreeFleet(ProcessFleet):
    """The processes of a run without rounds: keepers, and the modules that come with `begin`."""

    def __init__(
        self,
        scene: Scene,
        rule: str,
        *,
        seed: int = 0,
        hesitate: float = 0.0,
        processes: int = 2,
        keepers: int = 2,
        speeds: Mapping[int, float] | None = None,
        jitter: float = 0.0,
        on_crash: OnCrash = "stop",
        schedule: Mapping[int, Sequence[OwnMove]] | None = None,
        logs: Path | None = None,
        lock: IO[bytes] | None = None,
        way: Way = straight,
        known: Callable[[int], int] = lambda _: 0,
    ) -> None:
        """Plan the fleet; the logs of keepers are kept in a folder `logs`, if one is named.

        What keepers have logged there before is taken up again. Each keeper holds the `lock` of
        that folder for as long as it lives. Keepers and module processes take
        the `way` to the router. A keeper starts only if its log has as many commits as are `known`.
        """
        for name, number in (("processes", processes), ("keepers", keepers)):
            if number < 1:
                raise InputError(f"{name}={number}: expected 1 or more")
        if schedule is None:
            rule_named(rule, scene.system, "free")
        super().__init__(scene, rule, seed=seed, hesitate=hesitate, way=way)
        self.keepers = keepers
        self.modules_of = dealt(scene, min(processes, len(scene.start)))
        self.on_crash = on_crash
        self._speeds = dict(speeds or {})
        self._jitter = jitter
        self._schedule = schedule
        self._logs = logs
        self._lock = lock
        self._folder: Path | None = None
        self._text = scene_to_toml(scene)
        incarnations = next_incarnations(logs, self.run)
        self._log_run = incarnations.run
        self._incarnations = dict.fromkeys(range(len(self.modules_of)), incarnations.incarnation)
        self._incarnations_of_keepers = dict.fromkeys(range(keepers), incarnations.incarnation)
        self._known = known
        self._restarts = 0

    def _start(self) -> None:
        if self._logs is None:
            folder = self._folder = Path(tempfile.mkdtemp(prefix="cubepath-keepers-"))
            self._resources.callback(shutil.rmtree, folder, ignore_errors=True)
        else:
            self._folder = self._logs
            self._folder.mkdir(parents=True, exist_ok=True)
        self._open_router(Router(processes=len(self.modules_of), keepers=self.keepers))
        for keeper in range(self.keepers):
            self._keep(keeper)

    def begin(self, processes: Iterable[int] | None = None) -> None:
        """Start the modules, or those of some processes; others may come later."""
        for process in range(len(self.modules_of)) if processes is None else processes:
            self._host(process)

    def processes_alive(self) -> set[int]:
        """Return the numbers of the module processes that have not died."""
        return {
            process
            for process in range(len(self.modules_of))
            if process_name(process) in self._children.by_name
        }

    def _keep(self, keeper: int) -> None:
        name = keeper_name(keeper)
        endpoint, credentials = self._access(name)
        if self._folder is None:
            raise AssertionError("no folder for logs")  # it is there before the router is
        config = KeeperConfig(
            endpoint=endpoint,
            run=self.run,
            keeper=keeper,
            keepers=self.keepers,
            modules_of=self.modules_of,
            scene=self._text,
            log=str(log_of(self._folder, keeper)),
            log_run=self._log_run,
            commits=self._known(keeper),
            incarnation=self._incarnations_of_keepers[keeper],
            tell_reads=self._schedule is not None,
            credentials=credentials,
        )
        self._children.spawn(name, _KEEPER, config, self._lock)

    def _host(self, process: int) -> None:
        name, modules = process_name(process), self.modules_of[process]
        schedule = self._schedule
        endpoint, credentials = self._access(name)
        config = FreeProcessConfig(
            endpoint=endpoint,
            run=self.run,
            process=process,
            modules=modules,
            keepers=self.keepers,
            incarnation=self._incarnations[process],
            scene=self._text,
            rule=self._rule,
            seed=self._seed,
            hesitate=self._hesitate,
            speeds={module: self._speeds[module] for module in modules if module in self._speeds},
            jitter=self._jitter,
            schedule=None
            if schedule is None
            else {module: list(schedule.get(module, ())) for module in modules},
            credentials=credentials,
        )
        self._children.spawn(name, _HOST, config)

    def look(self) -> list[Crash]:
        """Look after the processes; return those that have died since this was last called.

        ProcessDied if that ends the run.
        """
        router = self._router
        found = []
        if router is not None and router.look_after():
            found.append(Crash("router", "died", restarted=True))
        found += map(self._crashed, self._children.ended())
        self._restarts += sum(crash.restarted for crash in found)
        if self._restarts > _RESTARTS_MAX:
            raise ProcessDied(f"processes died {self._restarts} times, {found[-1].name} the last")
        return found

    def _crashed(self, ended: EndedProcess) -> Crash:
        if ended.error is not None:  # it would end so again
            raise ProcessDied(ended.error)
        if self.on_crash == "stop":
            raise ProcessDied(f"{ended.name} has ended: {ended.how}")
        self._children.forget(ended.name)
        if self.on_crash == "restart":
            self.start_again(ended.name)
        return Crash(ended.name, ended.how, restarted=self.on_crash == "restart")

    def start_again(self, name: str) -> None:
        """Start a process again that has died, or was never started.

        InputError for any other name, and for a process that lives.
        """
        hosts = {process_name(each): each for each in self._incarnations}
        keepers = {keeper_name(each): each for each in self._incarnations_of_keepers}
        if name not in hosts | keepers:
            near = did_you_mean(name, hosts | keepers)
            known = ", ".join((*hosts, *keepers))
            raise InputError(f"{name}: cannot be started again{near}, expected one of {known}")
        if self._children.lives(name):
            raise InputError(f"{name}: lives, expected a process that has died")
        if name in keepers:
            self._incarnations_of_keepers[keepers[name]] += 1
            self._keep(keepers[name])
        else:
            self._incarnations[hosts[name]] += 1
            self._host(hosts[name])

    def leave(self, process: int) -> None:
        """End a module process permanently, without a crash: its modules stay where they are."""
        self._children.kill(process_name(process))

    @property
    def _end_s(self) -> float:
        return _END_S_MAX


class LogsInfo(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What a folder of logs says of itself: the run that began it, and its last incarnation."""

    run: str
    incarnation: int


def log_of(logs: Path, keeper: int) -> Path:
    """Return the path of a keeper's log."""
    return logs / f"{keeper_name(keeper)}.log"


def read_incarnations(logs: Path) -> LogsInfo | None:
    """Return what a folder of logs says of itself, None if it has no logs yet.

    InputError if it has logs and does not say it.
    """
    path = logs / INCARNATIONS
    try:
        return msgspec.json.decode(path.read_bytes(), type=LogsInfo)
    except FileNotFoundError:
        if next(logs.glob("keeper_*.log"), None) is None:
            return None
        found = "not there"
    except (msgspec.DecodeError, UnicodeDecodeError) as error:
        found = str(error)
    except OSError as error:
        found = error.strerror or str(error)
    raise InputError(
        f"{path}: {found}, expected the run and the incarnation of the logs in its folder"
    )


def next_incarnations(logs: Path | None, run: str) -> LogsInfo:
    """Return the run that began these logs, and a later first incarnation for all processes.

    It is in the folder when this returns, so it is not given again.
    """
    first = LogsInfo(run, 1)
    if logs is None:
        return first
    before = read_incarnations(logs)
    incarnations = (
        first
        if before is None
        else LogsInfo(before.run, before.incarnation + INCARNATIONS_OF_A_FLEET)
    )
    try:
        logs.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise unwritable(logs, error) from None
    with written_whole(logs / INCARNATIONS) as file:
        file.write(msgspec.json.encode(incarnations))
    return incarnations
