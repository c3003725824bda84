"""Robots in three dimensions: their moves by geometry, their shapes by known numbers."""

from itertools import permutations, product

import pytest
from hypothesis import given, settings, strategies as st

from cubepath.coordinator.theory.complexes.shape_complexes import shape_complex
from cubepath.protocol.core.actions import admissible, apply
from cubepath.protocol.core.catalogue import CUBES, DODECAHEDRA, Cell, Generator
from cubepath.protocol.scenes.built_in_pages import page_catalogue
from cubepath.protocol.scenes.random_scenes import Stream, grown_shape
from cubepath.protocol.scenes.specs import scene_from_spec
from cubepath.protocol.systems.lattice import LatticeSystem
from oracles.complexes import shape_f_vector
from oracles.swept_cells import CUBE, DODECAHEDRON, shifting, swept, turning
from oracles.touching import pieces, touching

LOCAL = ["sliding-cubes", "pivoting-cubes", "rolling-dodecahedra"]
ROBOTS = [*LOCAL, "sliding-cubes-connected"]
NEAR = [*product(range(-2, 3), repeat=3)]


def on_the_way(generator: Generator) -> set[Cell]:
    """Return the cells that the mover sweeps, by points inside it."""
    ((source, target),) = generator.motion
    stays = [cell for cell in generator.before if cell in generator.after]
    if generator.name.startswith("roll"):
        way = turning(DODECAHEDRON, source, target, stays[0])
        return swept(DODECAHEDRON, way, [cell for cell in NEAR if sum(cell) % 2 == 0])
    if generator.name.startswith(("quarter", "half")):
        beside = min(stays, key=lambda cell: cell not in touching(CUBES, source))
        return swept(CUBE, turning(CUBE, source, target, beside), NEAR)
    corners = touching(CUBES, source) & touching(CUBES, target) - {*stays}
    return swept(CUBE, shifting(CUBE, source, *corners, target), NEAR)


@pytest.mark.slow
@pytest.mark.parametrize("name", ROBOTS)
def test_what_is_swept_is_off_and_what_hangs_on_the_mover_is_held(name: str) -> None:
    """By geometry. Other cells that must be off are those where a module would be left behind."""
    catalogue = page_catalogue(name)
    lattice, kinds = (
        catalogue.lattice,
        {each.name.partition("-")[0]: each for each in catalogue.generators},
    )
    assert len(kinds) == (1 if lattice == DODECAHEDRA else 2)
    for generator in kinds.values():
        ((source, target),) = generator.motion
        stays = {*generator.before} & {*generator.after}
        held = stays.union(*(touching(lattice, cell) for cell in stays))
        off = {*generator.support} - {*generator.trace} - stays - {*generator.free}
        must = on_the_way(generator)
        assert must >= {source, target}
        assert must - {source, target} <= off
        ends = touching(lattice, source) ^ touching(lattice, target)
        left = {cell for cell in ends - {source, target} - held if cell not in must}
        guards = dict(generator.guards)
        if name in LOCAL:
            assert left <= {*guards, *off}
            assert off - must == left - {*guards}
        for cell, other in guards.items():
            assert cell in left
            assert other in touching(lattice, cell)
            assert other in held or (cell in touching(lattice, source)) != (
                other in touching(lattice, source)
            )


@pytest.mark.parametrize("name", ROBOTS)
def test_moves_are_alike_in_all_orientations(name: str) -> None:
    """Each rotation and reflection of the cube takes the 24 generators to themselves."""
    catalogue = page_catalogue(name)
    known = {each.canonical(catalogue.lattice) for each in catalogue.generators}
    assert len(known) == 24
    for axes, signs in product(permutations(range(3)), product((1, -1), repeat=3)):
        matrix = list(zip(axes, signs, strict=True))

        def put(cells: tuple[Cell, ...]) -> tuple[Cell, ...]:
            return tuple(tuple(sign * cell[axis] for axis, sign in matrix) for cell in cells)  # noqa: B023

        for each in catalogue.generators:
            ((source, target),) = map(put, each.motion)
            image = Generator(
                "image",
                support=put(each.support),
                trace=put(each.trace),
                before=put(each.before),
                after=put(each.after),
                motion=((source, target),),
                free=put(each.free),
                guards=tuple((one, other) for one, other in map(put, each.guards)),
            )
            assert image.canonical(catalogue.lattice) in known


