"""The values of the standard instances, computed again; `python tests/standards.py` writes them.

Run as a program, it computes what is asked for by name, or all, and writes the table and the
schedules: the exact optimum where an exhaustive search ends, else the best that the schedule on
file, a run of the family's rule, so many seconds of search (`--seconds`) and, where that leaves a
gap, so many more of SAT solvers (`--prove`, which takes the extra `proofs`) have shown. A value
that is proved does not depend on the time that it took; one that is not can be better with more.
"""

import argparse
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from itertools import product

import numpy as np
import tomli_w

from cubepath.agents.environments.rollouts import play_in_python
from cubepath.agents.rules.registry import rule_named
from cubepath.coordinator.experiments.instances import FOLDER, StandardInstance, standard
from cubepath.coordinator.shortening.path_steps import read_steps
from cubepath.coordinator.theory.complexes.exploration import explore
from cubepath.coordinator.theory.complexes.state_complexes import state_complex
from cubepath.coordinator.theory.optimality.optimality_report import beyond
from cubepath.coordinator.theory.optimality.tasks import PathTask
from cubepath.coordinator.theory.search.anytime import improve
from cubepath.coordinator.theory.search.exact import optimum
from cubepath.coordinator.theory.search.lower_bounds import lower_bound
from cubepath.coordinator.theory.search.transitions import Transitions
from cubepath.protocol.core.actions import Action, State
from cubepath.protocol.core.catalogue import GeneratorPlacement
from cubepath.protocol.core.input_files import opened
from cubepath.protocol.core.sites import to_json
from cubepath.protocol.core.system import Bound, Scene
from cubepath.protocol.path_files.moves import write_cubes
from cubepath.protocol.scenes.registry import all_families
from cubepath.protocol.scenes.specs import scene_from_spec

SEARCHED = 250_000
"""The states that an exhaustive search may look at."""
EXHAUSTIVE = "exhaustive search"
Cubes = Sequence[Sequence[Action]]


def goal_of(scene: Scene) -> State:
    """Return the state at the goal, with the occupied obstacles."""
    assert scene.goal is not None
    return scene.goal | scene.system.filled


def cubes_on_file(instance: StandardInstance) -> Cubes:
    """Return the cubes of the schedule, each found to commute and to be admissible."""
    with opened(instance.schedule) as file:
        return read_steps(file, instance.system).steps


def searched(scene: Scene) -> tuple[int, Cubes | None]:
    """Return what an exhaustive search proves, and a shortest schedule if it ends."""
    steps = Transitions(scene.system)
    start, goal = steps.encode(scene.start_state), steps.encode(goal_of(scene))
    found = optimum(steps, start, goal, max_states=SEARCHED)
    if found.cubes is None:
        return found.at_least, None
    return found.at_least, [[steps.actions[each] for each in cube] for cube in found.cubes]


def bound_of(scene: Scene, best: int) -> Bound:
    """Return the best bound, and how it is known; there is no search where it is met already."""
    proved = lower_bound(scene.system, scene.start_state, goal_of(scene), within=best)
    at_least = proved.cubes if proved.cubes == best else searched(scene)[0]
    if at_least > proved.cubes:
        return Bound(at_least, f"{EXHAUSTIVE} of {SEARCHED} states")
    return proved


def rounds_in_the_complex(scene: Scene, most: int) -> int | None:
    """Return the least number of cubes to the goal by the state complex; None if that is too large.

    A cube path takes whole cubes from corner to opposite corner, so it is a way of as few steps in
    the graph that joins the opposite corners of all cubes.
    """
    explored = explore(scene, max_states=most)
    if not explored.complete:
        return None
    faces = state_complex(explored).complex.faces
    pairs = []
    for size in range(1, len(faces)):
        for ends in product((0, 1), repeat=size - 1):
            corners = []
            for flip in (0, 1):
                at = np.arange(len(faces[size]))
                for direction, end in zip(range(size, 0, -1), (0, *ends), strict=True):
                    at = faces[direction][at, direction - 1, end ^ flip]
                corners.append(at)
            pairs.append(np.stack(corners, axis=1))
    both = np.concatenate(pairs)
    goal = goal_of(scene)
    (target,) = [n for n in range(len(explored.states)) if explored.state(n) == goal]
    reached = np.arange(len(explored.states)) == 0
    assert explored.state(0) == scene.start_state
    rounds = 0
    while not reached[target]:
        here = reached[both]
        reached[both[here.any(axis=1)].ravel()] = True
        rounds += 1
    return rounds


