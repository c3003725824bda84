"""Claims of the paper as rows of `cubepath paper`: those of its definition and its examples.

A claim is a function without arguments that does the computation; a row has its text and its
result. The others are in `topology`, `curvature` and `geodesics_and_time`; `claims` lists all of
them, in the order of the paper.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from itertools import combinations
from typing import Any

import msgspec

from cubepath.coordinator.theory.complexes.exploration import Exploration, explore
from cubepath.coordinator.theory.complexes.links import actions_at
from cubepath.coordinator.theory.complexes.state_complexes import f_vector
from cubepath.protocol.core.actions import Action, State, admissible, apply, commute
from cubepath.protocol.core.catalogue import HEXAGONS, SQUARES, Catalogue
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.sites import Site
from cubepath.protocol.core.system import Scene
from cubepath.protocol.scenes.specs import scene_from_spec
from cubepath.protocol.systems.lattice import LatticeSystem

Outcome = tuple[str, bool | None]
"""The computed result in words, and whether it agrees; None if the paper leaves it open."""


@dataclass(frozen=True, slots=True)
class PaperClaim:
    """One claim of the paper, and how to compute it.

    `expected` is the known result: True for most claims, False if the printed text falls short,
    None if it could not be reproduced. Any other result is a bug in this program.
    """

    item: str
    claim: str
    compute: Callable[[], Outcome]
    expected: bool | None = True


@dataclass(frozen=True, slots=True)
class ClaimResult:
    """One claim with its computed result, and how long the computation took."""

    item: str
    claim: str
    computed: str
    agrees: bool | None
    as_expected: bool
    seconds: float

    def document(self) -> dict[str, Any]:
        """Return the row as JSON."""
        return {
            "item": self.item,
            "claim": self.claim,
            "computed": self.computed,
            "agrees": self.agrees,
            "seconds": round(self.seconds, 3),
        }


def claim(
    claims: list[PaperClaim], item: str, text: str, *, expected: bool | None = True
) -> Callable[[Callable[[], Outcome]], Callable[[], Outcome]]:
    """Add the decorated function to a list of claims."""

    def add(compute: Callable[[], Outcome]) -> Callable[[], Outcome]:
        claims.append(PaperClaim(item, text, compute, expected))
        return compute

    return add


CLAIMS: list[PaperClaim] = []

SYSTEMS = (
    "hex:n=3,base=1",
    "hex-open:n=2",
    "hex-tunnel:n=4",
    "sliding:p=2,q=2",
    "arm:n=5",
    "arm-free:n=4",
    "arms",
    "agv:graph=K5,n=2",
    "agv-labelled:graph=K5,n=2",
    "polygon:n=7",
    "triangulation:n=7",
    "words",
    "assembly",
)
"""A small scene of every local system in the plane; those in space go on without end."""


@cache
def small_systems() -> dict[str, Exploration]:
    """Return a small scene of every local system, explored."""
    return {spec: explore(scene_from_spec(spec)) for spec in SYSTEMS}


@claim(
    CLAIMS,
    "2, definition of an action",
    "an action is undone by itself: what it made of a state it makes into that state again",
)
def _undone() -> Outcome:
    moves = 0
    for explored in small_systems().values():
        for number in range(len(explored.states)):
            state = explored.state(number)
            for action in actions_at(explored.scene, state):
                after = apply(action, state)
                if not admissible(action, after) or apply(action, after) != state:
                    return f"{action.label} of {explored.scene.spec} is not undone", False
                moves += 1
    return f"{moves} moves of {len(SYSTEMS)} systems, each undone by itself", True


def _topology(cells: frozenset[Site]) -> int:
    """Return the numbers of pieces of a set of hexagons and of its outside, as one number."""
    pieces = HEXAGONS.pieces(cells)
    qs = [cell[0] for cell in cells if isinstance(cell, tuple)]
    rs = [cell[1] for cell in cells if isinstance(cell, tuple)]
    outside = frozenset(
        (q, r)
        for q in range(min(qs) - 1, max(qs) + 2)
        for r in range(min(rs) - 1, max(rs) + 2)
        if (q, r) not in cells
    )
    return 1000 * pieces + HEXAGONS.pieces(outside)


@claim(
    CLAIMS,
    "3, 2-d hex with pivots",
    "the first catalogue changes the aggregate's shape but not its topology; the second may",
)
def _topology_of_aggregates() -> Outcome:
    keeping = explore(scene_from_spec("hex:n=5,base=1"))
    kept = {_topology(keeping.state(number)) for number in range(len(keeping.states))}
    changing = explore(scene_from_spec("hex-open:n=7"), max_states=3_000)
    seen = len(changing.states)
    changed = {_topology(changing.state(number)) for number in range(seen)}
    return (
        (
            f"catalogue 1: {len(kept)} topological type in all {len(keeping.states)} states of five"
            f" modules at a base; catalogue 2: {len(changed)} in the first {seen} of seven modules"
        ),
        len(kept) == 1 and len(changed) > 1,
    )


@claim(
    CLAIMS,
    "3, 2-d square lattice",
    "the condition of dot and arrow keeps the aggregate from disconnecting under slides",
)
def _slides_keep_connected() -> Outcome:
    states = broken = 0
    for spec in ("sliding:p=2,q=2,n=2", "sliding:p=2,q=1,n=4", "sliding:p=1,q=1,n=5"):
        scene = scene_from_spec(spec)
        explored = explore(scene)
        for number in range(len(explored.states)):
            if SQUARES.pieces(explored.state(number)) != 1:
                return f"{spec}: state {number} is in pieces", False
        states += len(explored.states)
        free = explore(_unguarded(scene), max_states=500)
        broken += any(SQUARES.pieces(free.state(number)) != 1 for number in range(len(free.states)))
    return (
        (
            f"{states} states of three scenes, all connected; without the condition"
            f" {broken} of the scenes come apart"
        ),
        broken == 3,
    )


def _unguarded(scene: Scene) -> Scene:
    """Return sliding squares without the condition of dot and arrow."""
    catalogue = scene.system.catalogue
    if catalogue is None:
        raise InputError(f"{scene.spec}: no lattice")
    generators = tuple(
        msgspec.structs.replace(
            generator,
            support=tuple(cell for cell in generator.support if cell not in generator.free),
            free=(),
            guards=(),
        )
        for generator in catalogue.generators
    )
    free = LatticeSystem(
        Catalogue(catalogue.lattice, generators),
        workspace=[(x, y) for x in range(-4, 8) for y in range(-4, 8)],
        filled=scene.system.filled,
    )
    return replace(scene, system=free, goal=None, goals=())


@claim(
    CLAIMS,
    "3, articulated arm",
    "including rotations of the generators gives deadlocked configurations",
)
def _deadlock() -> Outcome:
    scene = scene_from_spec("arm-free:start=deadlock")
    found = actions_at(scene, scene.start_state)
    return (f"an arm of {len(scene.start)} segments from which {len(found)} moves lead", not found)


def _square_of(state: State, one: Action, other: Action) -> bool:
    """Return whether both orders of the two actions lead from the state to the same state."""
    first, second = apply(one, state), apply(other, state)
    if not (admissible(other, first) and admissible(one, second)):
        return False
    return apply(other, first) == apply(one, second)


@claim(
    CLAIMS,
    "4, commuting pairs [left]",
    "two pivots of hexagons far enough apart commute, and form a square",
)
def _commuting_pair() -> Outcome:
    scene = scene_from_spec("hex:n=5")
    actions = actions_at(scene, scene.start_state)
    pairs = [(one, other) for one, other in combinations(actions, 2) if commute(one, other)]
    squares = sum(_square_of(scene.start_state, one, other) for one, other in pairs)
    return (
        (
            f"a chain of five has {len(actions)} moves; {len(pairs)} pairs commute and form"
            f" {squares} squares"
        ),
        bool(pairs) and squares == len(pairs),
    )


@claim(
    CLAIMS,
    "4, commuting pairs [right]",
    "two slides may form a square of the transition graph and not commute: their traces meet",
)
def _square_without_commuting() -> Outcome:
    found = 0
    scenes = ("sliding:p=2,q=1,n=4", "sliding:p=2,q=2,n=4")
    for spec in scenes:
        explored = explore(scene_from_spec(spec))
        for number in range(len(explored.states)):
            state = explored.state(number)
            for one, other in combinations(actions_at(explored.scene, state), 2):
                found += (
                    not commute(one, other)
                    and bool(one.trace & other.trace)
                    and _square_of(state, one, other)
                )
    return f"{found} such pairs of moves at the states of {len(scenes)} scenes", found > 0


@claim(
    CLAIMS,
    "4, lemma on the skeleta",
    "vertices are the states; edges are those of the transition graph",
)
def _skeleta() -> Outcome:
    states = edges = 0
    for spec, explored in small_systems().items():
        scene = explored.scene
        seen = {scene.start_state}
        stack = [scene.start_state]
        pairs = set()
        while stack:
            state = stack.pop()
            for action in actions_at(scene, state):
                after = apply(action, state)
                pairs.add((frozenset({state, after}), action))
                if after not in seen:
                    seen.add(after)
                    stack.append(after)
        counted = f_vector(explored)
        if counted[:2] != (len(seen), len(pairs)):
            return f"{spec}: {counted[:2]}, the graph has {len(seen)}, {len(pairs)}", False
        states, edges = states + len(seen), edges + len(pairs)
    return f"{states} states and {edges} edges of {len(SYSTEMS)} systems, found both ways", True
