"""Whether a rule is local: the scenes in which it is played, and what the plays show.

The rule is loaded in separate processes, never in the one that checks it. Each family has a small
scene, in which all modules may sense one another, and a larger one, in which there is something
that a module does not see.

A rule is local if its choices follow from what its module knows from the start, what it has seen,
and its own random stream. So a play in which anything else was different must have the same choices
as the original run. Each play that has not is a finding, and so is each use of anything outside.
"""

import os
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from pathlib import Path
from random import Random
from tempfile import TemporaryDirectory
from typing import Literal, Self, TypeAlias

from cubepath.agents.locality.fork_server import PATIENCE_S, ForkServer
from cubepath.agents.locality.plays import (
    ChangedWorlds,
    Conditions,
    FitQuestion,
    ModuleLife,
    ModuleReplay,
    OutsideAccess,
    Play,
    PlayResult,
    PlayTask,
    WholeRun,
)
from cubepath.agents.rules.rule import RuleName
from cubepath.protocol.core.errors import CheckError, InputError
from cubepath.protocol.core.options import seconds
from cubepath.protocol.core.system import Scene, local_only
from cubepath.protocol.scenes.registry import all_families
from cubepath.protocol.scenes.specs import scene_from_spec

SCENES: Mapping[str, tuple[str, ...]] = {
    "hex": ("hex:n=4", "hex:n=12"),
    "hex-open": ("hex-open:n=4", "hex-open:n=12"),
    "hex-tunnel": ("hex-tunnel:n=4", "hex-tunnel:n=7"),
    "sliding": ("sliding:p=2,q=1,n=3", "sliding:p=6,q=2,n=8"),
    "agv": ("agv:graph=K5,n=3", "agv:graph=grid6x6,n=9"),
    "agv-labelled": ("agv-labelled:graph=K5,n=3", "agv-labelled:graph=grid6x6,n=8"),
    "arm": ("arm:n=3", "arm:n=12"),
    "arm-free": ("arm-free:n=3", "arm-free:n=8"),
    "arms": ("arms",),
    "polygon": ("polygon:n=6", "polygon:n=14"),
    "triangulation": ("triangulation:n=6", "triangulation:n=16"),
    "words": ("words", "words:word=abcabcabcabc,relations=ab~ba+bc~cb+ac~ca"),
    "assembly": ("assembly:n=2", "assembly:n=4"),
    "compression": ("compression:n=4", "compression:n=8"),
    "sliding-cubes": ("sliding-cubes:n=3", "sliding-cubes:n=8"),
    "pivoting-cubes": ("pivoting-cubes:n=3", "pivoting-cubes:n=8"),
    "rolling-dodecahedra": ("rolling-dodecahedra:n=3", "rolling-dodecahedra:n=8"),
}
"""By family; of another one it is the default scene."""


def all_scenes() -> list[str]:
    """Return the scenes of all families."""
    return [spec for family in all_families() for spec in SCENES.get(family, (family,))]


Kind: TypeAlias = Literal[
    "reach",
    "state",
    "clock",
    "random",
    "process",
    "environment",
    "files",
    "network",
    "frames",
    "memory",
    "hashing",
    "fails",
    "repeat",
    "unexplained",
]

USES: Mapping[Kind, str] = {
    "clock": "uses the clock",
    "random": "uses random numbers that are not the module's own",
    "process": "uses the process, its threads or others",
    "environment": "uses the machine or the environment of the process",
    "files": "uses files",
    "network": "uses the network",
    "frames": "looks at stack frames",
    "memory": "looks at what else is in memory",
}
"""By kind of access what the rule does."""
DEPENDS: Mapping[Kind, str] = {
    "reach": "sees beyond its reach",
    "state": "keeps state outside the module",
    "clock": "depends on the clock",
    "random": "depends on random numbers that are not the module's own",
    "process": "depends on the process it is in",
    "environment": "depends on the folder or the environment of the process",
    "hashing": "depends on hashes or addresses, as by the order of a set",
    "repeat": "does not choose the same twice",
    "unexplained": "depends on something outside the module that was not seen",
    "fails": "fails",
}
"""By kind of difference what the rule does."""


