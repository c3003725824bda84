"""Clauses put to a solver in this process, and the exhaustive search that they must agree with.

A pair of states comes from random walks. What is asked about it is whether a path of so many rounds
exists: by clauses, and by breadth-first search, which know nothing of each other.
"""

from collections.abc import Iterator, Sequence
from random import Random
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from pysat.solvers import Solver

from cubepath.coordinator.normal_form.definitions import end_state, is_cube
from cubepath.coordinator.theory.satisfiability.encoding import Encoding, encode
from cubepath.coordinator.theory.satisfiability.met_moves import MetMoves
from cubepath.coordinator.theory.search.exact import optimum
from cubepath.coordinator.theory.search.transitions import Transitions
from cubepath.protocol.core.actions import Action
from cubepath.protocol.core.sites import Site
from cubepath.protocol.core.system import Scene, System

State = frozenset[Site]


class Pair(NamedTuple):
    """Two states, and the moves between them: those of a system, or those that are listed."""

    system: System | None
    listed: tuple[Action, ...]
    start: State
    goal: State

    def moves(self) -> Transitions:
        """Return the graph that the exhaustive search walks on."""
        return Transitions(self.system, self.listed)

    def met(self) -> MetMoves:
        """Return what the clauses are built from."""
        return MetMoves(self.system, self.listed, self.start, self.goal)

    def optimum(self, max_states: int = 4_000) -> int | None:
        """Return the least number of rounds, by exhaustive search; None if there are too many."""
        steps = self.moves()
        ends = steps.encode(self.start), steps.encode(self.goal)
        found = optimum(steps, *ends, max_states=max_states)
        return None if found.cubes is None else len(found.cubes)


def pairs_of(where: Scene, count: int, *, seed: int, rounds: int = 9) -> Iterator[Pair]:
    """Yield so many pairs of states of a scene."""
    yield from pairs_near(where.start_state, where.system, count, seed=seed, rounds=rounds)


def pairs_near(
    state: State, moves: System | Sequence[Action], count: int, *, seed: int, rounds: int = 9
) -> Iterator[Pair]:
    """Yield so many pairs: states on random walks from this one, and on walks from there."""
    random = Random(seed)  # noqa: S311 - nothing secret
    system, listed = (moves, ()) if isinstance(moves, System) else (None, tuple(moves))
    steps = Transitions(system, listed)
    home = steps.encode(state)
    for _ in range(count):
        start = _wander(steps, home, random.randrange(12), random)
        goal = _wander(steps, start, random.randrange(rounds + 1), random)
        yield Pair(system, listed, steps.decode(start), steps.decode(goal))


def _wander(steps: Transitions, state: int, rounds: int, random: Random) -> int:
    """Make so many rounds of commuting moves, of which none takes back one of the round before."""
    last: set[int] = set()
    for _ in range(rounds):
        options = [number for number in steps.possible(state) if number not in last]
        random.shuffle(options)
        last = {number for number in steps.greedy(options) if random.random() < 0.7}
        for number in last:
            state ^= steps.toggle[number]
    return state


def model(problem: Encoding) -> NDArray[np.bool_] | None:
    """Return the truth of each variable in a model of the clauses, None if there is none."""
    with Solver(name="glucose4") as solver:
        begin = 0
        literals = problem.literals.tolist()
        for end in problem.ends.tolist():
            solver.add_clause(literals[begin:end])
            begin = end
        if not solver.solve():
            return None
        true = np.zeros(len(problem.variables) + 1, dtype=np.bool_)
        found = np.array(solver.get_model(), dtype=np.int64)
        true[found[(found > 0) & (found < len(true))]] = True
        return true[1:]


def check_pair(pair: Pair, *, max_states: int = 4_000, met: MetMoves | None = None) -> int | None:
    """Check that clauses and search agree at the optimum and one below; return the optimum.

    None if there are too many states for the search. `met` is what to build the clauses from.
    """
    best = pair.optimum(max_states)
    if best is None:
        return None
    met = pair.met() if met is None else met
    problem = encode(met, best)
    true = model(problem)
    assert true is not None, f"{best} rounds suffice"
    check_schedule(pair, problem, true)
    if best:
        assert model(encode(met, best - 1)) is None, f"{best} rounds are needed"
    return best


def check_schedule(pair: Pair, problem: Encoding, true: NDArray[np.bool_]) -> None:
    """Check that a model is a legal cube path between the ends, by the definitions."""
    cubes = problem.schedule(true)
    assert len(cubes) <= problem.rounds
    assert all(map(is_cube, cubes))
    assert end_state(cubes, pair.start) == pair.goal


def random_actions(random: Random, count: int, sites: int, *, size: int) -> list[Action]:
    """Return actions that create and destroy, hold what they write, read, leave free, guard."""
    found: dict[Action, None] = {}
    while len(found) < count:
        support = random.sample(range(sites), random.randint(1, size))
        trace = support[: random.randint(1, min(3, len(support)))]
        reads = support[len(trace) :]
        toggled = trace[: random.randint(1, len(trace))]
        free = [site for site in reads if random.random() < 0.4]
        before = {site for site in support if random.random() < 0.5} - {*free}
        guards = [
            (one, other)
            for one in reads
            for other in reads
            if one != other and random.random() < 0.2
        ]
        after = before ^ {*toggled}
        found[Action(support, trace, before, after, free=free, guards=guards)] = None
    return list(found)
