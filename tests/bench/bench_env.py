"""Agent-steps a second of processor time: through PettingZoo's dicts, fresh and kept, and arrays.

    python tests/bench/bench_env.py [--quick] [--peer PYTHON ...]

Actions are drawn beforehand, from the masks of a first run with the same seed; they are legal, so
every module that is not held back by another moves. "later" is the second half of the steps of
"arrays", when fewer modules come to places where none was before. The floor, measured in the same
run, is what PettingZoo's interface costs: an environment of as many agents that hands out one fixed
observation and mask in fresh dicts and moves nothing. `--peer` names a Python that has magent2,
whose battle is stepped with random actions, or pogema, in free space; each by about as many agents.
pogema needs one of its own, since it pins old packages. Batches are of environments of one scene.
Their floor is to copy what is observed from one array to another; bytes are those of the
environment after its steps, for each module, without the scene.
"""

import argparse
import gc
import math
import statistics
import subprocess
import sys
import time
import tracemalloc
from collections.abc import Callable, Iterator
from functools import lru_cache, partial
from typing import Any

import numpy as np
from tqdm import tqdm

from cubepath.agents import parallel_env, vector_env
from cubepath.protocol.core.system import Scene
from cubepath.protocol.scenes.specs import scene_from_spec
from cubepath.protocol.systems.lattice import LatticeSystem

FAMILIES = ("hex:n=", "hex-open:n=", "arm:n=", "agv:graph=grid64x64,n=")
LOOSE, ROW = "loose hexagons, n=", 5
BATCHES = (("hex:n=10", 1000), ("agv:graph=grid16x16,n=100", 100))
WIDE = ("hex:n=", LOOSE, "agv:graph=grid400x400,n=")
PEERS = {
    "magent2": """
import sys, time
import numpy as np
from magent2.environments import battle_v4
agents = int(sys.argv[1])
env = battle_v4.parallel_env(map_size=max(12, int((8 * agents) ** 0.5)), max_cycles=10**6)
env.reset(seed=0)
rates = []
for _ in range(5):
    done, began = 0, time.process_time()
    while done < 10_000:
        draws = np.random.randint(21, size=len(env.agents)).tolist()
        actions = dict(zip(env.agents, draws))
        done += len(actions)
        env.step(actions)
        if not env.agents:
            env.reset(seed=0)
    rates.append(done / (time.process_time() - began))
print(len(env.possible_agents), sorted(rates)[2])
""",
    "pogema": """
import random, sys, time
from pogema import GridConfig, pogema_v0
agents = int(sys.argv[1])
size = int((4 * agents) ** 0.5) + 1
free = dict(density=0.0, on_target="restart", max_episode_steps=10**6)
env = pogema_v0(GridConfig(num_agents=agents, size=size, seed=0, obs_radius=5, **free))
env.reset()
rates = []
for _ in range(5):
    began = time.process_time()
    for _ in range(10_000 // agents):
        env.step([random.randrange(5) for _ in range(agents)])
    rates.append(10_000 // agents * agents / (time.process_time() - began))
print(agents, sorted(rates)[2])
""",
}
"""What prints agents and agent-steps a second of another environment, of about so many agents."""


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


