"""A run, or another path, as the data of a page: as it was executed, and its normal cube path.

`docs/viewing.md` has the document's fields.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from cubepath.coordinator.normal_form.array_heap import NormalForm
from cubepath.coordinator.normal_form.compiled_heap import cancellations
from cubepath.coordinator.plugins import plugin
from cubepath.coordinator.tools.viewing.heard import claims_document, heard_document
from cubepath.coordinator.tools.viewing.worlds import World, path_document
from cubepath.protocol.core.actions import Action
from cubepath.protocol.core.system import Scene
from cubepath.protocol.recordings.recording import Recording

FORMAT = 1
Progress = Callable[[str], None]


@dataclass(frozen=True, eq=False)
class Shown:
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


def document_of(shown: Sequence[Shown], progress: Progress | None = None) -> dict[str, Any]:
    """Return all that a page shows, as a document for `cubepath.coordinator.tools.viewing.packing`.

    `progress` is called with the name of each part before it is begun. InputError if a move is not
    admissible or a place cannot be drawn.
    """
    tell = progress or (lambda _: None)
    worlds: list[World] = []
    paths: list[dict[str, Any]] = []
    for each in shown:
        world = next((known for known in worlds if _same(known.scene, each.scene)), None)
        if world is None:
            world = World(each.scene)
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


def _paths(each: Shown, world: World, number: int, tell: Progress) -> list[dict[str, Any]]:
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


def _complex(shown: Sequence[Shown], tell: Progress) -> dict[str, Any] | None:
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
