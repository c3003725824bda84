"""What a seed stands for under the free clock: a scene, a rule, keepers, modules in processes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from random import Random

from cubepath.agents.rules.registry import BUILT_IN, fitting_rules, rule_named
from cubepath.coordinator.simulation.faults import SECOND_US, between
from cubepath.coordinator.simulation.scenarios import (
    INSTANCES,
    Asked,
    Instance,
    built,
    drawn_system,
)
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.system import Scene

_SMALL = (3, 4, 5, 6, 7, 8)
_KEEPERS = (2, 3, 3, 4, 5, 6)
_HESITATE = (0.0, 0.0, 0.0, 0.1, 0.5)
_ALONE = 0.8
"""How probable it is that each module has a process of its own."""
_FACTORS = (0.0, 0.0, 0.0, 1.0, 3.0, 10.0, 40.0)
"""How slowly modules think."""
_MOVES, _LONG_S = (5, 40), (0.5, 20.0)
"""After how many moves, and how many seconds at most, there are no more faults."""
_STRIPS = 0.6
_FILES = 1 / 32
"""How probable it is that keepers have their journals in files."""


def _vehicles(name: str) -> Instance:
    def spec(modules: int, random: Random) -> str:
        if random.random() < _STRIPS:
            return f"{name}:graph=grid2x{max(6, modules + modules // 2 + 1)},n={modules}"
        return INSTANCES[name](modules, random)

    return spec


FREE_INSTANCES: Mapping[str, Instance] = {
    **INSTANCES,
    "agv": _vehicles("agv"),
    "agv-labelled": _vehicles("agv-labelled"),
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
    """After so many moves there are no more faults."""
    long_us: int
    """After this time, too."""
    files: bool
    seed: int
    ends_at_goal: bool | None = None
    """Whether the run ends at its goal, and else when its faults are over, as in an experiment;
    None if that follows from the rule, and whatever is left has to be done after the faults."""

    @property
    def scene(self) -> Scene:
        """Return the scene; one that was built before is built no more."""
        return built(self.system)

    @property
    def to_goal(self) -> bool:
        """Return whether the rule moves towards a goal; those of other people may not."""
        if self.ends_at_goal is not None:
            return self.ends_at_goal
        return self.rule in BUILT_IN and self.rule != "random"

    def smaller(self) -> list[FreeScenario]:
        """Return scenarios like this with less in them, the smallest first."""
        family, count = self.system.partition(":")[0], len(self.scene.start)
        found: list[FreeScenario] = []
        for modules in range(1, count) if family in FREE_INSTANCES else ():
            try:
                spec = FREE_INSTANCES[family](modules, Random(self.seed))  # noqa: S311 - not for secrets
                scene = built(spec)
                rule_named(self.rule, scene.system, "free")
            except InputError:
                continue
            if len(scene.start) < count and not scene.reached(scene.start):
                processes = min(self.processes, len(scene.start))
                found.append(replace(self, system=spec, processes=processes))
        found += (replace(self, processes=number) for number in range(1, self.processes))
        return [*found, *(replace(self, keepers=number) for number in range(1, self.keepers))]

    def shorter(self, moves: int) -> list[FreeScenario]:
        """Return scenarios like this with fewer moves under faults than a run had."""
        numbers = sorted({1, 2, 3, moves // 4, moves // 2, moves - 1, moves})
        return [replace(self, moves=most) for most in numbers if 0 < most < self.moves]

    def plainer(self) -> list[FreeScenario]:
        """Return scenarios like this with nothing that makes modules differ."""
        plain = replace(self, hesitate=0.0, factors=(0.0,), files=False)
        return [] if plain == self else [plain]


def free_scenario_of(seed: int, asked: Asked) -> FreeScenario:
    """Return the run that a seed stands for."""
    random = Random(f"{seed}/free scenario")  # noqa: S311 - not for secrets
    spec = drawn_system(asked, random, _SMALL, FREE_INSTANCES)
    scene = built(spec)
    modules = len(scene.start)
    alone = random.random() < _ALONE
    return FreeScenario(
        system=spec,
        rule=asked.rule or random.choice(fitting_rules(scene, "free", foreign=True)),
        processes=min(modules, 8) if alone else random.randint(1, min(modules, 8)),
        keepers=random.choice(_KEEPERS),
        hesitate=random.choice(_HESITATE),
        factors=tuple(random.choice(_FACTORS) for _ in range(random.choice((1, 2, 5)))),
        moves=random.randint(*_MOVES),
        long_us=int(between(random, *_LONG_S) * SECOND_US),
        files=random.random() < _FILES,
        seed=random.randrange(1 << 16),
    )
