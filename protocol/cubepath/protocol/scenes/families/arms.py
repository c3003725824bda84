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

from collections.abc import Collection, Iterable, Mapping

from msgspec.structs import replace

from cubepath.protocol.core.actions import Action, State
from cubepath.protocol.core.catalogue import EDGES, Catalogue, Cell, Generator, Lattice, Move
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.sites import Site
from cubepath.protocol.core.system import Scene, System
from cubepath.protocol.scenes.registry import Family, Values, scene_of, whole
from cubepath.protocol.systems.lattice import LatticeSystem
from cubepath.protocol.systems.listed import TabledSystem


def arm_catalogue() -> Catalogue:
    """Return the generators of the positive articulated arm on lattice edges.

    The edge ``(x, y, 0)`` runs right from the vertex (x, y), ``(x, y, 1)`` runs up. `flip` turns a
    corner (as words: xy <-> yx), `rotate` turns the last segment; its support holds, off, the
    edges that would continue the arm from either tip (paper, example articulated planar arm).
    """
    right, up = (0, 0, 0), (0, 0, 1)
    right_then_up, up_then_right = (1, 0, 1), (0, 1, 0)
    flip = Generator(
        name="flip",
        support=(right, right_then_up, up, up_then_right),
        trace=(right, right_then_up, up, up_then_right),
        before=(right, right_then_up),
        after=(up, up_then_right),
        # Segments keep their order along the arm: each turns in place.
        motion=((right, up), (right_then_up, up_then_right)),
    )
    rotate = Generator(
        name="rotate",
        support=(right, up, (1, 0, 0), right_then_up, up_then_right, (0, 1, 1)),
        trace=(right, up),
        before=(right,),
        after=(up,),
        motion=((right, up),),
    )
    return Catalogue(EDGES, (flip, rotate))


def _arm(name: str, values: Values) -> Scene:
    """Build a positive arm of n segments that begins straight up and ends as the word `goal`."""
    count = whole(values, "n", least=1)
    word = values["goal"] or "x" * count
    if len(word) != count or set(word) - {"x", "y"}:
        raise InputError(f"goal={word}: expected {count} letters x and y")
    goal = arm_sites(word)
    return scene_of(name, LatticeSystem(arm_catalogue()), arm_sites("y" * count), goal, own=True)


def arm_sites(word: str) -> tuple[Site, ...]:
    """Return the lattice edges of the positive arm that spells `word` from the origin."""
    x = y = 0
    found: list[Site] = []
    for letter in word:
        found.append((x, y, 0 if letter == "x" else 1))
        x, y = (x + 1, y) if letter == "x" else (x, y + 1)
    return tuple(found)


def _is_positive_arm(system: System, start: State) -> bool:
    """Return whether the state is an arm that goes right and up, under the arm's own catalogue.

    Its complex is contractible for every length (paper, proposition on the positive arm).
    """
    if system.catalogue != arm_catalogue() or not system.open:
        return False
    edges = sorted(map(EDGES.check, start), key=lambda edge: edge[0] + edge[1])
    tips = [(x + 1 - axis, y + axis) for x, y, axis in edges]
    return all((edge[0], edge[1]) == tip for edge, tip in zip(edges[1:], tips, strict=False))


_POSITIVE = (
    Family(
        "arm",
        "positive articulated arm on lattice edges",
        {
            "n": ("5", "number of segments"),
            "goal": ("", "word of the goal, from the base; all x when left out"),
        },
        _arm,
        LatticeSystem,
        "word",
        _is_positive_arm,
    ),
)


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
    system = LatticeSystem(free_arm_catalogue(), filled=[BASE])
    return scene_of(name, system, start, goal, own=True)


_FREE = (
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
    *_POSITIVE,
    *_FREE,
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
