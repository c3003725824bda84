"""What paths of one scene are made of: its sites, the moves between them, and how all this looks.

It draws by `agents.rendering`; `page_document` has the document's fields.

Which move each move of a path waited for: the heap of pieces of the path as it stands.

Nothing is cancelled here. Each move falls onto the moves before it until one that it does not
commute with; so its *depth* is one more than the greatest depth of those, and the one that it
*waits for* is the last of the greatest depth among them. From the last move of the greatest depth
these lead down to depth 1, which is the longest chain of moves that had to follow each other. In a
normal cube path the depth of a move is the number of its cube.

Source: heaps of pieces (Viennot).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cubepath.agents.rendering.backdrop import Backdrop, DrawnShapes, colour_text, still
from cubepath.agents.rendering.pen import palette
from cubepath.protocol.core.actions import Action, end_at, why_inadmissible
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.sites import Site, in_order, site_text
from cubepath.protocol.core.system import Scene


class Waits(NamedTuple):
    """The heap of a path, in the order of its moves.

    `depths` counts from 1, int32, shape (moves,). `below` has the place, from 0, of the move that
    each waits for, or -1, int32, shape (moves,). `chain` has the places of the moves of the longest
    chain in their order, int32, shape (greatest depth,).
    """

    depths: NDArray[np.int32]
    below: NDArray[np.int32]
    chain: NDArray[np.int32]


def waits_of(path: Iterable[Action]) -> Waits:
    """Return the heap of a path; each move at the cost of its support.

    >>> left, right = Action([1, 2], [1, 2], [1], [2]), Action([2, 3], [2, 3], [2], [3])
    >>> far = Action([8, 9], [8, 9], [8], [9])
    >>> found = waits_of([left, far, right])
    >>> found.depths.tolist(), found.below.tolist(), found.chain.tolist()
    ([1, 1, 2], [-1, -1, 0], [0, 2])
    """
    nobody = (0, -1)
    # For each site the greatest depth, and the last move of it, among those that write the site,
    # and among those that touch it at all: a move that only reads it waits for the former alone.
    written: dict[Site, tuple[int, int]] = {}
    touched: dict[Site, tuple[int, int]] = {}
    depths: list[int] = []
    below: list[int] = []
    deepest = nobody
    for place, action in enumerate(path):
        under = nobody
        for site in action.trace:
            under = max(under, touched.get(site, nobody))
        for site in action.reads:
            under = max(under, written.get(site, nobody))
        own = under[0] + 1, place
        depths.append(own[0])
        below.append(under[1])
        deepest = max(deepest, own)
        for site in action.trace:
            written[site] = touched[site] = own
        for site in action.reads:
            touched[site] = max(own, touched.get(site, nobody))
    chain: list[int] = []
    place = deepest[1]
    while place >= 0:
        chain.append(place)
        place = below[place]
    return Waits(
        np.array(depths, np.int32), np.array(below, np.int32), np.array(chain[::-1], np.int32)
    )


Motion = tuple[int, int]
_SHAPES = ("none", "cell", "bar", "box", "dot")


class NumberedWorld:
    """The sites and moves that paths of a scene have met so far, by number.

    A *row* is an action in one direction: its name and place, and the sites between which modules
    go, the mover first.
    """

    def __init__(self, scene: Scene) -> None:
        """Begin with the sites where the modules start."""
        self.scene = scene
        self._sites: dict[Site, int] = {}
        self._rows: dict[tuple[Action, int], int] = {}
        self._names: dict[str, int] = {}
        self._named: list[int] = []
        self._at: list[str] = []
        self._motions: list[list[Motion]] = []
        self._actions: list[Action] = []
        self._start = [self.site(site) for site in scene.start]

    @property
    def counts(self) -> tuple[int, int]:
        """Return how many sites and rows there are."""
        return len(self._sites), len(self._motions)

    def site(self, site: Site) -> int:
        """Return the number of a site."""
        return self._sites.setdefault(site, len(self._sites))

    def row(self, action: Action, end: int) -> int:
        """Return the number of an action that leads away from its local state `end`."""
        found = self._rows.get((action, end))
        if found is None:
            found = self._rows[action, end] = len(self._motions)
            name, at, motion = self._move(action, end)
            self._named.append(self._names.setdefault(name, len(self._names)))
            self._at.append(at)
            self._motions.append([(self.site(one), self.site(other)) for one, other in motion])
            self._actions.append(action)
        return found

    def _move(self, action: Action, end: int) -> tuple[str, str, Sequence[tuple[Site, Site]]]:
        before = action.ends[end] & action.trace
        for move in self.scene.system.moves_of(action):
            if before == frozenset(source for source, _ in move.motion):
                return move.generator, site_text(move.at), move.motion
        after = action.ends[1 - end] & action.trace
        if len(before) != len(after):
            raise InputError(f"{action!r} makes {len(after)} modules of {len(before)}")
        return action.label, "", list(zip(in_order(before), in_order(after), strict=True))

    def proposed(self, generator: str, at: Site, site: Site) -> int | None:
        """Return the row of a move that a module at a site proposes; None if there is no such."""
        move = self.scene.system.move_named(site, generator, at)
        if move is None:
            return None
        before = {source for source, _ in move.motion}
        return self.row(move.action, 0 if before <= move.action.ends[0] else 1)

    def document(self) -> dict[str, Any]:
        """Return all of this as data."""
        sites = list(self._sites)
        picture = still(self.scene, sites)
        bodies = [picture.body(site) for site in sites]
        moves = [len(motion) for motion in self._motions]
        flat = [ends for motion in self._motions for ends in motion]
        return {
            "spec": self.scene.spec,
            "drawing": self.scene.system.drawing,
            "box": list(picture.box),
            "behind": _layer(picture.behind),
            "before": _layer(picture.before),
            "outline": picture.outline,
            "thick": picture.thick,
            "joints": picture.joints,
            "modules": self._modules(),
            "goal": self._goal(),
            "sites": {
                "name": [site_text(site) for site in sites],
                "shape": np.array([_SHAPES.index(body.shape) for body in bodies]),
                "at": np.array([body.at for body in bodies], np.float64).ravel(),
                "to": np.array([body.to for body in bodies], np.float64).ravel(),
                "colour": ["" if b.colour is None else colour_text(b.colour) for b in bodies],
                "word": [body.word or "" for body in bodies],
            },
            "start": np.array(self._start),
            "rows": {
                "generators": list(self._names),
                "generator": np.array(self._named, np.int64),
                "at": list(self._at),
                "begins": np.cumsum([0, *moves]),
                "source": np.array([source for source, _ in flat], np.int64),
                "target": np.array([target for _, target in flat], np.int64),
                **self._pivots(picture, sites),
            },
        }

    def _modules(self) -> dict[str, Any]:
        system, start = self.scene.system, self.scene.start
        labels = [system.label_of(site) for site in start]
        return {
            "colour": [colour_text(colour) for colour in palette(len(start))],
            "word": [str(n if label is None else label) for n, label in enumerate(labels)],
        }

    def _goal(self) -> NDArray[np.int64] | None:
        """Return the numbers of the sites of the goal; those that nobody ever met count as new."""
        if self.scene.goal is None:
            return None
        return np.array([self._sites.get(site, -1) for site in in_order(self.scene.goal)])

    def _pivots(self, picture: Backdrop, sites: Sequence[Site]) -> dict[str, NDArray[np.float64]]:
        corners: list[tuple[float, float]] = []
        turns: list[float] = []
        for action, motion in zip(self._actions, self._motions, strict=True):
            for source, target in motion:
                pivot = picture.pivot(action, sites[source], sites[target])
                corners.append((0, 0) if pivot is None else pivot.about)
                turns.append(0 if pivot is None else pivot.turn)
        return {
            "corner": np.array(corners, np.float64).reshape(-1),
            "turn": np.array(turns, np.float64),
        }


def _layer(drawn: DrawnShapes) -> dict[str, Any]:
    return {"ops": drawn.ops, "outlines": drawn.outlines}


def path_document(
    world: NumberedWorld,
    number: int,
    steps: Iterable[Sequence[Action]],
    *,
    title: str,
    step_name: str,
) -> dict[str, Any]:
    """Return a path through a world as data; `number` is that of the world in its document.

    InputError if a move is not admissible when its turn comes.
    """
    state = set(world.scene.start_state)
    rows: list[int] = []
    ends: list[int] = []
    path: list[Action] = []
    for place, actions in enumerate(steps, 1):
        for action in actions:
            end = end_at(action, state)
            if end is None:
                raise InputError(f"{step_name} {place}: {why_inadmissible(action, state)}")
            rows.append(world.row(action, end))
            state -= action.ends[end]
            state |= action.ends[1 - end]
            path.append(action)
        ends.append(len(rows))
    waits = waits_of(path)
    return {
        "world": number,
        "title": title,
        "step": step_name,
        "ends": np.array(ends, np.int64),
        "rows": np.array(rows, np.int64),
        "below": waits.below,
        "depth": waits.depths,
        "chain": waits.chain,
    }