PERIOD: Mapping[str, str] = {"lockstep": "round", "free": "turn"}
"""By clock what the choices of a module are counted by."""


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing that is wrong with a rule: its kind, and a line for people."""

    kind: Kind
    text: str


@dataclass(slots=True)
class Evidence:
    """What was found in all scenes, in the order in which it was."""

    accesses: set[OutsideAccess] = field(default_factory=set)
    depends: dict[Kind, str] = field(default_factory=dict)
    """By kind the first difference, in words."""
    changed: set[str] = field(default_factory=set)
    """Global names of the rule's file that were changed."""

    def add(self, kind: Kind, text: str) -> None:
        """Keep the first difference of a kind."""
        self.depends.setdefault(kind, text)

    def findings(self) -> Iterator[Finding]:
        """Yield a finding a kind: what was used, where, and its effect."""
        for kind, depends in DEPENDS.items():
            if kind in self.depends and kind not in USES:
                names = f" ({', '.join(sorted(self.changed))} changed)" if kind == "state" else ""
                shown = names if self.changed else ""
                yield Finding(kind, f"{depends}{shown}: {self.depends[kind]}")
        for kind, uses in USES.items():
            accesses = (each for each in self.accesses if each.kind == kind)
            used = sorted(f"{each.what} in {each.where}" for each in accesses)
            if used:
                came = self.depends.get(kind)
                if came is None and (kind in DEPENDS or not self.depends):
                    came = "no choice was seen to change with it"
                shown = "" if came is None else f": {came}"
                yield Finding(kind, f"{uses} ({', '.join(used)}){shown}")
            elif kind in self.depends:
                yield Finding(kind, f"{DEPENDS[kind]}: {self.depends[kind]}")


def difference(
    run: Mapping[int, ModuleLife],
    other: Mapping[int, ModuleLife],
    *,
    spec: str,
    how: str,
    clock: str,
) -> str | None:
    """Return in words the first choice that differs, by round and module; None if none does.

    `how` says what was different about the play.

    A play may have fewer modules than the run; its rounds count as far as both go, and up to the
    first difference both have seen the same.
    """
    rounds = max((len(life.choices) for life in run.values()), default=0)
    for index in range(rounds):
        for module in sorted(run.keys() & other.keys()):
            was, now = run[module].choices, other[module].choices
            if index < len(was) and index < len(now) and was[index] != now[index]:
                then, again = was[index].beside(now[index])
                when = f"in {PERIOD[clock]} {index + 1}"
                when = when if run[module].observations else "when it was made"
                return f"module_{module} of {spec} has {then} {when}, {how} {again}"
    return None


_HASH_SEEDS = 4
"""The number of servers, each with its own hash seed; most plays use the first."""
_WATCHED = 6
"""This many modules of a scene are played again on their own, spread over their numbers."""
_HESITATE = 0.2
_ROUNDS = 40
_SEEDS = 1 << 31
TIMEOUT_S = 600.0
"""A check that takes longer ends."""


@dataclass(frozen=True, slots=True)
class LocalityReport:
    """The result of checking a rule in some scenes."""

    rule: str
    seed: int
    systems: tuple[str, ...]
    modules: int
    """Modules that were played again on their own."""
    choices: int
    """Choices that were compared with those of a run."""
    changes: int
    """Sites beyond the reach of a module that were changed."""
    findings: tuple[Finding, ...]
    clock: str = "lockstep"

    @property
    def ok(self) -> bool:
        """Whether nothing was found."""
        return not self.findings


_USUAL = Conditions()


@dataclass(frozen=True, slots=True)
class _Variant:
    """A run under other conditions: what that shows if choices differ, and how it is reported."""

    kind: Kind
    how: str
    conditions: Conditions = _USUAL
    server: int = 0
    backwards: bool = False


_AGAIN = (_Variant("repeat", "played again"),) * 3
_VARIANTS = (
    _Variant("state", "asked in another order", backwards=True),
    _Variant("clock", "at another time", Conditions(clock=1)),
    _Variant("random", "with other global random numbers", Conditions(random=1)),
    _Variant("process", "in other processes", Conditions(process=1)),
    _Variant("environment", "in another folder and environment", Conditions(environment=1)),
    *(
        _Variant("hashing", "with another PYTHONHASHSEED", server=server)
        for server in range(1, _HASH_SEEDS)
    ),
)
_UNTOUCHED = _Variant(
    "unexplained", "in another process", Conditions(trapped=False, environment=2), server=1
)

_ALONE = _Variant("state", "alone in a process")
_ELSEWHERE = _Variant("reach", "where modules beyond its reach are elsewhere")
_FEWER = _Variant("reach", "where modules beyond its reach are gone, and others there")


