"""Learn a policy for 8 vehicles on an 8x8 grid, compare it, and run it over zenoh.

About a minute on one core: ``pip install 'cubepath[learning]'``, then ``python recipe.py learned``.
"""

from __future__ import annotations

import argparse
import math
from pathlib import Path

import numpy as np
import torch
from sb3_contrib import MaskablePPO

from cubepath.agents import RuleType, play, play_many, sb3_env, sb3_rule, sb3_save
from cubepath.coordinator import run
from cubepath.protocol import scene_from_spec

SCENES = "agv-labelled:graph=grid8x8,n=8,seed={}"
TRAINING, TEST = 1001, range(1, 51)
HORIZON = 64


def learn(file: Path, steps: int) -> None:
    """Learn one policy for all modules, from what each sees, and write it to a file.

    A module gets 0.2 for a move that leads nearer to its goal and -0.2 for one that leads away, in
    addition to the reward that all share.
    """
    torch.set_num_threads(1)  # the network is small: more threads only wait for each other
    scene = SCENES.format(TRAINING)
    env = sb3_env(scene, num_envs=64, max_cycles=HORIZON, progress=0.2)
    model = MaskablePPO(
        "MlpPolicy",
        env,
        n_steps=32,
        batch_size=1024,
        n_epochs=6,
        learning_rate=1e-3,
        gamma=0.95,
        seed=0,
    )
    sb3_save(model.learn(steps), file)


def interval(reached: int, runs: int) -> tuple[float, float]:
    """Return the Wilson interval of a share, at 95 %."""
    z, share = 1.96, reached / runs
    middle = share + z * z / (2 * runs)
    width = z * math.sqrt(share * (1 - share) / runs + z * z / (4 * runs * runs))
    return (middle - width) / (1 + z * z / runs), (middle + width) / (1 + z * z / runs)


def compare(rules: list[str | RuleType]) -> dict[str, tuple[float, float]]:
    """Print how many unseen scenes each rule solves; return the intervals of these shares."""
    print(f"{'rule':26} reached within {HORIZON} rounds, 95 % interval   median rounds")
    found = {}
    for rule in rules:
        runs = [play_many(SCENES.format(s), rule, [s], max_rounds=HORIZON) for s in TEST]
        reached = sum(int(each.reached[0]) for each in runs)
        rounds = np.median([each.rounds[0] for each in runs])
        name = rule if isinstance(rule, str) else rule.name
        low, high = found[name] = interval(reached, len(TEST))
        print(f"{name:26} {reached:3} of {len(TEST)}   {low:.2f} to {high:.2f}   {rounds:.0f}")
    return found


def over_zenoh(folder: Path, seed: int) -> bool:
    """Run a test scene in two processes; return whether it makes the moves that `play` makes."""
    scene = SCENES.format(seed)
    policy = sb3_rule("policy", folder / "policy.npz")
    here = play(scene_from_spec(scene), policy, seed=seed, max_rounds=HORIZON)
    wire = run(
        scene,
        f"{folder / 'policy.py'}:POLICY",
        seed=seed,
        max_rounds=HORIZON,
        processes=2,
        log=folder / f"seed-{seed}.mcap",
    )
    same = list(wire.path) == list(here.path)
    print(f"seed {seed} over zenoh: {wire.rounds} rounds, {len(wire.path)} moves, as here: {same}")
    return same


RULE = """from pathlib import Path

from cubepath.agents import sb3_rule

POLICY = sb3_rule("policy", Path(__file__).with_name("policy.npz"))
"""


def main() -> None:
    """Learn, compare, run."""
    parser = argparse.ArgumentParser(description="Learn a policy for 8 vehicles on an 8x8 grid.")
    parser.add_argument("folder", type=Path, help="a new folder for the policy and a recording")
    parser.add_argument("--steps", type=int, default=300_000, help="actions of modules to learn")
    asked = parser.parse_args()
    asked.folder.mkdir(parents=True)
    learn(asked.folder / "policy.npz", asked.steps)
    (asked.folder / "policy.py").write_text(RULE)
    policy = sb3_rule("policy", asked.folder / "policy.npz")
    compare([policy, "metropolis", "metropolis:temperature=0.2", "random"])
    over_zenoh(asked.folder, TEST[0])


if __name__ == "__main__":
    main()
