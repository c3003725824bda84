"""How long it takes to find proofs of optimality and to check them, and how large they are.

With the extra ``proofs``: ``python tests/bench/bench_proofs.py [--quick]`` prints the table of
docs/proofs.md, with more rows and columns. Each row refutes one round less than the optimum, which
is asked for first and not counted. ``find`` is CaDiCaL alone, handing over the clauses included,
and ``verify`` all that ``cubepath verify`` does with the file: reading it, deriving moves, windows
and clauses again, and following the log. Nothing is asserted but that the proof holds.
"""

import argparse
import os
import time
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory, TemporaryFile
from typing import NamedTuple

from bench_improve import WALK, walks

from cubepath.coordinator.theory.optimality.tasks import proof_of
from cubepath.coordinator.theory.proof_checking.optimality import check_optimality
from cubepath.coordinator.theory.satisfiability.encoding import encode, prepare
from cubepath.coordinator.theory.satisfiability.met_moves import MetMoves
from cubepath.coordinator.theory.satisfiability.proving import SEARCH, Refutation
from cubepath.coordinator.theory.satisfiability.solver_process import SolverProcess
from cubepath.protocol.core.actions import State, apply_in_place
from cubepath.protocol.core.sites import Site
from cubepath.protocol.core.system import Scene
from cubepath.protocol.path_files.optimality_proofs import read_proof, write_proof
from cubepath.protocol.scenes.specs import scene_from_spec

CHAINS = (
    ("hex:n=6", 18),
    ("hex:n=7", 22),
    ("hex:n=8", 28),
    ("hex:n=8,bend=60", 25),
    ("hex:n=9", 32),
)
WALKS = (("hex:n=12", 17), ("hex-open:n=8", 26))
QUICK = (("hex:n=4", 9),)


class Case(NamedTuple):
    """What is to be proved: the fewest rounds from the start of a scene to a goal."""

    name: str
    scene: Scene
    goal: State
    optimum: int


def chains(optima: tuple[tuple[str, int], ...]) -> Iterator[Case]:
    """Yield chains of hexagons, each to its own goal."""
    for spec, optimum in optima:
        scene = scene_from_spec(spec)
        yield Case(f"chain `{spec}`", scene, frozenset(scene.goal or ()), optimum)


def walked(optima: tuple[tuple[str, int], ...]) -> Iterator[Case]:
    """Yield the ends of the random walks of docs/instances.md."""
    for spec, optimum in optima:
        (walk,) = walks((spec,), WALK)
        state: set[Site] = set(walk.task.start)
        for action in walk.task.path:
            apply_in_place(action, state)
        yield Case(f"walk of `{spec}`", scene_from_spec(spec), frozenset(state), optimum)


def row(case: Case, folder: Path) -> str:
    """Return a line of the table; AssertionError unless the proof is one of optimality."""
    system, start, path = case.scene.system, case.scene.start_state, folder / "a.proof"
    met = MetMoves(system, (), start, case.goal)
    problem, best = encode(met, case.optimum - 1), encode(met, case.optimum)
    with SolverProcess() as solver, TemporaryFile() as log:
        schedule = best.schedule(solver.solve(best).true)
        begun = time.perf_counter()
        solver.ask(problem, log=log)
        answer = solver.answer(None)
        found = time.perf_counter() - begun
        assert answer is not None
        assert answer.satisfiable is False
        assert answer.log is not None
        size = os.fstat(log.fileno()).st_size
        refuted = Refutation(problem.rounds, SEARCH, log, problem)
        write_proof(path, proof_of(refuted, schedule, case.scene, system, (start, case.goal)))
    begun = time.perf_counter()
    assert check_optimality(read_proof(path)).optimal
    verified = time.perf_counter() - begun
    return (
        f"| {case.name} | {case.optimum} | {problem.rounds} | {len(problem.variables):,}"
        f" | {len(problem.ends):,} | {size / 1e6:.1f} | {path.stat().st_size / 1e6:.1f}"
        f" | {found:.1f} | {verified:.1f} |"
    )


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="a small chain alone")
    quick = parser.parse_args().quick
    prepare()
    print(
        "| instance | optimum | rounds refuted | variables | clauses | log MB | file MB | find s"
        " | verify s |\n|---|---|---|---|---|---|---|---|---|"
    )
    with TemporaryDirectory() as name:
        folder = Path(name)
        for case in chains(QUICK):
            line = row(case, folder)  # compiles, or loads, what checks
            if quick:
                print(line)
        for case in () if quick else (*chains(CHAINS), *walked(WALKS)):
            print(row(case, folder), flush=True)


if __name__ == "__main__":
    main()
