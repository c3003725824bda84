"""The least timetable of a plan whose vehicles may follow one another."""

from collections import Counter
from fractions import Fraction
from itertools import pairwise
from pathlib import Path
from random import Random

import pytest

from cubepath.coordinator.normal_form.heap import normal_cube_path
from cubepath.coordinator.theory.following.files import read_vehicle_plan, timetable_file
from cubepath.coordinator.theory.following.timetable import (
    RULES,
    FollowingTimetable,
    Rule,
    following_timetable,
)
from cubepath.coordinator.theory.proof_checking.following import check_following
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.path_files.durations import Durations
from cubepath.protocol.systems.graph import along_edge
from faces import ROOT
from oracles.vehicle_rounds import (
    Cell,
    Drawn,
    Move,
    draw_plan,
    groups_of,
    is_legal,
    obvious_timetable,
    plan_of,
    without_returns,
)

AGV = ROOT / "tests" / "data" / "agv"
PLANS = 240


def rounds_of(found: FollowingTimetable) -> dict[int, list[Move]]:
    rounds: dict[int, list[Move]] = {}
    for place, start in found.starts.items():
        move = found.plan.moves[place]
        rounds.setdefault(int(start) + 1, []).append((move.vehicle, move.source, move.target))
    return rounds


def timed_moves(found: FollowingTimetable) -> Counter[object]:
    moves = found.plan.moves
    return Counter(
        (moves[k].vehicle, moves[k].source, moves[k].target, start)
        for k, start in found.starts.items()
    )


def times_for(drawn: Drawn, seed: int) -> dict[frozenset[Cell], Fraction]:
    """Draw how long each edge takes, or nothing, which is 1 for all."""
    random = Random(seed)  # noqa: S311 - to be repeated
    if random.random() < 0.5:
        return {}
    cells = {cell for moves in drawn.rounds for move in moves for cell in move[1:]}
    return {
        frozenset((cell, (cell[0] + dx, cell[1] + dy))): Fraction(random.randint(1, 6), 2)
        for cell in sorted(cells)
        for dx, dy in ((1, 0), (0, 1))
    }


def has_unequal_rotation(drawn: Drawn, times: dict[frozenset[Cell], Fraction]) -> bool:
    """Return whether vehicles that rotate, and are not turned back, take unequal times."""
    return any(
        len({times.get(frozenset(move[1:]), 1) for move in group}) > 1
        for group in without_returns(groups_of(drawn))
    )


def test_random_plans_are_legal_and_never_later() -> None:
    """Many plans, rotations among them: a separate simulation allows every timetable."""
    rotations = trains = cancelled = 0
    for seed in range(PLANS):
        rule: Rule = RULES[seed % 2]
        drawn = draw_plan(seed, rule)
        found = following_timetable(drawn.plan(), rule)
        assert is_legal(drawn.starts, rounds_of(found), rule), seed
        moves = found.plan.moves
        assert all(start + 1 <= (moves[k].round or 0) for k, start in found.starts.items()), seed
        rotations += found.rotations
        cancelled += len(found.cancelled)
        starts = [(found.starts[k], moves[k]) for k in found.starts]
        left = {(start, move.source) for start, move in starts}
        trains += sum((start, move.target) in left for start, move in starts)
    assert min(rotations, trains, cancelled) > 8


def test_random_plans_have_the_least_solution() -> None:
    """It is what iteration to a fixpoint gives, with the same moves left."""
    for seed in range(PLANS):
        rule: Rule = RULES[seed % 2]
        drawn = draw_plan(seed, rule)
        found = following_timetable(drawn.plan(), rule)
        assert timed_moves(found) == Counter(obvious_timetable(drawn, rule, {})), seed


def test_either_rule_is_for_any_plan_that_does_not_rotate() -> None:
    """A plan that does not keep to CG:SHOP's rule gets a timetable that does."""
    longer = 0
    for seed in range(150):
        drawn = draw_plan(seed)
        plan = drawn.plan()
        if following_timetable(plan, "mapf").rotates:
            with pytest.raises(InputError, match="rotate"):
                following_timetable(plan, "cgshop")
            continue
        found = following_timetable(plan, "cgshop")
        assert is_legal(drawn.starts, rounds_of(found), "cgshop"), seed
        assert timed_moves(found) == Counter(obvious_timetable(drawn, "cgshop", {})), seed
        longer += found.makespan > (plan.rounds or 0)
    assert longer > 1


