"""What a path's file tells, in one object: where it comes from, its moves, start and scene."""

import json
from collections.abc import Mapping
from pathlib import Path

import pytest

from cubepath.coordinator.shortening.path_input import read_input
from cubepath.protocol.core.catalogue import GeneratorPlacement
from cubepath.protocol.file_forms import NO_HINTS, PlanHints
from cubepath.protocol.scenes.specs import scene_from_spec

ROOT = Path(__file__).parents[3]
PLANS = ROOT / "tests" / "data" / "imports"
SCENARIO = ROOT / "tests" / "data" / "agv" / "grid8-12agents.json"
ROOM = PlanHints(None, (PLANS / "room.map",))


@pytest.mark.parametrize(
    ("source", "system", "hints", "form", "told"),
    [
        (ROOT / "logs" / "golden" / "agv-3.mcap", None, NO_HINTS, "recording", (None, False)),
        (SCENARIO, None, NO_HINTS, "scenario", (12, True)),
        (PLANS / "lacam.txt", None, ROOM, "mapf-log", (4, True)),
        (PLANS / "pivots.txt", "hex:n=3", NO_HINTS, "plain", (None, False)),
    ],
)
def test_a_file_says_what_it_is(
    source: Path, system: str | None, hints: PlanHints, form: str, told: tuple[int | None, bool]
) -> None:
    """Its form, its planner's rounds, whether its goals are labelled, and where it comes from."""
    found = read_input(source, system, hints)
    assert (found.source, found.form) == (source, form)
    assert (found.planner_rounds, found.labelled_goals) == told
    assert found.scene is not None
    assert found.start is not None
    assert found.start <= found.scene.start_state
    assert len(found.moves) == len(found.actions) == len(found.numbered.numbers) > 0
    assert all(isinstance(move.name, GeneratorPlacement) for move in found.moves)
    for place, move in enumerate(found.moves):
        assert found.numbered.move(place) == move
        assert move.action == found.actions[place]


def test_the_scene_of_a_plan_is_built_when_it_is_asked_for() -> None:
    """It can take long, and shortening does not need it: the moves tell enough of the start."""
    found = read_input(PLANS / "lacam.txt", None, ROOM)
    assert found.given_scene is None
    assert found.start == found.numbered.stated_start()
    assert found.scene is found.scene
    assert found.scene is not None


def save(path: Path, *lines: Mapping[str, object]) -> Path:
    path.write_text("".join(json.dumps(line) + "\n" for line in lines))
    return path


def test_moves_tell_their_start(tmp_path: Path) -> None:
    """Each site is as the first move with it found it; nobody knows where one does not say."""
    there = {"id": 1, "support": [0, 1, 7], "trace": [0, 1], "before": [0, 7], "after": [1, 7]}
    back = {**there, "before": [1, 7], "after": [0, 7]}
    other = {"id": 2, "support": [1, 5], "trace": [5], "before": [5], "after": []}
    path = tmp_path / "moves.jsonl"
    found = read_input(save(path, there, back, other))
    assert (found.form, found.scene) == ("moves", None)
    assert found.start == frozenset({0, 5, 7})
    assert read_input(save(path)).start == frozenset()
    assert read_input(save(path, there, {"id": "x", "support": [9], "trace": [9]})).start is None


def test_a_system_says_what_the_start_is(tmp_path: Path) -> None:
    """All of its state, whichever sites the moves have."""
    spec = "agv:graph=grid3x3,n=2"
    path = save(tmp_path / "moves.jsonl", {"generator": "edge", "at": [[0, 0], [1, 0]]})
    found = read_input(path, spec)
    assert found.start == scene_from_spec(spec).start_state == frozenset({(0, 0), (0, 1)})
    assert found.moves[0].before == frozenset({(0, 0)})
