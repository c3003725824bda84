"""Shortening files: recordings, moves files and scenarios give one result, or one clear refusal."""

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Literal

import msgspec
import pytest
from hypothesis import given, settings, strategies as st

from cubepath.coordinator.commands.main import main
from cubepath.coordinator.normal_form.definitions import end_state, is_normal
from cubepath.coordinator.normal_form.heap import normal_cube_path
from cubepath.coordinator.shortening.normal_path import Shortened, shorten
from cubepath.protocol.core.actions import Action, admissible, apply
from cubepath.protocol.core.catalogue import GeneratorPlacement, Move
from cubepath.protocol.core.errors import CheckError, CubepathError, InputError
from cubepath.protocol.core.sites import Site, in_order
from cubepath.protocol.path_files import supports
from cubepath.protocol.path_files.moves import read_cubes, read_moves, write_cubes
from cubepath.protocol.recordings.writing import RecordingWriter
from cubepath.protocol.scenes.specs import scene_from_spec
from cubepath.protocol.scenes.toml import scene_to_toml
from cubepath.protocol.systems.graphs import scenario_from_json
from cubepath.protocol.wire.keys import topic_of
from cubepath.protocol.wire.messages import Report, Reports, encode
from oracles.obvious import obvious_normal_form
from samples.strategies import scene

