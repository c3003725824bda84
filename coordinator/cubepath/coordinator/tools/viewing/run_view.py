"""A run, or another path, as the data of a page: as it was executed, and its normal cube path.

`page_document` has the fields. Each move falls onto the moves before it until one that
it does not commute with; nothing is cancelled. Its *depth* is one more than the greatest depth of
those, and it *waits for* the last of them with that depth. Source: heaps of pieces (Viennot).
"""

import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from cubepath.agents.rendering.pictures import DrawnShapes, colour_text, still, way_of
from cubepath.agents.rendering.projection import CELL_FACES, FRONT, ROD, box_faces
from cubepath.agents.rendering.solids import middle_of
from cubepath.agents.rendering.style import palette
from cubepath.coordinator.normal_form.array_heap import NormalForm
from cubepath.coordinator.normal_form.compiled_heap import cancellations
from cubepath.coordinator.plugins import plugin
from cubepath.coordinator.runs.states import motion_of
from cubepath.protocol.core.actions import Action, end_at, why_inadmissible
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.sites import Site, in_order, site_text
from cubepath.protocol.core.system import Scene, System
from cubepath.protocol.recordings.recording import Recording
from cubepath.protocol.wire.messages import Report


class Waits(NamedTuple):
    """The heap of a path, in the order of its moves.

    `depths` counts from 1, int32, shape (moves,). `below` has the place, from 0, of the move that
    each waits for, or -1, int32, shape (moves,).
    """

    depths: NDArray[np.int32]
    below: NDArray[np.int32]


