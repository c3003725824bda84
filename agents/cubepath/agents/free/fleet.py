"""The processes of a run without rounds: a router, keepers and modules. Nothing paces them.

A fleet starts them, watches them, and ends them. When one of them dies, `on_crash` decides what
happens: keepers restart from their logs, and modules are placed again where they were.
"""

import shutil
import tempfile
from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Unpack

import msgspec
from msgspec.structs import replace

from cubepath.agents.free.config import FreeProcessConfig, OnCrash, OwnMove
from cubepath.agents.keepers.config import KeeperConfig
from cubepath.agents.processes.child_processes import EndedProcess
from cubepath.agents.processes.fleet import LEFT, FleetOptions, ProcessFleet
from cubepath.agents.processes.membership import LOG_BYTES_MAX, offer
from cubepath.agents.processes.pacer import ProcessDied
from cubepath.agents.rules.registry import rule_named
from cubepath.protocol.core.errors import CheckError, InputError
from cubepath.protocol.core.formatting import did_you_mean
from cubepath.protocol.core.output_files import unwritable, written_whole
from cubepath.protocol.core.system import Scene
from cubepath.protocol.scenes.toml import scene_to_toml
from cubepath.protocol.wire.credentials import (
    certificate_files,
    keeper_name,
    number_in,
    process_name,
)
from cubepath.protocol.wire.outgoing_log import INCARNATIONS_OF_A_FLEET

_KEEPER, _HOST = "cubepath.agents.keepers.process", "cubepath.agents.free.process"
_END_S_MAX = 2.0
"""How long processes may take to end after they were told to; killed they lose nothing either."""
INCARNATIONS = "incarnations"
"""The file in a folder of logs with the run that began them and its last incarnations."""
_RESTARTS_MAX = 100
"""How often processes are restarted in all: one that dies immediately would do so forever."""


@dataclass(frozen=True, slots=True)
class Crash:
    """A process has died: how, and whether it was started again, or is back."""

    name: str
    how: str
    restarted: bool


@dataclass(frozen=True, slots=True)
class Handover:
    """A process or a keeper continues elsewhere, or is back; nothing has died."""

    name: str
    how: str


