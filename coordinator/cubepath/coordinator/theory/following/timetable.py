"""The least timetable of a plan whose vehicles may follow one another.

A plan is reduced first: a move and the next one along the same edge cancel if neither end of the
edge is visited between them, and so does a rotation with the one that turns it back. What remains
visits every vertex in the order of the plan. The timetable is the least solution of these
inequalities, where move m begins at s(m) and takes d(m):

- a vehicle's next move begins when its last has ended: s(n) >= s(m) + d(m);
- a vehicle that enters a vertex waits for the one that left it last, as `wait` says;
- the moves of a rotation begin together.

The planner's own rounds satisfy them if the planner kept to the rule, so no move is later than in
the plan. In the order of the plan every move comes after those it waits for, rotations apart, so
one pass finds the least solution, and for each move an inequality that holds with equality. A chain
of those from the last move back to the start is as long as the timetable: none is shorter with
these moves in this order. These moves do not commute, so there are no cubes and no classes here.

Under the rule of multi-agent path finding (`mapf`) a vehicle may enter a vertex while another
leaves it: it begins to enter no earlier than the other begins to leave, and arrives no earlier than
the other has left. Under that of CG:SHOP 2021 (`cgshop`) it may do so only in the direction in
which the other leaves; otherwise it begins when the other has left. Where all moves take one round,
"no earlier" is: in the same round, or later. Nobody swaps places along an edge. For unit squares
that move at a constant pace the rule of CG:SHOP is what their bodies allow.
"""

import time
from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from itertools import pairwise
from math import lcm
from typing import Final, Literal, TypeAlias

from cubepath.protocol.core.catalogue import GeneratorPlacement
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.sites import site_text
from cubepath.protocol.path_files.durations import Durations, Time, time_text
from cubepath.protocol.plans.imported import VehicleMove, VehiclePlan

Rule: TypeAlias = Literal["mapf", "cgshop"]
RULES: Final[tuple[Rule, ...]] = ("mapf", "cgshop")


def same_direction(one: VehicleMove, other: VehicleMove) -> bool:
    """Return whether two moves on a grid go in one direction."""
    return all(
        b - a == d - c
        for a, b, c, d in zip(one.source, one.target, other.source, other.target, strict=True)
    )


def may_overlap(rule: Rule, leaving: VehicleMove, entering: VehicleMove) -> bool:
    """Return whether a vertex may be entered by one move while another leaves it."""
    return rule == "mapf" or same_direction(leaving, entering)


def wait(rule: Rule, leaving: VehicleMove, entering: VehicleMove, times: tuple[int, int]) -> int:
    """Return how much later than `leaving` the move `entering` begins at least.

    `times` is how long the two take, in any unit.
    """
    leaves, enters = times
    return max(0, leaves - enters) if may_overlap(rule, leaving, entering) else leaves


Cell = tuple[int, int]
Pairs = tuple[tuple[int, int], ...]


TimetableStep: TypeAlias = tuple[int, ...]
"""Moves of a plan that are made at one time, by their places: a single move, or a rotation."""


@dataclass(frozen=True, eq=False)
class FollowingTimetable:
    """When each move that is left of a plan begins, under a rule; all places are from 0.

    `cancelled` are the places of moves that undo each other, each pair as (earlier, later), in
    order of the later. `rotates` says whether vehicles rotate in the plan, which then has no order
    of moves one by one. `steps` are the rest, in the order of the plan. `starts`, `durations`
    and `binding` are by place: `binding` is the place of a move because of which this one begins
    no earlier, None where it begins at 0. Cancelled moves are in none of the three. `seconds` is
    how long this took.
    """

    plan: VehiclePlan
    rule: Rule
    cancelled: Pairs
    steps: tuple[TimetableStep, ...]
    starts: dict[int, Time]
    durations: dict[int, Time]
    binding: dict[int, int | None]
    rotates: bool
    seconds: float

    @cached_property
    def makespan(self) -> Fraction:
        """When the last move ends."""
        ends = (start + self.durations[k] for k, start in self.starts.items())
        return Fraction(max(ends, default=0))

    @property
    def rotations(self) -> int:
        """How many rotations are left."""
        return sum(len(step) > 1 for step in self.steps)

    @cached_property
    def chain(self) -> tuple[int, ...]:
        """Places of moves that bind one another, from one that begins at 0 to one that ends last.

        Of the moves that end last, the first in the plan is taken.
        """
        found: list[int] = []
        last = next(
            (k for k, at in self.starts.items() if at + self.durations[k] == self.makespan), None
        )
        while last is not None:
            found.append(last)
            last = self.binding[last]
        return tuple(reversed(found))


