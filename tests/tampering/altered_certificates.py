"""Certificates with something changed in them: by hand, with what is said of it, and at random."""

from collections.abc import Callable
from random import Random

from msgspec.structs import replace

from cubepath.protocol.path_files.certificates import Certificate
from samples.strategies import Word, toggle

ROAD = [toggle(n, reads=[n - 1], label=f"step {n}") for n in range(1, 6)]
"""Five moves, each of which waits for the one before."""
SIDE = toggle(50, label="aside")
HUB = toggle("hub", label="hub")
PATH = [ROAD[0], SIDE, HUB, ROAD[1], SIDE, ROAD[2], HUB, ROAD[3], ROAD[4], toggle(60)]
GOOD = Certificate(10, [(2, 5), (3, 7)], [[1, 10], [4], [6], [8], [9]], [1, 4, 6, 8, 9])

WRONG: dict[str, tuple[Word, Certificate, str, str]] = {
    "two pairs mixed up": (
        PATH,
        replace(GOOD, cancelled=[(2, 7), (3, 5)]),
        "cancelled",
        "moves 3 and 5 are a pair, but they are not equal",
    ),
    "a pair the wrong way round": (
        PATH,
        replace(GOOD, cancelled=[(5, 2), (3, 7)]),
        "cancelled",
        "moves 5 and 2 are a pair, but the later one stands first",
    ),
    "pairs out of order": (
        PATH,
        replace(GOOD, cancelled=[(3, 7), (2, 5)]),
        "cancelled",
        "pair 2 ends at move 5, and the one before at move 7: expected them in order of the later",
    ),
    "a pair left out": (
        PATH,
        replace(GOOD, cancelled=[(3, 7)]),
        "form",
        "move 2 is in no pair and in no cube",
    ),
    "a pair left out, its moves kept": (
        PATH,
        replace(GOOD, cancelled=[(3, 7)], cubes=[[1, 2, 10], [4, 5], *GOOD.cubes[2:]]),
        "reduced",
        "moves 2 and 5 remain, but are equal with nothing between them",
    ),
    "a pair across a writer": (
        [ROAD[0], toggle(1), ROAD[0]],
        Certificate(3, [(1, 3)], [[2]], [2]),
        "cancelled",
        "moves 1 and 3 are a pair, but move 2 is between them",
    ),
    "a pair across a reader": (
        [toggle(1), ROAD[1], toggle(1)],
        Certificate(3, [(1, 3)], [[2]], [2]),
        "cancelled",
        "moves 1 and 3 are a pair, but move 2 is between them",
    ),
    "a pair across a writer of what it reads": (
        [ROAD[1], toggle(1), ROAD[1]],
        Certificate(3, [(1, 3)], [[2]], [2]),
        "cancelled",
        "moves 1 and 3 are a pair, but move 2 is between them",
    ),
    "two pairs that cross": (
        [toggle(1), ROAD[0], toggle(1), ROAD[0]],
        Certificate(4, [(1, 3), (2, 4)], [], []),
        "cancelled",
        "moves 1 and 3 are a pair, but move 2 is between them",
    ),
    "cube numbers swapped": (
        PATH,
        replace(GOOD, cubes=[[1, 10], [6], [4], [8], [9]]),
        "schedule",
        "move 6 does not commute with move 4 before it, but is in cube 2, and that in cube 3",
    ),
    "two cubes in one": (
        PATH,
        replace(GOOD, cubes=[[1, 10], [4], [6], [8, 9]], chain=[1, 4, 6, 8]),
        "schedule",
        "move 9 does not commute with move 8 before it, but is in cube 4, and that in cube 4",
    ),
    "a shorter chain": (
        PATH,
        replace(GOOD, chain=[1, 4, 6, 8]),
        "chain",
        "the chain has 4 moves, and there are 5 cubes",
    ),
    "one cube too many": (
        PATH,
        replace(GOOD, cubes=[[10], [1], [4], [6], [8], [9]]),
        "chain",
        "the chain has 5 moves, and there are 6 cubes",
    ),
    "neighbours that commute": (
        PATH,
        replace(GOOD, chain=[1, 4, 6, 8, 10]),
        "chain",
        "moves 8 and 10 are neighbours in the chain, but they commute",
    ),
    "a chain against the path": (
        PATH,
        replace(GOOD, chain=[4, 1, 6, 8, 9]),
        "chain",
        "move 1 comes after move 4 in the chain, but not in the path",
    ),
    "one move twice in the chain": (
        PATH,
        replace(GOOD, chain=[1, 4, 4, 8, 9]),
        "chain",
        "move 4 comes after move 4 in the chain, but not in the path",
    ),
    "a cancelled move in the chain": (
        PATH,
        replace(GOOD, chain=[1, 4, 5, 8, 9]),
        "chain",
        "move 5 is in the chain, but in no cube",
    ),
    "a move of the chain that is none": (
        PATH,
        replace(GOOD, chain=[1, 4, 6, 8, 11]),
        "chain",
        "move 11 is in the chain, but in no cube",
    ),
    "an index of 0": (
        PATH,
        replace(GOOD, cancelled=[(0, 5), (3, 7)]),
        "form",
        "pair 1 has move 0, and the path has 10 moves",
    ),
    "an index beyond the end": (
        PATH,
        replace(GOOD, cubes=[[1, 11], *GOOD.cubes[1:]]),
        "form",
        "cube 1 has move 11, and the path has 10 moves",
    ),
    "an index twice": (
        PATH,
        replace(GOOD, cubes=[[1, 10, 2], *GOOD.cubes[1:]]),
        "form",
        "move 2 is in pair 1, and again in cube 1",
    ),
    "a move left out": (
        PATH,
        replace(GOOD, cubes=[[1], *GOOD.cubes[1:]]),
        "form",
        "move 10 is in no pair and in no cube",
    ),
    "a cube of nothing": (PATH, replace(GOOD, cubes=[*GOOD.cubes, []]), "form", "cube 6 holds no"),
    "a path that goes on": ([*PATH, SIDE], GOOD, "form", "move 11 is in no pair and in no cube"),
}


