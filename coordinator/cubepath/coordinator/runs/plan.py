"""What to run: a checked plan, the name of its recording, and the parameters recorded in it."""

import platform
import re
import sys
from collections.abc import Mapping
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any, Literal, TypedDict

from cubepath.agents.free.config import OnCrash
from cubepath.agents.processes.network import NetworkConfig
from cubepath.agents.rules.registry import own_rule, rule_for, rule_named
from cubepath.agents.rules.schedule import RECORDED, SCHEDULE, RecordedChoices
from cubepath.coordinator.runs.options import SPEED_MAX, RunOptions
from cubepath.coordinator.runs.schedule import Assignment
from cubepath.protocol.core.errors import InputError, OptionError
from cubepath.protocol.core.formatting import did_you_mean
from cubepath.protocol.core.options import check_options, real_number, whole_number
from cubepath.protocol.core.output_files import is_special
from cubepath.protocol.core.system import Scene, local_only
from cubepath.protocol.recordings.writing import TOPICS_MAX
from cubepath.protocol.scenes.specs import scene_from_spec

MAX_ROUNDS = 1000
DEFAULT_SYSTEM = "hex"
_NAME_MAX = 60
_SAID = ("ready", "bundle", "reports", "retransmit", "waiting")
"""The kinds of messages that each process may send."""
_SAID_HERE = ("go", "refused", "edges", "cube", "certificate", "summary")


@dataclass(frozen=True, slots=True)
class Plan(RunOptions):
    """What to run; `rule` None means the rule of the system's family, which reaches the goal.

    With a `schedule`, a cubes file or a recording, the modules carry it out; `system` None then
    means the system of the recording, otherwise "hex". The run ends where the schedule stops, or
    with `repair` the modules follow the rule from there. `max_rounds` None allows as many rounds as
    the schedule needs, and `MAX_ROUNDS` for the rule.

    >>> plan = Plan("agv:graph=grid3x3,n=2", "random", max_rounds=10, processes=0)
    >>> run(plan, seed=4, log="logs/planned.mcap").rounds
    10
    """

    system: str | Scene | None = None
    """A name with keys, the path of a TOML file, or a scene; None is "hex"."""
    rule: str | None = None
    """A name or ``FILE.py:NAME``; module processes find it by that."""

    @property
    def network(self) -> NetworkConfig:
        """Return where the processes meet."""
        return NetworkConfig(self.listen, self.connect, self.secure, self.wait_for)

    @property
    def is_free(self) -> bool:
        """Whether the run has no rounds."""
        return self.clock == "free"


class PlanOptions(TypedDict, total=False):
    """The fields of a `Plan` but for `system` and `rule`, for functions that take them by name."""

    seed: int
    hesitate: float
    processes: int
    max_rounds: int | None
    log: str | Path | None
    schedule: str | Path | None
    repair: bool
    patience: float
    listen: str | None
    connect: str | None
    secure: str | Path | None
    wait_for: int
    clock: Literal["lockstep", "free"]
    keepers: int
    speeds: Mapping[int, float]
    jitter: float
    on_crash: OnCrash
    resume: str | Path | None
    log_time: Literal["round", "level", "wall"] | None


_FILES = frozenset(("log", "schedule", "secure", "resume"))


def plan_of(what: Plan | str | Path | Scene | None, rule: str | None, options: PlanOptions) -> Plan:
    """Return a plan that is asked for by name, or a plan with some of its fields replaced."""
    fields: dict[str, Any] = {
        key: Path(value) if key in _FILES and isinstance(value, str) else value
        for key, value in options.items()
    }
    strange = fields.keys() - PlanOptions.__annotations__.keys()
    if strange:
        name = min(strange)
        near = did_you_mean(name, PlanOptions.__annotations__)
        raise TypeError(f"unexpected argument {name!r}{near}")
    if rule is not None:
        fields["rule"] = rule
    if isinstance(what, Plan):
        return replace(what, **fields)
    return Plan(str(what) if isinstance(what, Path) else what, **fields)


@dataclass(frozen=True, slots=True)
class Branch:
    """What a run has of a recording whose choices modules repeat."""

    recorded: RecordedChoices
    rounds: int | None
    """After this many rounds all modules follow rules; None if never."""
    parameters: Mapping[str, str]
    """What the recording of the run says of it."""


