"""Checking a certificate: a few lines that trust only the definition of an action and `commute`.

A certificate of an edge path a1 ... an names the pairs of moves that cancel, the cube of each
remaining move, and a chain of N dependent moves, where N is the number of cubes. `check_proof`
makes five checks. If all hold, the cubes are a schedule in the homotopy class of the path, and no
schedule in the class has fewer cubes:

1. `form`: each move of the path is in exactly one pair or cube, no other number is in any, and no
   cube is empty.
2. `cancelled`: when a pass over the path reaches the later move of a pair, it equals the earlier
   one, and each move between them commutes with both or has been taken out before. So the two can
   be brought side by side and taken out: they are a detour there and back. The pairs are in order
   of the later move, so that a reader of the path needs no list of all pairs.
3. `schedule`: of two remaining moves that do not commute, the earlier is in an earlier cube. So the
   moves of a cube commute, and the cubes in order are the path again, with commuting moves swapped.
4. `reduced`: between two equal remaining moves lies one that does not commute with them. So nothing
   is left to cancel. The normal form theorem for graph products of groups (Green 1990; Hermiller
   and Meier 1995), here of groups of order two, as Tits proved it for right-angled Coxeter groups,
   says: if everything that cancels in a path of the class is taken out, these same moves remain, in
   an order that differs by swaps of commuting moves. So every path of the class contains all of
   these moves, with those that do not commute in the same order as here.
5. `chain`: it has as many of the remaining moves as there are cubes, in the order of the path, and
   no two neighbours in it commute. In any schedule of the class these moves come in this order, no
   two in one cube, so the schedule has at least as many cubes.

Cost: each check is one pass over the path with a column for each site, and takes time and space
proportional to the sizes of the supports. Only a refused certificate is gone through once more, by
the definition, to name the moves at fault.

From the project it imports only the definition of an action.
"""

from collections.abc import Mapping, Sequence
from itertools import pairwise

from cubepath.protocol.core.actions import Action, commute
from cubepath.protocol.core.sites import Site

Pairs = Sequence[tuple[int, int]]
Cubes = Sequence[Sequence[int]]


def check_proof(
    path: Sequence[Action], cancelled: Pairs, cubes: Cubes, chain: Sequence[int]
) -> dict[str, str | None]:
    """Return for each check why it fails, None if it holds; see the docstring of this module.

    Moves are given by their place in the path, from 1. If `form` fails, no other check is made.

    >>> step, far = Action([1, 2], [1, 2], [1], [2]), Action([5, 6], [5, 6], [5], [6])
    >>> check_proof([step, far, step], [(1, 3)], [[2]], [2])
    {'form': None, 'cancelled': None, 'schedule': None, 'reduced': None, 'chain': None}
    >>> check_proof([step, far, step], [(1, 2)], [[3]], [3])["cancelled"]
    'moves 1 and 2 are a pair, but they are not equal'
    """
    form = _form(len(path), cancelled, cubes)
    if form is not None:
        return {"form": form}
    cube_of = {move: number for number, cube in enumerate(cubes, 1) for move in cube}
    left = [move for move in range(1, len(path) + 1) if move in cube_of]
    return {
        "form": None,
        "cancelled": _cancelled(path, cancelled),
        "schedule": _schedule(path, left, cube_of),
        "reduced": _reduced(path, left),
        "chain": _chain(path, len(cubes), chain, cube_of),
    }


def _form(moves: int, cancelled: Pairs, cubes: Cubes) -> str | None:
    pairs = [(f"pair {number}", pair) for number, pair in enumerate(cancelled, 1)]
    where: dict[int, str] = {}
    for name, members in [*pairs, *((f"cube {n}", cube) for n, cube in enumerate(cubes, 1))]:
        if not members:
            return f"{name} holds no move"
        for move in members:
            if not 1 <= move <= moves:
                return f"{name} has move {move}, and the path has {moves} moves"
            if move in where:
                return f"move {move} is in {where[move]}, and again in {name}"
            where[move] = name
    if len(where) < moves:
        missing = next(move for move in range(1, moves + 1) if move not in where)
        return f"move {missing} is in no pair and in no cube"
    return None


