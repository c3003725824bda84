"""Triangulations under flips: of a convex polygon, and of any planar point set.

Source: Abrams and Ghrist, examples ("triangulations of polygons with edge-flipping as the
generator"). Files of points are plain text or JSON, as the CG:SHOP 2026 challenge has them.
"""

import json
import re
from collections.abc import Iterable
from dataclasses import dataclass
from fractions import Fraction
from math import cos, lcm, pi, sin
from pathlib import Path
from random import Random
from typing import Any

from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.input_files import read_text
from cubepath.protocol.core.parsing import check_keys
from cubepath.protocol.core.system import Scene
from cubepath.protocol.scenes.random_scenes import (
    WALK_KEY,
    Stream,
    random_triangulation,
    walk_length,
    walked,
)
from cubepath.protocol.scenes.registry import Family, Values, whole
from cubepath.protocol.systems.flips import FlipSystem
from cubepath.protocol.systems.point_sets import SWEEPS, Edge, Point, distinct_edges, edge_of

_RADIUS = 10**6
"""The radius of a polygon: its corners, rounded to integers, stay strictly convex."""
_CORNERS_MAX = 40
_SIDE = 1000
"""Random points lie in a square of this side."""
_RANDOM_MAX = 20_000
"""The most random points; a file may have more."""
_RANDOM = "random"
_NUMBER = re.compile(r"[+-]?(\d{1,30}(\.\d{0,30})?|\.\d{1,30})([eE][+-]?\d{1,2})?")


def polygon_points(count: int) -> tuple[Point, ...]:
    """Return the corners of a convex polygon, counter-clockwise from the top."""
    turns = [pi / 2 + 2 * pi * corner / count for corner in range(count)]
    return tuple((round(_RADIUS * cos(turn)), round(_RADIUS * sin(turn))) for turn in turns)


def fan(corner: int, count: int) -> frozenset[Edge]:
    """Return the diagonals of a polygon from one of its corners to all others."""
    near = {corner, (corner + 1) % count, (corner - 1) % count}
    return frozenset(edge_of(corner, other) for other in range(count) if other not in near)


