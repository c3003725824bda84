"""A run: modules in processes, their edge path gathered and shortened, everything on record.

Room: coordinator. It starts the fleet, paces rounds and listens; it decides nothing for a module.
"""

from __future__ import annotations

import platform
import re
import signal
import sys
import threading
import time
from collections.abc import Callable, Generator
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from types import FrameType
from typing import Any

import msgspec

from cubepath.agents.processes.dealing import dealt
from cubepath.agents.processes.fleet import Fleet
from cubepath.agents.processes.pacer import PATIENCE_S, PATIENCE_S_MAX
from cubepath.agents.rules.registry import rule_named
from cubepath.agents.rules.schedule import SCHEDULE
from cubepath.coordinator.runs.conductor import Conductor, Ended, Ending
from cubepath.coordinator.runs.gatherer import Gatherer
from cubepath.coordinator.runs.schedule import (
    Assignment,
    assignment_of,
    read_schedule,
    with_end,
)
from cubepath.protocol.core.errors import CubepathError, InputError
from cubepath.protocol.core.system import Scene, local_only
from cubepath.protocol.path_files.schedules import schedule_to_jsonl
from cubepath.protocol.recordings.recording import TOPICS_MAX, RecordingWriter
from cubepath.protocol.scenes.registry import sound_family
from cubepath.protocol.scenes.specs import scene_from_spec
from cubepath.protocol.wire.keys import topic_of
from cubepath.protocol.wire.messages import (
    Message,
    Stopped,
    encode,
)
from cubepath.protocol.wire.sessions import check_descriptors

MAX_ROUNDS = 1000
_FLUSH_S = 0.5
_FLUSHES = (250, 1 << 18)
"""How much of a run a kill may lose: seconds, or messages, or bytes of them."""
DEFAULT_SYSTEM = "hex"
_NAME_MAX = 60
_SAID = ("ready", "said", "reports", "again", "waiting")
"""The kinds of messages that each process may send."""
_SAID_HERE = ("go", "refused", "edges", "cube", "certificate", "summary")
_INTERRUPTS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


class Interrupted(Exception):  # noqa: N818 - it is not an error, but what the user asked for
    """The user asked the run to stop."""


@dataclass(frozen=True, slots=True)
class Plan:
    """What to run; `rule` None means the rule of the system's family, which reaches the goal.

    With a `schedule`, a cubes file or a recording, the modules carry it out; `system` None then
    means the system of the recording, otherwise "hex". The run ends where the schedule stops, or
    with `repair` the modules follow the rule from there. `max_rounds` None allows as many rounds as
    the schedule needs, and `MAX_ROUNDS` for the rule.
    """

    system: str | None = None
    rule: str | None = None
    seed: int = 0
    hesitate: float = 0.0
    processes: int = 4
    max_rounds: int | None = None
    log: Path | None = None
    schedule: Path | None = None
    repair: bool = False
    patience: float = PATIENCE_S
    """For how many seconds nothing may come of a phase before the run ends."""


@dataclass(frozen=True, slots=True)
class Outcome:
    """The outcome of a run; the first fourteen fields are the keys of ``cubepath run --json``.

    So is `refused`, how many messages were refused. `error` is a key too if there is one. If a
    schedule was carried out, there are two more: how many cubes it has, and where it stopped, None
    if it did not.
    """

    log: str
    system: str
    rule: str
    seed: int
    modules: int
    processes: int
    rounds: int
    moves: int
    reduced_moves: int
    cubes: int
    max_cube_dimension: int
    goal_reached: bool
    path_digest: str
    seconds: float
    ended: Ended
    error: str | None
    messages: int
    refused: int = 0
    schedule_cubes: int | None = None
    schedule_stopped: Stopped | None = None

    def document(self) -> dict[str, Any]:
        """Return the keys of ``--json``."""
        extra = {"ended", "error", "messages"}
        if self.error is not None:
            extra -= {"error"}
        if self.schedule_cubes is None:
            extra |= {"schedule_cubes", "schedule_stopped"}
        found: dict[str, Any] = msgspec.to_builtins(
            {key: getattr(self, key) for key in self.__slots__ if key not in extra}
        )
        return found


Watch = Callable[[Gatherer], None]


def run(plan: Plan, watch: Watch | None = None) -> Outcome:
    """Run the plan to its end, close the recording, and return the outcome.

    InputError if the plan cannot be run at all; everything that goes wrong later (a process that
    dies, a rule that gives up, a full disk, an interrupt) is part of the outcome. `watch` is called
    after each round.
    """
    task = task_of(plan)
    _check_topics(task, plan.processes)
    check_descriptors(min(plan.processes, len(task.scene.start)), files=1)
    path = plan.log or Path("logs") / _file_name(plan, task)
    assignment = task.assignment
    schedule = None if assignment is None else schedule_to_jsonl(assignment.cubes)
    with RecordingWriter(
        path, task.scene, _parameters(plan, task), schedule, flushes=_FLUSHES
    ) as writer:
        return _Run(plan, task, writer).play(watch)


