"""A run, or another path, as the data of a page: as it was executed, and its normal cube path.

`page_document` has the document's fields.

Claims and messages of a recorded run, as data of a page.

It reads recordings.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from cubepath.coordinator.normal_form.array_heap import NormalForm
from cubepath.coordinator.normal_form.compiled_heap import cancellations
from cubepath.coordinator.plugins import plugin
from cubepath.coordinator.tools.viewing.worlds import NumberedWorld, path_document
from cubepath.protocol.core.actions import Action
from cubepath.protocol.core.sites import Site
from cubepath.protocol.core.system import Scene
from cubepath.protocol.recordings.recording import Recording
from cubepath.protocol.wire.messages import Report

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
    """Return the claims of a run, step by step: who claimed which row, and what came of it.

    ``ends`` has the number of claims up to the end of each step; ``won`` is 1 for a claim that was
    granted, 0 for one that was lost, and 2 where that is not on record. A claim of a run without
    rounds stands one level above the greatest that was on record when it was said.
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
    flat = [each for one in listed for each in one]
    modules, rows, won = np.array(flat, np.int64).reshape(-1, 3).T
    return {
        "ends": np.cumsum([len(one) for one in listed], dtype=np.int64),
        "module": modules,
        "row": rows,
        "won": won,
    }


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
    flat = [each for one in found for each in sorted(one)]
    kind, sender, receiver = np.array(flat, np.int64).reshape(-1, 3).T
    return {
        "kinds": list(kinds),
        "ends": np.cumsum([len(one) for one in found]),
        "kind": kind,
        "from": sender,
        "to": receiver,
    }


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
