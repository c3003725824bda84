"""What a page shows of a run, as data: positions, cancellations, claims, messages, the complex."""

import cmath
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from cubepath.coordinator.runs.gathering import gathered
from cubepath.coordinator.theory.complexes.exploration import explore
from cubepath.coordinator.tools.viewing.pages import pack, unpack
from cubepath.coordinator.tools.viewing.run_view import NumberedWorld, RunView, document_of
from cubepath.protocol.core.sites import site_from_json
from cubepath.protocol.recordings.recording import read_recording
from oracles.obvious import obvious_normal_form
from processes.watched_pages import KINDS, followed, pivoting_squares, watched

GOLDEN = Path(__file__).parents[4] / "logs" / "golden"


def recorded(name: str) -> RunView:
    """Return a recording as a page shows it."""
    recording = read_recording(GOLDEN / f"{name}.mcap")
    run = gathered(recording)
    steps = [step.actions for step in run.steps]
    heap = run.heap
    return RunView(
        recording.scene, steps, heap.cube_path(), heap.normal_form(), recording=recording
    )


def document(shown: RunView) -> Any:
    """Return the document of a page as a browser reads it."""
    return unpack(pack(document_of([shown])))


def positions(data: Any, number: int) -> list[list[str]]:
    """Follow the modules through a path in the obvious way: a list of sites, changed in place."""
    path = data["paths"][number]
    world = data["worlds"][path["world"]]
    rows, names = world["rows"], world["sites"]["name"]
    sites = list(world["start"])
    found = [[names[site] for site in sites]]
    for step, end in enumerate(path["ends"]):
        begin = path["ends"][step - 1] if step else 0
        for row in path["rows"][begin:end]:
            each = range(rows["begins"][row], rows["begins"][row + 1])
            goes = {rows["source"][motion]: rows["target"][motion] for motion in each}
            sites = [goes.get(site, site) for site in sites]
        found.append([names[site] for site in sites])
    return found


@pytest.mark.few(4)
@pytest.mark.parametrize("spec", ["hex:n=5", "arms", "words", "own.toml", *KINDS[1:5], *KINDS[7:9]])
def test_modules_are_where_the_run_had_them(spec: str, tmp_path: Path) -> None:
    """After each round and after each cube, in systems of every kind."""
    page = watched(spec, tmp_path)
    data = document(page.shown)
    assert [positions(data, 0), positions(data, 1)] == [*page.sites]


def test_what_cancels_is_what_the_definition_cancels(tmp_path: Path) -> None:
    """Partners name each other and are equal; those that are left are the normal cube path."""
    page = watched("sliding:p=2,q=1,n=4", tmp_path, rounds=20).shown
    path = document(page)["paths"][0]
    moves = [action for step in page.steps for action in step]
    for place, (level, partner) in enumerate(zip(path["level"], path["partner"], strict=True)):
        assert (level == 0) == (partner >= 0)
        if partner >= 0:
            assert path["partner"][partner] == place
            assert moves[partner] == moves[place]
    cubes = obvious_normal_form(moves)
    for number, cube in enumerate(cubes, 1):
        left = [moves[place] for place, level in enumerate(path["level"]) if level == number]
        assert set(left) == cube
    assert 0 in path["level"]


def test_claims_are_those_on_record() -> None:
    """Who claimed what in which round, and whether it was granted or lost."""
    shown = recorded("agv-6")
    assert shown.recording is not None
    data = document(shown)
    claims, rows = data["paths"][0]["claims"], data["worlds"][0]["rows"]
    table = shown.recording.claims()
    wanted = list(
        zip(table["module"].tolist(), table["generator"].tolist(), table["outcome"], strict=True)
    )
    found = [
        (module, rows["generators"][rows["generator"][row]], ("lost", "granted", "")[won])
        for module, row, won in zip(claims["module"], claims["row"], claims["won"], strict=True)
    ]
    assert found == wanted
    rounds = [int((table["round"] <= number).sum()) for number in range(1, len(shown.steps) + 1)]
    assert claims["ends"] == rounds


def test_claims_of_a_run_without_rounds_have_levels() -> None:
    """Each is at a level above all moves that were on record before it was said."""
    shown = recorded("hex-free-5")
    assert shown.recording is not None
    claims = document(shown)["paths"][0]["claims"]
    table, moves = shown.recording.claims(), shown.recording.moves()
    wanted = [0] * len(shown.steps)
    for said in table["wall_ns"].tolist():
        before = moves["round"][moves["wall_ns"] < said].tolist()
        if max(before, default=0) < len(wanted):
            wanted[max(before, default=0)] += 1
    assert claims["ends"] == [sum(wanted[: number + 1]) for number in range(len(wanted))]
    assert claims["won"].count(0) == (table["outcome"] == "lost").sum()