@dataclass(frozen=True, slots=True)
class RunTask:
    """A checked plan: the scene, the rule, and the maximal number of rounds.

    With an `assignment` the modules follow that first, and the rule only to repair a schedule. With
    a `branch` they choose first as in another recording.
    """

    scene: Scene
    rule: str
    max_rounds: int
    assignment: Assignment | None = None
    branch: Branch | None = None

    @property
    def name(self) -> str:
        """Return the name of the rule that modules follow at the beginning."""
        if self.branch is not None:
            return RECORDED
        return self.rule if self.assignment is None else SCHEDULE


def task_of(plan: Plan) -> RunTask:
    """Return the task of a plan; InputError names what cannot be run."""
    _check_types(plan)
    (_check_free if plan.is_free else _check_lockstep)(plan)
    if plan.schedule is not None:
        return _task_of_schedule(plan, plan.schedule)
    if plan.repair:
        raise OptionError("repair: there is no schedule that could need it")
    scene = _with_runs(_scene_named(plan.system))
    _check_speeds(plan, scene)
    most = MAX_ROUNDS if plan.max_rounds is None else plan.max_rounds
    rule = _rule_of(plan, scene)
    rule_for(rule, scene, plan.clock)
    return RunTask(scene, rule, most)


_TYPES: tuple[tuple[str, tuple[type, ...], str], ...] = (
    ("system", (str, Scene), "a name, a file or a scene"),
    ("rule", (str,), "the name of a rule, or FILE.py:NAME"),
    ("speeds", (Mapping,), "factors by module, as in {0: 2.0}"),
)


def _check_types(plan: Plan) -> None:
    """Refuse fields of other types than a plan has, or out of their bounds."""
    for key, kinds, expected in _TYPES:
        value = getattr(plan, key)
        if value is not None and not isinstance(value, kinds):
            raise InputError(f"{key}={value!r}: expected {expected}")
    check_options(plan)
    if plan.log is not None and plan.log.suffix not in {"", ".mcap"} and not is_special(plan.log):
        raise OptionError(f"log: {plan.log} has the suffix {plan.log.suffix}, expected .mcap")
    for module, factor in plan.speeds.items():
        whole_number("speed of module", module)
        real_number(f"speed={module}", factor)


def _check_lockstep(plan: Plan) -> None:
    usual = Plan()
    for name in ("speeds", "keepers", "jitter", "on_crash", "resume"):
        if getattr(plan, name) != getattr(usual, name):
            key = {"speeds": "speed", "resume": "from"}.get(name, name.replace("_", "-"))
            raise OptionError(f"{key}: only for runs without rounds, expected clock=free")
    if plan.log_time == "level":
        raise OptionError("log-time=level: only for runs without rounds, expected round or wall")


def _check_free(plan: Plan) -> None:
    if plan.repair:
        raise OptionError("repair: not for runs without rounds (clock=free)")
    if plan.log_time == "round":
        raise OptionError("log-time=round: without rounds (clock=free), expected level or wall")
    if plan.processes < 1:
        raise OptionError(f"processes={plan.processes}: expected 1 or more with clock=free")
    for module, factor in plan.speeds.items():
        if not 0.0 < factor <= SPEED_MAX:
            raise OptionError(
                f"speed={module}={factor:g}: expected more than 0 and at most {SPEED_MAX}"
            )


def _check_speeds(plan: Plan, scene: Scene) -> None:
    strange = [module for module in plan.speeds if not 0 <= module < len(scene.start)]
    if strange:
        raise OptionError(
            f"speed={strange[0]}={plan.speeds[strange[0]]:g}: no such module, the scene has"
            f" 0-{len(scene.start) - 1}"
        )


def _scene_named(system: str | Scene | None) -> Scene:
    if isinstance(system, Scene):
        return system
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


