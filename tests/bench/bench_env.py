"""PettingZoo agent-steps a second at 10, 100 and 1000 modules, against a bare loop over agents.

    python tests/bench/bench_env.py [--quick]

The floor, measured in the same run, is what PettingZoo's interface alone costs: an environment of
as many agents that hands out one fixed observation and mask and moves nothing.
"""

from __future__ import annotations

import argparse
import statistics
import sys
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from tqdm import tqdm

from cubepath.agents import parallel_env


class Bare:
    """An environment that does nothing, in the form that PettingZoo asks for."""

    def __init__(self, like: Any) -> None:
        self.agents = list(like.possible_agents)
        seen, _ = like.reset(seed=0)
        self._shape = {key: value.copy() for key, value in seen[self.agents[0]].items()}

    def step(self, actions: dict[str, int]) -> tuple[dict[str, Any], ...]:
        seen = {name: {k: v.copy() for k, v in self._shape.items()} for name in actions}
        return (
            seen,
            dict.fromkeys(actions, 0.0),
            dict.fromkeys(actions, False),
            dict.fromkeys(actions, False),
            {name: {"action_mask": one["action_mask"]} for name, one in seen.items()},
        )


def steps_per_second(
    step: Callable[[dict[str, int]], Any], agents: list[str], seen: Any, seconds: float
) -> float:
    """Return the median over three spans of agent-steps a second, with random legal actions."""
    random = np.random.default_rng(0)
    rates = []
    for _ in range(3):
        done, began = 0, time.perf_counter()
        while time.perf_counter() - began < seconds / 3:
            draws = random.random(len(agents))
            actions = {}
            for name, draw in zip(agents, draws, strict=True):
                legal = np.flatnonzero(seen[name]["action_mask"])
                actions[name] = int(legal[int(draw * len(legal))])
            seen = step(actions)[0]
            done += len(agents)
        rates.append(done / (time.perf_counter() - began))
    return statistics.median(rates)


def main() -> None:
    """Print the table."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--quick", action="store_true", help="a shorter span each")
    seconds = 0.6 if options.parse_args().quick else 3.0
    print(f"{'system':<28}{'agent-steps/s':>15}{'bare interface':>16}{'ratio':>8}")
    specs = [
        f"{family}{count}"
        for family in ("hex:n=", "arm:n=", "agv:graph=grid64x64,n=")
        for count in (10, 100, 1000)
    ]
    for spec in tqdm(specs, disable=None, leave=False, file=sys.stderr):
        one = parallel_env(spec, max_cycles=10**9)
        bare = Bare(one)
        seen, _ = one.reset(seed=0)
        ours = steps_per_second(one.step, one.agents, seen, seconds)
        floor = steps_per_second(bare.step, bare.agents, seen, seconds)
        print(f"{spec:<28}{ours:>15,.0f}{floor:>16,.0f}{floor / ours:>8.1f}", flush=True)


if __name__ == "__main__":
    main()