def following_timetable(
    plan: VehiclePlan, rule: Rule, durations: Durations | None = None
) -> FollowingTimetable:
    """Return the least timetable of a plan under a rule; each move takes 1 without `durations`.

    InputError if vehicles rotate where the rule has no rotations, or take unequal times for it, and
    if a duration is given that no move has.
    """
    began = time.perf_counter()
    moves = plan.moves
    steps = steps_of(plan)
    for step in steps:
        if len(step) > 1 and rule == "cgshop":
            raise InputError(
                f"{_rotation(plan, step)}: under the rule of CG:SHOP 2021 nobody turns into a"
                " vertex that is being left; expected --following mapf"
            )
    cancelled, left = _reduced(plan, steps)
    taken = _durations(plan, durations)
    unit = lcm(*{each.denominator for each in taken})
    times = [each.numerator * (unit // each.denominator) for each in taken]
    for step in left:
        if len({times[place] for place in step}) > 1:
            raise InputError(
                f"{_rotation(plan, step)}: their moves take unequal times; expected one for all,"
                " as they begin and end together"
            )
    starts, binding = _least(moves, left, times, rule)
    return FollowingTimetable(
        plan,
        rule,
        cancelled,
        tuple(left),
        {**starts} if unit == 1 else {k: Fraction(start, unit) for k, start in starts.items()},
        {place: taken[place] for place in starts},
        binding,
        len(steps) < len(moves),
        round(time.perf_counter() - began, 3),
    )


def steps_of(plan: VehiclePlan) -> list[TimetableStep]:
    """Return the steps of a plan in its order: rotations, and all other moves one by one."""
    found: list[TimetableStep] = []
    moves = plan.moves
    if all(move.round is None for move in moves):
        return [(place,) for place in range(len(moves))]
    place = 0
    while place < len(moves):
        end = place + 1
        # A train, each move into what the one before it leaves, or a rotation, which closes.
        while not _closes(moves, place, end) and _goes_on(moves, end):
            end += 1
        train = tuple(range(place, end))
        rotates = _closes(moves, place, end)
        found += [train] if rotates else [(each,) for each in train]
        place = end
    return found


def _goes_on(moves: Sequence[VehicleMove], end: int) -> bool:
    if end == len(moves) or moves[end].round is None:
        return False
    before, after = moves[end - 1], moves[end]
    return before.round == after.round and before.source == after.target


def _closes(moves: Sequence[VehicleMove], first: int, end: int) -> bool:
    return end > first + 1 and moves[first].target == moves[end - 1].source


def _reduced(
    plan: VehiclePlan, steps: Sequence[TimetableStep]
) -> tuple[Pairs, list[TimetableStep]]:
    """Return the pairs of moves that cancel, and the steps that are left."""
    moves = plan.moves
    pairs: list[tuple[int, int]] = []
    gone: set[int] = set()
    # For each vertex the steps that visit it and are left so far, the last of them on top.
    visits: defaultdict[Cell, list[int]] = defaultdict(list)
    for number, step in enumerate(steps):
        ends = [visits[moves[place].source] for place in step]
        if len(step) == 1:
            ends.append(visits[moves[step[0]].target])
        before = {end[-1] if end else -1 for end in ends}
        last = before.pop()
        undone = None if before or last < 0 else _undone(moves, steps[last], step)
        if undone is None:
            for end in ends:
                end.append(number)
        else:
            for end in ends:
                end.pop()
            gone |= {last, number}
            pairs += undone
    left = [step for number, step in enumerate(steps) if number not in gone]
    return tuple(sorted(pairs, key=lambda pair: pair[1])), left


def _undone(
    moves: Sequence[VehicleMove], earlier: TimetableStep, later: TimetableStep
) -> list[tuple[int, int]] | None:
    """Return the pairs of moves by which a step takes back an earlier one, None if it does not."""
    by_vehicle = {moves[place].vehicle: place for place in earlier}
    found: list[tuple[int, int]] = []
    for place in later:
        back = moves[place]
        there = by_vehicle.get(back.vehicle)
        if there is None or (moves[there].source, moves[there].target) != (
            back.target,
            back.source,
        ):
            return None
        found.append((there, place))
    return found if len(found) == len(earlier) else None


def _durations(plan: VehiclePlan, durations: Durations | None) -> list[Time]:
    if durations is None:
        return [1] * len(plan.moves)
    names = {
        ends: GeneratorPlacement("edge", ends)
        for ends in (tuple(sorted((move.source, move.target))) for move in plan.moves)
    }
    unused = durations.unused(names.values()) if names else None
    if unused is not None:
        raise InputError(f"a duration is given, but {unused} of this path")
    taken = {ends: durations.of(name) for ends, name in names.items()}
    return [taken[tuple(sorted((move.source, move.target)))] for move in plan.moves]


def _least(
    moves: Sequence[VehicleMove], steps: Sequence[TimetableStep], times: Sequence[int], rule: Rule
) -> tuple[dict[int, int], dict[int, int | None]]:
    """Return the earliest start of each move that is left, and the move that binds it."""
    starts: dict[int, int] = {}
    binding: dict[int, int | None] = {}
    own: dict[int, int] = {}  # the last move of each vehicle
    left: dict[Cell, int] = {}  # the last move that left a vertex
    for step in steps:
        begin, binds, bound = 0, None, step[0]
        for place in step:
            move = moves[place]
            waits = [(own[move.vehicle], times[own[move.vehicle]])] if move.vehicle in own else []
            before = None if len(step) > 1 else left.get(move.target)
            if before is not None:
                both = times[before], times[place]
                waits.append((before, wait(rule, moves[before], move, both)))
            for earlier, delay in waits:
                if starts[earlier] + delay > begin:
                    begin, binds, bound = starts[earlier] + delay, earlier, place
        for place in step:
            starts[place] = begin
            binding[place] = binds if place == bound else None
            own[moves[place].vehicle] = place
            left[moves[place].source] = place
        if len(step) > 1 and begin:
            _bind_rotation(step, bound, binding)
    return starts, binding


def _bind_rotation(step: TimetableStep, bound: int, binding: dict[int, int | None]) -> None:
    """Let every move of a rotation but one follow the move whose vertex it enters."""
    ahead = zip(step, (step[-1], *step), strict=False)
    binding.update((place, before) for place, before in ahead if place != bound)


def _rotation(plan: VehiclePlan, step: TimetableStep) -> str:
    """Return the beginning of an error on a rotation: the file, the round, who and where."""
    moves = [plan.moves[place] for place in step]
    vehicles = [str(move.vehicle) for move in moves]
    return (
        f"{plan.path}: round {moves[0].round}: {plan.called}s {', '.join(vehicles[:-1])}"
        f" and {vehicles[-1]} rotate at {list(moves[0].source)}"
    )


def chain_in_words(found: FollowingTimetable, *, timed: bool = False) -> list[str]:
    """Return lines on why no timetable of these moves, in their order, is shorter."""
    if not found.chain:
        return ["Nothing moves."]
    count = len(found.chain)
    what = "A chain of one move" if count == 1 else f"A chain of {count} moves"
    lines = [f"{what}, each of which binds the next:", *_links(found, timed=timed)]
    whole = time_text(found.makespan)
    units = "" if timed else " round" if whole == 1 else " rounds"
    lines.append(
        f"Checked, so proved: under the rule {found.rule} these moves, with every vertex visited in"
        f" the order of the input, take at least {whole}{units}."
    )
    return lines


def _links(found: FollowingTimetable, *, timed: bool) -> Iterator[str]:
    moves = found.plan.moves
    reasons = [""] + [f"  {_why(found, one, other)}" for one, other in pairwise(found.chain)]
    for place, why in zip(found.chain, reasons, strict=True):
        move, start = moves[place], found.starts[place]
        when = f"from {time_text(start)}" if timed else f"round {int(start) + 1}"
        goes = f"{site_text(move.source)} to {site_text(move.target)}"
        called = f"{found.plan.called} {move.vehicle}"
        yield f"  {when:<8}  move {place + 1}  {called}, {goes}{why}"


def _why(found: FollowingTimetable, before: int, after: int) -> str:
    one, other = found.plan.moves[before], found.plan.moves[after]
    if one.vehicle == other.vehicle:
        return "after its last move"
    follows = found.rule == "mapf" or same_direction(one, other)
    return f"{'follows' if follows else 'waits for'} {found.plan.called} {one.vehicle}"
