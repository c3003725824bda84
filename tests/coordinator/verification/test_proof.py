"""Checking a certificate, on paths by hand: who reads, who writes, what is between."""

import pytest

from cubepath.coordinator.verification.proof import check_proof
from samples.strategies import toggle

LETTERS = {
    "w": toggle("s"),
    "W": toggle("s", "t"),
    "t": toggle("t"),
    "r": toggle("a", reads=["s"]),
    "q": toggle("b", reads=["s"]),
    "x": toggle("c", reads=["s", "t"]),
    "v": toggle("s", reads=["far"]),
    "f": toggle("far"),
}
"""Writers of s, of both s and t, and of t; readers of s, the last one of t too; one that writes s
and reads what the one apart writes."""

Pairs = list[tuple[int, int]]
Cubes = list[list[int]]


def refusals(path: str, pairs: Pairs, cubes: Cubes, chain: list[int]) -> dict[str, str]:
    """Return the checks that fail, with what they say."""
    found = check_proof([LETTERS[letter] for letter in path], pairs, cubes, chain)
    return {name: why for name, why in found.items() if why is not None}


@pytest.mark.parametrize(
    ("path", "pairs", "cubes", "chain"),
    [
        ("", [], [], []),
        ("wfw", [(1, 3)], [[2]], [2]),
        ("rqr", [(1, 3)], [[2]], [2]),
        # A reader between two writers that is undone itself, under one more that is undone.
        ("wrrw", [(2, 3), (1, 4)], [], []),
        ("wrqqrw", [(3, 4), (2, 5), (1, 6)], [], []),
        ("wrqrqw", [(2, 4), (3, 5), (1, 6)], [], []),
        # What was written before both, and what was read.
        ("wrr", [(2, 3)], [[1]], [1]),
        ("qww", [(2, 3)], [[1]], [1]),
        ("wxx", [(2, 3)], [[1]], [1]),
        ("wrqw", [], [[1], [2, 3], [4]], [1, 2, 4]),
        ("wrqw", [], [[1], [3, 2], [4]], [1, 3, 4]),
        ("rqw", [], [[1, 2], [3]], [2, 3]),
        ("wtx", [], [[1, 2], [3]], [2, 3]),
        ("rwr", [], [[1], [2], [3]], [1, 2, 3]),
        ("wrw", [], [[1], [2], [3]], [1, 2, 3]),
        ("xtx", [], [[1], [2], [3]], [1, 2, 3]),
        ("fwfw", [(1, 3), (2, 4)], [], []),
    ],
)
def test_a_certificate_that_proves_is_accepted(
    path: str, pairs: Pairs, cubes: Cubes, chain: list[int]
) -> None:
    """Readers commute, whoever writes what they read does not, and what is undone is gone."""
    assert refusals(path, pairs, cubes, chain) == {}


