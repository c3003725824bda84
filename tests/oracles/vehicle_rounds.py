"""Random plans of vehicles in rounds, and the obvious ways to judge and to time them."""

import io
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from random import Random
from typing import Any

import msgspec

from cubepath.coordinator.theory.following.files import read_vehicle_plan
from cubepath.protocol.core.input_files import InputFile
from cubepath.protocol.plans.imported import VehiclePlan

Cell = tuple[int, int]
Move = tuple[int, Cell, Cell]


@dataclass
class Drawn:
    """A plan as drawn: where the vehicles start, and the moves of each round."""

    starts: list[Cell]
    rounds: list[list[Move]]
    size: Cell

    def document(self) -> dict[str, Any]:
        at = list(self.starts)
        for moves in self.rounds:
            for who, _, target in moves:
                at[who] = target
        return {
            "grid": self.size,
            "starts": self.starts,
            "goals": at,
            "moves": [(source, target) for moves in self.rounds for _, source, target in moves],
            "rounds": [len(moves) for moves in self.rounds],
        }

    def plan(self) -> VehiclePlan:
        return plan_of(self.document())


def plan_of(document: dict[str, Any]) -> VehiclePlan:
    """Read a scenario that is no file."""
    text = io.BytesIO(msgspec.json.encode(document))
    return read_vehicle_plan(InputFile(Path("plan.json"), text))


