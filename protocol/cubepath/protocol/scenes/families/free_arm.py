"""The articulated arm with all rotations of its generators, from a fixed base.

Source: Abrams and Ghrist, example 2-d articulated planar arm: "If one includes rotations of these
generators, more intricate types of configurations are possible, including deadlocked
configurations."
"""

from __future__ import annotations

from cubepath.protocol.core.catalogue import EDGES, Catalogue, Cell, Generator
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.system import Scene
from cubepath.protocol.scenes.family import Family, Values, whole
from cubepath.protocol.systems.lattice import LatticeSystem

Vertex = tuple[int, int]
STEPS: dict[str, Vertex] = {"r": (1, 0), "u": (0, 1), "l": (-1, 0), "d": (0, -1)}
"""The letters of an arm's word: right, up, left, down; counter-clockwise."""
BASE: Cell = (0, -1, 1)
"""The edge from below to the origin, an obstacle that is on; the arm is fixed to it."""
DEADLOCK = "urrddlu"
"""The shortest arm that cannot move; with its mirror image, the only one of seven segments.

Every corner would flip onto the arm itself, and the last segment would turn onto the arm or the
base. A move is its own inverse, so a deadlocked state cannot be reached either: it is a state of
the system like others with as many segments, but a component of the state complex by itself.
"""


def edge_between(one: Vertex, other: Vertex) -> Cell:
    """Return the lattice edge between two neighbouring vertices."""
    x, y = min(one, other)
    return (x, y, 0 if one[1] == other[1] else 1)


def edges_at(vertex: Vertex) -> tuple[Cell, ...]:
    """Return the four lattice edges at a vertex, counter-clockwise from the right."""
    x, y = vertex
    return tuple(edge_between(vertex, (x + dx, y + dy)) for dx, dy in STEPS.values())


def flips() -> tuple[Generator, ...]:
    """Return the flips of a corner, in all four orientations: two unordered pairs.

    The trace is the four edges of the unit square at the origin, of which two that meet in a corner
    are on. The support also holds, off, the other two edges at that corner and at the opposite one,
    where the corner goes, so the arm never touches itself. With only the trace as support it could,
    and then the next flip there could cut a ring off it.
    """
    square = tuple(edge_between(*pair) for pair in (((0, 0), (1, 0)), ((1, 0), (1, 1))))
    square += tuple(edge_between(*pair) for pair in (((0, 1), (1, 1)), ((0, 0), (0, 1))))
    found: list[Generator] = []
    for name, corner, opposite in (("rising", (1, 0), (0, 1)), ("falling", (0, 0), (1, 1))):
        before = tuple(edge for edge in square if edge in edges_at(corner))
        after = tuple(edge for edge in square if edge in edges_at(opposite))
        around = [edge for end in (corner, opposite) for edge in edges_at(end)]
        # Segments keep their order along the arm, so each keeps its end away from the corner.
        motion = tuple(
            (edge, next(other for other in after if set(_ends(edge)) & set(_ends(other))))
            for edge in before
        )
        found.append(
            Generator(
                name=f"flip-{name}",
                support=(*square, *(edge for edge in around if edge not in square)),
                trace=square,
                before=before,
                after=after,
                motion=motion,
            )
        )
    return tuple(found)


def end_rotations() -> tuple[Generator, ...]:
    """Return the four quarter turns of the last segment about the origin.

    They are the rotations of the paper's generator, so a half turn is two of them. The support also
    holds, off, the three edges that would continue the arm from each of the two tips: the segment
    is the last one, and its new tip meets no edge.
    """
    found: list[Generator] = []
    letters = list(STEPS)
    for one, other in zip(letters, (*letters[1:], letters[0]), strict=True):
        tips = STEPS[one], STEPS[other]
        trace = edge_between((0, 0), tips[0]), edge_between((0, 0), tips[1])
        beyond = tuple(edge for tip in tips for edge in edges_at(tip) if edge not in trace)
        found.append(
            Generator(
                name=f"rotate-{one}{other}",
                support=(*trace, *beyond),
                trace=trace,
                before=trace[:1],
                after=trace[1:],
                motion=(trace,),
            )
        )
    return tuple(found)


def _ends(edge: Cell) -> tuple[Vertex, Vertex]:
    x, y, axis = edge
    return (x, y), (x + (axis == 0), y + (axis == 1))


def free_arm_catalogue() -> Catalogue:
    """Return the generators of the arm with all rotations, on lattice edges.

    Every state that is reached from an arm at the base `BASE` is again an arm, a path that meets no
    vertex twice: a flip replaces a vertex of the path by one that is on no edge, and an end
    rotation replaces the last vertex so. The base is fixed because it is an obstacle, so in no
    trace, and because it continues the arm: the first segment is no free end.
    """
    return Catalogue(EDGES, (*flips(), *end_rotations()))


def arm_of(word: str) -> tuple[Cell, ...]:
    """Return the edges of the arm that spells `word` in letters r, u, l, d from the origin.

    Raises InputError if it is no arm: another letter, or a vertex of the arm or its base met twice.
    """
    at: Vertex = (0, 0)
    met, found = [at, _ends(BASE)[0]], list[Cell]()
    for letter in word:
        if letter not in STEPS:
            raise InputError(f"arm {word!r}: expected letters r, u, l and d, found {letter!r}")
        step = STEPS[letter]
        there = (at[0] + step[0], at[1] + step[1])
        if there in met:
            raise InputError(f"arm {word!r}: it meets the vertex {list(there)} twice")
        met.append(there)
        found.append(edge_between(at, there))
        at = there
    return tuple(found)


def _free_arm(name: str, values: Values) -> Scene:
    """Build an arm that spells `start` (or is deadlocked) and whose goal spells `goal`."""
    word = DEADLOCK if values["start"] == "deadlock" else values["start"]
    count = whole({"n": values["n"] or str(len(word) or 6)}, "n", least=1)
    start = arm_of(word or "u" * count)
    if len(start) != count:
        raise InputError(f"start={word}: expected n={count} letters")
    goal = arm_of(values["goal"] or "r" * count)
    if len(goal) != count:
        raise InputError(f"goal={values['goal']}: expected {count} letters, as the start has")
    return Scene(
        spec=name,
        family=name,
        system=LatticeSystem(free_arm_catalogue(), filled=[BASE]),
        start=start,
        goal=frozenset(goal),
        goals=tuple((site,) for site in goal),
    )


FAMILIES = (
    Family(
        "arm-free",
        "articulated arm on lattice edges that turns every way, from a fixed base",
        {
            "n": ("", "number of segments; 6, or those of the start, when left out"),
            "start": ("", "word in r, u, l, d from the base, or deadlock; straight up if left out"),
            "goal": ("", "word of the goal; straight to the right when left out"),
        },
        _free_arm,
        LatticeSystem,
    ),
)
