"""Choices a second: rules for all modules of many environments at once, against actors one by one.

    python tests/bench/bench_rules.py [--quick]

Both choose from what modules see in one run, each environment at a time of its own. The peer is an
`Actor` for each module, that is the same rule in plain Python; the floor is one pass of numpy over
the arrays. All rates are of processor time, the medians of several spans, after the first use; the
time to make the actors of all environments is beside them.
"""

import argparse
import statistics
import sys
import time
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from cubepath.agents.environments.world import World
from cubepath.agents.local.observation import Observation
from cubepath.agents.rules.actor import actors_for
from cubepath.agents.rules.registry import rule_named
from cubepath.agents.rules.rule import RuleType
from cubepath.agents.rules.vector_actors import VectorActors, vector_actors_for
from cubepath.protocol.compiled import allowance
from cubepath.protocol.core.system import Scene
from cubepath.protocol.scenes.specs import scene_from_spec

CASES = [
    (spec.format(n=count), rule, environments)
    for spec, rule in (("hex:n={n}", "random"), ("hex:n={n}", "chain"))
    for count, environments in ((12, 10), (12, 1000), (120, 10), (120, 100))
]
ROUNDS = 12
"""How many rounds of the run are seen."""


class Row(NamedTuple):
    """Choices a second, and the seconds to make the actors of all environments."""

    vectorised: float
    peer: float
    floor: float
    made: float
    peer_made: float


def seconds_of(work: Callable[[], object]) -> float:
    """Return the processor time that this takes."""
    began = time.process_time()
    work()
    return time.process_time() - began


def rate(choices: int, work: Callable[[], object], spans: int) -> float:
    """Return choices a second, the median of so many spans of 50 ms each, or one call if longer."""
    rates = []
    for _ in range(spans):
        calls, taken = 0, 0.0
        while taken < 0.05:
            taken += seconds_of(work)
            calls += 1
        rates.append(choices * calls / taken)
    return statistics.median(rates)


def run_of(scene: Scene, rule: RuleType) -> list[list[Observation]]:
    """Return what the modules see in the first rounds of a run."""
    world, actors = World(scene, seed=0), actors_for(scene, rule, seed=0, hesitate=0.2)
    seen = []
    for _ in range(ROUNDS):
        seen.append([world.observe(module) for module in actors])
        world.step({m: each.act(seen[-1][m]).action for m, each in actors.items()})
    return seen


def measure(spec: str, name: str, environments: int, spans: int) -> Row:
    """Measure one case."""
    scene = scene_from_spec(spec)
    rule = rule_named(name, scene.system)
    modules = len(scene.start)
    seen = run_of(scene, rule)

    def made() -> VectorActors:
        found = vector_actors_for(scene, rule, seeds=range(environments), hesitate=0.2)
        assert found is not None
        return found

    def array(key: str, *, first: bool) -> NDArray[Any]:
        rounds = [0 if first else each % ROUNDS for each in range(environments)]
        return np.array([[each[key] for each in seen[number]] for number in rounds])

    vector = made()
    out = np.zeros((environments, modules), np.int32)
    begin = [array(key, first=True) for key in ("observation", "action_mask")]
    vector.act(begin[0], begin[1], None, out)
    observation, mask = array("observation", first=False), array("action_mask", first=False)
    vectorised = rate(out.size, lambda: vector.act(observation, mask, None, out), spans)
    floor = rate(out.size, lambda: (observation.sum(), mask.sum()), spans)
    actors = actors_for(scene, rule, seed=0, hesitate=0.2)
    for module, each in actors.items():
        each.act(seen[0][module])
    peer = rate(
        modules * ROUNDS,
        lambda: [each.act(row[module]) for row in seen for module, each in actors.items()],
        spans,
    )
    one = statistics.median(
        seconds_of(lambda: actors_for(scene, rule, seed=1, hesitate=0.2)) for _ in range(spans)
    )
    many = statistics.median(seconds_of(made) for _ in range(spans))
    return Row(vectorised, peer, floor, many, one * environments)


def main() -> None:
    """Print the table."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--quick", action="store_true", help="few environments, one span each")
    quick = options.parse_args().quick
    allowance.left = 0
    print(f"{'':<24}{'':>6}{'choices a second':>39}{'':>8}{'seconds to make':>21}")
    print(
        f"{'system, rule':<24}{'runs':>6}{'vectorised':>15}{'actors':>10}{'one pass':>14}"
        f"{'ratio':>8}{'vectorised':>12}{'actors':>9}"
    )
    cases = [case for case in CASES if not quick or case[2] == 10]
    for spec, rule, environments in tqdm(cases, disable=None, leave=False, file=sys.stderr):
        row = measure(spec, rule, environments, 1 if quick else 5)
        print(
            f"{spec + ' ' + rule:<24}{environments:>6}{row.vectorised:>15,.0f}{row.peer:>10,.0f}"
            f"{row.floor:>14,.0f}{row.vectorised / row.peer:>8.0f}{row.made:>12.4f}"
            f"{row.peer_made:>9.3f}",
            flush=True,
        )


if __name__ == "__main__":
    main()