def _task_of_schedule(plan: Plan, path: Path) -> RunTask:
    if plan.hesitate:
        raise OptionError(f"hesitate={plan.hesitate}: a schedule has a round for every cube")
    if plan.rule is not None and not plan.repair:
        raise OptionError(
            f"rule={plan.rule}: a schedule needs none, only repair continues with one"
        )
    from cubepath.coordinator.runs.schedule_reading import assignment_of, read_schedule, with_end  # noqa: PLC0415 - few runs have one

    schedule = read_schedule(path)
    scene = schedule.scene
    if plan.system is not None:
        scene = _scene_named(plan.system)
    if scene is None:
        raise InputError(f"{path}: a cubes file, which names no system: expected one with it")
    scene = _with_runs(scene)
    _check_speeds(plan, scene)
    assignment = assignment_of(schedule, scene)
    cubes = len(assignment.cubes)
    most = cubes + (MAX_ROUNDS if plan.repair else 0)
    if plan.max_rounds is not None:
        most = plan.max_rounds if plan.repair else min(plan.max_rounds, cubes)
    rule = _rule_of(plan, scene)
    rule_named(rule, scene.system, plan.clock)  # it would go on from elsewhere in the scene
    return RunTask(with_end(scene, schedule, assignment), rule, most, assignment)


def _rule_of(plan: Plan, scene: Scene) -> str:
    return own_rule(scene) if plan.rule is None else plan.rule


def check_topics(task: RunTask, plan: Plan) -> None:
    """Refuse a run with more topics, one for each kind and speaker, than a recording can have."""
    if plan.is_free:
        return  # two topics a process and five a keeper, of which there are fewer
    hosts = min(plan.processes + plan.wait_for, len(task.scene.start))
    here = len(_SAID_HERE)
    if len(_SAID) * hosts + here > TOPICS_MAX:
        raise OptionError(
            f"processes={plan.processes}: what they say takes {len(_SAID) * hosts + here} topics,"
            f" and a recording has {TOPICS_MAX} at most: expected at most"
            f" {(TOPICS_MAX - here) // len(_SAID)} processes"
        )


def file_name(plan: Plan, task: RunTask) -> str:
    """Return the name of the recording of a plan that does not name one."""
    now = datetime.now(UTC).strftime("%Y%m%dT%H%M%S%f")
    rule_name = task.name if task.branch is None else task.rule
    rule = re.sub(r"[^\w.]+", "-", Path(rule_name).name)  # a rule may be FILE.py:NAME
    return f"{_system_name(plan, task.scene)}-{rule}-{plan.seed}-{now}.mcap"


def _system_name(plan: Plan, scene: Scene) -> str:
    """Return the name of a system in a log: the file that it was read from, or else its family."""
    spec = plan.system if isinstance(plan.system, str) else scene.spec
    name = scene.family or scene.spec
    is_pipe = spec.startswith("/dev/")  # process substitution in a shell gives a number
    if not is_pipe and (spec.endswith(".toml") or "/" in spec.partition(":")[0]):
        name = Path(spec).stem
    return name_part(name) or "system"


def name_part(text: str) -> str:
    """Return what of a text may stand in the name of a file, which it cannot lead elsewhere."""
    return re.sub(r"[^\w.]+", "-", text).strip("-.")[:_NAME_MAX]


def parameters_of(plan: Plan, task: RunTask) -> dict[str, str]:
    """Return what a recording says of the run, as far as it is known when the run begins."""
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
        **_processes(plan, scene),
        **({"log_time": "wall"} if plan.log_time == "wall" else {}),
        "modules": str(len(scene.start)),
        "max_rounds": str(task.max_rounds),
        **schedule,
        **({} if task.branch is None else task.branch.parameters),
        "python": sys.version.split()[0],
        "platform": f"{platform.system()} {platform.machine()}",
        **{
            package: _version(package)
            for package in ("cubepath", "eclipse-zenoh", "mcap", "pettingzoo", "numpy")
        },
    }


def _processes(plan: Plan, scene: Scene) -> dict[str, str]:
    """Return how many processes there are, or how many of them come from elsewhere.

    In that case the others may be fewer than planned, which nobody knows when the recording begins.
    """
    told = (
        {"wait_for": str(plan.wait_for)}
        if plan.wait_for
        else {"processes": str(min(plan.processes, len(scene.start)))}
    )
    if not plan.is_free:
        return told
    return told | {
        "clock": plan.clock,
        "keepers": str(plan.keepers),
        "log_time": plan.log_time or "level",
        "on_crash": plan.on_crash,
        "speeds": ",".join(f"{module}={plan.speeds[module]:g}" for module in sorted(plan.speeds)),
        "jitter": f"{plan.jitter:g}",
    }


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return "not installed"
