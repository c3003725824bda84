"""Checking a timetable of vehicles that follow one another against its input.

The timetable is carried out by the definition of its rule. If it is of the moves of its input, the
visits of every vertex must come in the order of the plan, and for every move the inequality that
binds it must hold with equality; so by induction along those inequalities no move can be earlier.
Nothing here is shared with what computes timetables.

In rounds: at the end of each, no two vehicles are at one vertex; no two swap places; a vertex where
somebody stands is entered only if that vehicle leaves it in this round, under the rule of CG:SHOP
2021 only in the same direction. With unequal times a vehicle holds the vertex that it leaves until
its move ends, and the one that it enters from when its move begins. Two hold one vertex only while
one leaves it and the other enters it, who neither begins nor ends earlier; under the rule of
CG:SHOP 2021 only in the same direction. No two are on one edge at one time in opposite directions.
"""

from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass, field
from itertools import chain, pairwise

from cubepath.protocol.core.sites import site_text
from cubepath.protocol.path_files.durations import time_from, time_text
from cubepath.protocol.path_files.following import FollowingFile, FollowingLine
from cubepath.protocol.plans.imported import VehiclePlan

Cell = tuple[int, int]


def why_illegal(timetable: FollowingFile, plan: VehiclePlan) -> str | None:
    """Return the first thing that a timetable does against its rule, None if it keeps to it.

    Only for lines of vehicles that the plan has.
    """
    rule = timetable.head.rule
    if timetable.head.rounds is not None:
        return why_not_in_rounds(timetable.lines, plan.starts, rule)
    ways: dict[int, list[FollowingLine]] = {vehicle: [] for vehicle in range(len(plan.starts))}
    for line in sorted(timetable.lines, key=lambda line: line.times):
        ways[line.vehicle].append(line)
    for vehicle, way in ways.items():
        why = _why_no_way(vehicle, plan.starts[vehicle], way)
        if why is not None:
            return why
    return _why_vertex_shared(ways, plan.starts, rule) or _why_edge_shared(timetable.lines)


def why_not_in_rounds(
    lines: Iterable[FollowingLine], starts: Iterable[Cell], rule: str
) -> str | None:
    """Return the first thing that moves of one round each do against a rule, None if nothing."""
    rounds: dict[int, list[FollowingLine]] = {}
    for line in lines:
        rounds.setdefault(line.round or 0, []).append(line)
    at = list(starts)
    for number, moving in sorted(rounds.items()):
        standing = {cell: vehicle for vehicle, cell in enumerate(at)}
        goes = {line.vehicle: line for line in moving}
        if len(goes) < len(moving):
            return f"round {number}: a vehicle moves twice"
        for line in moving:
            why = _why_not(line, at, standing, goes, rule)
            if why is not None:
                return f"round {number}: {_line_text(line)}: {why}"
        for line in moving:
            at[line.vehicle] = line.target
        if len(set(at)) < len(at):
            return f"round {number}: two vehicles are at {site_text(_twice(at))}"
    return None


def _why_not(
    line: FollowingLine,
    at: list[Cell],
    standing: dict[Cell, int],
    goes: dict[int, FollowingLine],
    rule: str,
) -> str | None:
    if at[line.vehicle] != line.source:
        return f"it is at {site_text(at[line.vehicle])}"
    there = standing.get(line.target)
    if there is None:
        return None
    ahead = goes.get(there)
    if ahead is None:
        return f"vehicle {there} stays there"
    if ahead.target == line.source:
        return f"vehicle {there} comes the other way"
    if rule == "cgshop" and _direction(ahead) != _direction(line):
        return f"vehicle {there} leaves it in another direction"
    return None


def _why_no_way(vehicle: int, start: Cell, way: list[FollowingLine]) -> str | None:
    """Return why the moves of a vehicle, in order of time, are no way from its start."""
    here = start
    for line in way:
        if line.source != here:
            return f"{_line_text(line)}: it is at {site_text(here)}"
        here = line.target
    for one, other in pairwise(way):
        if other.times[0] < one.times[1]:
            return f"vehicle {vehicle} begins a move at {_at(other)} before its last has ended"
    return None


