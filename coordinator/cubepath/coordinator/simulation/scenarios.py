"""What a seed stands for: a system, a rule, processes with modules, and a number of rounds.

Instances are small, so that a run takes some hundredths of a second; one in twenty is larger. Under
the free clock there are keepers as well.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from math import ceil, sqrt
from random import Random
from typing import Literal, TypeVar

from cubepath.agents.rules.registry import (
    find_rule,
    fitting_rules,
    is_built_in,
    rule_for,
    rule_named,
    rules,
    unknown_rule,
)
from cubepath.coordinator.simulation.faults import SECOND_US, between
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.system import Scene, local_only
from cubepath.protocol.scenes.registry import all_families
from cubepath.protocol.scenes.specs import scene_from_spec

_SMALL, _LARGE, _LARGE_RATE = (3, 4, 5, 6), 16, 0.05
_PROCESSES_MAX = 6
_TRIES = 20
"""A scene that begins at its goal has no run, and another is drawn: so often at most."""
_WITHOUT_GOAL = (3, 20)
"""The least and the greatest number of rounds of a rule that moves towards no goal."""
_TO_GOAL, _TO_GOAL_LARGE = 1000, 150
"""The most rounds of a rule that moves towards one; not all runs get there."""
_HESITATE = (0.0, 0.0, 0.1, 0.25, 0.5)

_AnyScenario = TypeVar("_AnyScenario", "Scenario", "FreeScenario")
Instance = Callable[[int, Random], str]
"""Returns the spec of a scene with about this many modules."""


def _chain(name: str) -> Instance:
    def spec(modules: int, random: Random) -> str:
        bend = random.choice((60, 120, -60, -120, 0))
        return f"{name}:n={modules}" + ("" if bend == 120 else f",bend={bend}")

    return spec


def _vehicles(name: str) -> Instance:
    def spec(modules: int, random: Random) -> str:
        side = ceil(sqrt(3 * modules))
        graphs = [f"grid{side}x{side}"]
        if modules < _LARGE:  # where all are neighbours, everybody hears everybody
            graphs.append(f"K{modules + 2}")
        if name == "agv":  # labelled ones cannot pass each other on a cycle
            graphs.append(f"C{2 * modules}")
        graph = random.choice(graphs)
        return f"{name}:graph={graph},n={modules}"

    return spec


def _word(modules: int, random: Random) -> str:
    letters = "".join(random.choice("abc") for _ in range(modules))
    return f"words:word={letters},relations=ab~ba+bc~cb+ac~ca"


def _assembly(modules: int, random: Random) -> str:
    kind = random.choice(("pyramid", "wall", "tree"))
    rows = {"pyramid": round(sqrt(2 * modules)) - 1, "wall": round(sqrt(modules))}
    return f"assembly:kind={kind},n={max(2, rows.get(kind, modules.bit_length() - 1))}"


INSTANCES: Mapping[str, Instance] = {
    "hex": _chain("hex"),
    "hex-open": _chain("hex-open"),
    "hex-tunnel": lambda modules, _: f"hex-tunnel:n={modules}",
    "sliding": lambda modules, random: (
        f"sliding:p={random.choice((1, 2, 3))},q={random.choice((1, 2))},n={min(modules, 4)}"
    ),
    "agv": _vehicles("agv"),
    "agv-labelled": _vehicles("agv-labelled"),
    "arm": lambda modules, _: f"arm:n={modules}",
    "arm-free": lambda modules, _: f"arm-free:n={modules}",
    "arms": lambda _modules, _: "arms:n=1",
    "polygon": lambda modules, _: f"polygon:n={min(modules, 9) + 3}",
    "triangulation": lambda modules, random: (
        f"triangulation:n={min(max(modules, 4), 8) + 2},seed={random.randrange(1, 4)}"
    ),
    "words": _word,
    "assembly": _assembly,
    "sliding-cubes": lambda modules, _: f"sliding-cubes:n={max(modules, 2)}",
    "pivoting-cubes": lambda modules, _: f"pivoting-cubes:n={max(modules, 2)}",
    "rolling-dodecahedra": lambda modules, _: f"rolling-dodecahedra:n={max(modules, 2)}",
}
"""For each family the scenes that are simulated; of another one its default scene is."""
_ALWAYS_LARGE = frozenset(("arms",))


@dataclass(frozen=True, slots=True)
class ScenarioOptions:
    """What is the same for all seeds; None is drawn."""

    system: str | None = None
    rule: str | None = None
    modules: int | None = None
    liars: bool = False
    """Whether processes lie in most runs."""
    clock: Literal["lockstep", "free"] = "lockstep"

    def arguments(self) -> list[str]:
        """Return the options of the command line that ask for this."""
        named = {"--system": self.system, "--rule": self.rule, "--modules": self.modules}
        words = [
            word for key, value in named.items() if value is not None for word in (key, str(value))
        ]
        words += ["--liars"] if self.liars else []
        return [*words, "--clock", self.clock] if self.clock != "lockstep" else words


ANYTHING = ScenarioOptions()
"""Nothing is asked for: everything is drawn."""


@dataclass(frozen=True, slots=True)
class Scenario:
    """One run, without its faults."""

    system: str
    rule: str
    processes: int
    hesitate: float
    max_rounds: int
    seed: int

    @property
    def scene(self) -> Scene:
        """Return the scene; one that was built before is built no more."""
        return built(self.system)

    def smaller(self) -> list[Scenario]:
        """Return scenarios like this with fewer modules or processes, the smallest first."""
        return list(_smaller(self, INSTANCES, "lockstep"))

    def shorter(self, rounds: int) -> list[Scenario]:
        """Return scenarios like this with fewer rounds than a run had."""
        return [replace(self, max_rounds=most) for most in _fewer(rounds, self.max_rounds)]

    def plainer(self) -> list[Scenario]:
        """Return scenarios like this in which modules do not hesitate."""
        return [replace(self, hesitate=0.0)] if self.hesitate else []


def _smaller(
    scenario: _AnyScenario, instances: Mapping[str, Instance], clock: str
) -> Iterator[_AnyScenario]:
    """Yield the same with fewer modules, and then with fewer processes, the smallest first."""
    family, count = scenario.system.partition(":")[0], len(scenario.scene.start)
    for modules in range(1, count) if family in instances else ():
        try:
            spec = instances[family](modules, Random(scenario.seed))  # noqa: S311 - not for secrets
            scene = built(spec)
            rule_named(scenario.rule, scene.system, clock)
        except InputError:
            continue
        if len(scene.start) < count and not scene.reached(scene.start):
            processes = min(scenario.processes, len(scene.start))
            yield replace(scenario, system=spec, processes=processes)
    for processes in range(1, scenario.processes):
        yield replace(scenario, processes=processes)


def _fewer(done: int, most: int) -> list[int]:
    """Return numbers that a run is tried with which has done so much of at most so much."""
    return [
        each for each in sorted({1, 2, 3, done // 4, done // 2, done - 1, done}) if 0 < each < most
    ]


@lru_cache(maxsize=256)
def built(spec: str) -> Scene:
    """Return the scene of a spec; InputError if its modules cannot run."""
    scene = local_only(scene_from_spec(spec), "runs")
    _ = scene.system.move_slots
    return scene


def check(asked: ScenarioOptions) -> None:
    """Raise InputError if nothing can be simulated that is asked for."""
    if asked.liars and asked.clock != "lockstep":
        raise InputError(f"--liars with --clock {asked.clock}: expected --clock lockstep")
    if asked.system is not None:
        if asked.modules is not None and asked.system not in INSTANCES:
            names = ", ".join(INSTANCES)
            raise InputError(
                f"--modules {asked.modules} with --system {asked.system}: expected one of {names}"
            )
        scene = built(asked.system)
        if asked.rule is not None:
            # A name of `INSTANCES` stands for others, too.
            rule_named(asked.rule, scene.system, asked.clock)
            if asked.system not in INSTANCES:
                rule_for(asked.rule, scene, asked.clock)
    elif asked.rule is not None:
        rule = find_rule(asked.rule)
        if rule is None:
            raise unknown_rule(asked.rule)
        if asked.clock not in rule.clocks:
            names = ", ".join(rule.name for rule in rules().values() if asked.clock in rule.clocks)
            raise InputError(
                f"not for the {asked.clock} clock: rule {asked.rule!r}, expected one of {names}"
            )


def scenario_of(seed: int, asked: ScenarioOptions = ANYTHING) -> Scenario:
    """Return the run that a seed stands for."""
    random = Random(f"{seed}/scenario")  # noqa: S311 - not for secrets
    spec = drawn_system(asked, random)
    scene = built(spec)
    rule = asked.rule or random.choice(_fitting(spec, "lockstep"))
    found = find_rule(rule)
    modules = len(scene.start)
    to_goal = _TO_GOAL_LARGE if modules >= _LARGE else _TO_GOAL
    endless = scene.goal is None or (found is not None and not found.to_goal)
    return Scenario(
        system=spec,
        rule=rule,
        processes=random.randint(1, min(modules, _PROCESSES_MAX)),
        hesitate=random.choice(_HESITATE),
        max_rounds=random.randint(*_WITHOUT_GOAL) if endless else to_goal,
        seed=random.randrange(1 << 16),
    )


def drawn_system(
    asked: ScenarioOptions,
    random: Random,
    small: Sequence[int] = _SMALL,
    instances: Mapping[str, Instance] = INSTANCES,
) -> str:
    """Draw the spec of a scene, with about one of these numbers of modules in most cases."""
    if asked.system is not None and asked.system not in instances:
        return asked.system
    large = random.random() < _LARGE_RATE
    modules = asked.modules or (_LARGE if large else random.choice(small))
    family = asked.system or random.choice(_families_for(asked.rule, asked.clock, large=large))
    spec = instances[family](modules, random)
    for _ in range(_TRIES):
        scene = built(spec)
        if not scene.reached(scene.start):
            break
        spec = instances[family](modules, random)
    return spec


@lru_cache
def _families_for(rule: str | None, clock: str, *, large: bool) -> list[str]:
    names = [name for name in INSTANCES if name in all_families()]
    if not large:
        names = [name for name in names if name not in _ALWAYS_LARGE]
    if rule is not None:
        names = [name for name in names if rule in _fitting(name, clock)]
    return names


@lru_cache(maxsize=256)
def _fitting(spec: str, clock: str) -> list[str]:
    """Return the names of the rules for a scene; to find them, each is made."""
    return fitting_rules(built(spec), clock, foreign=True)


_FREE_SMALL = (3, 4, 5, 6, 7, 8)
_KEEPERS = (2, 3, 3, 4, 5, 6)
_FREE_HESITATE = (0.0, 0.0, 0.0, 0.1, 0.5)
_ALONE = 0.8
"""The probability that each module has a separate process."""
_FACTORS = (0.0, 0.0, 0.0, 1.0, 3.0, 10.0, 40.0)
"""How slowly modules think."""
_MOVES, _LONG_S = (5, 40), (0.5, 20.0)
"""After how many moves, and how many seconds at most, there are no more faults."""
_STRIPS = 0.6
_HOSTS = (0, 0, 2, 3)


def _free_vehicles(name: str) -> Instance:
    def spec(modules: int, random: Random) -> str:
        if random.random() < _STRIPS:
            return f"{name}:graph=grid2x{max(6, modules + modules // 2 + 1)},n={modules}"
        return INSTANCES[name](modules, random)

    return spec


FREE_INSTANCES: Mapping[str, Instance] = {
    **INSTANCES,
    "agv": _free_vehicles("agv"),
    "agv-labelled": _free_vehicles("agv-labelled"),
}
"""Of vehicles many are in strips that are crowded, and lie across several tiles."""


@dataclass(frozen=True, slots=True)
class FreeScenario:
    """One run, without its faults."""

    system: str
    rule: str
    processes: int
    keepers: int
    hesitate: float
    factors: tuple[float, ...]
    """How slowly modules think, in turn."""
    moves: int
    """After this many moves there are no more faults."""
    long_us: int
    """After this time, too."""
    seed: int
    ends_at_goal: bool | None = None
    """Whether the run ends at its goal, and else when its faults are over, as in an experiment;
    None if that follows from the rule, and whatever is left has to be done after the faults."""
    hosts: int = 0
    """On how many hosts it is, each with a router; 0: one router, and cuts between any processes.
    """

    @property
    def scene(self) -> Scene:
        """Return the scene; one that was built before is built no more."""
        return built(self.system)

    @property
    def to_goal(self) -> bool:
        """Return whether the rule moves towards a goal; those of other people may not."""
        if self.ends_at_goal is not None:
            return self.ends_at_goal
        own = find_rule(self.rule)
        sure = own is not None and is_built_in(own) and own.to_goal
        return sure and self.scene.goal is not None

    def smaller(self) -> list[FreeScenario]:
        """Return scenarios like this with less in them, the smallest first."""
        fewer = (replace(self, keepers=number) for number in range(1, self.keepers))
        return [*_smaller(self, FREE_INSTANCES, "free"), *fewer]

    def shorter(self, moves: int) -> list[FreeScenario]:
        """Return scenarios like this with fewer moves under faults than a run had."""
        return [replace(self, moves=most) for most in _fewer(moves, self.moves)]

    def plainer(self) -> list[FreeScenario]:
        """Return scenarios like this with nothing that makes modules differ."""
        plain = replace(self, hesitate=0.0, factors=(0.0,))
        return [each for each in (plain, replace(self, hosts=0)) if each != self]


def free_scenario_of(seed: int, asked: ScenarioOptions) -> FreeScenario:
    """Return the run that a seed stands for."""
    random = Random(f"{seed}/free scenario")  # noqa: S311 - not for secrets
    spec = drawn_system(asked, random, _FREE_SMALL, FREE_INSTANCES)
    scene = built(spec)
    modules = len(scene.start)
    alone = random.random() < _ALONE
    return FreeScenario(
        system=spec,
        rule=asked.rule or random.choice(_fitting(spec, "free")),
        processes=min(modules, 8) if alone else random.randint(1, min(modules, 8)),
        keepers=random.choice(_KEEPERS),
        hesitate=random.choice(_FREE_HESITATE),
        factors=tuple(random.choice(_FACTORS) for _ in range(random.choice((1, 2, 5)))),
        moves=random.randint(*_MOVES),
        long_us=int(between(random, *_LONG_S) * SECOND_US),
        seed=random.randrange(1 << 16),
        hosts=random.choice(_HOSTS),
    )