class PlayProcesses:
    """The processes that rules are played in: a context manager.

    Tasks are played at the same time, as many as there are processors.
    """

    def __init__(self, seed: int, timeout_s: float = TIMEOUT_S) -> None:
        """Start nothing yet; the hash seeds of the servers follow from the seed."""
        self._seed = seed
        self._folders = 0
        self._deadline = time.monotonic() + timeout_s

    def __enter__(self) -> Self:
        with ExitStack() as stack:
            self._folder = Path(stack.enter_context(TemporaryDirectory(prefix="cubepath-check-")))
            seeds = Random(f"{self._seed}/hash").sample(range(1, 1 << 32), _HASH_SEEDS)  # noqa: S311
            self._servers = [stack.enter_context(ForkServer(each)) for each in seeds]
            self._pool = ThreadPoolExecutor(len(os.sched_getaffinity(0)))
            stack.callback(self._pool.shutdown, wait=False, cancel_futures=True)
            self._resources = stack.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        self._resources.close()

    def submit(
        self, rule: str, play: Play, conditions: Conditions, server: int, clock: str
    ) -> Future[PlayResult]:
        """Let a task be played in a new process that begins in a new folder."""
        self._folders += 1
        folder = self._folder / str(self._folders)
        folder.mkdir()
        task = PlayTask(rule, play, conditions, str(folder), clock)
        return self._pool.submit(self._play, self._servers[server], task)

    def _play(self, server: ForkServer, task: PlayTask) -> PlayResult:
        left_s = self._deadline - time.monotonic()
        found = server.play(task, min(PATIENCE_S, left_s)) if left_s > 0 else None
        if found is None or (found.late and left_s < PATIENCE_S):
            raise TimeoutError
        return found


class Checker:
    """Checks one rule in scene after scene, and gathers what that shows."""

    def __init__(
        self,
        stage: PlayProcesses,
        rule: str,
        *,
        seed: int,
        progress: Callable[[], object],
        clock: str = "lockstep",
    ) -> None:
        """Play nothing yet. A rule FILE.py:NAME is looked for from the current folder."""
        file = RuleName.of(rule).file
        self._rule = f"{Path(file).resolve()}{rule[len(file) :]}" if file else rule
        self._shown, self._seed, self._stage = rule, seed, stage
        self._progress = progress
        self._clock = clock
        self._evidence = Evidence()
        self._specs: list[str] = []
        self._modules = self._choices = self._changes = 0
        self._late = False

    def check(self, spec: str) -> None:
        """Check the rule in a scene; InputError if it is not for it, or not to be found.

        Nothing is done after a play without an answer.
        """
        if self._late:
            return
        scene = local_only(scene_from_spec(spec), "runs")
        whole = self._run(scene)
        run = self._submit(whole, _USUAL).result()
        if run.unfit is not None:
            raise InputError(run.unfit)
        self._specs.append(spec)
        if not self._gathered(spec, "in a run", run):
            return
        self._look_for_errors(spec, run)
        variants = [*_AGAIN, *_VARIANTS, _UNTOUCHED]
        runs = [
            self._submit(replace(whole, backwards=each.backwards), each.conditions, each.server)
            for each in variants
        ]
        replays = [self._replays(scene, run, module) for module in _spread(run.lives, _WATCHED)]
        *others, untouched = [
            self._compared(spec, each, run, answer.result())
            for each, answer in zip(variants, runs, strict=True)
        ]
        again = next((pair for pair in others[: len(_AGAIN)] if pair is not None), None)
        found = [pair for pair in others if pair is not None]
        for alone, elsewhere, fewer in replays:
            pairs = [
                self._compared(spec, variant, run, answer.result())
                for variant, answer in ((_ALONE, alone), (_ELSEWHERE, elsewhere), (_FEWER, fewer))
            ]
            # State that modules share changes with their number; that alone shows no more.
            by_number = pairs[0] is not None and pairs[1] is None
            found += [pair for pair in pairs[: 2 if by_number else 3] if pair is not None]
            self._modules += 1
        if again is not None:  # then other conditions are not what makes the difference
            found = [again]
        if not found and untouched is not None:
            found = [untouched]
        for variant, text in found:
            self._evidence.add(variant.kind, text)

    def fitting(self, specs: Sequence[str]) -> list[str]:
        """Return the scenes that the rule is for; InputError if there is none, or no such rule."""
        found = self._submit(FitQuestion(tuple(specs)), _USUAL).result()
        if found.unfit is not None:
            raise InputError(found.unfit)
        if found.broken is not None:
            raise InputError(f"rule {self._shown!r}: {found.broken}")
        if not found.specs:
            raise InputError(f"rule {self._shown!r}: for no system with runs, expected one or more")
        return list(found.specs)

    def check_all(self, specs: Sequence[str]) -> None:
        """Check the rule in each of the scenes that it can be made for; InputError if in none."""
        unfit: InputError | None = None
        for spec in specs:
            try:
                self.check(spec)
            except InputError as error:
                unfit = error
        if unfit is not None and not self._specs:
            raise unfit

    def checked(self) -> LocalityReport:
        """Return what has been found so far."""
        return LocalityReport(
            rule=self._shown,
            seed=self._seed,
            systems=tuple(self._specs),
            modules=self._modules,
            choices=self._choices,
            changes=self._changes,
            findings=tuple(self._evidence.findings()),
            clock=self._clock,
        )

    def _run(self, scene: Scene) -> WholeRun:
        seed = Random(f"{self._seed}/{scene.spec}/run").randrange(_SEEDS)  # noqa: S311
        return WholeRun(scene, seed, _HESITATE, _ROUNDS)

    def _submit(self, play: Play, conditions: Conditions, server: int = 0) -> Future[PlayResult]:
        found = self._stage.submit(self._rule, play, conditions, server, self._clock)
        found.add_done_callback(lambda _: self._progress())
        return found

    def _replays(self, scene: Scene, run: PlayResult, module: int) -> list[Future[PlayResult]]:
        """Let a module be asked again: alone, in other surroundings, with fewer and more others."""
        life = run.lives[module]
        changes = ChangedWorlds(
            scene,
            life,
            run.sites,
            Random(f"{self._seed}/{scene.spec}/{module}"),  # noqa: S311
        )
        plays = [
            ModuleReplay(scene, life),
            ModuleReplay(scene, life, changes.elsewhere()),
            ModuleReplay(scene, life, changes.fewer_and_more()),
        ]
        self._changes += changes.count
        return [self._submit(play, _USUAL) for play in plays]

    def _gathered(self, spec: str, how: str, answer: PlayResult) -> bool:
        """Keep what a play shows by itself; return whether it came to an end."""
        self._evidence.accesses |= answer.accesses
        self._evidence.changed |= set(answer.changed)
        self._late = self._late or answer.late
        broken = answer.broken or answer.unfit
        if broken is not None:
            self._evidence.add("fails", f"{spec}, {how}: {broken}")
        return broken is None

    def _compared(
        self, spec: str, variant: _Variant, run: PlayResult, other: PlayResult
    ) -> tuple[_Variant, str] | None:
        """Return the variant with the first difference in words; None if there is none."""
        if not self._gathered(spec, variant.how, other):
            return None
        self._choices += sum(len(life.choices) for life in other.lives.values())
        how, clock = variant.how, self._clock
        text = difference(run.lives, other.lives, spec=spec, how=how, clock=clock)
        return None if text is None else (variant, text)

    def _look_for_errors(self, spec: str, run: PlayResult) -> None:
        for module, life in run.lives.items():
            error = life.choices[-1].error if life.choices else None
            if error is not None:
                period = PERIOD[self._clock]
                when = (
                    f"in {period} {len(life.choices)}" if life.observations else "when it is made"
                )
                self._evidence.add("fails", f"module_{module} of {spec} raises {error} {when}")