def _why_vertex_shared(
    ways: dict[int, list[FollowingLine]], starts: Iterable[Cell], rule: str
) -> str | None:
    """Return where two vehicles hold one vertex without following."""
    stays: dict[Cell, list[tuple[FollowingLine | None, FollowingLine | None, int]]] = {}
    for vehicle, start in enumerate(starts):
        moves = (None, *ways[vehicle], None)
        for arrives, leaves in pairwise(moves):
            cell = start if arrives is None else arrives.target
            stays.setdefault(cell, []).append((arrives, leaves, vehicle))
    for cell, here in stays.items():
        here.sort(key=lambda stay: (stay[0] is not None, stay[0].times if stay[0] else ()))
        for (_, leaves, first), (arrives, _, second) in pairwise(here):
            if arrives is None:
                return f"vehicles {first} and {second} both start at {site_text(cell)}"
            if leaves is None:
                return f"{_line_text(arrives)}, at {_at(arrives)}: vehicle {first} stays there"
            (begin, end), (next_begin, next_end) = leaves.times, arrives.times
            if end <= next_begin:
                continue
            if next_begin < begin or next_end < end:
                return f"{_line_text(arrives)}, at {_at(arrives)}: vehicle {first} has not left it"
            if rule == "cgshop" and _direction(leaves) != _direction(arrives):
                return (
                    f"{_line_text(arrives)}, at {_at(arrives)}: vehicle {first} leaves it in"
                    " another direction"
                )
    return None


def _why_edge_shared(lines: Iterable[FollowingLine]) -> str | None:
    edges: dict[frozenset[Cell], list[FollowingLine]] = {}
    for line in lines:
        edges.setdefault(frozenset((line.source, line.target)), []).append(line)
    for along in edges.values():
        along.sort(key=lambda line: line.times)
        for one, other in pairwise(along):
            if other.times[0] < one.times[1]:
                return (
                    f"{_line_text(other)}, at {_at(other)}: vehicle {one.vehicle} is on that edge"
                )
    return None


def _direction(line: FollowingLine) -> Cell:
    return line.target[0] - line.source[0], line.target[1] - line.source[1]


def _line_text(line: FollowingLine) -> str:
    return f"vehicle {line.vehicle}, {site_text(line.source)} to {site_text(line.target)}"


def _at(line: FollowingLine) -> object:
    return time_text(line.times[0])


def _twice(at: list[Cell]) -> Cell:
    return next(cell for place, cell in enumerate(at) if cell in at[:place])


FOLLOWING_CHECKS = {
    "form": "each move of the input is in one cancelled pair or in one line, as in the input",
    "cancelled": "the moves of a pair undo each other, and nothing that is left comes between them",
    "reduced": "of the moves that remain none cancel",
    "order": "every vertex is visited in the order of the input",
    "rule": "from the starts on, every move is allowed by the rule",
    "end": "every vehicle ends where the input takes it",
    "makespan": "the last move ends when the first line says",
    "least": "a chain of moves that bind one another leads from every move to the start",
}
"""The checks of a timetable by name, with what holds if they pass."""


def check_following(timetable: FollowingFile, plan: VehiclePlan) -> dict[str, str | None]:
    """Return for each check that was made why it fails, None if it holds; nothing is raised.

    A timetable of other moves than those of the input is checked for `form`, `rule`, `end` and
    `makespan` alone: nothing proves it the least.
    """
    head = timetable.head
    if head.vehicles != len(plan.starts):
        return {"form": f"it is of {head.vehicles} vehicles, and the input has {len(plan.starts)}"}
    if head.cancelled is None:
        found = {"form": _only_edges(timetable, plan)}
    else:
        found = {"form": _same_moves(timetable, plan) or _equal_times(timetable)}
        if found["form"] is None:
            found |= _of_the_input(timetable, plan)
    if found["form"] is None:
        found["rule"] = why_illegal(timetable, plan)
        found["end"] = _end(timetable, plan)
        found["makespan"] = _makespan(timetable)
    return {name: found[name] for name in FOLLOWING_CHECKS if name in found}