def draw_plan(seed: int, rule: str = "mapf") -> Drawn:
    """Draw a plan that is legal under a rule, crowded: with trains, waits, rotations, returns."""
    random = Random(seed)  # noqa: S311 - to be repeated
    size = random.randint(2, 5), random.randint(2, 5)
    cells = [(x, y) for x in range(size[0]) for y in range(size[1])]
    starts = random.sample(cells, random.randint(1, max(1, len(cells) * 4 // 5)))
    at, rounds, eager = list(starts), list[list[Move]](), random.uniform(0.2, 1)
    for _ in range(random.randint(0, 12)):
        if rounds and random.random() < 0.2:
            wanted = {who: source for who, source, _ in rounds[-1] if random.random() < 0.8}
        else:
            wanted = {who: _beside(random, at[who]) for who in range(len(at))}
            wanted = {who: cell for who, cell in wanted.items() if random.random() < eager}
            wanted |= _rotation(random, at, size) if random.random() < 0.4 else {}
        wanted = {who: cell for who, cell in wanted.items() if cell in cells}
        moves = _allowed(at, wanted, rule)
        random.shuffle(moves)
        rounds.append(moves)
        for who, _, target in moves:
            at[who] = target
    return Drawn(starts, rounds, size)


def _beside(random: Random, cell: Cell) -> Cell:
    dx, dy = random.choice([(1, 0), (-1, 0), (0, 1), (0, -1)])
    return cell[0] + dx, cell[1] + dy


def _rotation(random: Random, at: list[Cell], size: Cell) -> dict[int, Cell]:
    x, y = random.randrange(size[0] - 1), random.randrange(size[1] - 1)
    ring = [(x, y), (x + 1, y), (x + 1, y + 1), (x, y + 1)]
    if random.random() < 0.5:
        ring.reverse()
    standing = {cell: who for who, cell in enumerate(at)}
    ahead = zip(ring, [*ring[1:], ring[0]], strict=True)
    return {standing[cell]: target for cell, target in ahead if cell in standing}


def _allowed(at: list[Cell], wanted: dict[int, Cell], rule: str) -> list[Move]:
    """Return the moves that are left when what breaks the rule is taken out, one by one."""
    while True:
        moves = [(who, at[who], target) for who, target in wanted.items()]
        wrong = first_wrong(at, moves, rule)
        if wrong is None:
            return moves
        del wanted[wrong]


def first_wrong(at: list[Cell], moves: list[Move], rule: str) -> int | None:
    """Return a vehicle whose move breaks the rule in a round, None if there is none."""
    standing = {cell: who for who, cell in enumerate(at)}
    goes = {who: target for who, _, target in moves}
    entered: set[Cell] = set()
    for who, source, target in moves:
        there = standing.get(target)
        if target in entered or source != at[who] or target == source:
            return who
        entered.add(target)
        if there is None:
            continue
        if there not in goes or goes[there] == source:
            return who
        ahead = goes[there]
        turns = (target[0] - source[0], target[1] - source[1]) != (
            ahead[0] - target[0],
            ahead[1] - target[1],
        )
        if rule == "cgshop" and turns:
            return who
    return None


def is_legal(starts: list[Cell], rounds: dict[int, list[Move]], rule: str) -> bool:
    """Return whether rounds are legal from the starts on."""
    at = list(starts)
    for number in sorted(rounds):
        if first_wrong(at, rounds[number], rule) is not None:
            return False
        for who, _, target in rounds[number]:
            at[who] = target
    return True


def obvious_timetable(drawn: Drawn, rule: str, times: dict[frozenset[Cell], Fraction]) -> set[Any]:
    """Return vehicle, source, target and start of each move, by iteration to a fixpoint.

    Groups of moves that undo each other are taken out as long as there are any; then all
    inequalities are listed, and starts are raised until they hold.
    """
    groups = without_returns(groups_of(drawn))
    moves = [move for group in groups for move in group]
    taken = [times.get(frozenset(move[1:]), Fraction(1)) for move in moves]
    number = {(place, move): k for k, (place, move) in enumerate(_placed(groups))}
    later: list[tuple[int, int, Fraction]] = []  # one, other: other begins so much later
    for place, group in enumerate(groups):
        for move in group:
            k = number[place, move]
            for before in range(place - 1, -1, -1):
                own = [other for other in groups[before] if other[0] == move[0]]
                if own:
                    j = number[before, own[0]]
                    later.append((j, k, taken[j]))
                    break
            for before in range(place, -1, -1):
                left = [other for other in groups[before] if other[1] == move[2]]
                if left and left[0] != move:
                    j = number[before, left[0]]
                    later.append((j, k, _delay(rule, left[0], move, (taken[j], taken[k]))))
                    break
            later += [(number[place, other], k, Fraction(0)) for other in group]
    starts = [Fraction(0)] * len(moves)
    changed = True
    while changed:
        changed = False
        for one, other, delay in later:
            if starts[other] < starts[one] + delay:
                starts[other], changed = starts[one] + delay, True
    return {(*move, start) for move, start in zip(moves, starts, strict=True)}


def _delay(rule: str, leaves: Move, enters: Move, both: tuple[Fraction, Fraction]) -> Fraction:
    straight = all(
        leaves[2][axis] - leaves[1][axis] == enters[2][axis] - enters[1][axis] for axis in (0, 1)
    )
    if rule == "cgshop" and not straight:
        return both[0]
    return max(Fraction(0), both[0] - both[1])


def _placed(groups: list[list[Move]]) -> list[tuple[int, Move]]:
    return [(place, move) for place, group in enumerate(groups) for move in group]


def groups_of(drawn: Drawn) -> list[list[Move]]:
    """Return the moves in an order in which a vertex is left before it is entered."""
    found: list[list[Move]] = []
    for moves in drawn.rounds:
        left = list(moves)
        while left:
            sources = {source for _, source, _ in left}
            free = [move for move in left if move[2] not in sources]
            if free:
                found += [[move] for move in free]
                left = [move for move in left if move not in free]
                continue
            ring = [left[0]]
            while (ahead := next(m for m in left if m[1] == ring[-1][2])) != ring[0]:
                ring.append(ahead)
            found.append(ring)
            left = [move for move in left if move not in ring]
    return found


def without_returns(groups: list[list[Move]]) -> list[list[Move]]:
    def cells(group: list[Move]) -> set[Cell]:
        return {cell for _, source, target in group for cell in (source, target)}

    for one, group in enumerate(groups):
        back = {(who, target, source) for who, source, target in group}
        for other in range(one + 1, len(groups)):
            if set(groups[other]) == back:
                rest = groups[:one] + groups[one + 1 : other] + groups[other + 1 :]
                return without_returns(rest)
            if cells(groups[other]) & cells(group):
                break
    return groups
