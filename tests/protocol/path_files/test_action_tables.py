"""Tables of actions in binary files, and lines: made of arrays as of actions, one by one."""

from itertools import pairwise
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from cubepath.protocol.core.actions import Action
from cubepath.protocol.core.catalogue import GeneratorPlacement
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.sites import Ordinals, Site, in_order
from cubepath.protocol.path_files import npz
from cubepath.protocol.path_files.moves import PathMove, known_of_named, named_action
from cubepath.protocol.path_files.npz import read_moves_npz, table_of, write_moves_npz
from cubepath.protocol.path_files.numbered import NumberedPath, number_moves, read_path
from cubepath.protocol.path_files.path_lines import write_path
from cubepath.protocol.path_files.supports import TabledActions
from oracles.plain_steps import COMPILED, PLAIN, plain_steps
from samples.strategies import SCENES, lists_of, scene, walks, words

both_ways = pytest.mark.parametrize("steps", [PLAIN, COMPILED])


@st.composite
def paths(draw: st.DrawFn, *, placed: bool = True) -> NumberedPath:
    """Draw a path with ids and directions, some moves of it known by support and trace alone.

    With `placed` also walks of a system, by generator.
    """
    if placed and draw(st.booleans()):
        spec = draw(st.sampled_from(SCENES))
        walk = draw(walks(spec, max_size=8))
        system = scene(spec).system
        found = [system.moves_of(action)[0] for action in walk]
        return number_moves(
            PathMove(move.action, GeneratorPlacement(move.generator, move.at)) for move in found
        )
    moves: list[PathMove] = []
    for number, action in enumerate(draw(words(max_size=12))):
        kind = draw(st.integers(0, 3))
        if kind == 0:
            name = f"n{draw(st.integers(0, 3))}{in_order(action.trace)}{in_order(action.reads)}"
            moves.append(PathMove(named_action(name, action.support, action.trace), name))
        else:
            moves.append(PathMove(action, number // kind, action.ends[kind % 2]))
    return number_moves(moves)


def obvious_table(path: NumberedPath) -> tuple[list[Site], dict[str, list[list[int]]]]:
    """Return the sites and lists of a table, from the actions themselves."""
    sites = Ordinals[Site]()
    lists: dict[str, list[list[int]]] = {}
    for action, name, stated in zip(path.actions, path.action_names, path.stated, strict=True):
        parts: list[tuple[str, Any]] = [
            ("support", action.support),
            ("trace", action.trace),
            ("before", action.ends[0] if stated else ()),
            ("after", action.ends[1] if stated else ()),
            ("free", action.free),
        ]
        for part, found in parts:
            known = found if stated else known_of_named(name, found)
            lists.setdefault(part, []).append([sites[site] for site in in_order(known)])
        pairs: list[Any] = [*in_order(action.guards)]
        lists.setdefault("guard", []).append([sites[site] for pair in pairs for site in pair])
    return list(sites), lists


@given(path=paths())
def test_a_table_lists_what_the_actions_say(path: NumberedPath) -> None:
    """Each list in canonical order, the sites in the order of the supports."""
    table = table_of(path.supports, path.action_names)
    found = {
        part: [sites[begin:end].tolist() for begin, end in pairwise(starts.tolist())]
        for part, (starts, sites) in table.parts.items()
    }
    sites, lists = obvious_table(path)
    assert table.sites == sites
    assert found == lists or not len(path.actions)
    assert {array.dtype for pair in table.parts.values() for array in pair} == {np.dtype(np.int32)}


def everything(found: NumberedPath) -> Any:
    return (
        [(action, action.label, action.ends) for action in found.actions],
        found.action_names,
        found.stated,
        found.numbers.tolist(),
        found.ends.tolist(),
        [found.name(move) for move in range(len(found.numbers))],
    )


@both_ways
@settings(max_examples=40)
@given(path=paths())
def test_what_is_read_is_what_was_written(
    tmp_path_factory: pytest.TempPathFactory, steps: int, path: NumberedPath
) -> None:
    """Arrays give the path back, and without an action unless it has free sites or guards."""
    target = tmp_path_factory.mktemp("paths") / "m.npz"
    write_moves_npz(target, path)
    with plain_steps(steps):
        found = read_moves_npz(target)
    bare = not any(action.free or action.guards for action in path.actions)
    assert isinstance(found.actions, TabledActions) is bare
    if isinstance(found.actions, TabledActions):
        assert found.actions.made == 0
    assert msgspec.json.encode(everything(found)[1:]) == msgspec.json.encode(everything(path)[1:])
    assert list(found.actions) == list(path.actions)


ODD = [
    ("support", [0, 0, 1, 2]),
    ("support", [2, 1]),
    ("trace", [1, 1, 0]),
    ("trace", []),
    ("trace", [2]),
    ("trace", [3]),
    ("before", [1, 1]),
    ("before", [0]),
    ("before", [2, 1]),
    ("before", []),
    ("after", [1]),
    ("after", [2]),
    ("after", [3]),
]


@given(
    changes=lists_of(st.tuples(st.integers(0, 2), st.sampled_from(ODD)), max_size=3),
    names=st.sampled_from([["a", "b", "c"], ["a", "a", "a"], ["a", "\0id", 5]]),
    stated=st.sampled_from([[True, True, True], [True, False, True], [False, False, True]]),
    sites=st.sampled_from([[1, 2, 3, 4], [1, 2, "x", ["\0id", "b"]], [[0, 2], [0, 1], 1.5, 0]]),
)
def test_odd_tables_are_read_or_refused_as_action_by_action(
    tmp_path_factory: pytest.TempPathFactory,
    changes: list[tuple[int, tuple[str, list[int]]]],
    names: list[Any],
    stated: list[bool],
    sites: list[Any],
) -> None:
    """Sites twice, in any order, off the support; equal actions; local states the other way."""
    rows: dict[str, list[list[int]]] = {
        "support": [[0, 1, 2], [0, 1], [3]],
        "trace": [[0, 1], [1], [3]],
        "before": [[0, 2], [], []],
        "after": [[1, 2], [1], [3]],
    }
    for place, (part, row) in changes:
        rows[part][place] = row
    arrays: dict[str, Any] = {
        f"{part}_starts": np.cumsum([0, *map(len, lists)], dtype=np.int32)
        for part, lists in rows.items()
    }
    for part, lists in rows.items():
        arrays[f"{part}_sites"] = np.array([site for row in lists for site in row], np.int32)
    for name, values in (("sites", sites), ("names", names)):
        arrays[name] = np.frombuffer(msgspec.json.encode(values), dtype=np.uint8)
    arrays |= {"format": np.array("cubepath-moves-1"), "stated": np.array(stated)}
    arrays |= {"moves": np.array([0, 1, 2, 0, 1]), "ends": np.array([0, 1, 0, -1, 0], np.int8)}
    target = tmp_path_factory.mktemp("paths") / "m.npz"
    np.savez(target, **arrays)

    def told() -> Any:
        try:
            return everything(read_moves_npz(target))
        except InputError as error:
            return str(error)

    with pytest.MonkeyPatch.context() as patch:
        found = told()
        patch.setattr(npz, "actions_of", lambda *_: None)
        assert found == told()


@pytest.mark.parametrize("more", [{}, {"free": [2]}])
def test_a_direction_counts_from_the_before_of_the_file(
    tmp_path: Path, more: dict[str, list[int]]
) -> None:
    """Whichever of its local states an action takes for the first one, by arrays or one by one."""
    for before, after in ((0, 1), (1, 0)):
        rows = {"support": [0, 1, 2], "trace": [0, 1], "before": [before], "after": [after], **more}
        arrays: dict[str, Any] = {"format": np.array("cubepath-moves-1")}
        for part, row in rows.items():
            arrays[f"{part}_starts"] = np.array([0, len(row)])
            arrays[f"{part}_sites"] = np.array(row)
        for name, values in (("sites", [5, 6, 7]), ("names", ["a"])):
            arrays[name] = np.frombuffer(msgspec.json.encode(values), dtype=np.uint8)
        arrays |= {"moves": np.zeros(3, np.int32), "ends": np.array([0, 1, -1], np.int8)}
        np.savez(tmp_path / "m.npz", **arrays)
        found = [move.before for move in read_moves_npz(tmp_path / "m.npz").moves()]
        assert found == [{5 + before}, {5 + after}, None]


def obvious_line(move: PathMove) -> dict[str, Any]:
    """Return a self-contained line, from the action itself."""
    sites = {"support": move.action.support, "trace": move.action.trace}
    if move.before is None:
        sites = {part: known_of_named(move.name, some) for part, some in sites.items()}
    else:
        sites["before"] = move.before
        sites["after"] = move.action.ends[move.before == move.action.ends[0]]
    return {"id": move.name} | {part: [*in_order(some)] for part, some in sites.items()}


@given(path=paths(placed=False))
def test_lines_are_those_of_the_moves(
    tmp_path_factory: pytest.TempPathFactory, path: NumberedPath
) -> None:
    """Byte for byte, and they need no action where the path was read into arrays."""
    folder = tmp_path_factory.mktemp("paths")
    write_path(folder / "one.jsonl", path)
    told = [msgspec.json.encode(obvious_line(move)) for move in path.moves()]
    assert (folder / "one.jsonl").read_bytes().splitlines() == told
    write_moves_npz(folder / "m.npz", path)
    found = read_moves_npz(folder / "m.npz")
    write_path(folder / "again.jsonl", found)
    write_moves_npz(folder / "again.npz", found)
    assert isinstance(found.actions, TabledActions)
    assert found.actions.made == 0
    assert (folder / "again.jsonl").read_bytes() == (folder / "one.jsonl").read_bytes()
    assert (folder / "again.npz").read_bytes() == (folder / "m.npz").read_bytes()


def test_a_move_without_a_direction_has_no_line(tmp_path: Path) -> None:
    """It is named by its number, where a line would have to say what is on before it."""
    step, other = Action([1, 2], [1, 2], [1], [2]), Action([3], [3], [], [3])
    moves = [PathMove(step, "a", frozenset({1})), PathMove(other, "b", frozenset({3}))]
    path = number_moves(moves)
    path.ends[1] = -1
    with pytest.raises(InputError, match="move 2: nothing says from which of its two local states"):
        write_path(tmp_path / "m.jsonl", path)
    assert not (tmp_path / "m.jsonl").exists()


def test_free_sites_have_no_line(tmp_path: Path) -> None:
    """A line by contents cannot say them, so the action is refused by its label."""
    step = Action([1, 2], [1], [], [1], free=[2], label="step")
    path = number_moves([PathMove(step, "a", frozenset())])
    with pytest.raises(InputError, match=r"step.* has free sites or guards"):
        write_path(tmp_path / "m.jsonl", path)
    assert not (tmp_path / "m.jsonl").exists()


def test_what_comes_twice_in_two_directions_is_written_both_ways(tmp_path: Path) -> None:
    """There and back of one action, each with its own before."""
    step = Action([1, 2], [1, 2], [1], [2])
    path = number_moves([PathMove(step, "a", frozenset({each})) for each in (1, 2)])
    write_path(tmp_path / "m.jsonl", path)
    found = read_path(tmp_path / "m.jsonl")
    assert [move.before for move in found.moves()] == [frozenset({1}), frozenset({2})]
