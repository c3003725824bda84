"""A run: modules in processes, their edge path gathered and shortened, all of it on record.

Room: coordinator. It starts the fleet, paces rounds and listens; it decides nothing for a module.
"""

from __future__ import annotations

import platform
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

from cubepath.agents.fleet import Fleet
from cubepath.agents.rules import rule_named
from cubepath.coordinator.gather import Gatherer, Step
from cubepath.protocol.actions import Action
from cubepath.protocol.errors import CheckError, CubepathError, InputError
from cubepath.protocol.keys import topic_of
from cubepath.protocol.messages import Cube, Edges, Placed, Report, Summary, decode, encode
from cubepath.protocol.recording import RecordingWriter
from cubepath.protocol.scenes import FAMILIES, scene_from_spec
from cubepath.protocol.systems import Scene, local_only

Ended = Literal["goal", "max-rounds", "failed", "interrupted"]
MAX_ROUNDS = 1000
_INTERRUPTS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


class Interrupted(Exception):  # noqa: N818 - it is no error, it is what the person asked for
    """The person asked the run to stop."""


@dataclass(frozen=True, slots=True)
class Plan:
    """What to run; `rule` None is the rule that reaches the goal of the system's family."""

    system: str = "hex"
    rule: str | None = None
    seed: int = 0
    hesitate: float = 0.0
    processes: int = 4
    max_rounds: int = MAX_ROUNDS
    log: Path | None = None


@dataclass(frozen=True, slots=True)
class Outcome:
    """What a run did; the first fourteen fields are the keys of ``cubepath run --json``."""

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

    def document(self) -> dict[str, Any]:
        """Return the keys of ``--json``."""
        extra = ("ended", "error", "messages")
        return {key: getattr(self, key) for key in self.__slots__ if key not in extra}


Watch = Callable[[Gatherer], None]


def run(plan: Plan, watch: Watch | None = None) -> Outcome:
    """Run the plan to its end and return what came of it, with the recording closed.

    InputError where the plan cannot be run at all; everything that goes wrong later (a process
    that dies, a rule that gives up, a full disk, an interrupt) is told in the outcome. `watch` is
    called after each round.
    """
    scene, rule = scene_of_plan(plan)
    path = plan.log or Path("logs") / _file_name(scene, rule, plan.seed)
    with RecordingWriter(path, scene, _parameters(plan, scene, rule)) as writer:
        return _Run(plan, scene, rule, writer).play(watch)


def scene_of_plan(plan: Plan) -> tuple[Scene, str]:
    """Return the plan's scene and rule, checked; InputError names what cannot be run."""
    if not 0.0 <= plan.hesitate < 1.0:
        raise InputError(f"hesitate={plan.hesitate}: expected at least 0 and less than 1")
    for key, number in (("seed", plan.seed), ("processes", plan.processes)):
        if number < 0:
            raise InputError(f"{key}={number}: expected 0 or more")
    if plan.max_rounds < 0:
        raise InputError(f"max-rounds={plan.max_rounds}: expected 0 or more")
    scene = local_only(scene_from_spec(plan.system), "runs")
    family = FAMILIES.get(scene.family)
    rule = plan.rule or (family.rule if family is not None else "random")
    rule_named(rule, scene.system)
    return scene, rule


@contextmanager
def _interrupts() -> Generator[Callable[[], None]]:
    """Turn SIGINT, SIGTERM and SIGHUP into `Interrupted`, raised between two messages.

    A second one is taken at once. Off the main thread there is nothing to take over.
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
    """A run under way: wire messages go on record as they come, edges by round.

    Cubes and summary, the coordinator's own results, are written at the end.
    """

    def __init__(self, plan: Plan, scene: Scene, rule: str, writer: RecordingWriter) -> None:
        self._plan = plan
        self._scene = scene
        self._rule = rule
        self._writer = writer
        self._gatherer = Gatherer(scene, self._step)
        self._began = time.monotonic()

    def play(self, watch: Watch | None) -> Outcome:
        try:
            ended, error = self._rounds(watch)
        except Interrupted:
            ended, error = "interrupted", "interrupted"
        except CubepathError as problem:
            ended, error = "failed", str(problem)
        try:
            self._finish(ended, error)
            self._writer.close()
        except CubepathError as problem:
            ended, error = "failed", error or str(problem)
        return self._outcome(ended, error)

    def _rounds(self, watch: Watch | None) -> tuple[Ended, str | None]:
        plan, gatherer = self._plan, self._gatherer
        if gatherer.reached:
            return "goal", None
        with (
            _interrupts() as check,
            Fleet(
                self._scene,
                self._rule,
                seed=plan.seed,
                hesitate=plan.hesitate,
                processes=plan.processes,
                sink=self._wire,
                check=check,
            ) as fleet,
        ):
            for number in fleet.rounds(plan.max_rounds):
                if gatherer.rounds != number:
                    return "failed", f"round {number} ended, but not all modules have reported it"
                if watch is not None:
                    watch(gatherer)
                if gatherer.failed is not None:
                    return "failed", gatherer.failed
                if gatherer.reached:
                    return "goal", None
        return "max-rounds", None

    def _wire(self, topic: str, data: bytes, wall_ns: int) -> None:
        try:
            message = decode(data)
        except InputError as error:  # somebody else has joined the run
            raise CheckError(f"on {topic}: {error}") from None
        self._writer.write(topic_of(message), data, round_number=message.round, wall_ns=wall_ns)
        if isinstance(message, Report):
            self._gatherer.receive(message)

    def _step(self, step: Step) -> None:
        self._say(Edges(step.round, list(step.executed)))

    def _say(self, message: Edges | Cube | Summary) -> None:
        self._writer.write(
            topic_of(message),
            encode(message),
            round_number=message.round,
            wall_ns=time.time_ns(),
        )

    def _finish(self, ended: Ended, error: str | None) -> None:
        gatherer = self._gatherer
        placed = _placed(gatherer.steps)
        for index, cube in enumerate(gatherer.heap.cube_path(), 1):
            self._say(Cube(gatherer.rounds, index, [placed[action] for action in cube]))
        heap = gatherer.heap
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
            )
        )

    def _outcome(self, ended: Ended, error: str | None) -> Outcome:
        plan, gatherer = self._plan, self._gatherer
        heap = gatherer.heap
        modules = len(self._scene.start)
        return Outcome(
            log=str(self._writer.path),
            system=self._scene.spec,
            rule=self._rule,
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
        )


def _placed(steps: list[Step]) -> dict[Action, Placed]:
    return {
        action: Placed(executed.generator, executed.at)
        for step in steps
        for executed, action in zip(step.executed, step.actions, strict=True)
    }


def _file_name(scene: Scene, rule: str, seed: int) -> str:
    now = datetime.now(UTC).strftime("%Y%m%dT%H%M%S%f")
    return f"{scene.family or 'system'}-{rule}-{seed}-{now}.mcap"


def _parameters(plan: Plan, scene: Scene, rule: str) -> dict[str, str]:
    return {
        "system": scene.spec,
        "family": scene.family,
        "rule": rule,
        "seed": str(plan.seed),
        "hesitate": str(plan.hesitate),
        "processes": str(min(plan.processes, len(scene.start))),
        "modules": str(len(scene.start)),
        "max_rounds": str(plan.max_rounds),
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
