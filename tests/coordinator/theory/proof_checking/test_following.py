"""Timetables of vehicles that follow one another, checked: what holds passes, all else is seen."""

import io
import re
from collections.abc import Callable
from pathlib import Path
from random import Random

import msgspec
import pytest

from cubepath.coordinator.theory.following.files import timetable_file
from cubepath.coordinator.theory.following.timetable import RULES, following_timetable
from cubepath.coordinator.theory.proof_checking.following import (
    FOLLOWING_CHECKS,
    check_following,
    why_illegal,
)
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.input_files import InputFile
from cubepath.protocol.path_files.following import (
    FollowingFile,
    FollowingHead,
    FollowingLine,
    read_following,
)
from cubepath.protocol.plans.imported import VehiclePlan
from oracles.vehicle_rounds import Drawn, Move, draw_plan, is_legal


def timetable(seed: int, rule: str = "mapf") -> tuple[FollowingFile, VehiclePlan]:
    plan = draw_plan(seed, rule).plan()
    return timetable_file(following_timetable(plan, "mapf" if rule == "mapf" else "cgshop")), plan


def timed(file: FollowingFile) -> FollowingFile:
    """Return a timetable of rounds by times, which say the same."""
    lines = [
        msgspec.structs.replace(line, round=None, start=line.round - 1, end=line.round)
        for line in file.lines
        if line.round is not None
    ]
    head = msgspec.structs.replace(file.head, rounds=None, makespan=file.head.rounds)
    return FollowingFile(head, tuple(lines))


def moved_at_random(drawn: Drawn, random: Random, rule: str) -> FollowingFile:
    """Return the moves of a plan, each vehicle's in order, a few of them in other rounds."""
    lines: list[FollowingLine] = []
    late: dict[int, int] = {}
    for number, moves in enumerate(drawn.rounds, 1):
        for who, source, target in moves:
            late[who] = late.get(who, 0) + (random.random() < 0.05)
            lines.append(FollowingLine(who, source, target, round=number + late[who]))
    rounds = max((line.round or 0 for line in lines), default=0)
    head = FollowingHead(
        "mapf" if rule == "mapf" else "cgshop",
        vehicles=len(drawn.starts),
        moves=len(lines),
        rounds=rounds,
    )
    return FollowingFile(head, tuple(lines))


def rounds_of(file: FollowingFile) -> dict[int, list[Move]]:
    rounds: dict[int, list[Move]] = {}
    for line in file.lines:
        rounds.setdefault(line.round or 0, []).append((line.vehicle, line.source, line.target))
    return rounds


