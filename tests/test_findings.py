"""The findings: the page says what its rows say, and small rows come out again in two ways."""

import json
import sys
from collections import Counter
from dataclasses import asdict
from itertools import product
from math import comb, prod
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

import flip_diameter
import hexagon_shapes
import rules
import three_gaps
import torsion
from cubepath.coordinator.experiments.instances import standard
from cubepath.coordinator.theory.complexes.exploration import explore
from cubepath.coordinator.theory.complexes.shape_complexes import (
    Shape,
    normal_place,
    shape_complex,
    steps_at,
)
from cubepath.coordinator.theory.complexes.state_complexes import state_complex
from cubepath.coordinator.theory.satisfiability.encoding import encode
from cubepath.coordinator.theory.satisfiability.met_moves import MetMoves
from cubepath.coordinator.theory.satisfiability.solver_process import SolverProcess
from cubepath.coordinator.theory.search.exact import optimum
from cubepath.coordinator.theory.search.transitions import Transitions
from cubepath.protocol import scene_from_spec
from cubepath.protocol.core.actions import apply
from cubepath.protocol.core.catalogue import HEX_DIRECTIONS, HEXAGONS
from cubepath.protocol.core.sites import Site
from cubepath.protocol.scenes.built_in_pages import page_catalogue
from cubepath.protocol.systems.lattice import LatticeSystem
from findings import FILES, TABLES, committed, factors
from studies import DOCS, PAGE, tables_of_page

FREE_TRIANGULATIONS = (1, 3, 4, 12, 27, 82, 228, 733, 2282, 7528, 24834, 83898)
"""A000207 from the pentagon on."""
SHAPES = (1, 3, 11, 44, 186, 814, 3652, 16689, 77359, 362671, 1716033, 8182213)
"""A001207 from one hexagon on."""
FREE_SHAPES = (1, 1, 3, 7, 22, 82, 333, 1448, 6572, 30490, 143552, 683101)
"""A000228 from one hexagon on."""


def _as_kept(row: Any) -> Any:
    return json.loads(json.dumps(asdict(row)))


def test_the_page_has_the_tables_of_its_rows() -> None:
    """Each table is between its marks; the pictures are there, and small."""
    tables = {(name, table(committed(name))) for name, table in TABLES.items()}
    assert tables_of_page().items() >= tables
    for name in FILES:
        assert f"(findings-{name}.png)" in PAGE.read_text("utf-8")
        assert (DOCS / f"findings-{name}.png").stat().st_size < 60_000