def waits_of(path: Iterable[Action]) -> Waits:
    """Return the heap of a path; each move at the cost of its support.

    >>> left, right = Action([1, 2], [1, 2], [1], [2]), Action([2, 3], [2, 3], [2], [3])
    >>> far = Action([8, 9], [8, 9], [8], [9])
    >>> found = waits_of([left, far, right])
    >>> found.depths.tolist(), found.below.tolist()
    ([1, 1, 2], [-1, -1, 0])
    """
    nobody = (0, -1)
    # For each site the greatest depth, and the last move of it, among those that write the site,
    # and among those that touch it at all: a move that only reads it waits for the former alone.
    written: dict[Site, tuple[int, int]] = {}
    touched: dict[Site, tuple[int, int]] = {}
    depths: list[int] = []
    below: list[int] = []
    for place, action in enumerate(path):
        under = nobody
        for site in action.trace:
            under = max(under, touched.get(site, nobody))
        for site in action.reads:
            under = max(under, written.get(site, nobody))
        own = under[0] + 1, place
        depths.append(own[0])
        below.append(under[1])
        for site in action.trace:
            written[site] = touched[site] = own
        for site in action.reads:
            touched[site] = max(own, touched.get(site, nobody))
    return Waits(np.array(depths, np.int32), np.array(below, np.int32))


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
            motion = motion_of(self.scene.system, action, end)
            moves = self.scene.system.moves_of(action)
            move = next((each for each in moves if each.motion == motion), None)
            name = action.label if move is None else move.generator
            self._named.append(self._names.setdefault(name, len(self._names)))
            self._at.append("" if move is None else site_text(move.at))
            self._motions.append([(self.site(one), self.site(other)) for one, other in motion])
            self._actions.append(action)
        return found

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
        bodies = [picture.moving.body(self.scene, site) for site in sites]
        moves = [len(motion) for motion in self._motions]
        flat = [ends for motion in self._motions for ends in motion]
        return {
            "spec": self.scene.spec,
            "drawing": self.scene.system.drawing,
            "box": list(picture.box),
            "behind": _layer(picture.behind),
            "before": _layer(picture.before),
            "outline": picture.outline,
            "thick": picture.moving.thick,
            "joints": picture.moving.joints,
            "modules": self._modules(),
            "goal": self._goal(),
            "sites": {
                "name": [site_text(site) for site in sites],
                "shape": np.array([_SHAPES.index(body.shape) for body in bodies]),
                "at": np.array([body.at for body in bodies], np.float64).ravel(),
                "to": np.array([body.to for body in bodies], np.float64).ravel(),
                "colour": ["" if b.colour is None else colour_text(b.colour) for b in bodies],
                "word": [body.word or "" for body in bodies],
                **_in_space(self.scene.system, sites),
            },
            "solids": _solids(self.scene),
            "start": np.array(self._start),
            "rows": {
                "generators": list(self._names),
                "generator": np.array(self._named, np.int64),
                "at": list(self._at),
                "begins": np.cumsum([0, *moves]),
                "source": np.array([source for source, _ in flat], np.int64),
                "target": np.array([target for _, target in flat], np.int64),
                **self._ways(sites),
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

    def _ways(self, sites: Sequence[Site]) -> dict[str, NDArray[Any]]:
        legs: list[tuple[float, ...]] = []
        begins = [0]
        for action, motion in zip(self._actions, self._motions, strict=True):
            for source, target in motion:
                way = way_of(self.scene, action, sites[source], sites[target])
                legs += [(*leg.about, *leg.axis, leg.turn) for leg in way]
                begins.append(len(legs))
        return {"legs": np.array(legs, np.float64).ravel(), "leg_begins": np.array(begins)}


def _in_space(system: System, sites: Iterable[Site]) -> dict[str, NDArray[Any]]:
    """Return the kind of each cell and its middle, x, y, z; nothing in the plane."""
    drawing, places = system.drawing, map(system.place_of, sites)
    known = [*places] if drawing in CELL_FACES else []
    axes = [place[3] if isinstance(place, tuple) and len(place) == 4 else 0 for place in known]
    points = [middle_of(drawing, place) for place in known]
    return {"kind": np.array(axes, np.int64), "point": np.array(points, np.float64).ravel()}


def _solids(scene: Scene) -> dict[str, Any] | None:
    """Return the shapes of cells in three dimensions, and those of obstacles and the goal."""
    system = scene.system
    if system.drawing not in CELL_FACES:
        return None
    goal = in_order(scene.goal or ())
    places = [*in_order(system.filled), *in_order(system.empty), *goal]
    colours = ["wall"] * len(system.filled) + ["line"] * len(system.empty) + ["goal"] * len(goal)
    kinds = [*CELL_FACES[system.drawing], box_faces(ROD, ROD, ROD)]
    faces = [[face.corners.ravel().tolist() for face in kind] for kind in kinds]
    fixed = {**_in_space(system, places), "colour": colours}
    return {"azimuth": FRONT.azimuth, "tilt": FRONT.tilt, "kinds": faces, "fixed": fixed}


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
    }


Columns: TypeAlias = dict[str, NDArray[Any]]
DELIVERIES_MAX = 1_000_000
"""With more deliveries than this a page has none, and says so: it would not open any more."""
_OUTCOMES = {"lost": 0, "granted": 1, "": 2}
Entry: TypeAlias = tuple[int, int, int]


def claim_entry(
    world: NumberedWorld, module: int, generator: str, at: Site, site: Site, *, outcome: str
) -> Entry | None:
    """Return a claim as (module, row, won); None if no module at the site could propose it.

    The outcome is "lost", "granted", or "" where that is not known.
    """
    row = world.proposed(generator, at, site)
    return None if row is None else (module, row, _OUTCOMES[outcome])


def delivery_entries(report: Report, kinds: dict[str, int]) -> Iterable[Entry]:
    """Yield what a module was delivered as (kind, sender, receiver); new kinds get numbers."""
    for kind, sender in report.deliveries():
        yield kinds.setdefault(kind, len(kinds)), sender, report.module


def claims_document(world: NumberedWorld, recording: Recording, steps: int) -> dict[str, Any]:
    """Return the claims of a run, step by step: which module claimed which row, and the result.

    ``ends`` has the number of claims up to the end of each step; ``won`` is 1 for a claim that was
    granted, 0 for one that was lost, and 2 where that is not recorded. A claim of a run without
    rounds stands one level above the greatest that was recorded when it was sent.
    """
    found = recording.claims()
    rounds = _levels(recording, found) if recording.clock == "free" else found["round"]
    listed: list[list[Entry]] = [[] for _ in range(steps)]
    for number, module, generator, at, site, outcome in zip(
        rounds.tolist(),
        *(found[name].tolist() for name in ("module", "generator", "at", "site", "outcome")),
        strict=True,
    ):
        if 1 <= number <= steps:  # a round that is not complete has no step
            entry = claim_entry(world, module, generator, at, site, outcome=outcome)
            if entry is not None:
                listed[number - 1].append(entry)
    return _table(listed, ("module", "row", "won"))


def _table(listed: Sequence[Sequence[Entry]], names: Sequence[str]) -> Columns:
    """Return the entries of each step as columns, and how many there are up to its end."""
    columns = np.array([each for one in listed for each in one], np.int64).reshape(-1, 3).T
    ends = np.cumsum([len(one) for one in listed], dtype=np.int64)
    return {"ends": ends, **dict(zip(names, columns, strict=True))}


def _levels(recording: Recording, claims: Columns) -> NDArray[np.int64]:
    """Return for each claim one more than the greatest level of the moves reported before it."""
    moves = recording.moves()
    order = np.argsort(moves["wall_ns"], kind="stable")
    greatest = np.maximum.accumulate(np.append(0, moves["round"][order]))
    before = np.searchsorted(moves["wall_ns"][order], claims["wall_ns"])
    found: NDArray[np.int64] = greatest[before] + 1
    return found


def heard_document(recording: Recording, rounds: int) -> dict[str, Any]:
    """Return who was delivered what in each round: the kind, the sender and the receiver.

    ``ends`` has the number of deliveries up to the end of each round, ``kind`` numbers of
    ``kinds``. Of a run with more deliveries than a page can hold there is ``left_out`` alone, their
    number.
    """
    kinds: dict[str, int] = {}
    found: list[list[Entry]] = [[] for _ in range(rounds)]
    total = 0
    for logged in recording.messages("report"):
        report = logged.message
        if not 1 <= report.round <= rounds:
            continue
        entries = list(delivery_entries(report, kinds))
        total += len(entries)
        if total <= DELIVERIES_MAX:
            found[report.round - 1] += entries
    if total > DELIVERIES_MAX:
        return {"left_out": total}
    return {"kinds": list(kinds), **_table([*map(sorted, found)], ("kind", "from", "to"))}


FORMAT = 1
Progress = Callable[[str], None]


@dataclass(frozen=True, eq=False)
class RunView:
    """What a page shows of one run or path.

    `steps` holds the actions of each round, level, move or cube as it was executed or given, those
    without a move too; `cubes` is the normal cube path of the same moves. `found` says what becomes
    of each move, if that is known already. `recording` gives the claims and the messages, if there
    is one, and `facts` are pairs of texts for the head of the page. With a `chain`, places from 0
    in the cubes one after another, they are the schedule of a certificate, which the chain proves.
    `marks` are pairs of a step, from 1, and what the time axis says of it.

    >>> played = play("hex:n=4", hesitate=0.5, seed=1)
    >>> cubes = normal_cube_path(played.path)
    >>> shown = RunView(played.scene, played.steps, cubes, facts=(("rule", "chain"),))
    >>> len(shown.steps) > len(shown.cubes)
    True
    """

    scene: Scene
    steps: Sequence[Sequence[Action]]
    cubes: Sequence[Sequence[Action]]
    found: NormalForm | None = None
    step_name: str = "round"
    name: str = ""
    recording: Recording | None = None
    facts: tuple[tuple[str, str], ...] = ()
    chain: Sequence[int] | None = None
    marks: Sequence[tuple[int, str]] = ()


def document_of(shown: Sequence[RunView], progress: Progress | None = None) -> dict[str, Any]:
    """Return all that a page shows, as a document for `cubepath.coordinator.tools.viewing.pages`.

    `progress` is called with the name of each part before it is begun. InputError if a move is not
    admissible or a place cannot be drawn.
    """
    tell = progress or (lambda _: None)
    worlds: list[NumberedWorld] = []
    paths: list[dict[str, Any]] = []
    for each in shown:
        world = next((known for known in worlds if _same(known.scene, each.scene)), None)
        if world is None:
            world = NumberedWorld(each.scene)
            worlds.append(world)
        paths += _paths(each, world, worlds.index(world), tell)
    tell("picture")
    return {
        "format": FORMAT,
        "title": " and ".join(dict.fromkeys(title_of(each.scene) for each in shown)),
        "facts": [[list(fact) for fact in each.facts] for each in shown],
        "names": [each.name for each in shown],
        "worlds": [world.document() for world in worlds],
        "paths": paths,
        # One run beside its schedule; two runs beside each other.
        "beside": [0, 1] if len(shown) == 1 else [0, 2],
        "complex": _complex(shown, tell),
    }


def title_of(scene: Scene) -> str:
    """Return the title of a scene: its spec without the folders of its files."""
    return re.sub(r"[^=,]*/", "", scene.spec)


def _same(one: Scene, other: Scene) -> bool:
    """Return whether two scenes are the same world: the same system, start and goal."""
    if one is other:
        return True
    both = one.start == other.start and one.goal == other.goal
    return both and one.system.to_table() == other.system.to_table()


def _paths(
    each: RunView, world: NumberedWorld, number: int, tell: Progress
) -> list[dict[str, Any]]:
    executed = "as executed" if each.step_name in {"round", "level"} else "as given"
    prefix = f"{each.name}: " if each.name else ""
    tell("path")
    path = path_document(
        world, number, each.steps, title=prefix + executed, step_name=each.step_name
    )
    found = each.found
    if found is None:
        found = cancellations(action for step in each.steps for action in step)
    path |= {"level": found.levels, "partner": found.partners}
    if each.marks:
        path["marks"] = [list(mark) for mark in each.marks]
    if each.recording is not None:
        tell("claims")
        path["claims"] = claims_document(world, each.recording, len(each.steps))
    if each.recording is not None and each.recording.clock == "lockstep":
        tell("messages")
        path["heard"] = heard_document(each.recording, len(each.steps))
    tell("schedule")
    title = "normal cube path" if each.chain is None else "certified schedule"
    cubes = path_document(world, number, each.cubes, title=prefix + title, step_name="cube")
    if each.chain is not None:
        cubes["chain"] = np.array(each.chain, np.int64)
    return [path, cubes]


def _complex(shown: Sequence[RunView], tell: Progress) -> dict[str, Any] | None:
    """Return the state complex with the state after each step of each path; None if too large."""
    scene = shown[0].scene
    if not all(_same(each.scene, scene) for each in shown):
        return None
    tell("complex")
    space: Any = plugin("state_space")(scene)
    if space is None:
        return None
    document: dict[str, Any] = space.document(
        [space.along(steps) for each in shown for steps in (each.steps, each.cubes)]
    )
    return document