@pytest.mark.parametrize(
    ("path", "pairs", "cubes", "chain", "fault"),
    [
        ("wrw", [(1, 3)], [[2]], [2], "cancelled: moves 1 and 3 are a pair, but move 2 is"),
        ("rwr", [(1, 3)], [[2]], [2], "cancelled: moves 1 and 3 are a pair, but move 2 is"),
        ("xtx", [(1, 3)], [[2]], [2], "cancelled: moves 1 and 3 are a pair, but move 2 is"),
        ("WtW", [(1, 3)], [[2]], [2], "cancelled: moves 1 and 3 are a pair, but move 2 is"),
        ("wrqrw", [(2, 4), (1, 5)], [[3]], [3], "cancelled: moves 1 and 5 are a pair, but move 3"),
        ("wrqqw", [(3, 4), (1, 5)], [[2]], [2], "cancelled: moves 1 and 5 are a pair, but move 2"),
        # What commutes is not what stands between.
        ("wfrw", [(1, 4)], [[2, 3]], [3], "cancelled: moves 1 and 4 are a pair, but move 3 is"),
        ("fwrw", [(2, 4)], [[1, 3]], [3], "cancelled: moves 2 and 4 are a pair, but move 3 is"),
        ("rwwr", [(1, 4)], [[2], [3]], [2, 3], "cancelled: moves 1 and 4 are a pair, but move 2"),
        ("wf", [(1, 2)], [], [], "cancelled: moves 1 and 2 are a pair, but they are not equal"),
        ("wv", [(1, 2)], [], [], "cancelled: moves 1 and 2 are a pair, but they are not equal"),
        ("ww", [(2, 1)], [], [], "cancelled: moves 2 and 1 are a pair, but the later one"),
        ("rw", [], [[1, 2]], [2], "schedule: move 2 does not commute with move 1 before it, but"),
        ("wr", [], [[1, 2]], [2], "schedule: move 2 does not commute with move 1 before it, but"),
        ("tW", [], [[1, 2]], [2], "schedule: move 2 does not commute with move 1 before it, but"),
        ("tx", [], [[1, 2]], [2], "schedule: move 2 does not commute with move 1 before it, but"),
        ("wr", [], [[2], [1]], [1, 2], "schedule: move 2 does not commute with move 1 before it,"),
        (
            "wrw",
            [],
            [[1], [2, 3]],
            [1, 2],
            "schedule: move 3 does not commute with move 2 before it, but is in cube 2, and that",
        ),
        ("rqw", [], [[2], [1, 3]], [2, 3], "schedule: move 3 does not commute with move 1 before"),
        # Nor is it what a move comes too early for; that is not gone, and in no lower cube.
        ("frw", [], [[1, 2, 3]], [3], "schedule: move 3 does not commute with move 2 before it"),
        ("wwrw", [(1, 2)], [[3, 4]], [3], "schedule: move 4 does not commute with move 3 before"),
        ("fwrw", [], [[1, 2], [3, 4]], [2, 3], "schedule: move 4 does not commute with move 3"),
        ("ww", [], [[1], [2]], [1, 2], "reduced: moves 1 and 2 remain, but are equal with nothing"),
        ("wrr", [], [[1], [2], [3]], [1, 2, 3], "reduced: moves 2 and 3 remain, but are equal"),
        ("rqr", [], [[1, 2], [3]], [1, 3], "reduced: moves 1 and 3 remain, but are equal"),
        ("xwtwtx", [(2, 4), (3, 5)], [[1], [6]], [1, 6], "reduced: moves 1 and 6 remain, but"),
        ("wrww", [], [[1], [2], [3], [4]], [1, 2, 3, 4], "reduced: moves 3 and 4 remain, but are"),
        ("rq", [], [[1], [2]], [1, 2], "chain: moves 1 and 2 are neighbours in the chain, but"),
        ("wf", [], [[1, 2]], [], "chain: the chain has 0 moves, and there are 1 cubes"),
        ("wrrw", [(2, 3)], [[1], [4]], [1, 2], "chain: move 2 is in the chain, but in no cube"),
        ("wf", [], [[1], [2]], [1, 2], "chain: moves 1 and 2 are neighbours in the chain, but"),
        ("wr", [], [[1], [2]], [2, 1], "chain: move 1 comes after move 2 in the chain, but not"),
        ("wr", [], [[1], [2]], [1, 1], "chain: move 1 comes after move 1 in the chain, but not"),
        ("wr", [], [[1], []], [1], "form: cube 2 holds no move"),
        ("wr", [], [[1], [3]], [1], "form: cube 2 has move 3, and the path has 2 moves"),
        ("wr", [], [[1], [0]], [1], "form: cube 2 has move 0, and the path has 2 moves"),
        ("wr", [(1, 2)], [[2]], [1], "form: move 2 is in pair 1, and again in cube 1"),
        ("wr", [], [[2]], [1], "form: move 1 is in no pair and in no cube"),
        ("wr", [], [[1]], [1], "form: move 2 is in no pair and in no cube"),
    ],
)
def test_the_check_that_fails_says_which_moves_are_at_fault(
    path: str, pairs: Pairs, cubes: Cubes, chain: list[int], fault: str
) -> None:
    """By their place in the path, the first that there are."""
    told = [f"{check}: {why}" for check, why in refusals(path, pairs, cubes, chain).items()]
    assert [each for each in told if each.startswith(fault)], told
    if fault.startswith("form: "):
        assert told == [fault]