@dataclass(frozen=True, slots=True)
class Task:
    """A checked plan: the scene, the rule, and the maximal number of rounds.

    With an `assignment` the modules follow that first, and the rule only to repair a schedule.
    """

    scene: Scene
    rule: str
    max_rounds: int
    assignment: Assignment | None = None

    @property
    def name(self) -> str:
        """Return the name of the rule that modules follow at the beginning."""
        return self.rule if self.assignment is None else SCHEDULE


def task_of(plan: Plan) -> Task:
    """Return the task of a plan; InputError names what cannot be run."""
    if not 0.0 <= plan.hesitate < 1.0:
        raise InputError(f"hesitate={plan.hesitate}: expected at least 0 and less than 1")
    for key, number in (("seed", plan.seed), ("processes", plan.processes)):
        if number < 0:
            raise InputError(f"{key}={number}: expected 0 or more")
    if plan.max_rounds is not None and plan.max_rounds < 0:
        raise InputError(f"max-rounds={plan.max_rounds}: expected 0 or more")
    if not 0.0 < plan.patience < PATIENCE_S_MAX:
        raise InputError(
            f"patience={plan.patience}: expected more than 0 and less than {PATIENCE_S_MAX:g} s"
        )
    if plan.schedule is not None:
        return _task_of_schedule(plan, plan.schedule)
    if plan.repair:
        raise InputError("repair: there is no schedule that could need it")
    scene = _with_runs(_scene_named(plan.system))
    most = MAX_ROUNDS if plan.max_rounds is None else plan.max_rounds
    return Task(scene, _rule_of(plan, scene), most)


def _scene_named(system: str | None) -> Scene:
    return scene_from_spec(DEFAULT_SYSTEM if system is None else system)


def _with_runs(scene: Scene) -> Scene:
    """Return the scene; InputError if its modules cannot run, or have too many moves to list."""
    scene = local_only(scene, "runs")
    try:
        # Module processes list all moves; asked for here, nothing has been started yet.
        _ = scene.system.move_slots
    except InputError as error:
        raise InputError(f"{scene.spec}: {error}") from None
    return scene


def _task_of_schedule(plan: Plan, path: Path) -> Task:
    if plan.hesitate:
        raise InputError(f"hesitate={plan.hesitate}: a schedule has a round for every cube")
    if plan.rule is not None and not plan.repair:
        raise InputError(f"rule={plan.rule}: a schedule needs none, only repair goes on with one")
    schedule = read_schedule(path)
    scene = schedule.scene
    if plan.system is not None or scene is None:
        scene = _scene_named(plan.system)
    scene = _with_runs(scene)
    assignment = assignment_of(schedule, scene)
    cubes = len(assignment.cubes)
    most = cubes + (MAX_ROUNDS if plan.repair else 0)
    if plan.max_rounds is not None:
        most = plan.max_rounds if plan.repair else min(plan.max_rounds, cubes)
    return Task(with_end(scene, schedule, assignment), _rule_of(plan, scene), most, assignment)


def _rule_of(plan: Plan, scene: Scene) -> str:
    family = sound_family(scene.family)
    own = family.rule if family is not None else "random"
    rule = own if plan.rule is None else plan.rule
    rule_named(rule, scene.system)
    return rule


def _check_topics(task: Task, processes: int) -> None:
    """Refuse a run with more topics, one for each kind and speaker, than a recording can have."""
    hosts = min(processes, len(task.scene.start))
    here = len(_SAID_HERE)
    if len(_SAID) * hosts + here > TOPICS_MAX:
        raise InputError(
            f"processes={processes}: what they say takes {len(_SAID) * hosts + here} topics, and a"
            f" recording has {TOPICS_MAX} at most: expected at most"
            f" {(TOPICS_MAX - here) // len(_SAID)} processes"
        )


@contextmanager
def _interrupts() -> Generator[Callable[[], None]]:
    """Turn SIGINT, SIGTERM and SIGHUP into `Interrupted`, raised between two messages.

    A second signal raises KeyboardInterrupt at once. Outside the main thread no signal is handled.
    """
    asked = threading.Event()

    def ask(_number: int, _frame: FrameType | None) -> None:
        if asked.is_set():
            raise KeyboardInterrupt
        asked.set()

    def check() -> None:
        if asked.is_set():
            raise Interrupted

    if threading.current_thread() is not threading.main_thread():
        yield check
        return
    before = {number: signal.signal(number, ask) for number in _INTERRUPTS}
    try:
        yield check
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