@lru_cache(maxsize=1)
def scene_of(spec: str) -> Scene:
    """Return a scene by its name; the loose ones are of this file.

    They are hexagons that may part, in short rows far from one another in a plane without end, so
    many of them can move, and the scene does not grow with the square of the modules.
    """
    if not spec.startswith(LOOSE):
        return scene_from_spec(spec)
    size = int(spec.removeprefix(LOOSE))
    catalogue = scene_from_spec("hex-open:n=1").system.catalogue
    if catalogue is None:
        raise AssertionError("hex-open is a system of a catalogue")
    width = 1 + math.isqrt(size // ROW)
    start = []
    for number in range(size):
        row, place = divmod(number, ROW)
        start.append((2 * ROW * (row % width) + place, ROW * (row // width)))
    goals = tuple((x, y + 1) for x, y in start)
    system = LatticeSystem(catalogue)
    return Scene(spec, "", system, tuple(start), frozenset(goals), (goals,) * size)


def drawn(spec: str, count: int, steps: int) -> tuple[list[np.ndarray[Any, Any]], float]:
    """Return random legal actions for so many steps, and the share of agents that moved in one."""
    env = vector_env(scene_of(spec), num_envs=count, max_cycles=10**9, copy=False)
    seen, _ = env.reset(seed=0)
    random = np.random.default_rng(0)
    size = env.scene.system.site_size
    found, moved = [], 0
    for _ in range(steps):
        mask = seen["action_mask"]
        draws = random.random(mask.shape, dtype=np.float32)
        actions = np.where(mask, draws, -1).argmax(axis=2)
        before = seen["observation"][..., :size].copy()
        seen, *_ = env.step(actions)
        moved += int((seen["observation"][..., :size] != before).any(axis=2).sum())
        found.append(actions)
    return found, moved / (steps * found[0].size)


def rate(
    make: Callable[[], Callable[[Any], Any]],
    actions: list[Any],
    agents: int,
    *,
    first: int = 0,
    repeats: int = 5,
) -> float:
    """Return the median over some runs of agent-steps a second of processor time.

    The first steps, so many, are not counted.
    """
    rates = []
    for _ in range(repeats):
        step = make()
        for each in actions[:first]:
            step(each)
        gc.collect()
        began = time.process_time()
        for each in actions[first:]:
            step(each)
        rates.append(agents * (len(actions) - first) / (time.process_time() - began))
    return statistics.median(rates)


def dicts(spec: str, **options: Any) -> Callable[[], Callable[[Any], Any]]:
    """Return how to make an environment and get its `step`."""
    scene = scene_of(spec)

    def make() -> Callable[[Any], Any]:
        env = parallel_env(scene, max_cycles=10**9, **options)
        env.reset(seed=0)
        return env.step

    return make


def arrays(spec: str, count: int) -> Callable[[], Callable[[Any], Any]]:
    """Return how to make a vector environment and get its `step`."""

    scene = scene_of(spec)

    def make() -> Callable[[Any], Any]:
        env = vector_env(scene, num_envs=count, max_cycles=10**9, copy=False)
        env.reset(seed=0)
        return env.step

    return make


def copies(spec: str, count: int) -> Callable[[], Callable[[Any], Any]]:
    """Return how to make a step that only copies observations and masks."""
    seen, _ = vector_env(scene_of(spec), num_envs=count, copy=False).reset(seed=0)
    pairs = [(array.copy(), array) for array in seen.values()]

    def step(_: Any) -> None:
        for target, source in pairs:
            np.copyto(target, source)

    return lambda: step


def memory(spec: str, count: int, actions: list[Any]) -> float:
    """Return the bytes that environments take after some steps, for each module."""
    make = arrays(spec, count)
    tracemalloc.start()
    step = make()
    for each in actions:
        step(each)
    gc.collect()
    found, _ = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    del step
    return found / int(actions[0].size)


def single(spec: str, modules: int, steps: int, repeats: int) -> Iterator[str]:
    """Yield the figures of one environment, in millions of agent-steps a second."""
    actions, moved = drawn(spec, 1, steps)
    env = parallel_env(scene_of(spec))
    names = env.possible_agents
    named = [dict(zip(names, each[0].tolist(), strict=True)) for each in actions]
    bare = Bare(env)
    few = named[: max(2, 3000 // modules)]
    measured = partial(rate, agents=modules, repeats=repeats)
    rates = [
        measured(dicts(spec, world="plain"), few),
        measured(dicts(spec, world="compiled"), named),
        measured(dicts(spec, world="compiled", copy=False), named),
        measured(arrays(spec, 1), actions),
        measured(arrays(spec, 1), actions, first=len(actions) // 2),
        measured(lambda: bare.step, named),
    ]
    yield f"{spec:<30}{moved:>7.2f}" + "".join(f"{each / 1e6:>9.3f}" for each in rates)


def main() -> None:
    """Print the tables."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--quick", action="store_true", help="fewer steps, of fewer modules")
    options.add_argument(
        "--peer", action="append", default=[], help="a Python that has magent2 or pogema"
    )
    given = options.parse_args()
    work, repeats = (2_000, 1) if given.quick else (300_000, 5)
    print("million agent-steps a second; moves: the share of agents that move in a step")
    print(f"{'one environment':<30}{'moves':>7}{'plain':>9}{'dicts':>9}{'kept':>9}", end="")
    print(f"{'arrays':>9}{'later':>9}{'floor':>9}")
    sizes = (10,) if given.quick else (10, 100, 1000)
    todo = [(f"{family}{size}", size) for family in FAMILIES for size in sizes]
    for spec, size in tqdm(todo, disable=None, leave=False, file=sys.stderr):
        for line in single(spec, size, max(5, work // size), repeats):
            print(line, flush=True)
    wide = [(f"{family}{size}", 1) for family in WIDE for size in (1000, 10_000, 100_000)]
    for spec, count in BATCHES if given.quick else (*BATCHES, *wide):
        size = int(spec.rpartition("=")[2])
        actions, moved = drawn(spec, count, max(3, 2 * work // (size * count)))
        measured = partial(rate, arrays(spec, count), actions, size * count, repeats=repeats)
        found, later = measured(), measured(first=len(actions) // 2)
        floor = rate(copies(spec, count), actions, size * count, repeats=repeats)
        what = f"{spec} x {count}" if count > 1 else f"{spec}, arrays"
        print(
            f"{what:<37} moves {moved:.2f} {found / 1e6:>8.3f} later {later / 1e6:>8.3f}"
            f" floor {floor / 1e6:>8.3f} ratio {floor / found:>6.1f}"
            f" bytes {memory(spec, count, actions):>6.0f}",
            flush=True,
        )
    for python in given.peer:
        for name, code in PEERS.items():
            asked = [python, "-c", f"import {name}"]
            if subprocess.run(asked, check=False, capture_output=True).returncode:
                continue
            for size in sizes:
                told = subprocess.run(
                    [python, "-c", code, str(size)], capture_output=True, text=True, check=True
                )
                agents, theirs = told.stdout.split()[-2:]
                print(f"{name}, {agents} agents {float(theirs) / 1e6:>8.3f}", flush=True)


if __name__ == "__main__":
    main()
