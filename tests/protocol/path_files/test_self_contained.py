"""Self-contained moves read straight into arrays: the same as line by line, and no action built."""

import json
from pathlib import Path
from random import Random
from typing import Any

import pytest
from hypothesis import given, strategies as st

from cubepath.coordinator.shortening.path_input import _Reading
from cubepath.protocol.core.actions import Action
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.input_files import opened
from cubepath.protocol.core.sites import Site
from cubepath.protocol.file_forms import NO_HINTS
from cubepath.protocol.path_files import numbered
from cubepath.protocol.path_files.moves import read_moves
from cubepath.protocol.path_files.numbered import NumberedPath, number_moves
from cubepath.protocol.path_files.supports import TabledActions, supports_of
from samples.strategies import lists_of

Line = dict[str, str]
"""A line by its keys, each with its value as JSON text."""

SPELLINGS = (
    ("1", "1.0", "1e0", "10E-1"),
    ('"a"', '"\\u0061"'),
    ("[1,2]", "[ 1 ,\t2.0]", "[1e0,2]"),
    ('["é",[[]]]', '["\\u00e9", [ [ ] ]]'),
    ("12345678901234567890123", "12345678901234567890123"),
    ("0.5", "5e-1"),
    ("0", "-0.0"),
    ('"1, 2]}"', '"1, 2]\\u007d"'),
)
"""Sites, each written in several ways."""


def spelled(random: Random, sites: list[int], *, doubled: bool = True) -> str:
    """Return a list of sites as JSON: in any order, in any spelling, some of them twice."""
    found = list(sites)
    if doubled and found and random.random() < 0.2:
        found.append(random.choice(found))
    random.shuffle(found)
    blank = random.choice(["", "", " ", "\t"])
    each = f",{blank}".join(random.choice(SPELLINGS[site]) for site in found)
    return f"[{blank}{each}{blank}]"


def written(random: Random, line: Line) -> str:
    """Return a line, its keys in any order."""
    keys = list(line)
    if random.random() < 0.3:
        random.shuffle(keys)
    gap = random.choice(["", "", " "])
    pairs = f",{gap}".join(f'"{key}"{gap}:{gap}{line[key]}' for key in keys)
    return f"{gap}{{{pairs}}}{gap}"


ACTIONS: tuple[tuple[list[int], ...], ...] = (
    ([0, 1], [0, 1], [0], [1]),
    ([0, 1, 2], [0, 1], [1, 2], [0, 2]),
    ([1, 2, 3], [1], [2], [1, 2]),
    ([3, 4], [3, 4], [], [3, 4]),
    ([4, 5, 6], [5], [], [5]),
    ([4, 5, 6], [5], [4], [4, 5]),
    ([6, 7], [6, 7], [7], [6]),
    ([7], [7], [], [7]),
)


def a_path(seed: int, size: int, *, named: bool, labels: int) -> list[str]:
    """Return lines of moves that are mostly admissible, each written in its own way."""
    random = Random(seed)  # noqa: S311 - nothing secret
    known: dict[int, bool] = {}
    found: list[str] = []
    for _ in range(size):
        number = random.randrange(len(ACTIONS))
        support, trace, *ends = ACTIONS[number]
        line = {"support": spelled(random, support), "trace": spelled(random, trace)}
        if named and number % 3 == 0:
            line = {"id": json.dumps(random.choice([number, f"n{number}"])), **line}
            line["support"], line["trace"] = spelled(random, support), spelled(random, trace)
            for site in trace:
                known.pop(site, None)
        else:
            fitting = [
                end
                for end in (0, 1)
                if all(
                    known.get(site, site in ends[end]) is (site in ends[end]) for site in support
                )
            ]
            end = random.choice(fitting or [0, 1])
            if not fitting and random.random() < 0.95:
                continue
            line = {"id": json.dumps(f"m{random.randrange(labels)}"), **line}
            line["before"] = spelled(random, ends[end])
            line["after"] = spelled(random, ends[1 - end])
            known |= {site: site in ends[1 - end] for site in support}
        found.append(written(random, line))
        if random.random() < 0.05:
            found.append(random.choice(["", " ", "\r"]))
    return found


def plainly(path: Path) -> NumberedPath | str:
    """Return a path as the reader of lines reads it, or what it says is wrong."""
    try:
        return number_moves(read_moves(path))
    except InputError as error:
        return str(error)


def quickly(path: Path) -> NumberedPath | str:
    """Return a path as commands read it, or what they say is wrong."""
    try:
        with opened(path) as file:
            return _Reading(file, None, NO_HINTS, None)._lines(None)
    except InputError as error:
        return str(error)


def everything(found: NumberedPath | str) -> Any:
    """Return all that can be seen of a path; a message as it is."""
    if isinstance(found, str):
        return found
    return (
        [(each.action, each.name, each.before, each.action.label) for each in found.moves()],
        [(action, action.ends, action.reads, action.label) for action in found.actions],
        found.action_names,
        found.stated,
        found.numbers.tolist(),
        found.ends.tolist(),
        found.names or None,  # of no moves there are none
        found.stated_start(),
    )