class _Run:
    """A run in progress: wire messages are recorded as they arrive, edges round by round.

    Cubes, certificate and summary, the coordinator's own results, are written at the end.
    """

    def __init__(self, plan: Plan, task: Task, writer: RecordingWriter) -> None:
        self._plan = plan
        self._task = task
        self._writer = writer
        self._conductor = Conductor(
            task.scene,
            max_rounds=task.max_rounds,
            record=self._say,
            assignment=task.assignment,
            repair=plan.repair,
            modules_of=dealt(task.scene, max(1, min(plan.processes, len(task.scene.start)))),
            seed=plan.seed,
        )
        self._began = self._flushed = time.monotonic()

    def play(self, watch: Watch | None) -> Outcome:
        conductor = self._conductor
        try:
            ending = self._rounds(watch)
        except Interrupted:
            ending = Ending("interrupted", "interrupted")
        except CubepathError as problem:
            ending = conductor.failed(str(problem))
        except MemoryError:
            ending = conductor.failed("out of memory")
        try:
            for message in conductor.results(ending):
                self._say(message)
            self._writer.close()
        except CubepathError as problem:
            ending = Ending("failed", ending.error or str(problem))
        return self._outcome(ending)

    def _rounds(self, watch: Watch | None) -> Ending:
        plan, task, conductor = self._plan, self._task, self._conductor
        ending = conductor.before()
        if ending is not None:
            return ending
        with (
            _interrupts() as check,
            Fleet(
                task.scene,
                task.rule,
                seed=plan.seed,
                hesitate=plan.hesitate,
                processes=plan.processes,
                schedule=None if task.assignment is None else task.assignment.own,
                patience_s=plan.patience,
                sink=self._wire,
                check=lambda: self._between_messages(check),
                plausible=conductor.check,
            ) as fleet,
        ):
            ending = conductor.between(0, fleet.end_schedule)
            while ending is None:
                number = fleet.play_round()
                if watch is not None and conductor.gatherer.rounds == number:
                    watch(conductor.gatherer)
                ending = conductor.between(number, fleet.end_schedule)
        return ending

    def _between_messages(self, check: Callable[[], None]) -> None:
        check()
        now = time.monotonic()
        if now - self._flushed >= _FLUSH_S:
            self._flushed = now
            self._writer.flush()

    def _wire(self, message: Message, data: bytes, wall_ns: int) -> None:
        self._writer.write(topic_of(message), data, round_number=message.round, wall_ns=wall_ns)
        self._conductor.hear(message)

    def _say(self, message: Message) -> None:
        self._writer.write(
            topic_of(message),
            encode(message),
            round_number=message.round,
            wall_ns=time.time_ns(),
        )

    def _outcome(self, ending: Ending) -> Outcome:
        plan, gatherer, scene = self._plan, self._conductor.gatherer, self._task.scene
        heap = gatherer.heap
        modules = len(scene.start)
        return Outcome(
            log=str(self._writer.path),
            system=scene.spec,
            rule=self._task.name,
            seed=plan.seed,
            modules=modules,
            processes=min(plan.processes, modules),
            rounds=gatherer.rounds,
            moves=heap.moves,
            reduced_moves=heap.reduced_moves,
            cubes=heap.cubes,
            max_cube_dimension=heap.max_cube_dimension,
            goal_reached=gatherer.reached,
            path_digest=gatherer.digest,
            seconds=round(time.monotonic() - self._began, 3),
            ended=ending.ended,
            error=ending.error,
            messages=self._writer.messages,
            refused=self._conductor.refused,
            schedule_cubes=self._conductor.schedule_cubes,
            schedule_stopped=self._conductor.stopped,
        )


def _file_name(plan: Plan, task: Task) -> str:
    now = datetime.now(UTC).strftime("%Y%m%dT%H%M%S%f")
    return f"{_system_name(plan, task.scene)}-{task.name}-{plan.seed}-{now}.mcap"


def _system_name(plan: Plan, scene: Scene) -> str:
    """Return the name of a system in a log: the file that it was read from, or else its family."""
    told = scene.spec if plan.system is None else plan.system
    name = scene.family or scene.spec
    is_pipe = told.startswith("/dev/")  # process substitution in a shell gives a number
    if not is_pipe and (told.endswith(".toml") or "/" in told.partition(":")[0]):
        name = Path(told).stem
    return re.sub(r"[^\w.]+", "-", name).strip("-.")[:_NAME_MAX] or "system"


def _parameters(plan: Plan, task: Task) -> dict[str, str]:
    scene = task.scene
    schedule = {} if plan.schedule is None else {"schedule": str(plan.schedule)}
    if plan.repair:
        schedule["repair"] = task.rule
    return {
        "system": scene.spec,
        "family": scene.family,
        "rule": task.name,
        "seed": str(plan.seed),
        "hesitate": str(plan.hesitate),
        "processes": str(min(plan.processes, len(scene.start))),
        "modules": str(len(scene.start)),
        "max_rounds": str(task.max_rounds),
        **schedule,
        "python": sys.version.split()[0],
        "platform": f"{platform.system()} {platform.machine()}",
        **{
            package: _version(package)
            for package in ("cubepath", "eclipse-zenoh", "mcap", "pettingzoo", "numpy")
        },
    }


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return "not installed"