DATA = Path(__file__).parents[2] / "data" / "agv"
SPECS = ("hex:n=4", "agv:graph=grid3x3,n=3", "agv-labelled:graph=grid3x3,n=3", "arm:n=5")
VEHICLES = "agv:graph=grid3x3,n=2"
"""Two vehicles, at [0, 0] and [0, 1]."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("shorten")


def save(path: Path, lines: Sequence[object]) -> Path:
    path.write_bytes(b"".join(msgspec.json.encode(line) + b"\n" for line in lines))
    return path


def figures(result: Shortened) -> tuple[int, int, int, int]:
    return result.moves, result.reduced_moves, result.cubes, result.max_cube_dimension


# Scenarios


@pytest.mark.few(1)
@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("grid8-12agents", (71, 69, 13, 10)),
        pytest.param("random-32-32-10-30agents", (719, 719, 53, 30), marks=pytest.mark.slow),
        pytest.param("cgshop2021-algae", (5205, 4719, 114, 91), marks=pytest.mark.slow),
    ],
)
def test_real_paths_have_the_known_normal_cube_paths(
    folder: Path, name: str, expected: tuple[int, int, int, int]
) -> None:
    """Moves, reduced moves, cubes and greatest dimension, against the definitions on the way."""
    path = DATA / f"{name}.json"
    result = shorten(path)
    assert figures(result) == expected
    scenario = scenario_from_json(path)
    where = scene(f"agv:scene={path}")
    lines = [GeneratorPlacement("edge", move) for move in scenario.moves]
    moves = [move.action for move in read_moves(save(folder / "m.jsonl", lines), where)]
    assert tuple(map(frozenset, result.cube_path)) == obvious_normal_form(moves)
    assert is_normal(result.cube_path)
    start = frozenset(scenario.starts)
    assert end_state(result.cube_path, start) == end_state(moves, start)


def test_moves_of_a_scenario_are_named_by_generator_and_edge(folder: Path) -> None:
    """The cubes of a scenario are a cubes file whose moves are edges of the grid."""
    result = shorten(DATA / "grid8-12agents.json")
    path = folder / "cubes.jsonl"
    write_cubes(path, result.named)
    first = json.loads(path.read_text().splitlines()[0])["moves"][0]
    assert first == {"generator": "edge", "at": [[0, 2], [1, 2]]}
    assert [len(cube) for cube in read_cubes(path)] == [len(cube) for cube in result.cube_path]
    # Written out cube by cube, the path is one against the system, and is the same again.
    lines = [move for cube in read_cubes(path) for move in cube]
    again = shorten(
        save(folder / "again.jsonl", lines), system=f"agv:scene={DATA / 'grid8-12agents.json'}"
    )
    assert again.cube_path == result.cube_path


def plan(**others: object) -> dict[str, Any]:
    """Return a scenario of two vehicles, an obstacle at [1, 1] and one move."""
    return {
        "grid": [3, 2],
        "obstacles": [[1, 1]],
        "starts": [[0, 0], [2, 0]],
        "goals": [[0, 1], [2, 1]],
        "moves": [[[0, 0], [1, 0]]],
        **others,
    }


BAD_PLANS: dict[str, tuple[dict[str, Any], str]] = {
    "no edge": (
        plan(moves=[[[0, 0], [1, 0]], [[1, 0], [0, 1]]]),
        "move 2, vehicle 0, [1,0] to [0,1]: no edge of the grid, expected a step to a neighbour",
    ),
    "no step": (plan(moves=[[[0, 0], [0, 0]]]), "move 1, vehicle 0 stays at [0,0]"),
    "empty": (
        plan(moves=[[[0, 0], [0, 1]], [[0, 0], [1, 0]]]),
        "move 2, [0,0] is empty, expected a vehicle",
    ),
    "occupied": (
        plan(moves=[[[0, 0], [1, 0]], [[2, 0], [1, 0]]]),
        "move 2, vehicle 1, [2,0] to [1,0]: [1,0] is occupied by vehicle 0, which stays",
    ),
    "obstacle": (
        plan(moves=[[[0, 0], [1, 0]], [[1, 0], [1, 1]]]),
        "move 2, vehicle 0, [1,0] to [1,1]: [1,1] is an obstacle or outside, expected free",
    ),
    "outside": (
        plan(moves=[[[0, 0], [-1, 0]]]),
        "move 1, vehicle 0, [0,0] to [-1,0]: [-1,0] is an obstacle or outside, expected free",
    ),
    "one start twice": (plan(starts=[[0, 0], [0, 0]]), "start 1 at [0, 0] is taken twice"),
    "no goals": ({"starts": [[0, 0]]}, "missing required field `goals`"),
    "one cell": (
        plan(grid=[1, 1], obstacles=[], starts=[[0, 0]], goals=[[0, 0]]),
        "move 1, vehicle 0, [0,0] to [1,0]: [1,0] is an obstacle or outside, expected free",
    ),
}


@pytest.mark.parametrize("case", BAD_PLANS)
def test_the_first_bad_move_of_a_scenario_is_named(tmp_path: Path, case: str) -> None:
    """By its number, counted from 1, and what is wrong with it."""
    document, reason = BAD_PLANS[case]
    path = tmp_path / "plan.json"
    path.write_text(json.dumps(document))
    with pytest.raises(InputError) as caught:
        shorten(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert reason in str(caught.value)


def test_a_scenario_is_told_by_content(tmp_path: Path) -> None:
    """Its name does not matter, nor whether it is on one line or on many."""
    for indent in (None, 2):
        path = tmp_path / "plan.jsonl"
        path.write_text("\n" + json.dumps(plan(), indent=indent))
        assert figures(shorten(path)) == (1, 1, 1, 1)
    path.write_text(json.dumps(plan(), indent=2)[:-9])
    with pytest.raises(InputError, match=r"plan\.jsonl: Input data was truncated"):
        shorten(path)
    path.write_text(json.dumps(plan(moves=[])))
    assert figures(shorten(path)) == (0, 0, 0, 0)


# Moves files


@pytest.mark.parametrize("system", [None, VEHICLES])
def test_an_empty_path_is_a_path_of_no_cubes(tmp_path: Path, system: str | None) -> None:
    """An empty file has no moves, and its cube path no cubes."""
    path = tmp_path / "empty.jsonl"
    path.write_bytes(b"")
    result = shorten(path, system=system)
    assert figures(result) == (0, 0, 0, 0)
    assert result.named == ()
    assert list(result.document()) == [
        "moves",
        "reduced_moves",
        "cubes",
        "max_cube_dimension",
        "planner_rounds",
        "seconds",
    ]


def walk(spec: str, choices: Sequence[int]) -> list[Move]:
    """Return the moves that these choices among the admissible ones make, from the start."""
    where, found = scene(spec), list[Move]()
    state = where.start_state
    for choice in choices:
        options = [
            move
            for site in in_order(state - where.system.filled)
            for move in where.system.moves(site)
            if move is not None and admissible(move.action, state)
        ]
        found.append(options[choice % len(options)])
        state = apply(found[-1].action, state)
    return found


walks = st.tuples(st.sampled_from(SPECS), st.lists(st.integers(0, 59), max_size=20)).map(
    lambda drawn: (drawn[0], walk(*drawn))
)


def by_generator(move: Move) -> dict[str, Any]:
    return {"generator": move.generator, "at": move.at}


def by_name(move: Move) -> dict[str, Any]:
    """Return a line as a planner writes it that knows no more than what commutes."""
    action = move.action
    return {"id": action.label, "support": in_order(action.support), "trace": list(action.trace)}


def by_contents(moves: Sequence[Move], start: frozenset[Site]) -> list[dict[str, Any]]:
    """Return the lines with local states, as the states come, and the numbers of moves as ids."""
    lines = []
    state = start
    for number, move in enumerate(moves):
        before, state = state, apply(move.action, state)
        support = move.action.support
        shown = {"before": in_order(support & before), "after": in_order(support & state)}
        lines.append({**by_name(move), "id": number, **shown})
    return lines


@pytest.mark.slow
@settings(max_examples=30)
@given(drawn=walks)
def test_all_forms_of_a_path_give_the_same_cubes(
    folder: Path, drawn: tuple[str, list[Move]]
) -> None:
    """By generator, by contents, and by name with support and trace alone."""
    spec, moves = drawn
    path = folder / "walk.jsonl"
    placed = shorten(save(path, [by_generator(move) for move in moves]), system=spec)
    assert obvious_normal_form([move.action for move in moves]) == tuple(
        map(frozenset, placed.cube_path)
    )
    save(path, by_contents(moves, scene(spec).start_state))
    for system in (None, spec):
        contents = shorten(path, system=system)
        assert contents.cube_path == placed.cube_path
        # The id is that of the very move that is left.
        for cube, names in zip(contents.cube_path, contents.named, strict=True):
            assert [moves[name].action for name in names if isinstance(name, int)] == list(cube)
    named = shorten(save(path, [by_name(move) for move in moves]))
    assert figures(named) == figures(placed)
    assert [set(cube) for cube in named.named] == [
        {action.label for action in cube} for cube in placed.cube_path
    ]


def test_a_bad_moves_file_is_refused_by_file_and_line(tmp_path: Path) -> None:
    """What `read_moves` says of a file is what shortening it says."""
    path = save(tmp_path / "m.jsonl", [{"generator": "edge", "at": [[0, 0], [1, 0]]}])
    with pytest.raises(InputError, match=r"m\.jsonl:1: generator 'edge' without a system"):
        shorten(path)
    with pytest.raises(InputError, match="unknown system 'agw'"):
        shorten(path, system="agw:n=2")
    with pytest.raises(InputError, match=r"missing\.jsonl: No such file"):
        shorten(tmp_path / "missing.jsonl")
    for text in ("[", '{\n "id": 1', "\x89"):
        path.write_text(text)
        with pytest.raises(InputError, match=r"m\.jsonl:1: "):
            shorten(path)


def test_progress_counts_every_move(tmp_path: Path) -> None:
    """The calls add up to the moves, and do not come for each of them."""
    calls: list[int] = []
    line = {"id": "a", "support": [1], "trace": [1]}
    result = shorten(save(tmp_path / "m.jsonl", [line] * 2500), progress=calls.append)
    assert sum(calls) == result.moves == 2500
    assert 1 < len(calls) < 10
    assert result.reduced_moves == 0


# Recordings


def report(
    number: int, module: int, before: tuple[int, int], site: tuple[int, int] | None = None
) -> Report:
    """Return the report of a vehicle that went along an edge, or stayed."""
    move = None if site is None else GeneratorPlacement("edge", tuple(sorted([before, site])))
    claim: Literal["none", "granted"] = "none" if move is None else "granted"
    return Report(number, module, before, site or before, claim, move, {})


RUN = [
    report(1, 0, (0, 0), (1, 0)),
    report(1, 1, (0, 1), (1, 1)),
    report(2, 0, (1, 0), (0, 0)),
    report(2, 1, (1, 1), (1, 2)),
    report(3, 0, (0, 0)),
    report(3, 1, (1, 2)),
]


def record(path: Path, reports: Sequence[Report]) -> Path:
    with RecordingWriter(path, scene(VEHICLES), {"system": VEHICLES}) as writer:
        for each in reports:
            message = Reports(each.round, each.module, [each])
            data = encode(message)
            writer.write(topic_of(message), data, round_number=each.round, wall_ns=0)
    return path


def test_a_recording_is_shortened_from_its_reports(tmp_path: Path) -> None:
    """What it is, its first bytes tell; the path is that of the complete rounds."""
    path = record(tmp_path / "no.suffix", RUN)
    result = shorten(path)
    assert figures(result) == (4, 2, 2, 1)
    assert result.named == (
        (GeneratorPlacement("edge", ((0, 1), (1, 1))),),
        (GeneratorPlacement("edge", ((1, 1), (1, 2))),),
    )
    unfinished = report(4, 0, (0, 0), (1, 0))
    arrival = [RUN[3], RUN[2], *RUN[::-1], unfinished]
    assert shorten(record(tmp_path / "late", arrival)).named == result.named


def test_a_recording_without_rounds_is_a_path_of_no_cubes(tmp_path: Path) -> None:
    """A run that ended before its first round is over has no moves."""
    assert figures(shorten(record(tmp_path / "short.mcap", RUN[:1]))) == (0, 0, 0, 0)


def flipped(whole: bytes, place: int) -> bytes:
    return whole[:place] + bytes([whole[place] ^ 1]) + whole[place + 1 :]


DAMAGE: dict[str, tuple[Callable[[bytes], bytes], str]] = {
    "cut": (lambda whole: whole[:-40], "truncated"),
    "cut in a chunk": (lambda whole: whole[: len(whole) // 2], "truncated"),
    "a bit": (lambda whole: flipped(whole, len(whole) // 2), "corrupt"),
}


@pytest.mark.parametrize("kind", DAMAGE)
def test_a_damaged_recording_is_refused_with_the_way_out(tmp_path: Path, kind: str) -> None:
    """The damage is named, and the command that saves what can be read."""
    path = record(tmp_path / "log.mcap", [each for _ in range(40) for each in RUN])
    damage, what = DAMAGE[kind]
    path.write_bytes(damage(path.read_bytes()))
    with pytest.raises(InputError, match=what) as caught:
        shorten(path)
    assert f"'cubepath log recover {path} -o OUT'" in str(caught.value)


BAD_RUNS: dict[str, tuple[list[Report], type[CubepathError], str]] = {
    "contradiction": (
        [RUN[0], report(1, 0, (0, 0))],
        CheckError,
        "report 1 (report/module_0): module_0 reports round 1 twice, and differently",
    ),
    "no module": ([report(1, 2, (0, 0))], CheckError, "no such module in this run"),
    "unknown edge": (
        [report(1, 0, (0, 0), (2, 0)), RUN[1]],
        CheckError,
        "report of module_0: edge at [[0,0],[2,0]] is no move from [0,0]",
    ),
    "a gap": (
        [*RUN[:2], *RUN[4:], report(4, 0, (0, 0))],
        InputError,
        "round 2 is not complete, but there are reports of round 4",
    ),
    "inadmissible": (
        [report(1, 0, (0, 0), (0, 1)), RUN[1]],
        CheckError,
        "report of module_0: edge at [[0,0],[0,1]] is not admissible",
    ),
}


@pytest.mark.parametrize("case", BAD_RUNS)
def test_a_recording_that_makes_no_path_is_refused(tmp_path: Path, case: str) -> None:
    """Reports that contradict each other, or the system, or leave rounds out."""
    reports, error, reason = BAD_RUNS[case]
    path = record(tmp_path / "log.mcap", reports)
    with pytest.raises(error) as caught:
        shorten(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert reason in str(caught.value)


def test_an_empty_file_with_the_name_of_a_recording_is_no_empty_path(tmp_path: Path) -> None:
    """A log that was lost is told; an empty moves file is a path of no moves."""
    named = {"lost.mcap": "an MCAP recording", "lost.npz": "arrays of numpy", "lost.json": "JSON"}
    for name, held in named.items():
        (tmp_path / name).write_bytes(b"")
        with pytest.raises(InputError, match=f"{name}: empty file, expected {held}"):
            shorten(tmp_path / name)
    (tmp_path / "moves.jsonl").write_bytes(b"")
    assert figures(shorten(tmp_path / "moves.jsonl")) == (0, 0, 0, 0)


def test_the_file_of_the_system_is_not_written_over(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The output is neither the input nor the system beside it."""
    system = tmp_path / "system.toml"
    system.write_text(scene_to_toml(scene_from_spec("agv:graph=P3,n=1")))
    moves = tmp_path / "moves.jsonl"
    moves.write_text("")
    before = system.read_bytes()
    assert main(["shorten", str(moves), "--system", str(system), "-o", str(system)]) == 2
    assert "is an input" in capsys.readouterr().err
    assert system.read_bytes() == before


