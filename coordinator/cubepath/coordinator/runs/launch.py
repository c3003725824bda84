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
from typing import Any, Literal

import msgspec

from cubepath.agents.processes.fleet import Fleet
from cubepath.agents.rules.registry import rule_named
from cubepath.agents.rules.schedule import SCHEDULE
from cubepath.coordinator.normal_form.certificate import certificate_of
from cubepath.coordinator.runs.gatherer import Gatherer, Step
from cubepath.coordinator.runs.schedule import (
    Assignment,
    ScheduleExecution,
    assignment_of,
    read_schedule,
    told,
    with_end,
)
from cubepath.protocol.core.errors import CheckError, CubepathError, InputError
from cubepath.protocol.core.system import Scene, local_only
from cubepath.protocol.path_files.schedules import schedule_to_jsonl
from cubepath.protocol.recordings.recording import TOPICS_MAX, RecordingWriter
from cubepath.protocol.scenes.registry import sound_family
from cubepath.protocol.scenes.specs import scene_from_spec
from cubepath.protocol.wire.keys import topic_of
from cubepath.protocol.wire.messages import (
    Certified,
    Cube,
    Edges,
    Report,
    Stopped,
    Summary,
    decode,
    encode,
)
from cubepath.protocol.wire.sessions import check_descriptors

Ended = Literal["goal", "max-rounds", "failed", "interrupted"]
MAX_ROUNDS = 1000
DEFAULT_SYSTEM = "hex"
_NAME_MAX = 60
_SAID = ("here", "note", "claim", "verdict", "report")
"""The kinds of messages that each module may send; notes only if its rule sends some."""
_SAID_HERE = ("go", "edges", "cube", "certificate", "summary")
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


@dataclass(frozen=True, slots=True)
class Outcome:
    """The outcome of a run; the first fourteen fields are the keys of ``cubepath run --json``.

    `error` is a key too if there is one. If a schedule was carried out, there are two more: how
    many cubes it has, and where it stopped, None if it did not.
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
    with RecordingWriter(path, task.scene, _parameters(plan, task), schedule) as writer:
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
    modules = len(task.scene.start)
    talks = rule_named(task.rule, task.scene.system).note_length(modules) > 0
    kinds = len(_SAID) - (not talks)
    here = len(_SAID_HERE)
    topics = kinds * modules + here + min(processes, modules)
    if topics > TOPICS_MAX:
        most = max((TOPICS_MAX - here - processes) // kinds, (TOPICS_MAX - here) // (kinds + 1))
        raise InputError(
            f"{task.scene.spec}: what {modules} modules say takes {topics} topics, and a recording"
            f" has {TOPICS_MAX} at most: expected at most {most} modules"
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
        self._gatherer = Gatherer(task.scene, self._step)
        self._execution = None if task.assignment is None else ScheduleExecution(task.assignment)
        self._began = time.monotonic()

    def play(self, watch: Watch | None) -> Outcome:
        try:
            ended, error = self._rounds(watch)
        except Interrupted:
            ended, error = "interrupted", "interrupted"
        except CubepathError as problem:
            ended, error = "failed", self._with_stop(str(problem))
        except MemoryError:
            ended, error = "failed", self._with_stop("out of memory")
        try:
            self._finish(ended, error)
            self._writer.close()
        except CubepathError as problem:
            ended, error = "failed", error or str(problem)
        return self._outcome(ended, error)

    @property
    def _stopped(self) -> Stopped | None:
        return None if self._execution is None else self._execution.stopped

    def _with_stop(self, error: str) -> str:
        return error if self._stopped is None else f"{told(self._stopped)}; then {error}"

    def _rounds(self, watch: Watch | None) -> tuple[Ended, str | None]:
        plan, task, gatherer, assignment = (
            self._plan,
            self._task,
            self._gatherer,
            self._task.assignment,
        )
        if gatherer.reached and (assignment is None or not assignment.cubes):
            return "goal", None
        with (
            _interrupts() as check,
            Fleet(
                task.scene,
                task.rule,
                seed=plan.seed,
                hesitate=plan.hesitate,
                processes=plan.processes,
                schedule=None if assignment is None else assignment.own,
                sink=self._wire,
                check=check,
            ) as fleet,
        ):
            ended = self._ended(fleet)
            if ended is not None:
                return ended
            for number in fleet.rounds(task.max_rounds):
                if gatherer.rounds != number:
                    return "failed", f"round {number} ended, but not all modules have reported it"
                if watch is not None:
                    watch(gatherer)
                ended = self._ended(fleet)
                if ended is not None:
                    return ended
        return "max-rounds", None

    def _ended(self, fleet: Fleet) -> tuple[Ended, str | None] | None:
        """Return how the run has ended, None if it goes on; called between rounds."""
        gatherer, carrying = self._gatherer, self._execution
        if carrying is not None and not carrying.over:
            carrying.look(gatherer)
            if not carrying.over:
                return None  # even if it passes the goal on its way
            if carrying.stopped is not None and not self._plan.repair:
                return "failed", told(carrying.stopped)
            if not gatherer.reached and self._plan.repair:
                fleet.end_schedule()
                return None
        elif gatherer.failed is not None:
            return "failed", self._with_stop(gatherer.failed)
        return ("goal", None) if gatherer.reached else None

    def _wire(self, topic: str, data: bytes, wall_ns: int) -> None:
        try:
            message = decode(data)
        except InputError as error:  # a stranger has joined the run
            raise CheckError(f"on {topic}: {error}") from None
        self._writer.write(topic_of(message), data, round_number=message.round, wall_ns=wall_ns)
        if isinstance(message, Report):
            self._gatherer.receive(message)

    def _step(self, step: Step) -> None:
        self._say(Edges(step.round, list(step.executed)))

    def _say(self, message: Edges | Cube | Certified | Summary) -> None:
        self._writer.write(
            topic_of(message),
            encode(message),
            round_number=message.round,
            wall_ns=time.time_ns(),
        )

    def _finish(self, ended: Ended, error: str | None) -> None:
        gatherer = self._gatherer
        for index, cube in enumerate(gatherer.schedule(), 1):
            self._say(Cube(gatherer.rounds, index, list(cube)))
        heap = gatherer.heap
        path = [action for step in gatherer.steps for action in step.actions]
        start = self._task.scene.start_state
        proof = certificate_of(path, start=start, found=heap.normal_form())
        self._say(Certified(gatherer.rounds, proof))
        self._say(
            Summary(
                round=gatherer.rounds,
                ended=ended,
                error=error,
                rounds=gatherer.rounds,
                moves=heap.moves,
                reduced_moves=heap.reduced_moves,
                cubes=heap.cubes,
                max_cube_dimension=heap.max_cube_dimension,
                goal_reached=gatherer.reached,
                path_digest=gatherer.digest,
                schedule_cubes=self._schedule_cubes,
                schedule_stopped=self._stopped,
            )
        )

    @property
    def _schedule_cubes(self) -> int | None:
        return None if self._task.assignment is None else len(self._task.assignment.cubes)

    def _outcome(self, ended: Ended, error: str | None) -> Outcome:
        plan, gatherer, scene = self._plan, self._gatherer, self._task.scene
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
            ended=ended,
            error=error,
            messages=self._writer.messages,
            schedule_cubes=self._schedule_cubes,
            schedule_stopped=self._stopped,
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