def test_unequal_times() -> None:
    """With unequal times it is the fixpoint too, and the checker allows it."""
    made = 0
    for seed in range(PLANS // 2):
        rule: Rule = RULES[seed % 2]
        drawn = draw_plan(seed, rule)
        times = times_for(drawn, seed)
        placed = {("edge", tuple(sorted(edge))): time for edge, time in times.items()}
        plan = drawn.plan()
        used = {tuple(sorted((move.source, move.target))) for move in plan.moves}
        durations = Durations(placed={key: t for key, t in placed.items() if key[1] in used})
        if has_unequal_rotation(drawn, times):
            with pytest.raises(InputError, match=r"rotate .* unequal times"):
                following_timetable(plan, rule, durations)
            continue
        found = following_timetable(plan, rule, durations)
        assert timed_moves(found) == Counter(obvious_timetable(drawn, rule, times)), seed
        checks = check_following(timetable_file(found, timed=True), plan)
        assert not any(checks.values()), (seed, checks)
        made += bool(times) and found.makespan > 0
    assert made > 20


def test_the_chain_is_as_long_as_the_timetable() -> None:
    """Each move of the chain begins as its predecessor lets it, and they span the makespan."""
    for seed in range(120):
        found = following_timetable(draw_plan(seed).plan(), "mapf")
        chain = found.chain
        assert bool(chain) == bool(found.starts)
        if chain:
            assert found.starts[chain[0]] == 0
            assert found.starts[chain[-1]] + 1 == found.makespan
            steps = [found.starts[b] - found.starts[a] for a, b in pairwise(chain)]
            assert set(steps) <= {0, 1}


def test_reduction_is_that_of_the_heap() -> None:
    """Without rotations as many moves are left as the normal cube path has."""
    compared = 0
    for seed in range(150):
        found = following_timetable(draw_plan(seed).plan(), "mapf")
        if not found.rotates:
            moves = [along_edge(*sorted((m.source, m.target))) for m in found.plan.moves]
            left = sum(map(len, normal_cube_path(moves)))
            assert len(found.starts) == left, seed
            compared += left < len(moves)
    assert compared > 12


@pytest.mark.parametrize(
    ("name", "rule", "rounds"),
    [
        ("grid8-12agents", "mapf", 12),
        ("grid8-12agents", "cgshop", 12),
        ("random-32-32-10-30agents", "mapf", 53),
        ("random-32-32-10-30agents", "cgshop", 53),
        ("cgshop2021-algae", "mapf", 51),
        ("cgshop2021-algae", "cgshop", 56),
    ],
)
def test_sample_plans(name: str, rule: Rule, rounds: int) -> None:
    """The figures of docs/schedules.md."""
    found = following_timetable(read_vehicle_plan(AGV / f"{name}.json"), rule)
    assert found.makespan == rounds
    assert not any(check_following(timetable_file(found), found.plan).values())


SQUARE: list[Cell] = [(0, 0), (1, 0), (1, 1), (0, 1)]


def turn(ring: list[Cell], *, times: int = 1) -> list[list[tuple[Cell, Cell]]]:
    return [list(zip(ring, [*ring[1:], ring[0]], strict=True))] * times


def square(rounds: list[list[tuple[Cell, Cell]]]) -> dict[str, object]:
    return {
        "grid": [2, 2],
        "starts": SQUARE,
        "goals": SQUARE,
        "moves": [move for moves in rounds for move in moves],
        "rounds": [len(moves) for moves in rounds],
    }


def test_a_rotation_is_one_step() -> None:
    """Four vehicles that fill a square turn twice in two rounds."""
    found = following_timetable(plan_of(square(turn(SQUARE, times=2))), "mapf")
    assert found.makespan == 2
    assert (found.rotations, len(found.starts)) == (2, 8)


def test_a_rotation_that_is_turned_back_cancels() -> None:
    """There and back is nothing, and the pairs are by vehicle."""
    back = turn(SQUARE) + turn(SQUARE[::-1])
    found = following_timetable(plan_of(square(back)), "mapf")
    assert found.makespan == 0
    assert (len(found.cancelled), found.chain) == (4, ())


def test_rotations_are_refused_by_the_rule_of_cgshop() -> None:
    """The line names the file, the round, the vehicles and a vertex."""
    with pytest.raises(InputError, match=r"plan.json: round 1: vehicles .* rotate at \[0, 0\]"):
        following_timetable(plan_of(square(turn(SQUARE))), "cgshop")


def test_rotations_take_equal_times() -> None:
    """Vehicles that rotate begin and end together, so unequal times are refused."""
    slow = Durations(placed={("edge", ((0, 0), (1, 0))): Fraction(2)})
    with pytest.raises(InputError, match="unequal times"):
        following_timetable(plan_of(square(turn(SQUARE))), "mapf", slow)


def test_swaps_are_refused_with_vehicles_vertex_and_round() -> None:
    """Two vehicles that change places along an edge are no plan under either rule."""
    swap: list[tuple[Cell, Cell]] = [((0, 0), (1, 0)), ((1, 0), (0, 0))]
    with pytest.raises(
        InputError, match=r"plan.json: round 2, vehicle 0, \[0,0\] to \[1,0\]: vehicle 1 comes"
    ):
        plan_of(square([[], swap]))


def test_a_duration_that_no_move_has_is_refused() -> None:
    """As for timetables of cubes."""
    with pytest.raises(InputError, match="'slide' is no generator"):
        following_timetable(
            plan_of(square(turn(SQUARE))), "mapf", Durations(named={"slide": Fraction(2)})
        )


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("logs/golden/hex-5.mcap", "a recording, whose rounds are cubes already"),
        ("tests/data/imports/slides.txt", "a plan of moves, not of vehicles"),
    ],
)
def test_other_inputs_are_refused(name: str, said: str) -> None:
    """Only plans of vehicles have rounds in which some follow."""
    from cubepath.protocol.file_forms import PlanHints

    hints = PlanHints("plain") if name.endswith(".txt") else PlanHints()
    with pytest.raises(InputError, match=said):
        read_vehicle_plan(Path(ROOT / name), "sliding" if hints.format else None, hints)