def _polygon(name: str, values: Values) -> Scene:
    """Build a convex polygon whose diagonals form a fan, and are to form another."""
    count = whole(values, "n", least=4, most=_CORNERS_MAX)
    goal = whole({**values, "goal": values["goal"] or str(count // 2)}, "goal", least=0)
    if goal >= count:
        raise InputError(f"goal={goal}: expected a corner, 0 to {count - 1}")
    system = FlipSystem(polygon_points(count))
    return _scene(name, system, fan(0, count), fan(goal, count), spec=name)


@dataclass(frozen=True)
class Points:
    """The content of a file of points: the points as integers, and triangulations if any."""

    points: tuple[Point, ...]
    triangulations: tuple[frozenset[Edge], ...] = ()


def read_points(path: Path) -> Points:
    """Read points from text with `x y` a line, or from JSON; InputError names the file and place.

    JSON is a list of pairs, or an object with `points_x`, `points_y` and, optionally,
    `triangulations`, each a list of edges. Coordinates are decimals, taken exactly: all are
    multiplied by the least factor that makes them integers.
    """
    text = read_text(path)
    if path.suffix == ".json" or text.lstrip()[:1] in ("{", "["):
        return _points_from_json(text, str(path))
    rows = []
    for number, line in enumerate(text.splitlines(), 1):
        words = line.partition("#")[0].split()
        if words:
            where = f"{path}:{number}"
            if len(words) != 2:
                raise InputError(f"{where}: expected 'x y', found {line.strip()!r}")
            rows.append((_exact(words[0], where), _exact(words[1], where)))
    return Points(_on_whole_numbers(rows))


def _points_from_json(text: str, where: str) -> Points:
    def exact(number: str) -> Fraction:
        return _exact(number, where)

    try:
        value: Any = json.loads(text, parse_int=exact, parse_float=exact, parse_constant=exact)
        check_keys(text.encode(), where=f"{where}:")
    except json.JSONDecodeError as error:
        raise InputError(f"{where}:{error.lineno}: not JSON: {error.msg}") from None
    if not isinstance(value, dict):
        return Points(_on_whole_numbers(_pairs(value, where, "points")))
    for key in ("points_x", "points_y"):
        if not isinstance(value.get(key), list):
            raise InputError(f"{where}: expected a list of pairs, or an object with a list {key}")
    if len(value["points_x"]) != len(value["points_y"]):
        raise InputError(
            f"{where}: points_x has {len(value['points_x'])} numbers,"
            f" points_y {len(value['points_y'])}"
        )
    both = [list(pair) for pair in zip(value["points_x"], value["points_y"], strict=True)]
    points = _on_whole_numbers(_pairs(both, where, "points"))
    triangulations = value.get("triangulations", [])
    if not isinstance(triangulations, list):
        raise InputError(f"{where}: triangulations: expected a list")
    return Points(
        points,
        tuple(
            _edges(each, f"{where}: triangulations[{number}]", len(points))
            for number, each in enumerate(triangulations)
        ),
    )


def _pairs(value: Any, where: str, what: str) -> list[tuple[Fraction, Fraction]]:
    if not isinstance(value, list):
        raise InputError(f"{where}: {what}: expected a list of pairs")
    found = []
    for number, pair in enumerate(value):
        match pair:
            case [Fraction() as one, Fraction() as other]:
                found.append((one, other))
            case _:
                raise InputError(f"{where}: {what}[{number}]: expected two numbers")
    return found


def _edges(value: Any, where: str, count: int) -> frozenset[Edge]:
    pairs = [tuple(map(_whole_or_not, pair)) for pair in _pairs(value, where, "edges")]
    try:
        return frozenset(distinct_edges(pairs, count))
    except InputError as error:
        raise InputError(f"{where}: {error}") from None


def _whole_or_not(number: Fraction) -> int | float:
    return int(number) if number.denominator == 1 else float(number)


def _exact(text: str, where: str) -> Fraction:
    if not _NUMBER.fullmatch(text):
        raise InputError(f"{where}: {text[:40]!r} is not a decimal number of at most 30 digits")
    return Fraction(text)


def _on_whole_numbers(rows: Iterable[tuple[Fraction, Fraction]]) -> tuple[Point, ...]:
    rows = list(rows)
    scale = lcm(*(number.denominator for row in rows for number in row))
    return tuple((int(x * scale), int(y * scale)) for x, y in rows)


def random_points(count: int, seed: int) -> tuple[Point, ...]:
    """Return distinct points with integer coordinates, from a seed."""
    random = Random(seed)  # noqa: S311 - nothing secret
    found: dict[Point, None] = {}
    while len(found) < count:
        found[random.randrange(_SIDE), random.randrange(_SIDE)] = None
    return tuple(found)


def _triangulation(name: str, values: Values) -> Scene:
    """Build a point set with a triangulation at the start and another as the goal.

    The points, a random triangulation and the walk to the goal each have their own stream.
    """
    seed = whole(values, "seed", least=0)
    if values["points"]:
        found = read_points(Path(values["points"]))
        where = f"{values['points']}: "
    else:
        count = whole(values, "n", least=4, most=_RANDOM_MAX)
        found = Points(random_points(count, seed))
        where = ""
    try:
        system = FlipSystem(found.points)
    except InputError as error:
        raise InputError(f"{where}{error}") from None
    known: dict[str, frozenset[Edge]] = {way: system.plane.sweep(way) for way in SWEEPS}
    # A file lists all edges of a triangulation, or leaves out those that are in every one.
    known |= {str(n): edges | system.kept for n, edges in enumerate(found.triangulations)}
    default = ("0", "1") if len(found.triangulations) > 1 else ("right", "left")

    def named(key: str, default: str) -> frozenset[Edge]:
        value = values[key] or default
        if value == _RANDOM:
            return random_triangulation(system, Stream(f"{key} triangulation", seed))
        if value not in known:
            raise InputError(f"{key}={value}: expected one of {', '.join((*known, _RANDOM))}")
        return known[value]

    start = named("start", default[0])
    diagonals = system.modules_of(start)
    moves = walk_length(values, len(diagonals))
    goal: Iterable[Edge]
    if moves is None:
        goal = named("goal", default[1])
    elif values["goal"]:
        raise InputError(f"walk={moves}: leads to the goal, so expected no goal={values['goal']}")
    else:
        goal = system.modules_among(walked(system, diagonals, moves, Stream("walk", seed)))
    return _scene(name, system, start, goal, spec=values["points"] or name)


def _scene(
    name: str, system: FlipSystem, start: Iterable[Edge], goal: Iterable[Edge], *, spec: str
) -> Scene:
    begin, end = system.modules_of(start), system.modules_of(goal)
    return Scene(
        spec=spec,
        family=name,
        system=system,
        start=begin,
        goal=frozenset(end),
        goals=(end,) * len(begin),
    )


FAMILIES = (
    Family(
        "polygon",
        "triangulations of a convex polygon, by flips of diagonals",
        {
            "n": ("6", f"number of corners, 4 to {_CORNERS_MAX}"),
            "goal": ("", "corner of the fan that is the goal, n/2 when left out"),
        },
        _polygon,
        FlipSystem,
        "crossing",
    ),
    Family(
        "triangulation",
        "triangulations of any planar point set, by flips of diagonals",
        {
            "points": ("", "a file: text with 'x y' a line, or JSON; random points if left out"),
            "n": ("12", f"number of random points, 4 to {_RANDOM_MAX}"),
            "seed": ("1", "of random points, triangulations and walks"),
            "start": (
                "",
                "right, left, up, down (a sweep), random, or the number of one in the file",
            ),
            "goal": ("", "likewise"),
            "walk": WALK_KEY,
        },
        _triangulation,
        FlipSystem,
        "crossing",
        is_file=lambda key, value: key == "points" and bool(value),
    ),
)