def test_the_rule_is_judged_as_by_simulation() -> None:
    """Of random timetables those are allowed that a separate simulation allows; so by times."""
    verdicts = [0, 0]
    for seed in range(500):
        rule = RULES[seed // 2 % 2]
        random = Random(seed)  # noqa: S311 - to be repeated
        drawn = draw_plan(seed, RULES[seed % 2])
        file, plan = moved_at_random(drawn, random, rule), drawn.plan()
        legal = is_legal(drawn.starts, rounds_of(file), rule)
        assert (why_illegal(file, plan) is None) == legal, seed
        assert (why_illegal(timed(file), plan) is None) == legal, (seed, why_illegal(file, plan))
        verdicts[legal] += 1
    assert min(verdicts) > 75


def test_every_timetable_passes_every_check() -> None:
    """By rounds, and by times that say the same."""
    for seed in range(80):
        file, plan = timetable(seed, RULES[seed % 2])
        for each in (file, timed(file)):
            found = check_following(each, plan)
            assert set(found) == set(FOLLOWING_CHECKS)
            assert not any(found.values()), (seed, found)


def line_changed(file: FollowingFile, place: int, **changes: object) -> FollowingFile:
    lines = list(file.lines)
    lines[place] = msgspec.structs.replace(lines[place], **changes)
    return FollowingFile(file.head, tuple(lines))


def head_changed(file: FollowingFile, **changes: object) -> FollowingFile:
    return FollowingFile(msgspec.structs.replace(file.head, **changes), file.lines)


def delayed(file: FollowingFile, place: int) -> FollowingFile:
    return line_changed(file, place, round=(file.lines[place].round or 0) + 1)


def hastened(file: FollowingFile, place: int) -> FollowingFile:
    return line_changed(file, place, round=max(1, (file.lines[place].round or 0) - 1))


def all_later(file: FollowingFile, _place: int) -> FollowingFile:
    lines = [msgspec.structs.replace(line, round=(line.round or 0) + 1) for line in file.lines]
    rounds = (file.head.rounds or 0) + 1
    return FollowingFile(msgspec.structs.replace(file.head, rounds=rounds), tuple(lines))


def unbound(file: FollowingFile, place: int) -> FollowingFile:
    return line_changed(file, place, after=None)


def bound_by_itself(file: FollowingFile, place: int) -> FollowingFile:
    return line_changed(file, place, after=file.lines[place].move)


def another_vehicle(file: FollowingFile, place: int) -> FollowingFile:
    other = (file.lines[place].vehicle + 1) % max(2, file.head.vehicles)
    return line_changed(file, place, vehicle=other)


def another_move(file: FollowingFile, place: int) -> FollowingFile:
    return line_changed(file, place, move=(file.lines[place].move or 0) + 1)


def without_a_line(file: FollowingFile, place: int) -> FollowingFile:
    return FollowingFile(file.head, file.lines[:place] + file.lines[place + 1 :])


def twice_a_line(file: FollowingFile, place: int) -> FollowingFile:
    return FollowingFile(file.head, (*file.lines, file.lines[place]))


def without_a_pair(file: FollowingFile, _place: int) -> FollowingFile:
    return head_changed(file, cancelled=(file.head.cancelled or [])[1:])


def other_rounds(file: FollowingFile, _place: int) -> FollowingFile:
    return head_changed(file, rounds=(file.head.rounds or 0) + 1)


def one_vehicle_more(file: FollowingFile, _place: int) -> FollowingFile:
    return head_changed(file, vehicles=file.head.vehicles + 1)


def pair_cancelled(file: FollowingFile, place: int) -> FollowingFile:
    """Let two moves of a vehicle cancel that do not."""
    line = file.lines[place]
    own = [other for other in file.lines if other.vehicle == line.vehicle and other != line]
    if not own or line.move is None or own[0].move is None:
        return file
    pair = min(line.move, own[0].move), max(line.move, own[0].move)
    pairs = [*(file.head.cancelled or []), pair]
    pairs.sort(key=lambda each: each[1])
    lines = tuple(each for each in file.lines if each not in (line, own[0]))
    return FollowingFile(msgspec.structs.replace(file.head, cancelled=pairs), lines)


@pytest.mark.parametrize(
    "tamper",
    [
        delayed,
        hastened,
        all_later,
        unbound,
        bound_by_itself,
        another_vehicle,
        another_move,
        without_a_line,
        twice_a_line,
        without_a_pair,
        other_rounds,
        one_vehicle_more,
        pair_cancelled,
    ],
)
def test_tampering_is_seen(tamper: Callable[[FollowingFile, int], FollowingFile]) -> None:
    """Whatever is changed in a timetable, some check fails, or nothing was changed."""
    seen = 0
    for seed in range(60):
        file, plan = timetable(seed, RULES[seed % 2])
        if not file.lines:
            continue
        place = seed % len(file.lines)
        changed = tamper(file, place)
        if changed == file or (tamper is unbound and file.lines[place].after is None):
            continue
        found = check_following(changed, plan)
        assert any(found.values()), seed
        seen += 1
    assert seen > 4


def test_a_timetable_without_moves_of_the_input() -> None:
    """It is judged by rule and ends alone, and its moves must be edges of the workspace."""
    drawn = draw_plan(21)
    file = moved_at_random(drawn, Random(1), "mapf")  # noqa: S311 - to be repeated
    plan = drawn.plan()
    assert set(check_following(file, plan)) == {"form", "rule", "end", "makespan"}
    away = line_changed(file, 0, target=(90, 90))
    assert check_following(away, plan)["form"] is not None
    short = FollowingFile(file.head, file.lines[:-1])
    assert check_following(short, plan)["end"] is not None


def test_whatever_a_file_says_is_judged() -> None:
    """Numbers in a file changed at random, one or many: each is refused or checked, or holds."""
    judged = 0
    for seed in range(300):
        random = Random(seed)  # noqa: S311 - to be repeated
        file, plan = timetable(seed % 50, RULES[seed % 2])
        words = re.split(
            rb"(-?\d+)", b"\n".join(map(msgspec.json.encode, [file.head, *file.lines]))
        )
        for _ in range(random.randint(1, 4)):
            place = random.randrange(3, len(words), 2)  # the first number is of the format
            words[place] = str(random.choice([0, 1, 2, random.randint(-2, 30)])).encode()
        try:
            changed = read_following(InputFile(Path("changed"), io.BytesIO(b"".join(words))))
        except InputError:
            continue
        found = check_following(changed, plan)
        assert changed == file or any(found.values()), (seed, words)
        judged += changed != file
    assert judged > 40