def _only_edges(timetable: FollowingFile, plan: VehiclePlan) -> str | None:
    edges = {frozenset(edge) for edge in plan.edges()}
    for number, line in enumerate(timetable.lines, 2):
        if frozenset((line.source, line.target)) not in edges:
            return f"line {number}: {_goes(line)} is no edge of the workspace"
        if line.vehicle >= len(plan.starts):
            return f"line {number}: there is no vehicle {line.vehicle}"
        if line.move is not None or line.after is not None:
            return f'line {number}: has "move" or "after", but is of no input by its first line'
    return None


def _same_moves(timetable: FollowingFile, plan: VehiclePlan) -> str | None:
    head, moves = timetable.head, plan.moves
    if head.input_moves != len(moves):
        return f"it is of {head.input_moves} moves, and the input has {len(moves)}"
    met: set[int] = set()
    for move in chain.from_iterable(head.cancelled or ()):
        if not 1 <= move <= len(moves):
            return f"a pair has move {move}, and the input has {len(moves)} moves"
        if move in met:
            return f"move {move} is in two pairs"
        met.add(move)
    for number, line in enumerate(timetable.lines, 2):
        why = _other_move(line, plan, met)
        if why is not None:
            return f"line {number}: {why}"
    missing = next((move for move in range(1, len(moves) + 1) if move not in met), None)
    return None if missing is None else f"move {missing} of the input is in no pair and no line"


def _other_move(line: FollowingLine, plan: VehiclePlan, met: set[int]) -> str | None:
    """Return how a line differs from its move in the input, and add the move to those met."""
    move, moves = line.move, plan.moves
    if move is None or not 1 <= move <= len(moves):
        return f"is of no move of the input, which has {len(moves)}"
    if move in met:
        return f"move {move} is in another line or in a pair too"
    met.add(move)
    given = moves[move - 1]
    if (line.vehicle, line.source, line.target) == (given.vehicle, given.source, given.target):
        return None
    return (
        f"move {move} is of vehicle {given.vehicle} from {site_text(given.source)} to"
        f" {site_text(given.target)} in the input, not {_goes(line)}"
    )


def _equal_times(timetable: FollowingFile) -> str | None:
    if all(line.round is not None for line in timetable.lines):
        return None
    known: dict[frozenset[Cell], FollowingLine] = {}
    for number, line in enumerate(timetable.lines, 2):
        first = known.setdefault(frozenset((line.source, line.target)), line)
        if _taken(first) != _taken(line):
            return f"line {number}: {_goes(line)} takes another time than along this edge before"
    return None


def _taken(line: FollowingLine) -> object:
    begin, end = line.times
    return end - begin


def _goes(line: FollowingLine) -> str:
    return f"vehicle {line.vehicle}, {site_text(line.source)} to {site_text(line.target)}"


def _end(timetable: FollowingFile, plan: VehiclePlan) -> str | None:
    at = list(plan.starts)
    for line in sorted(timetable.lines, key=lambda line: line.times):
        at[line.vehicle] = line.target
    for vehicle, (found, expected) in enumerate(zip(at, plan.ends, strict=True)):
        if found != expected:
            return (
                f"vehicle {vehicle} ends at {site_text(found)},"
                f" in the input at {site_text(expected)}"
            )
    return None


def _makespan(timetable: FollowingFile) -> str | None:
    head = timetable.head
    last = max((line.times[1] for line in timetable.lines), default=None)
    stated = head.rounds if head.makespan is None else time_from(head.makespan)
    if stated != (last or 0):
        return (
            f"the last move ends at {time_text(last) if last else 0}, the first line says {stated}"
        )
    return None


