"""CG:SHOP 2026, parallel flips of triangulations: an instance and the flips of a solution.

Source: the competition's own schemas and verifier, package cgshop2026-pyutils, CG-SHOP/pyutils26 on
GitHub (`schemas/instance.py`, `schemas/solution.py`, `verify.py`, `geometry/flip_partner_map.py`)::

    {"content_type": "CGSHOP2026_Instance", "instance_uid": "demo-square",
     "points_x": [0, 1, 0, 1], "points_y": [0, 0, 1, 1], "triangulations": [[[0, 3]], [[1, 2]]]}
    {"content_type": "CGSHOP2026_Solution", "instance_uid": "demo-square",
     "flips": [[[[0, 3]]], []], "meta": {"author": "you"}}

Coordinates are integers; a triangulation is a list of edges, which may leave out the edges of the
hull. For each triangulation, `flips` has a list of rounds, and a round is a list of edges that are
all flipped at one time. Each edge is in the triangulation before the round, the triangles on its
two sides form a strictly convex quadrilateral, and no two edges belong to one triangle. All this
holds here too, since two flips commute iff they share no triangle (two quadrilaterals that share a
side do commute). Each triangulation has its own path; the key `triangulation` chooses.

The actions are those of `cubepath.protocol.systems.flips`. They are built from the current
triangles, so the number of points is not limited as it is there.
"""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import msgspec

from cubepath.protocol.core.catalogue import GeneratorPlacement
from cubepath.protocol.core.errors import InputError, errors_at
from cubepath.protocol.core.parsing import read_json
from cubepath.protocol.core.system import Scene
from cubepath.protocol.path_files.moves import PathMove
from cubepath.protocol.plans.imported import ImportedPath, PlanRequest, no_system, only
from cubepath.protocol.systems import point_sets
from cubepath.protocol.systems.flips import FlipSystem, flip_of

_INSTANCE, _SOLUTION = "CGSHOP2026_Instance", "CGSHOP2026_Solution"


class _Instance(msgspec.Struct):
    instance_uid: str
    points_x: list[int]
    points_y: list[int]
    triangulations: list[list[point_sets.Edge]]
    content_type: str = _INSTANCE


class _Solution(msgspec.Struct):
    instance_uid: str
    flips: list[list[list[point_sets.Edge]]]
    content_type: str = _SOLUTION
    meta: dict[str, Any] = {}


def read_cgshop2026(request: PlanRequest) -> ImportedPath:
    """Read the flips of one triangulation, with a second file; errors as `ImportedPath` says."""
    path = request.path
    no_system(request, "a CG:SHOP 2026 solution, whose instance says what the system is")
    companion = only(request, "instance")
    instance = read_json(companion, _Instance)
    solution = read_json(request.file, _Solution)
    _check_pair(request, companion, instance, solution)
    points = _points(companion, instance)
    chosen = _chosen(path, request.values["triangulation"], len(solution.flips))
    with errors_at(f"{companion}: triangulations[{chosen}]"):
        edges = point_sets.distinct_edges(instance.triangulations[chosen], len(points))
        triangles = point_sets.Triangles(points, edges)
    start = triangles.edges()
    rounds = solution.flips[chosen]

    def moves() -> Iterator[PathMove]:
        for number, flips in enumerate(rounds):
            try:
                yield from _round(triangles, flips)
            except InputError as error:
                raise InputError(
                    f"{path}: triangulation {chosen}, round {number}, {error}"
                ) from None

    def scene() -> Scene:
        with errors_at(str(companion)):
            system = FlipSystem(points)
        return Scene(str(path), "triangulation", system, system.modules_of(start))

    def unsolved() -> str | None:
        end = frozenset(triangles.edges())
        others = (k for k in range(len(solution.flips)) if k != chosen)
        off = [(k, why) for k in others if (why := _apart(points, instance, solution, k, end))]
        if not off:
            return None
        first, why = off[0]
        many = "triangulation does not end" if len(off) == 1 else "triangulations do not end"
        return (
            f"{len(off)} other {many} as triangulation {chosen} does, the first is triangulation"
            f" {first}: {why}"
        )

    sizes = lambda: tuple(map(len, rounds))  # noqa: E731 - asked for where rounds are drawn
    return ImportedPath(moves(), len(rounds), scene, unsolved=unsolved, round_sizes=sizes)