class FreeFleet(ProcessFleet):
    """The processes of a run without rounds: keepers, and the modules that come with `begin`."""

    def __init__(
        self,
        scene: Scene,
        rule: str,
        *,
        keepers: int = 2,
        speeds: Mapping[int, float] | None = None,
        jitter: float = 0.0,
        on_crash: OnCrash = "stop",
        schedule: Mapping[int, Sequence[OwnMove]] | None = None,
        logs: Path | None = None,
        lock: IO[bytes] | None = None,
        known: Callable[[int], int] = lambda _: 0,
        **options: Unpack[FleetOptions],
    ) -> None:
        """Plan the fleet; the logs of keepers are kept in a folder `logs`, if one is named.

        What keepers have logged there before is taken up again. Each keeper holds the `lock` of
        that folder for as long as it lives. A keeper starts only if its log has as many commits as
        are `known`.
        """
        for name, number in (("processes", options.get("processes", 1)), ("keepers", keepers)):
            if number < 1:
                raise InputError(f"{name}={number}: expected 1 or more")
        if schedule is None:
            rule_named(rule, scene.system, "free")
        super().__init__(scene, rule, keepers=keepers, **options)
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
        self._incarnations: dict[str, int] = defaultdict(lambda: incarnations.incarnation)
        """By the name of a keeper or a process that of its last start."""
        self._known = known
        self._restarts = 0
        self._remote: set[str] = set()
        """The keepers and processes that have joined from elsewhere."""
        self._awaited: set[str] = set()
        """Those that are to continue elsewhere, and have not begun there."""
        self._left: set[str] = set()
        """Remote processes that are not there at the moment."""
        self._deal([])

    def _start_processes(self) -> None:
        if self._joiners is not None:
            self._remote = set(self._joiners.names)
        if self._logs is None:
            folder = self._folder = Path(tempfile.mkdtemp(prefix="cubepath-keepers-"))
            self._resources.callback(shutil.rmtree, folder, ignore_errors=True)
        else:
            self._folder = self._logs
            self._folder.mkdir(parents=True, exist_ok=True)
        for keeper in range(self.keepers):
            self._launch(keeper_name(keeper))

    def begin(self, processes: Iterable[int] | None = None) -> None:
        """Start the modules, or those of some processes; others may come later."""
        for process in range(len(self.modules_of)) if processes is None else processes:
            self._launch(process_name(process))

    def processes_alive(self) -> set[int]:
        """Return the numbers of the module processes that have not died."""
        alive = self._children.by_name.keys() | (self._remote - self._left)
        return {n for n in range(len(self.modules_of)) if process_name(n) in alive}

    def _launch(self, name: str) -> None:
        """Start a keeper or a process, or send it its orders."""
        if self._joiners is not None and name in self._remote:
            self._joiners.send(name, offer(self._config(name), "free"))
            return
        config = self._config(name)
        endpoint, credentials = self._access(name)
        config = replace(config, endpoint=endpoint, credentials=credentials)
        if isinstance(config, KeeperConfig):
            self._children.spawn(name, _KEEPER, config, self._lock)
        else:
            self._children.spawn(name, _HOST, config)

    def _config(self, name: str) -> KeeperConfig | FreeProcessConfig:
        """Return the configuration of a process, apart from how it finds the router."""
        if name.startswith("keeper_"):
            return self._config_of_keeper(number_in(name))
        return self._config_of_process(number_in(name))

    def _config_of_keeper(self, keeper: int) -> KeeperConfig:
        name = keeper_name(keeper)
        if self._folder is None:
            raise AssertionError("no folder for logs")  # it is there before any process
        return KeeperConfig(
            endpoint="",
            run=self.run,
            keeper=keeper,
            keepers=self.keepers,
            modules_of=self.modules_of,
            scene=self._text,
            log="" if name in self._remote else str(log_of(self._folder, keeper)),
            logged=log_of(self._folder, keeper).read_bytes() if name in self._awaited else b"",
            log_run=self._log_run,
            commits=self._known(keeper),
            incarnation=self._incarnations[name],
            tell_reads=self._schedule is not None,
        )

    def _config_of_process(self, process: int) -> FreeProcessConfig:
        modules, schedule = self.modules_of[process], self._schedule
        return FreeProcessConfig(
            endpoint="",
            run=self.run,
            process=process,
            modules=modules,
            keepers=self.keepers,
            incarnation=self._incarnations[process_name(process)],
            scene=self._text,
            rule=self._rule,
            seed=self._seed,
            hesitate=self._hesitate,
            speeds={module: self._speeds[module] for module in modules if module in self._speeds},
            jitter=self._jitter,
            schedule=None
            if schedule is None
            else {module: list(schedule.get(module, ())) for module in modules},
        )

    def look(self) -> list[Crash | Handover]:
        """Look after the processes; return who has died or moved since this was last called.

        ProcessDied if that ends the run.
        """
        found = []
        if self._look_after_the_router():
            found.append(Crash("router", "died", restarted=True))
        found += map(self._crashed, self._children.ended())
        moved = self._look_for_handovers()
        found += self._look_for_the_remote()
        self._restarts += sum(crash.restarted for crash in found)
        if self._restarts > _RESTARTS_MAX:
            raise ProcessDied(f"processes died {self._restarts} times, {found[-1].name} the last")
        return [*moved, *found]

    def _look_for_handovers(self) -> list[Handover]:
        """Let others continue for processes and keepers, and continue for those that leave."""
        if self._joiners is None or self._folder is None:
            return []
        taken, begun, returned = self._joiners.look()
        found = []
        for name in taken:
            if name not in self._remote:
                found.append(Handover(name, "continues elsewhere"))
                if name in self._children.by_name:
                    self._children.kill(name)  # its log is complete, and its attempts are decided
                self._remote.add(name)
                self._awaited.add(name)
            self._incarnations[name] += 1
            self._launch(name)
        for name in begun:
            # From here on its log is elsewhere alone, so nobody else can begin with it.
            self._awaited.discard(name)
            log_of(self._folder, number_in(name)).unlink(missing_ok=True)
            self._joiners.answer(name)
        for name, log in returned.items():
            reason = self._take_back(self._folder, name, log)
            self._joiners.answer(name, reason)
            if reason is None:
                self._joiners.withdraw(name)
                found.append(Handover(name, "was handed back and continues here"))
                self._continue_here(name)
        there = {name for name in self._awaited if self._joiners.is_there(name)}
        self._awaited -= {name for name in there if not name.startswith("keeper_")}
        for name in sorted(self._awaited.intersection(self._joiners.gone())):
            found.append(Handover(name, "continues here, as nobody has begun elsewhere"))
            self._joiners.withdraw(name)
            self._continue_here(name)
        return found

    def _continue_here(self, name: str) -> None:
        """Start a process again that was elsewhere, or was to be."""
        for names in (self._remote, self._awaited, self._left):
            names.discard(name)
        self._incarnations[name] += 1
        self._launch(name)

    def _take_back(self, folder: Path, name: str, log: bytes) -> str | None:
        """Keep the log of a keeper that comes back; return why it cannot continue here, if so."""
        try:
            if self._network.secure is not None:
                certificate_files(self._network.secure, name)
            if name.startswith("keeper_"):
                with written_whole(log_of(folder, number_in(name))) as file:
                    file.write(log)
        except (InputError, CheckError) as error:
            return str(error)
        return None

    def _places(self, folder: Path) -> dict[str, list[int]]:
        """Return the places that others may take, with their modules."""
        found = {process_name(n): modules for n, modules in enumerate(self.modules_of)}
        found |= {keeper_name(k): [] for k in range(self.keepers)}
        return {
            name: modules
            for name, modules in found.items()
            if (name in self._left if name in self._remote else self._can_move(folder, name))
        }

    def _can_move(self, folder: Path, name: str) -> bool:
        """Return whether what is here could continue elsewhere: a keeper's log goes with it."""
        if not name.startswith("keeper_"):
            return True
        try:
            return log_of(folder, number_in(name)).stat().st_size <= LOG_BYTES_MAX
        except OSError:
            return False

    def _look_for_the_remote(self) -> list[Crash]:
        """Return those that have left and those that are back."""
        if self._joiners is None or self._folder is None:
            return []
        left = set(self._joiners.gone())
        new, back = sorted(left - self._left), sorted(self._left - left)
        self._left = left
        self._joiners.vacate(self._places(self._folder))
        if new and self.on_crash == "stop":
            raise ProcessDied(f"{new[0]} has ended: {LEFT}")
        return [
            *(Crash(name, LEFT, restarted=False) for name in new),
            *(Crash(name, LEFT, restarted=True) for name in back),
        ]

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

        InputError for any other name, and for a process that lives or is remote.
        """
        names = [
            *map(process_name, range(len(self.modules_of))),
            *map(keeper_name, range(self.keepers)),
        ]
        if name not in names:
            near = did_you_mean(name, names)
            raise InputError(
                f"{name}: cannot be started again{near}, expected one of {', '.join(names)}"
            )
        if name in self._remote:
            raise InputError(f"{name}: has joined from elsewhere, expected a local process")
        if self._children.lives(name):
            raise InputError(f"{name}: lives, expected a process that has died")
        self._incarnations[name] += 1
        self._launch(name)

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