def obvious_start(found: NumberedPath) -> frozenset[Site] | None:
    """Return what is on at the start, move by move: the first move with a site says it."""
    on: dict[Site, bool] = {}
    for move in found.moves():
        if move.before is None:
            return None
        for site in move.action.support:
            on.setdefault(site, site in move.before)
    return frozenset(site for site in on if on[site])


def saved(folder: Path, text: bytes) -> Path:
    path = folder / "m.jsonl"
    path.write_bytes(text)
    return path


@given(
    seed=st.integers(0, 2**32),
    size=st.integers(0, 40),
    named=st.booleans(),
    labels=st.sampled_from([3, 1000]),
)
def test_what_means_the_same_is_the_same_however_it_is_written(
    tmp_path_factory: pytest.TempPathFactory, *, seed: int, size: int, named: bool, labels: int
) -> None:
    """Spellings of sites, their order, doubled sites and ids, swapped ends, white space."""
    lines = a_path(seed, size, named=named, labels=labels)
    path = saved(tmp_path_factory.mktemp("moves"), "\n".join(lines).encode())
    found = quickly(path)
    if isinstance(found, NumberedPath):
        assert isinstance(found.actions, TabledActions)
        start = found.stated_start()
        assert found.actions.made == 0
        assert start == obvious_start(found)
    assert everything(found) == everything(plainly(path))


DAMAGE = b'{}[]",:\\ \t\r\n\x0b\x00\xff1e-.truefalsnid'


@given(
    seed=st.integers(0, 2**32),
    size=st.integers(1, 6),
    named=st.booleans(),
    damage=lists_of(
        st.tuples(st.integers(0, 2**20), st.sampled_from(DAMAGE), st.integers(0, 2)), max_size=3
    ),
)
def test_damage_is_told_as_line_by_line(
    tmp_path_factory: pytest.TempPathFactory,
    *,
    seed: int,
    size: int,
    named: bool,
    damage: list[tuple[int, int, int]],
) -> None:
    """Bytes that are put in, replaced or left out: the same path, or the same message."""
    text = bytearray("\n".join(a_path(seed, size, named=named, labels=2)).encode())
    for where, byte, how in damage:
        place = where % max(1, len(text))
        text[place : place + (how > 0)] = bytes([byte]) if how < 2 else b""
    path = saved(tmp_path_factory.mktemp("moves"), bytes(text))
    found = quickly(path)
    assert everything(found) == everything(plainly(path))