def named(scene: Scene, cubes: Cubes) -> Iterator[list[GeneratorPlacement]]:
    """Yield the cubes with the names of their moves, in a fixed order."""
    for cube in cubes:
        moves = [scene.system.moves_of(action)[0] for action in cube]
        names = [GeneratorPlacement(move.generator, to_json(move.at)) for move in moves]
        yield sorted(names, key=repr)


def proved(scene: Scene, cubes: Cubes, seconds: float) -> tuple[Cubes, Bound]:
    """Return the best schedule and the bound that SAT solvers find from a schedule on."""
    task = PathTask([action for cube in cubes for action in cube], scene.start_state, scene.system)
    found = beyond(task, prove=seconds)
    return found.cube_path, Bound(found.lower_bound, found.why)


def computed(
    instance: StandardInstance, seconds: float, prove: float
) -> tuple[StandardInstance, Cubes]:
    """Return the instance with its values, and a schedule that attains the best."""
    scene = scene_from_spec(instance.system)
    at_least, cubes = searched(scene)
    how = EXHAUSTIVE
    if cubes is None:
        rule = rule_named(all_families()[scene.family].rule, scene.system)
        run = play_in_python(scene, rule, seed=0, hesitate=0.0, max_rounds=3000)
        paths = [cubes_on_file(instance)] if instance.schedule.exists() else []
        if run.reached:
            paths.append([[move.action for move in each.moves.values()] for each in run.rounds])
        path = min(paths, key=len)
        bound = bound_of(scene, len(path))
        actions: Iterable[Action] = [action for cube in path for action in cube]
        better = improve(
            actions, scene.start_state, scene.system, seconds=seconds, enough=bound.cubes
        )
        cubes, searches = better.cube_path, "improve"
        if prove and bound.cubes < len(cubes):
            cubes, other = proved(scene, cubes, prove)
            bound = max(bound, other, key=lambda each: each.cubes)
            searches += " and improve --prove"
        at_least = bound.cubes
        how = f"rule {rule.name}, then {searches}; bound: {bound.why}"
    moves = sum(map(len, cubes))
    found = replace(instance, best=len(cubes), moves=moves, bound=at_least, how=how)
    return found, cubes


def write(instances: Iterable[StandardInstance]) -> None:
    """Write the table."""
    rows = [
        {
            "name": each.name,
            "system": each.system.removeprefix(f"{FOLDER}/"),
            "best": each.best,
            "moves": each.moves,
            "bound": each.bound,
            "how": each.how,
        }
        for each in instances
    ]
    head = "# Written by tests/standards.py; docs/instances.md says what stands here.\n\n"
    (FOLDER / "standard.toml").write_text(head + tomli_w.dumps({"instance": rows}))


def main() -> None:
    """Compute and write what is asked for."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("names", nargs="*", metavar="NAME")
    parser.add_argument("--seconds", type=float, default=10, help="of search, each (default 10)")
    parser.add_argument("--prove", type=float, default=60, help="seconds of proving (default 60)")
    asked = parser.parse_args()
    known = list(standard())
    for place, instance in enumerate(known):
        if asked.names and instance.name not in asked.names:
            continue
        found, cubes = computed(instance, asked.seconds, asked.prove)
        known[place] = found
        write_cubes(instance.schedule, named(scene_from_spec(instance.system), cubes))
        write(known)
        print(f"{found.name}: {found.best} cubes, at least {found.bound}: {found.how}")


if __name__ == "__main__":
    main()