def _spread(lives: Mapping[int, ModuleLife], most: int) -> list[int]:
    """Return some of the modules, spread over their numbers."""
    modules = sorted(lives)
    step = max(1, -(-len(modules) // most))
    return modules[::step]


def check_rule(
    rule: str,
    systems: Sequence[str] | None = None,
    *,
    seed: int = 0,
    clock: str = "lockstep",
    timeout_s: float = TIMEOUT_S,
    progress: Callable[[], object] = lambda: None,
) -> LocalityReport:
    """Return what is found of a rule, a name or FILE.py:NAME, in scenes under a clock.

    By default these are a small and a larger scene of each family that it is for. `progress` is
    called for each play. The answer follows from the rule, the scenes and the seed; InputError if
    there is no such rule, or it is for none of the scenes. A rule that gives no answer for a minute
    is a finding; CheckError if all takes longer than `timeout_s` and nothing was found by then.

    >>> found = check_rule("random", ["agv:graph=P3,n=1"])
    >>> found.systems, found.findings
    (('agv:graph=P3,n=1',), ())
    """
    if clock not in PERIOD:
        raise InputError(f"clock={clock!r}: expected one of {', '.join(PERIOD)}")
    timeout_s = seconds("timeout_s", timeout_s)
    with PlayProcesses(seed, timeout_s) as stage:
        checker = Checker(stage, rule, seed=seed, progress=progress, clock=clock)
        try:
            if systems is None:
                checker.check_all(checker.fitting(all_scenes()))
            else:
                for spec in systems:
                    checker.check(spec)
        except TimeoutError:
            if checker.checked().ok:
                raise CheckError(
                    f"rule {rule!r}: not checked within {timeout_s:g} s, expected one that answers"
                    " sooner, or a longer timeout"
                ) from None
        return checker.checked()