def _apart(
    points: Sequence[point_sets.Point],
    instance: _Instance,
    solution: _Solution,
    number: int,
    end: frozenset[point_sets.Edge],
) -> str | None:
    """Return why a triangulation's own flips do not take it to this end; None if they do."""
    try:
        triangles = point_sets.Triangles(
            points, point_sets.distinct_edges(instance.triangulations[number], len(points))
        )
        for flips in solution.flips[number]:
            _round(triangles, flips)
    except InputError as error:
        return str(error)
    stray = sorted(end.symmetric_difference(triangles.edges()))
    if not stray:
        return None
    has = "lacks" if stray[0] in end else "has"
    return f"it {has} edge {list(stray[0])}, expected all to end alike"


def _check_pair(
    request: PlanRequest, companion: Path, instance: _Instance, solution: _Solution
) -> None:
    """Check that both files are of the expected types, and belong to one instance."""
    path = request.path
    for where, found, expected in (
        (companion, instance.content_type, _INSTANCE),
        (path, solution.content_type, _SOLUTION),
    ):
        if found != expected:
            raise InputError(f"{where}: content_type is {found!r}, expected {expected!r}")
    if instance.instance_uid != solution.instance_uid:
        raise InputError(
            f"{path}: a solution of {solution.instance_uid!r}, but {companion} is"
            f" {instance.instance_uid!r}"
        )
    if len(solution.flips) != len(instance.triangulations):
        raise InputError(
            f"{path}: flips of {len(solution.flips)} triangulations, the instance has"
            f" {len(instance.triangulations)}"
        )


def _points(path: Path, instance: _Instance) -> list[point_sets.Point]:
    if len(instance.points_x) != len(instance.points_y):
        raise InputError(
            f"{path}: points_x has {len(instance.points_x)} numbers,"
            f" points_y {len(instance.points_y)}"
        )
    return list(zip(instance.points_x, instance.points_y, strict=True))


def _chosen(path: Path, value: str, count: int) -> int:
    if not count:
        raise InputError(f"{path}: no triangulation, expected at least one")
    last = count - 1
    if not value:
        if count > 1:
            raise InputError(
                f"{path}: {count} triangulations, each with a path of its own: expected"
                f" --format cgshop2026:triangulation=K with K of 0 to {last}"
            )
        return 0
    if not (value.isascii() and value.isdecimal() and int(value[:9]) <= last):
        raise InputError(f"{path}: triangulation={value}: expected 0 to {last}")
    return int(value)


def _round(triangles: point_sets.Triangles, flips: Sequence[point_sets.Edge]) -> list[PathMove]:
    """Flip the edges of a round, or none; InputError names the first that cannot flip."""
    found: list[PathMove] = []
    quadrilaterals: list[tuple[int, int, int, int]] = []
    taken: dict[tuple[int, ...], point_sets.Edge] = {}
    for given in flips:
        edge = point_sets.edge_of(*given)
        with errors_at(f"flip of {list(given)}"):
            corners = triangles.corners(edge)
        a, d, b, c = corners
        both = [tuple(sorted(triangle)) for triangle in ((a, b, c), (a, b, d))]
        for triangle in both:
            other = taken.get(triangle)
            if other is not None:
                shared = f"triangle {list(triangle)} is that of {list(other)} too"
                why = "it stands twice" if other == edge else shared
                raise InputError(
                    f"flip of {list(given)}: {why}, expected the flips of a round to be possible"
                    " at one time"
                )
        taken.update(dict.fromkeys(both, edge))
        found.append(_move(edge, corners))
        quadrilaterals.append(corners)
    for corners in quadrilaterals:
        triangles.flip(corners)
    return found


def _move(edge: point_sets.Edge, corners: tuple[int, int, int, int]) -> PathMove:
    move = flip_of(point_sets.quadrilateral(*corners))
    sides = move.action.support - move.action.trace
    return PathMove(move.action, GeneratorPlacement("flip", move.at), sides | {edge})