@dataclass
class _Visits:
    """The steps of an input at each vertex, in order: moves alone, or those that rotate together.

    A step has the number of its first move.
    """

    plan: VehiclePlan
    rotations: dict[int, tuple[int, ...]] = field(default_factory=dict[int, tuple[int, ...]])
    rotation_of: dict[int, int] = field(default_factory=dict[int, int])
    at: defaultdict[Cell, list[int]] = field(default_factory=lambda: defaultdict(list))

    def __post_init__(self) -> None:
        at, moves = self.at, self.plan.moves
        for numbers in _steps(self.plan):
            step = numbers[0]
            if len(numbers) > 1:
                self.rotations[step] = numbers
                self.rotation_of.update(dict.fromkeys(numbers, step))
            else:
                at[moves[step - 1].target].append(step)
            for number in numbers:
                at[moves[number - 1].source].append(step)

    def step_of(self, move: int) -> int:
        return self.rotation_of.get(move, move)

    def moves_of(self, step: int) -> tuple[int, ...]:
        return self.rotations.get(step) or (step,)

    def cells(self, step: int) -> list[Cell]:
        if step in self.rotations:  # each vertex is left by one move, and entered by another
            return [self.plan.moves[move - 1].source for move in self.rotations[step]]
        move = self.plan.moves[step - 1]
        return [move.source, move.target]

    def undo(self, one: int, other: int) -> bool:
        """Return whether every move of a step is taken back by one of the other."""
        moves = self.plan.moves
        if one not in self.rotations and other not in self.rotations:
            there, back = moves[one - 1], moves[other - 1]
            return (there.vehicle, there.source, there.target) == (
                back.vehicle,
                back.target,
                back.source,
            )
        forth = [moves[move - 1] for move in self.moves_of(one)]
        back_again = [moves[move - 1] for move in self.moves_of(other)]
        return {(move.vehicle, move.target, move.source) for move in forth} == {
            (move.vehicle, move.source, move.target) for move in back_again
        }

    def adjacent(self, one: int, other: int) -> Cell | None:
        """Return a vertex at which another step comes between two steps, None if nowhere."""
        for cell in self.cells(one):
            here = self.at[cell]
            place = here.index(one) + 1
            if place == len(here) or here[place] != other:
                return cell
        return None

    def remove(self, step: int) -> None:
        for cell in self.cells(step):
            self.at[cell].remove(step)


def _steps(plan: VehiclePlan) -> Iterable[tuple[int, ...]]:
    """Yield the steps: the moves of a round that rotate together, and every other move alone."""
    rounds: dict[int, list[int]] = {}
    for number, move in enumerate(plan.moves, 1):
        if move.round is None:
            yield (number,)
        else:
            rounds.setdefault(move.round, []).append(number)
    for numbers in rounds.values():
        leaves = {plan.moves[number - 1].source: number for number in numbers}
        alone: set[int] = set()
        rotating: set[int] = set()
        for number in numbers:
            if number in rotating:
                continue
            walk: dict[int, None] = {number: None}
            ahead = leaves.get(plan.moves[number - 1].target)
            while ahead is not None and ahead not in walk and ahead not in alone:
                walk[ahead] = None
                ahead = leaves.get(plan.moves[ahead - 1].target)
            if ahead == number:
                rotating.update(walk)
                yield tuple(sorted(walk))
            else:
                alone.update(walk)
                yield (number,)


def _of_the_input(timetable: FollowingFile, plan: VehiclePlan) -> dict[str, str | None]:
    visits = _Visits(plan)
    lines = {line.move: line for line in timetable.lines if line.move is not None}
    why = _cancelled(timetable, visits)
    if why is not None:
        return {"cancelled": why}
    return {
        "cancelled": None,
        "reduced": _reduced(visits, lines),
        "order": _order(visits, lines),
        "least": _Binding(visits, lines, timetable.head.rule).why_not_least(),
    }


def _cancelled(timetable: FollowingFile, visits: _Visits) -> str | None:
    pairs = timetable.head.cancelled or []
    if any(one[1] >= other[1] for one, other in pairwise(pairs)):
        return "the pairs are not in order of their later moves"
    partner = dict(pairs)
    gone: set[int] = set()
    for earlier, later in pairs:
        one, other = visits.step_of(earlier), visits.step_of(later)
        if one in gone:
            continue  # of a rotation, whose other moves have been looked at
        moves = visits.moves_of(other)
        if sorted(partner.get(move, 0) for move in visits.moves_of(one)) != [*moves]:
            return f"moves {earlier} and {later}: of a rotation not all moves cancel together"
        if not visits.undo(one, other):
            return f"move {later} does not undo move {earlier}"
        between = visits.adjacent(one, other)
        if between is not None:
            return f"moves {earlier} and {later}: {site_text(between)} is visited between them"
        visits.remove(one)
        visits.remove(other)
        gone |= {one, other}
    return None


