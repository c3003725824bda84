"""What a proof of optimality takes: clauses, the solver, and its log.

``python tests/bench/bench_prove.py [--quick]``. Each row is a chain of hexagons or a random walk,
and the refutation of one round less than the optimum: seconds to build its clauses, of the solver
alone, their ratio, and sizes. Compiling is not counted.
"""

import argparse
import os
import time
from collections.abc import Iterator
from random import Random
from tempfile import TemporaryFile

from cubepath.coordinator.normal_form.heap import normal_cube_path
from cubepath.coordinator.theory.satisfiability.encoding import encode, prepare
from cubepath.coordinator.theory.satisfiability.met_moves import MetMoves
from cubepath.coordinator.theory.satisfiability.proving import Prover
from cubepath.coordinator.theory.satisfiability.solver_process import SolverProcess
from cubepath.coordinator.theory.search.transitions import Transitions
from cubepath.protocol.core.actions import Action
from cubepath.protocol.scenes.specs import scene_from_spec

HEXAGONS = {3: 4, 4: 9, 5: 13, 6: 18, 7: 22}
"""The optima of chains of hexagons that bend by 120 degrees, by the number of modules."""
WALKS = (
    ("triangulation:n=20", 200),
    ("polygon:n=16", 100),
    ("agv-labelled:graph=grid6x6,n=6", 400),
    ("hex-open:n=5", 200),
)
SECONDS = 60.0


def report(name: str, met: MetMoves, rounds: int) -> None:
    """Print what it takes to refute so many rounds."""
    begun = time.perf_counter()
    problem = encode(met, rounds)
    built = time.perf_counter() - begun
    with SolverProcess() as solver, TemporaryFile() as log:
        solver.solve(encode(MetMoves(None, (), frozenset("a"), frozenset("a")), 0))  # it starts
        begun = time.perf_counter()
        solver.ask(problem, log=log)
        answer = solver.answer(SECONDS)
        solved = time.perf_counter() - begun
        says = "open" if answer is None else "no path" if not answer.satisfiable else "a path"
        size = os.fstat(log.fileno()).st_size
    counts = len(problem.variables), len(problem.ends), len(problem.literals)
    print(
        f"{name:<26} {rounds:>6}  {built:>7.2f}  {solved:>7.2f}  {built / solved:>6.2f}"
        f"  {counts[0]:>9,}  {counts[1]:>10,}  {counts[2]:>10,}  {size / 1e6:>7.1f}  {says}"
    )


def walked(spec: str, moves: int) -> tuple[MetMoves, tuple[tuple[Action, ...], ...]]:
    """Return the moves between the ends of a random walk, and its normal cube path."""
    where, random = scene_from_spec(spec), Random(1)
    steps = Transitions(where.system)
    state = steps.encode(where.start_state)
    path: list[Action] = []
    for _ in range(moves):
        number = random.choice(steps.possible(state))
        path.append(steps.actions[number])
        state ^= steps.toggle[number]
    goal = steps.decode(state)
    return MetMoves(where.system, (), where.start_state, goal), normal_cube_path(path)


def rows(*, quick: bool) -> Iterator[tuple[str, MetMoves, int]]:
    """Yield what to refute: names, moves and numbers of rounds."""
    for count, best in HEXAGONS.items():
        if not quick or count < 5:
            where = scene_from_spec(f"hex:n={count}")
            goal = frozenset(where.goal or ())
            yield where.spec, MetMoves(where.system, (), where.start_state, goal), best - 1
    for spec, moves in WALKS[: 1 if quick else None]:
        met, path = walked(spec, moves)
        with Prover(met, path, 0) as prover:
            prover.run(SECONDS)
        yield f"{spec}, walk", met, prover.bound - 1


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="small ones alone")
    options = parser.parse_args()
    begun = time.perf_counter()
    prepare()
    print(f"compiled, or loaded, in {time.perf_counter() - begun:.1f} s")
    print(
        f"{'what':<26} {'rounds':>6}  {'build s':>7}  {'solve s':>7}  {'ratio':>6}"
        f"  {'variables':>9}  {'clauses':>10}  {'literals':>10}  {'log MB':>7}"
    )
    for name, met, rounds in rows(quick=options.quick):
        report(name, met, rounds)


if __name__ == "__main__":
    main()