COUNTS = {CUBES: (1, 3, 15, 86, 534, 3481), DODECAHEDRA: (1, 6, 50, 475, 4881)}
"""Fixed polycubes (OEIS A001931), and connected sets of cells of the face-centred cubic lattice."""


@pytest.mark.parametrize(
    "count",
    [
        *(1, 2, 3),
        pytest.param(4, marks=pytest.mark.slow),
        pytest.param(5, marks=pytest.mark.thorough),
        pytest.param(6, marks=pytest.mark.nightly),
    ],
)
def test_connected_sliding_cubes_reach_all_polycubes(count: int) -> None:
    """The vertices of the shape complex of the non-local variant are the fixed polycubes."""
    found = shape_complex(scene_from_spec(f"sliding-cubes-connected:n={count}"))
    assert found.complex.f_vector[0] == COUNTS[CUBES][count - 1]
    assert all(pieces(CUBES, shape) == 1 for shape in found.shapes)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("spec", "shapes"),
    [
        ("sliding-cubes:n=3", 15),
        ("sliding-cubes:n=4", 86),
        pytest.param("sliding-cubes:n=5", 534, marks=pytest.mark.thorough),
        pytest.param("sliding-cubes:n=6", 3477, marks=pytest.mark.nightly),
        ("pivoting-cubes:n=4", 86),
        pytest.param("pivoting-cubes:n=5", 534, marks=pytest.mark.thorough),
        pytest.param("pivoting-cubes:n=6", 3477, marks=pytest.mark.nightly),
        ("rolling-dodecahedra:n=3", 50),
        pytest.param("rolling-dodecahedra:n=4", 472, marks=pytest.mark.thorough),
        pytest.param("rolling-dodecahedra:n=5", 4803, marks=pytest.mark.nightly),
    ],
)
def test_which_shapes_a_line_reaches(spec: str, shapes: int) -> None:
    """Of cubes that keep together all to five; of dodecahedra all to three."""
    assert len(shape_complex(scene_from_spec(spec)).shapes) == shapes


@pytest.mark.slow
@pytest.mark.parametrize(
    "spec", ["sliding-cubes:n=3", "sliding-cubes-connected:n=3", "rolling-dodecahedra:n=2"]
)
def test_shape_complexes_are_what_the_definition_says(spec: str) -> None:
    """Cube by cube, also where the whole aggregate decides."""
    scene = scene_from_spec(spec)
    assert list(shape_complex(scene).complex.f_vector) == shape_f_vector(scene)


@settings(max_examples=8)
@given(st.sampled_from(LOCAL), st.integers(2, 30), st.integers(0, 10**6))
def test_an_aggregate_stays_connected(name: str, count: int, seed: int) -> None:
    """A compact one of some thirty modules at most, after each single move."""
    system = scene_from_spec(name).system
    assert isinstance(system, LatticeSystem)
    lattice = system.catalogue.lattice
    shape = frozenset(grown_shape(count, lattice, Stream("shape", seed)))
    for cell in shape:
        for move in system.moves_at(cell):
            if admissible(move.action, shape):
                assert lattice.pieces(apply(move.action, shape)) == 1


@pytest.mark.slow
@pytest.mark.parametrize("scene", ["line", "box", "random"])
@pytest.mark.parametrize("name", LOCAL)
def test_scenes_begin_and_end_connected(name: str, scene: str) -> None:
    """Start and goal of each scene, which differ and have as many modules."""
    found = scene_from_spec(f"{name}:scene={scene}")
    assert isinstance(found.system, LatticeSystem)
    for state in (found.start_state, found.goal or frozenset()):
        assert len(state) == 8
        assert pieces(found.system.catalogue.lattice, state) == 1
    assert found.start_state != found.goal