@pytest.mark.few(1)
@pytest.mark.parametrize("script", [flip_diameter, hexagon_shapes, rules, three_gaps, torsion])
def test_the_scripts_make_their_first_rows(
    script: ModuleType,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """With --quick each writes one line a row, and prints one a row."""
    out = tmp_path / "rows.json"
    few = ["--seeds", "2"] if script is three_gaps else []
    monkeypatch.setattr(sys, "argv", ["script", "--quick", "-o", str(out), *few])
    script.main()
    rows = json.loads(out.read_text("utf-8"))
    assert len(rows) == len(capsys.readouterr().out.splitlines()) > 1


# Flips.


def _flip_rows() -> list[dict[str, Any]]:
    return committed("flips")


@pytest.mark.parametrize("corners", range(5, 12))
def test_diameters_come_out_again(corners: int) -> None:
    """The same seed makes the same searches, with the same pair."""
    kept = next(row for row in _flip_rows() if row["n"] == corners)
    again = flip_diameter.measure(corners, every=kept["eccentricities"] is not None)
    assert _as_kept(again) == kept


def test_triangulations_are_as_many_as_is_known() -> None:
    """Catalan numbers, and A000207 up to symmetry; eccentricities are those of all orbits."""
    for row, free in zip(_flip_rows(), FREE_TRIANGULATIONS, strict=False):
        many = row["n"] - 2
        assert row["triangulations"] == comb(2 * many, many) // (many + 1)
        assert row["orbits"] == free
        known = row["eccentricities"]
        if known is not None:
            assert sum(known.values()) == free
            assert max(map(int, known)) == row["diameter"]


def _trees(corners: int) -> tuple[flip_diameter.Trees, list[frozenset[Site]]]:
    trees = flip_diameter.all_trees(corners - 2)
    sides = {(k, k + 1) for k in range(corners - 1)} | {(0, corners - 1)}
    states = [
        frozenset[Site](flip_diameter.diagonals(trees, tree)) for tree in range(len(trees.flips))
    ]
    assert not any(state & sides for state in states)
    return trees, states


def _distances(corners: int) -> np.ndarray[Any, Any]:
    """Return the distances of all pairs, by trees."""
    trees, states = _trees(corners)
    found = np.empty((len(states), len(states)), dtype=np.uint8)
    room = np.empty(len(states), dtype=np.int32)
    for tree in range(len(states)):
        flip_diameter.search(trees.flips, trees.parents, tree, found[tree], room)
    return found


@pytest.mark.parametrize("corners", [5, 6, 7, pytest.param(8, marks=pytest.mark.nightly)])
def test_distances_are_those_of_the_polygons_own_moves(corners: int) -> None:
    """All pairs, by breadth-first search over sets of commuting moves of the system."""
    _, states = _trees(corners)
    steps = Transitions(scene_from_spec(f"polygon:n={corners}").system)
    filled = steps.system.filled if steps.system else frozenset()
    number = {steps.encode(state | filled): tree for tree, state in enumerate(states)}
    assert len(number) == len(states)
    near = {here: [number[there] for there, _ in steps.cubes(here, 0)] for here in number}
    plain = np.full((len(states), len(states)), 255, dtype=np.uint8)
    for start, source in number.items():
        plain[source, source] = 0
        level = [start]
        depth = 0
        names = list(number)
        while level:
            depth += 1
            fresh = []
            for here in level:
                for there in near[here]:
                    if plain[source, there] == 255:
                        plain[source, there] = depth
                        fresh.append(names[there])
            level = fresh
    assert np.array_equal(plain, _distances(corners))


@pytest.mark.parametrize("corners", range(5, 9))
def test_symmetries_keep_distances(corners: int) -> None:
    """Turned and mirrored triangulations are turned and mirrored, and as far apart as before."""
    trees, states = _trees(corners)
    turned = np.empty(len(states), dtype=np.int32)
    flip_diameter.turn(trees.first, trees.counts, turned)
    mirror = flip_diameter.mirrored(trees)
    distances = _distances(corners)
    for image, moved in ((turned, 1), (mirror, -1)):
        for tree, state in enumerate(states):
            pairs = [
                sorted(
                    (corner + 1) % corners if moved == 1 else corners - 1 - corner
                    for corner in pair
                )
                for pair in state
                if isinstance(pair, tuple)
            ]
            assert states[image[tree]] == frozenset(map(tuple, pairs))
        assert np.array_equal(distances[np.ix_(image, image)], distances)


@pytest.mark.parametrize(
    "corners", [*range(5, 11), *(pytest.param(n, marks=pytest.mark.nightly) for n in (11, 12))]
)
def test_the_farthest_pairs_are_as_far_apart_as_said(corners: int) -> None:
    """By exhaustive search from both ends over the moves of the system."""
    row = next(row for row in _flip_rows() if row["n"] == corners)
    steps = Transitions(scene_from_spec(f"polygon:n={corners}").system)
    filled = steps.system.filled if steps.system else frozenset()
    ends = [steps.encode(filled.union(map(tuple, state))) for state in row["pair"]]
    found = optimum(steps, *ends)
    assert found.cubes is not None
    assert len(found.cubes) == row["diameter"]


@pytest.mark.few(3)
@pytest.mark.parametrize("row", _flip_rows()[2:], ids=lambda row: f"{row['n']} corners")
def test_a_solver_says_the_same_of_the_farthest_pairs(row: dict[str, Any]) -> None:
    """A round fewer than the diameter is refuted, and that many rounds are enough."""
    pytest.importorskip("pysat")
    system = scene_from_spec(f"polygon:n={row['n']}").system
    ends = [system.filled.union(map(tuple, state)) for state in row["pair"]]
    met = MetMoves(system, (), *ends)
    with SolverProcess() as solver:
        answers = [
            solver.solve(encode(met, rounds)).satisfiable
            for rounds in (row["diameter"] - 1, row["diameter"])
        ]
    assert answers == [False, True]


# Hexagons.


def test_shapes_are_as_many_as_is_known() -> None:
    """A001207 and A000228, with components that hold them all."""
    for row in committed("hexagons"):
        assert row["shapes"] == SHAPES[row["n"] - 1]
        assert row["free_shapes"] == FREE_SHAPES[row["n"] - 1]
        sizes = {int(size): many for size, many in row["by_size"].items()}
        assert sum(map(prod, sizes.items())) == row["shapes"]
        assert sum(sizes.values()) == row["components"]
        assert max(sizes) == row["largest"]
        assert len(row["stuck_shapes"]) == row["free_stuck"]
        assert sizes.get(1, 0) == row["stuck"]
        if row["catalogue"] == 1:
            assert sum(many for many, _ in row["holes"].values()) == row["shapes"]
            # No component has shapes with different numbers of holes: pivots keep the topology.
            assert sum(many for _, many in row["holes"].values()) == row["components"]


@pytest.mark.few(2)
@pytest.mark.parametrize("size", range(1, 8))
def test_components_come_out_again(size: int) -> None:
    """Both catalogues."""
    shapes = hexagon_shapes.all_shapes(size)
    again = [_as_kept(hexagon_shapes.measure(shapes, catalogue)) for catalogue in (1, 2)]
    assert again == [row for row in committed("hexagons") if row["n"] == size]


def _grown(size: int) -> set[Shape]:
    found: set[Shape] = {frozenset[Site]({(0, 0)})}
    for _ in range(size - 1):
        found = {
            normal_place(HEXAGONS, shape.union([(q + step[0], r + step[1])]))[0]
            for shape in found
            for (q, r), step in product(map(HEXAGONS.check, shape), HEX_DIRECTIONS)
            if (q + step[0], r + step[1]) not in shape
        }
    return found


@pytest.mark.parametrize(
    "size", [*range(1, 6), *(pytest.param(n, marks=pytest.mark.thorough) for n in (6, 7))]
)
def test_components_are_those_of_the_generators(size: int) -> None:
    """Both catalogues, on sets of cells, by the project's actions."""
    shapes = _grown(size)
    for catalogue in (1, 2):
        system = LatticeSystem(page_catalogue(f"hexagons-{catalogue}"))
        near = {
            shape: {
                normal_place(HEXAGONS, apply(action, shape))[0]
                for action in steps_at(system, shape).values()
            }
            for shape in shapes
        }
        assert catalogue == 2 or all(after <= shapes for after in near.values())
        sizes: Counter[int] = Counter()
        left = set(shapes)
        while left:
            part, todo = set[Shape](), [left.pop()]
            while todo:
                part.add(here := todo.pop())
                fresh = near[here] & left
                left -= fresh
                todo += fresh
            sizes[len(part)] += 1
        row = next(
            row
            for row in committed("hexagons")
            if (row["n"], row["catalogue"]) == (size, catalogue)
        )
        assert row["by_size"] == {str(each): sizes[each] for each in sorted(sizes)}
        assert row["stuck"] == sum(not after & shapes for after in near.values())


@pytest.mark.parametrize("size", [3, 5])
def test_the_shape_complex_of_a_chain_is_the_largest_component(size: int) -> None:
    """Its vertices are as many as that component's shapes."""
    rows = committed("hexagons")
    largest = next(row["largest"] for row in rows if row["n"] == size)
    assert len(shape_complex(scene_from_spec(f"hex:n={size}")).shapes) == largest


# Gaps.


def test_no_factor_is_below_one() -> None:
    """Rounds are at least the cubes, these the fewest, these the best known, this the bound."""
    for row in committed("gaps"):
        for beat, runs in enumerate(row["runs"]):
            assert all(rounds >= cubes >= row["fewest"] for rounds, cubes in runs)
            assert all(factor >= 1 - 1e-12 for factor in factors(row, beat))
        assert min(cubes for runs in row["runs"] for _, cubes in runs) == row["fewest"]
        assert row["fewest"] >= row["best"] >= row["bound"] > 0


@pytest.mark.parametrize(
    ("system", "rule"), [("hex:n=3", "chain"), ("hex-open:n=4", "chain"), ("arm:n=5", "word")]
)
def test_runs_and_optima_come_out_again(system: str, rule: str) -> None:
    """The first seeds are the first runs; the optimum is that of an exhaustive search alone."""
    row = next(row for row in committed("gaps") if (row["system"], row["rule"]) == (system, rule))
    again = _as_kept(three_gaps.measure(system, rule, seeds=3))
    assert again["runs"] == [runs[:3] for runs in row["runs"]]
    scene = scene_from_spec(system)
    assert scene.goal is not None
    steps = Transitions(scene.system)
    found = optimum(steps, steps.encode(scene.start_state), steps.encode(scene.goal))
    assert found.cubes is not None
    assert len(found.cubes) == row["best"] == row["bound"] == again["best"]


def test_optima_are_those_of_the_standard_set() -> None:
    """Where a system is in both, and a value is proved in one, the other does not contradict it."""
    rows = {row["system"]: row for row in committed("gaps")}
    both = [(each, rows[each.system]) for each in standard() if each.system in rows]
    assert sum(each.proved for each, _ in both) > 3
    for each, row in both:
        assert row["bound"] <= each.best
        assert each.bound <= row["best"]


# Torsion.


def test_ranks_differ_where_there_is_torsion() -> None:
    """Modulo 2 and 3, once for each Z/2; where exchanges can change places tori bound twice."""
    for row in committed("torsion"):
        ranks = row["ranks"]["2"], row["ranks"]["3"]
        lost = [three - two for two, three in zip(*ranks, strict=True)]
        assert lost == [len(factors) for factors in row["torsion"][:-1]]
        assert all(factors == [2] * len(factors) for factors in row["torsion"])
        if row["pairs"] is not None:
            assert row["bounding"] == [row["swapping"], 0]
            assert bool(row["swapping"]) == any(lost)
        assert (row["way"] is None) == (not row["swapping"])


@pytest.mark.slow
def test_twice_the_torus_is_a_boundary() -> None:
    """The torus has 36 squares; the cubes that it sweeps on the way of the page have it twice."""
    row = next(row for row in committed("torsion") if row["way"])
    exchanges = torsion.Exchanges(torsion.grid(5, 5))
    way = exchanges.way(torsion.PAIR)
    assert way is not None
    assert json.loads(json.dumps(way)) == row["way"]
    torus, swept = torsion.torus(torsion.PAIR), exchanges.filling(way)
    assert len(torus) == 36
    assert not torsion.boundary(torus)
    assert len(swept) == row["swept"]
    assert torsion.boundary(swept) == {square: 2 * count for square, count in torus.items()}


@pytest.mark.thorough
def test_exchanges_of_one_kind_are_homologous_over_the_integers() -> None:
    """Their difference is the boundary of squares that keep away from the junction beside them."""
    exchanges = torsion.Exchanges(torsion.grid(5, 5))
    for taken in exchanges.junctions:
        first: dict[Any, torsion.Junction] = {}
        for junction in exchanges.junctions:
            if set(junction) & set(taken):
                continue
            known = first.setdefault(exchanges.kind(junction, taken), junction)
            difference = Counter(torsion.exchange(junction))
            difference.subtract(torsion.exchange(known))
            squares = exchanges.between(junction, known, taken)
            assert torsion.boundary(squares) == {k: n for k, n in difference.items() if n}
            for moving, standing in squares:
                assert set(taken).isdisjoint(standing.union(*moving))


@pytest.mark.slow
@pytest.mark.parametrize("step", [pytest.param(1, marks=pytest.mark.thorough), 199])
def test_a_count_is_even_on_every_boundary_and_odd_on_the_torus(step: int) -> None:
    """So the torus is no boundary, modulo 2 or otherwise; the shorter test looks at some cubes."""
    assert sum(map(torsion.twisted, torsion.torus(torsion.PAIR))) % 2
    cubes = list(torsion.cells(torsion.grid(5, 5), 4, 3))
    assert len(cubes) == 126_008
    for cube in cubes[::step]:
        assert sum(torsion.twisted(face) for face, _ in torsion.faces(cube)) % 2 == 0


@pytest.mark.parametrize(
    ("word", "sign"),
    [((0, 0), 0), ((0, 1, 0, 1, 0, 1), 0), ((1, 2, 1, 2, 1, 2), 0), ((0, 2, 0, 2), 1), ((), 0)],
)
def test_swaps_are_lifted_as_they_should(word: tuple[int, ...], sign: int) -> None:
    """Far ones anticommute; all other relations of the symmetric group hold."""
    assert torsion.lifted_sign(word) == sign


@pytest.mark.thorough
def test_the_torus_by_the_arrays_of_the_complex() -> None:
    """By the project's own cubes and signs: 0 modulo 3, not modulo 2; twice it is a boundary."""
    built = state_complex(explore(scene_from_spec("agv:graph=grid5x5,n=4")))
    ends = [tuple(next(iter(end)) for end in action.ends) for action in built.explored.bits.actions]
    number: list[dict[torsion.Cell, tuple[int, int]]] = []
    for dimension in (2, 3):
        names: dict[torsion.Cell, tuple[int, int]] = {}
        both = zip(built.bases[dimension], built.actions[dimension], strict=True)
        for place, (base, actions) in enumerate(both):
            moves: Any = [ends[action] for action in actions]
            standing: Any = built.explored.state(base) - {one for one, _ in moves}
            edges = sorted((min(move), max(move)) for move in moves)
            sign = (-1) ** sum(
                [min(one), max(one)] > [min(other), max(other)]
                for at, one in enumerate(moves)
                for other in moves[at + 1 :]
            ) * (-1) ** sum(one > other for one, other in moves)
            names[tuple(edges), frozenset(standing)] = place, sign
        number.append(names)
    column = {
        number[0][square][0]: count * number[0][square][1]
        for square, count in torsion.torus(torsion.PAIR).items()
    }
    cubes, columns = (
        [
            {face: (-1) ** (at // 2 + at % 2 + 1) for at, face in enumerate(faces)}
            for faces in built.complex.faces[dimension].reshape(-1, 2 * dimension).tolist()
        ]
        for dimension in (4, 3)
    )
    way = torsion.Exchanges(torsion.grid(5, 5)).way(torsion.PAIR)
    assert way is not None
    total: Counter[int] = Counter()
    for cell, count in torsion.Exchanges(torsion.grid(5, 5)).filling(way).items():
        place, sign = number[1][cell]
        for square, value in columns[place].items():
            total[square] += sign * count * value
    assert {row: value for row, value in total.items() if value} == {
        row: 2 * value for row, value in column.items()
    }
    left = []
    for prime in (2, 3):
        known = torsion.pivots_of(cubes, prime)  # what bounds has a boundary that others have, too
        rest = (column for place, column in enumerate(columns) if place not in known)
        left.append(torsion.reduced(column, torsion.pivots_of(rest, prime), prime))
    assert [bool(each) for each in left] == [True, False]