def _reduced(visits: _Visits, lines: dict[int, FollowingLine]) -> str | None:
    undone = {
        one: other
        for steps in visits.at.values()
        for one, other in pairwise(steps)
        if visits.undo(one, other) and visits.adjacent(one, other) is None
    }
    one = next((step for step in map(visits.step_of, lines) if step in undone), None)
    if one is None:
        return None
    return f"move {undone[one]} and move {one} undo each other, with nothing between them"


def _order(visits: _Visits, lines: dict[int, FollowingLine]) -> str | None:
    for cell, steps in visits.at.items():
        moves = (lines[move] for step in steps for move in _at_vertex(visits, step, cell))
        events = [(line, line.source == cell, line.times) for line in moves]
        for (one, one_leaves, times), (other, other_leaves, next_times) in pairwise(events):
            (begin, end), (next_begin, next_end) = times, next_times
            if one_leaves == other_leaves:
                return f"at {site_text(cell)} move {other.move} comes next to move {one.move}"
            in_order = begin <= next_begin and end <= next_end if one_leaves else end <= next_begin
            if not in_order:
                return f"at {site_text(cell)} move {other.move} is too early after move {one.move}"
    for rotation in visits.rotations.values():
        if rotation[0] in lines and len({lines[move].times for move in rotation}) > 1:
            return f"moves {', '.join(map(str, rotation))} rotate, but not at one time"
    return None


def _at_vertex(visits: _Visits, step: int, cell: Cell) -> Iterable[int]:
    """Return the moves of a step that leave or enter a vertex, the one that leaves it first."""
    rotation, moves = visits.rotations.get(step), visits.plan.moves
    if rotation is None:
        return (step,)
    leaves = [move for move in rotation if moves[move - 1].source == cell]
    return leaves + [move for move in rotation if moves[move - 1].target == cell]


class _Binding:
    """The inequalities that the lines name, each of which must hold with equality."""

    def __init__(self, visits: _Visits, lines: dict[int, FollowingLine], rule: str) -> None:
        self._lines = lines
        self._rule = rule
        self._left_last: dict[int, int] = {}
        """For each move that enters a vertex, the one by which it was left last before."""
        for cell, steps in visits.at.items():
            leaving: int | None = None
            for step in steps:
                for move in _at_vertex(visits, step, cell):
                    if lines[move].source == cell:
                        leaving = move
                    elif leaving is not None:
                        self._left_last[move] = leaving
        self._before: dict[int, int] = {}
        last: dict[int, int] = {}
        for move in sorted(lines):
            vehicle = lines[move].vehicle
            if vehicle in last:
                self._before[move] = last[vehicle]
            last[vehicle] = move

    def why_not_least(self) -> str | None:
        for move, line in self._lines.items():
            begin = line.times[0]
            if line.after is None:
                if begin:
                    return f'move {move} begins at {time_text(begin)}, and no "after" says why'
            elif line.after not in self._lines:
                return f"move {move} is after move {line.after}, which is in no line"
            elif begin != self._least(move, line.after):
                return f"move {move} could be earlier for all that move {line.after} does"
        return self._circle()

    def _least(self, move: int, after: int) -> object:
        """Return when a move may begin for all that another does, None if that does not bind it."""
        line, before = self._lines[move], self._lines[after]
        if self._before.get(move) == after:
            return before.times[1]
        if self._left_last.get(move) != after:
            return None
        (begin, end), (own_begin, own_end) = before.times, line.times
        straight = all(
            a + d == b + c
            for a, b, c, d in zip(
                before.source, before.target, line.source, line.target, strict=True
            )
        )
        if self._rule == "cgshop" and not straight:
            return end
        return max(begin, end - (own_end - own_begin))

    def _circle(self) -> str | None:
        known: set[int] = set()
        for move in self._lines:
            walk: dict[int, None] = {}
            here: int | None = move
            while here is not None and here not in known:
                if here in walk:
                    return f"move {here} is after itself, by a circle of moves"
                walk[here] = None
                here = self._lines[here].after
            known.update(walk)
        return None