EDGE = '"trace": [1], "before": [1], "after": []}'
ODD = {
    "booleans beside words": '{"id": 1, "support": [1, "true"], ' + EDGE,
    "booleans": '{"id": 1, "support": [1, true], ' + EDGE,
    "booleans in a list": '{"id": 1, "support": [1, [false]], ' + EDGE,
    "null for a site": '{"id": 1, "support": [1, null], ' + EDGE,
    "an object for a site": '{"id": 1, "support": [1, {"a": 1}], ' + EDGE,
    "deep": '{"id": 1, "support": [1, ' + "[" * 64 + "]" * 64 + "], " + EDGE,
    "too deep": '{"id": 1, "support": [1, ' + "[" * 65 + "]" * 65 + "], " + EDGE,
    "far too deep": '{"id": 1, "support": [1, ' + "[" * 100_000 + "]" * 100_000 + "], " + EDGE,
    "not closed": '{"id": 1, "support": [1, ' + "[" * 100_000,
    "a huge number": '{"id": 1, "support": [1, ' + "9" * 5000 + "], " + EDGE,
    "beyond all numbers": '{"id": 1, "support": [1, 1e999], ' + EDGE,
    "large": '{"id": 1, "support": [1, 1e300], ' + EDGE,
    "a huge id": '{"id": ' + "9" * 5000 + ', "support": [1], ' + EDGE,
    "an id beyond 64 bits": '{"id": 123456789012345678901234, "support": [1], ' + EDGE,
    "an id with a point": '{"id": 1.0, "support": [1], ' + EDGE,
    "an id with half": '{"id": 1.5, "support": [1], ' + EDGE,
    "an id that is true": '{"id": true, "support": [1], ' + EDGE,
    "an escaped id": '{"id": "\\u0041\\"", "support": [1], ' + EDGE,
    "half a surrogate": '{"id": "\\ud800", "support": [1], ' + EDGE,
    "no UTF-8": '{"id": "\udcff", "support": [1], ' + EDGE,
    "no UTF-8 in a site": '{"id": 1, "support": [1, "\udcff"], ' + EDGE,
    "a NUL": '{"id": 1, "support": [1, "\x00"], ' + EDGE,
    "a NUL behind": '{"id": 1, "support": [1], ' + EDGE + "\x00",
    "an escaped NUL": '{"id": 1, "support": [1, "\\u0000id"], ' + EDGE,
    "a site like that of an id": '{"id": 1, "support": [1, ["\\u0000id", 1]], ' + EDGE,
    "a site twice": '{"id": 1, "support": [1, 1], ' + EDGE,
    "a key twice": '{"id": 1, "id": 1, "support": [1], ' + EDGE,
    "an escaped key": '{"\\u0069d": 1, "support": [1], ' + EDGE,
    "a key more": '{"id": 1, "of": 2, "support": [1], ' + EDGE,
    "a key too few": '{"id": 1, ' + EDGE,
    "a comma too many": '{"id": 1, "support": [1,], ' + EDGE,
    "a comma behind": '{"id": 1, "support": [1], ' + EDGE[:-1] + ",}",
    "two numbers": '{"id": 1, "support": [1 2], ' + EDGE,
    "two values": '{"id": 1, "support": [1], ' + EDGE + "{}",
    "a word": '{"id": 1, "support": [one], ' + EDGE,
    "crossed brackets": '{"id": 1, "support": [1, [}], ' + EDGE,
    "an empty trace": '{"id": 1, "support": [1], "trace": [], "before": [1], "after": []}',
    "a trace outside": '{"id": 1, "support": [2], ' + EDGE,
    "a state outside": '{"id": 1, "support": [1], "trace": [1], "before": [1, 2], "after": [2]}',
    "equal states": '{"id": 1, "support": [1], "trace": [1], "before": [1], "after": [1]}',
    "a change off the trace": '{"id": 1, "support": [1, 2], "trace": [1], "before": [1, 2],'
    ' "after": []}',
    "one state": '{"id": 1, "support": [1], "trace": [1], "before": [1]}',
    "null for states": '{"id": 1, "support": [1], "trace": [1], "before": null, "after": null}',
    "a generator": '{"generator": "edge", "at": [1, 2]}',
    "a vertical tab": "\x0b",
    "a long line": '{"id": 1, "support": [1, "' + "x" * 3_000_000 + '"], ' + EDGE,
    "an id for two contents": '{"id": 7, "support": [2, 3], "trace": [2]}',
    "a label that names": '{"id": 0, "support": [2, 3], "trace": [2]}',
    "no fit": '{"id": 1, "support": [1], "trace": [1], "before": [], "after": [1]}',
}


@pytest.mark.parametrize("what", ODD)
def test_odd_lines_are_told_as_line_by_line(tmp_path: Path, what: str) -> None:
    """Alone, and after others: the same path, or the same message."""
    before = '{"id": 0, "support": [1], "trace": [1], "before": [], "after": [1]}\n'
    before += '{"id": 7, "support": [2], "trace": [2]}\n'
    for text in (ODD[what], before + ODD[what], ODD[what] + "\n" + before, before + "\ufeff"):
        path = saved(tmp_path, text.encode(errors="surrogateescape"))
        assert everything(quickly(path)) == everything(plainly(path))


@pytest.mark.parametrize("size", [1, 7, 64])
def test_portions_of_any_size_give_one_path(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, size: int
) -> None:
    """With and without a newline at the end."""
    lines = a_path(5, 60, named=True, labels=1000)
    monkeypatch.setattr(numbered, "PORTION", size)
    for end in ("", "\n", "\n\n \n"):
        path = saved(tmp_path, ("\r\n".join(lines) + end).encode())
        assert everything(quickly(path)) == everything(plainly(path))


def test_actions_are_made_one_by_one_of_their_rows(tmp_path: Path) -> None:
    """Each once, by any index, as they are in the file; the arrays are those of the actions."""
    path = saved(tmp_path, "\n".join(a_path(3, 60, named=True, labels=1000)).encode())
    found, expected = quickly(path), plainly(path)
    assert isinstance(found, NumberedPath)
    assert isinstance(expected, NumberedPath)
    actions = found.actions
    assert isinstance(actions, TabledActions)
    assert actions[-1] == expected.actions[-1]
    assert actions[1] is actions[1]
    assert actions.made == 2
    assert list(actions[:3]) == expected.actions[:3]
    with pytest.raises(IndexError):
        actions[len(actions)]
    again = supports_of(actions, found.stated)

    def told(path: NumberedPath) -> list[set[tuple[Site, int]]]:
        rows, sites = path.supports.rows, path.supports.sites
        return [
            {
                (sites[site], said)
                for site, said in zip(
                    rows.sites[begin:end].tolist(), rows.says[begin:end].tolist(), strict=True
                )
            }
            for begin, end in zip(rows.starts[:-1], rows.starts[1:], strict=True)
        ]

    assert told(found) == told(expected)
    assert again.rows.stated.tolist() == found.stated
    assert all(isinstance(action, Action) for action in actions)