Tampering = Callable[[Certificate, Random], Certificate]


def _swap(found: Certificate, random: Random) -> Certificate:
    """Put two moves, of cubes or of pairs, in each other's place."""
    one, other = random.randrange(found.moves) + 1, random.randrange(found.moves) + 1
    to = {one: other, other: one}
    return replace(
        found,
        cancelled=[(to.get(a, a), to.get(b, b)) for a, b in found.cancelled],
        cubes=[[to.get(move, move) for move in cube] for cube in found.cubes],
    )


def _unpair(found: Certificate, random: Random) -> Certificate:
    pairs = list(found.cancelled)
    if not pairs:
        return found
    first, later = pairs.pop(random.randrange(len(pairs)))
    cubes = [*map(list, found.cubes), [], []]
    cubes[random.randrange(len(cubes))].append(first)
    cubes[random.randrange(len(cubes))].append(later)
    return replace(found, cancelled=pairs, cubes=[cube for cube in cubes if cube])


def _pair_up(found: Certificate, random: Random) -> Certificate:
    left = [move for cube in found.cubes for move in cube]
    if len(left) < 2:
        return found
    first, later = sorted(random.sample(left, 2))
    cubes = [[move for move in cube if move not in (first, later)] for cube in found.cubes]
    pairs = [*found.cancelled, (first, later)]
    return replace(found, cancelled=pairs, cubes=[cube for cube in cubes if cube])


def _move_on(found: Certificate, random: Random) -> Certificate:
    if not found.cubes:
        return found
    cubes = [*map(list, found.cubes), []]
    cube = random.choice(cubes[:-1])
    random.choice(cubes).append(cube.pop(random.randrange(len(cube))))
    return replace(found, cubes=[cube for cube in cubes if cube])


def _rechain(found: Certificate, random: Random) -> Certificate:
    chain = list(found.chain)
    if not chain:
        return found
    chain[random.randrange(len(chain))] = random.randrange(found.moves) + 1
    return replace(found, chain=chain)


def _match_chain(found: Certificate, random: Random) -> Certificate:
    return replace(found, chain=[random.choice(cube) for cube in found.cubes])


TAMPERINGS: tuple[Tampering, ...] = (_swap, _unpair, _pair_up, _move_on, _rechain, _match_chain)