def test_messages_are_those_that_were_delivered() -> None:
    """As many in each round as its reports say, from whom to whom."""
    shown = recorded("hex-5")
    assert shown.recording is not None
    heard = document(shown)["paths"][0]["heard"]
    flat = zip(heard["kind"], heard["from"], heard["to"], strict=True)
    found = [(heard["kinds"][kind], sender, receiver) for kind, sender, receiver in flat]
    wanted = [
        (each.message.round, kind, sender, each.message.module)
        for each in shown.recording.messages("report")
        for kind, sender in each.message.deliveries()
    ]
    begin = 0
    for number, end in enumerate(heard["ends"], 1):
        assert sorted(found[begin:end]) == sorted(each[1:] for each in wanted if each[0] == number)
        begin = end
    assert begin == len(wanted) > 0


def test_both_paths_run_through_the_state_complex(tmp_path: Path) -> None:
    """The state after each step is the vertex that the complex has for it."""
    page = watched("agv:graph=K5,n=2", tmp_path)
    data = document(page.shown)["complex"]
    explored = explore(page.shown.scene)
    for path, sites in zip(data["paths"], page.sites, strict=True):
        states = [frozenset(json_sites(names)) for names in sites]
        assert [explored.state(number) for number in path] == states
    assert len(data["points"]) == 3 * data["counts"][0]
    assert len(data["edges"]) == 2 * data["counts"][1]


def json_sites(names: list[str]) -> list[Any]:
    import json

    return [site_from_json(json.loads(name)) for name in names]


def turns(world: Any) -> Iterator[tuple[str, complex, complex, complex, float]]:
    """Yield of each motion its generator, both middles, the corner and the angle; 0 is straight."""
    rows, at = world["rows"], world["sites"]["at"]
    for row, begin in enumerate(rows["begins"][:-1]):
        name = rows["generators"][rows["generator"][row]]
        for place in range(begin, rows["begins"][row + 1]):
            ends = (rows[each][place] for each in ("source", "target"))
            one, other = (complex(*at[2 * site : 2 * site + 2]) for site in ends)
            first, last = rows["leg_begins"][place : place + 2]
            x, y, _, *axis, turn = rows["legs"][7 * first : 7 * last]
            assert not turn or axis == [0, 0, 1]
            yield name, one, other, complex(x, y), turn


def test_a_hexagon_turns_about_a_corner_that_it_keeps(tmp_path: Path) -> None:
    """Of a module that pivots, both places are as far from the corner as a corner is."""
    found = list(turns(document(watched("hex:n=5", tmp_path).shown)["worlds"][0]))
    assert found
    for _, one, other, corner, turn in found:
        assert abs(turn) == pytest.approx(2 * math.pi / 3)
        assert abs(one - corner) == pytest.approx(1 / math.sqrt(3), abs=1e-5)
        assert corner + (one - corner) * cmath.rect(1, turn) == pytest.approx(other, abs=1e-5)


def test_a_square_turns_where_its_move_says_so(tmp_path: Path) -> None:
    """It turns about a corner, past no cell that its move does not need free; others slide."""
    scene = pivoting_squares()
    world = NumberedWorld(scene)
    moves = [move for move in scene.system.moves((0, 1)) if move is not None]
    for move in moves:
        on = next(end for end in (0, 1) if (0, 1) in move.action.ends[end])
        world.row(move.action, on)
    found = list(turns(unpack(pack(world.document()))))
    assert len(found) == len(moves) == 16
    for (name, one, other, corner, turn), move in zip(found, moves, strict=True):
        assert abs(turn) == pytest.approx(math.pi / (1 if name.startswith("round") else 2))
        assert abs(one - corner) == pytest.approx(math.sqrt(0.5))
        assert corner + (one - corner) * cmath.rect(1, turn) == pytest.approx(other, abs=1e-5)
        for part in range(1, 20):
            spun = cmath.rect(1, turn * part / 20)
            for about in (0.49 + 0.49j, 0.49 - 0.49j, -0.49 - 0.49j, -0.49 + 0.49j, 0):
                spot = corner + (one + about - corner) * spun
                cell = round(spot.real), round(spot.imag)
                assert cell in move.action.support
                assert not any(cell in end for end in move.action.ends) or cell in move.motion[0]
    for spec in ("own.toml", "sliding:p=2,q=1,n=4"):
        slides = list(turns(document(watched(spec, tmp_path).shown)["worlds"][0]))
        assert slides
        assert not any(turn for *_, turn in slides)


def test_two_runs_of_one_scene_share_its_world_and_its_complex(tmp_path: Path) -> None:
    """Two runs lie beside each other; of other scenes each has a world of its own."""
    one = watched("agv:graph=K5,n=2", tmp_path).shown
    other = RunView(one.scene, one.cubes, one.cubes, name="other", step_name="cube")
    data = unpack(pack(document_of([one, other])))
    assert (len(data["worlds"]), data["beside"]) == (1, [0, 2])
    assert [path["title"] for path in data["paths"][2:]] == [
        "other: as given",
        "other: normal cube path",
    ]
    assert len(data["complex"]["paths"]) == 4
    again = watched("agv:graph=K5,n=2", tmp_path).shown
    assert len(document_of([one, again])["worlds"]) == 1
    apart = unpack(pack(document_of([one, watched("hex:n=5", tmp_path).shown])))
    assert (len(apart["worlds"]), apart["complex"]) == (2, None)
    assert [path["world"] for path in apart["paths"]] == [0, 0, 1, 1]
    assert followed(one.scene, one.cubes) == positions(data, 2)