def _cancelled(path: Sequence[Action], cancelled: Pairs) -> str | None:
    earlier = {later: first for first, later in cancelled}
    # For each site: the remaining moves that write it, each with the number of readers above it.
    columns: dict[Site, list[tuple[int, int]]] = {}
    for move, action in enumerate(path, 1):
        first = earlier.get(move)
        if first is not None and first > move:
            return f"moves {first} and {move} are a pair, but the later one stands first"
        if first is not None and path[first - 1] != action:
            return f"moves {first} and {move} are a pair, but they are not equal"
        for site in action.trace:
            column = columns.setdefault(site, [(0, 0)])
            if first is None:
                column.append((move, 0))
            elif column.pop() != (first, 0):
                return _between(path, cancelled, first, move)
        for site in action.reads:
            column = columns.setdefault(site, [(0, 0)])
            writer, readers = column[-1]
            if first is not None and writer > first:
                return _between(path, cancelled, first, move)
            column[-1] = (writer, readers + (1 if first is None else -1))
    return _disorder(cancelled)


def _disorder(cancelled: Pairs) -> str | None:
    """Return a message if a pair comes before one whose later move is earlier, else None."""
    for number, (before, pair) in enumerate(pairwise(cancelled), 2):
        if pair[1] < before[1]:
            return (
                f"pair {number} ends at move {pair[1]}, and the one before at move {before[1]}:"
                " expected them in order of the later move"
            )
    return None


def _between(path: Sequence[Action], cancelled: Pairs, first: int, later: int) -> str:
    gone = {move for pair in cancelled if pair[1] < later for move in pair}
    for move in range(first + 1, later):
        if move not in gone and not commute(path[move - 1], path[first - 1]):
            return f"moves {first} and {later} are a pair, but move {move} is between them"
    raise AssertionError(f"nothing is between moves {first} and {later}")


def _schedule(
    path: Sequence[Action], left: Sequence[int], cube_of: Mapping[int, int]
) -> str | None:
    # For each site: the last cube so far with a move that writes it, and with one that uses it.
    written: dict[Site, int] = {}
    touched: dict[Site, int] = {}
    for move in left:
        action, cube = path[move - 1], cube_of[move]
        if any(touched.get(site, 0) >= cube for site in action.trace) or any(
            written.get(site, 0) >= cube for site in action.reads
        ):
            return _not_in_order(path, cube_of, move)
        for site in action.support:
            touched[site] = max(cube, touched.get(site, 0))
        for site in action.trace:
            written[site] = cube
    return None


def _not_in_order(path: Sequence[Action], cube_of: Mapping[int, int], move: int) -> str:
    action, cube = path[move - 1], cube_of[move]
    for other in range(1, move):
        if cube_of.get(other, 0) >= cube and not commute(path[other - 1], action):
            return (
                f"move {move} does not commute with move {other} before it, but is in cube {cube},"
                f" and that in cube {cube_of[other]}"
            )
    raise AssertionError(f"nothing is in the way of move {move}")


def _reduced(path: Sequence[Action], left: Sequence[int]) -> str | None:
    # For each site: the last move that writes it, and that uses it. For each action: its last move.
    written: dict[Site, int] = {}
    touched: dict[Site, int] = {}
    last: dict[Action, int] = {}
    for move in left:
        action = path[move - 1]
        before = last.get(action)
        if (
            before is not None
            and all(touched[site] == before for site in action.trace)
            and all(written.get(site, 0) < before for site in action.reads)
        ):
            return f"moves {before} and {move} remain, but are equal with nothing between them"
        last[action] = move
        touched.update(dict.fromkeys(action.support, move))
        written.update(dict.fromkeys(action.trace, move))
    return None


def _chain(
    path: Sequence[Action], cubes: int, chain: Sequence[int], cube_of: Mapping[int, int]
) -> str | None:
    if len(chain) != cubes:
        return f"the chain has {len(chain)} moves, and there are {cubes} cubes"
    for move in chain:
        if move not in cube_of:
            return f"move {move} is in the chain, but in no cube"
    for move, following in pairwise(chain):
        if move >= following:
            return f"move {following} comes after move {move} in the chain, but not in the path"
        if commute(path[move - 1], path[following - 1]):
            return f"moves {move} and {following} are neighbours in the chain, but they commute"
    return None
