"""Vehicles on small grids, and the fewest rounds in which they may follow, by exhaustive search."""

from itertools import product
from random import Random

import numpy as np

from cubepath.coordinator.theory.following.optimum import VehicleClauses, VehicleTask
from cubepath.coordinator.theory.following.timetable import RULES, Rule
from cubepath.protocol.core.sites import Site
from oracles.vehicle_rounds import Cell, first_wrong

FAR = 9


def draw_task(seed: int) -> VehicleTask:
    """Draw a few vehicles on a small grid with obstacles."""
    random = Random(seed)  # noqa: S311 - to be repeated
    cells = list(product(range(random.randint(2, 3)), range(random.randint(1, 3))))
    free = random.sample(cells, random.randint(max(2, len(cells) - 2), len(cells)))
    free.sort()
    count = random.randint(1, min(4, len(free)))
    starts, ends = random.sample(free, count), random.sample(free, count)
    return task_of(tuple(starts), tuple(ends), free, RULES[seed % 2])


def task_of(
    starts: tuple[Cell, ...], ends: tuple[Cell, ...], free: list[Cell], rule: Rule
) -> VehicleTask:
    edges = [
        ((x, y), there) for x, y in free for there in ((x + 1, y), (x, y + 1)) if there in free
    ]
    return VehicleTask(starts, ends, edges, rule)


def cells_of(edge: tuple[Site, Site]) -> list[Cell]:
    return [(site[0], site[1]) for site in edge if isinstance(site, tuple)]


def exhaustive(task: VehicleTask) -> list[tuple[Cell, ...]] | None:
    """Return where all vehicles are after each round of a shortest timetable, None if too long.

    By breadth-first search over where they are together.
    """
    front = seen = {task.starts: [task.starts]}
    beside: dict[Cell, list[Cell]] = {}
    for x, y in (*task.starts, *(cell for edge in task.edges for cell in cells_of(edge))):
        near = [(x + 1, y), (x - 1, y), (x, y + 1), (x, y - 1)]
        beside[x, y] = [there for there in near if there in task.beside[x, y]]
    for _ in range(FAR):
        if task.ends in front:
            return front[task.ends]
        found: dict[tuple[Cell, ...], list[tuple[Cell, ...]]] = {}
        for at, way in front.items():
            for joint in product(*([cell, *beside[cell]] for cell in at)):
                moves = [
                    (who, here, there)
                    for who, (here, there) in enumerate(zip(at, joint, strict=True))
                    if here != there
                ]
                if joint not in seen and first_wrong(list(at), moves, task.rule) is None:
                    found[joint] = [*way, joint]
        seen = seen | found
        front = found
    return None


def one_by_one(clauses: VehicleClauses) -> list[list[int]]:
    """Return the clauses as lists."""
    found = np.split(clauses.literals, clauses.ends)[:-1]
    return [clause.tolist() for clause in found]
