"""Several arms that attach to one another, slide the point where they join, and detach.

Source: Abrams and Ghrist, example 2-d articulated planar arm, where an attach-detach generator
"allows endpoints of arms to merge (thus yielding a marked point at the attachment)" and a sliding
generator moves this point, "having the effect of allowing the attached arms to trade segments". The
text does not contain their figure; the generators below are our reading of it.

The sites are the edges and the vertices of a finite piece of the square lattice. An edge that is on
is a segment of an arm and a module. A vertex is on when it is marked. Marks are not conserved, so
every vertex is an agent that stays in place, with the letter ``free`` or ``marked``. All states
that are reached from the start of a scene have at most two segments at each vertex. Two segments at
a free vertex are a joint of one arm; two at a marked vertex are the ends of two arms that are
joined there. So two ends may not meet at a free vertex: they would look like a joint, and moves
would flip or turn the two arms as if they were one. Therefore:

- `flip` and `rotate` are those of the arm with all rotations (`free_arm`); a flip needs its corner
  free, since the segments at a marked point are of two arms, and a rotation leads to no other end.
- `attach` is the end rotation that leads to the end of another arm and marks the vertex where they
  then meet; read backwards, it detaches. The other arm's last segment goes straight on from there
  or to either side. As in every end rotation, the three other edges at the old tip are off, and
  so are the two others at the vertex.
- `slide` moves the mark along a segment, from one of its ends to the other. Both arms continue past
  the segment, so one gains a segment, the other loses one, and no arm is lost: the edges before
  it and behind it are on, and its far end is free.

Each arm has a base, a fixed edge. It comes from outside, so its end away from the arm is no vertex
of the workspace. An arm may give away all its segments: its base remains, and other arms can attach
to that.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import replace

from cubepath.protocol.core.actions import Action
from cubepath.protocol.core.catalogue import Catalogue, Cell, Generator, Lattice, Move
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.sites import Site
from cubepath.protocol.core.system import Scene
from cubepath.protocol.scenes.families.free_arm import (
    STEPS,
    Vertex,
    edge_between,
    edges_at,
    end_rotations,
    flips,
)
from cubepath.protocol.scenes.family import Family, Values, whole
from cubepath.protocol.systems.listed import TabledSystem

LETTERS = ("free", "marked")
_LATTICE = Lattice("edges and vertices", dimension=2, arity=3, drawing="edges")
"""Edges as in `EDGES`; the vertex (x, y) is (x, y, 2) where it is free and (x, y, 3) marked."""
_MOST = 400
"""The most vertices of a workspace: each is an agent."""


def arms_catalogue() -> Catalogue:
    """Return the generators, on the lattice of edges and of vertices by letter.

    For the sites (x, y, axis) and ((x, y), letter) of the system see `arms_system`.
    """
    return Catalogue(_LATTICE, (*_flips(), *end_rotations(), *_attachments(), *_slides()))


def _letters(vertex: Vertex) -> tuple[Cell, Cell]:
    """Return the two sites of a vertex: free and marked."""
    return (*vertex, 2), (*vertex, 3)


def _flips() -> Iterable[Generator]:
    for flip, corners in zip(flips(), (((1, 0), (0, 1)), ((0, 0), (1, 1))), strict=True):
        free = tuple(_letters(corner)[0] for corner in corners)
        yield replace(
            flip, support=flip.support + free, before=flip.before + free, after=flip.after + free
        )


def _attachments() -> Iterable[Generator]:
    """Yield the end rotations about the origin that lead to the end of another arm."""
    letters = list(STEPS)
    for turn in end_rotations():
        for old, new in (turn.trace, turn.trace[::-1]):
            left, met = _tip(old), _tip(new)
            free, marked = _letters(met)
            beyond = tuple(edge for edge in edges_at(left) if edge != old)
            for letter, other in zip(letters, edges_at(met), strict=True):
                if other == new:
                    continue
                beside = tuple(edge for edge in edges_at(met) if edge not in (new, other))
                ways = "".join(letters[edges_at((0, 0)).index(edge)] for edge in (old, new))
                yield Generator(
                    name=f"attach-{ways}{letter}",
                    support=(old, new, other, free, marked, *beyond, *beside),
                    trace=(old, new, free, marked),
                    before=(old, other, free),
                    after=(new, other, marked),
                    motion=((old, new), (free, marked)),
                )


def _tip(edge: Cell) -> Vertex:
    """Return the other vertex of an edge at the origin."""
    return next(step for step in STEPS.values() if edge_between((0, 0), step) == edge)


def _slides() -> Iterable[Generator]:
    """Yield the slides of a mark from the origin along an edge to the right or up.

    Their names are the words of the three edges in a row.
    """
    opposite = dict(zip("ruld", "ldru", strict=True))
    start: Vertex = (0, 0)
    for middle in "ru":
        end = STEPS[middle]
        for first in STEPS:
            for last in STEPS:
                if opposite[middle] in (first, last):
                    continue
                before = edge_between(start, STEPS[opposite[first]])
                behind = edge_between(end, (end[0] + STEPS[last][0], end[1] + STEPS[last][1]))
                arms = (before, edge_between(start, end), behind)
                (here_free, here), (there_free, there) = _letters(start), _letters(end)
                yield Generator(
                    name=f"slide-{first}{middle}{last}",
                    support=(*arms, here, there_free, here_free, there),
                    trace=(here, there_free, here_free, there),
                    before=(*arms, here, there_free),
                    after=(*arms, here_free, there),
                    motion=((here, here_free), (there_free, there)),
                )


def arms_system(vertices: Collection[Vertex], bases: Iterable[Cell]) -> TabledSystem:
    """Return the system on these vertices, all edges between them, and the fixed bases.

    Sites are ``(x, y, axis)`` for edges and ``((x, y), letter)`` for vertices. Edges outside the
    workspace are off, so supports leave them out.
    """
    fixed = frozenset(bases)
    inside = frozenset(vertices)
    edges = {
        edge
        for vertex in inside
        for edge in edges_at(vertex)
        if inside.issuperset(((edge[0], edge[1]), (edge[0] + 1 - edge[2], edge[1] + edge[2])))
    }
    names: dict[Site, Site] = {edge: edge for edge in edges | fixed}
    for vertex in inside:
        names |= {_letters(vertex)[number]: (vertex, LETTERS[number]) for number in (0, 1)}
    wide, high = ([vertex[axis] for vertex in inside] for axis in (0, 1))
    placed = (
        _placed(generator, (x, y), names, fixed)
        for generator in arms_catalogue().generators
        for x in range(min(wide) - 1, max(wide) + 2)
        for y in range(min(high) - 1, max(high) + 2)
    )
    return TabledSystem(
        [move for move in placed if move is not None],
        letters=LETTERS,
        fixed=fixed,
        drawing=_LATTICE.drawing,
    )


def _placed(
    generator: Generator, at: Vertex, names: Mapping[Site, Site], fixed: frozenset[Cell]
) -> Move | None:
    """Return the generator translated by `at`, or None if it does not fit in the workspace.

    `names` gives the system's site for every cell of the lattice in the workspace.
    """
    action = generator.place(_LATTICE, at)
    needed = action.trace.union(*action.ends)
    if not needed <= names.keys() or action.trace & fixed:
        return None

    def sites(cells: Iterable[Site]) -> list[Site]:
        return [names[cell] for cell in cells if cell in names]

    before, after = map(sites, action.ends)
    renamed = Action(sites(action.support), sites(action.trace), before, after, label=action.label)
    motion = tuple(
        (names[_LATTICE.shift(source, at)], names[_LATTICE.shift(target, at)])
        for source, target in generator.motion
    )
    return Move(renamed, generator.name, at, motion)


def _arms(name: str, values: Values) -> Scene:
    """Build m arms of n segments straight up; the goal gives the first a segment of the second."""
    count = whole(values, "n", least=1)
    arms = whole(values, "m", least=2)
    apart = whole(values, "d", least=2, most=_MOST)
    if apart % 2:
        raise InputError(f"d={apart}: expected an even number, or the arms can never meet")
    high = whole({"h": values["h"] or str(count + 1)}, "h", least=count + 1)
    right = apart * (arms - 1) + 1  # one column more than the bases need, as on the left
    if (right + 2) * (high + 1) > _MOST:
        raise InputError(f"m={arms},d={apart},h={high}: more than {_MOST} vertices")
    vertices = [(x, y) for x in range(-1, right + 1) for y in range(high + 1)]
    system = arms_system(vertices, [(apart * arm, -1, 1) for arm in range(arms)])
    # Every vertex in the support of some move is an agent.
    free: list[Site] = [(vertex, "free") for vertex in vertices if system.has_place(vertex)]
    lengths = [count + 1, count - 1, *[count] * (arms - 2)]
    goal = _upright(lengths, apart)
    start = (*_upright([count] * arms, apart), *free)
    return Scene(
        spec=name,
        family=name,
        system=system,
        start=start,
        goal=frozenset((*goal, *free)),
        goals=(goal,) * len(start),
    )


def _upright(lengths: Iterable[int], apart: int) -> tuple[Site, ...]:
    return tuple((apart * arm, y, 1) for arm, length in enumerate(lengths) for y in range(length))


FAMILIES = (
    Family(
        "arms",
        "arms that attach, trade segments by sliding the point where they are joined, and detach",
        {
            "n": ("2", "number of segments of each arm"),
            "m": ("2", "number of arms"),
            "d": ("2", "how far the bases are apart, an even number"),
            "h": ("", "height of the workspace; n + 1 when left out"),
        },
        _arms,
        TabledSystem,
    ),
)