def test_self_contained_moves_are_shortened_without_an_action(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """None is made to read, check and shorten them and to name the cubes; each only if asked for.

    What is found is what the reader of lines and the plain heap find.
    """
    lines = [
        {
            "id": number,
            "support": [[place, "x"], [place + 1, "x"]],
            "trace": [[place, "x"], [place + 1, "x"]],
            "before": [[place + back, "x"]],
            "after": [[place + 1 - back, "x"]],
        }
        for number, (place, back) in enumerate([(0, 0), (5, 0), (1, 0), (5, 1), (9, 0), (2, 0)])
    ]
    path = save(tmp_path / "m.jsonl", lines)
    made: list[object] = []
    monkeypatch.setattr(
        supports, "action_of_parts", lambda *parts, **named: made.append((parts, named))
    )
    build = Action.__init__
    monkeypatch.setattr(Action, "__init__", lambda *parts, **named: made.append((parts, named)))
    found = shorten(path)
    assert found.named == ((0, 4), (2,), (5,))
    assert not made
    monkeypatch.setattr(Action, "__init__", build)
    moves = [move.action for move in read_moves(path)]
    assert [frozenset(cube) for cube in normal_cube_path(moves)] == [
        frozenset(moves[int(str(name))] for name in cube) for cube in found.named
    ]
