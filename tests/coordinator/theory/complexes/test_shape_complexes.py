"""The shape complex, and macros that are lifted from it."""

import pytest

from cubepath.coordinator.theory.complexes.links import check_links
from cubepath.coordinator.theory.complexes.shape_complexes import (
    lattice_of,
    lift,
    macro,
    normal_place,
    shape_complex,
)
from cubepath.protocol.core.actions import apply_in_place
from cubepath.protocol.core.errors import CheckError, InputError
from cubepath.protocol.core.sites import Site
from cubepath.protocol.scenes.built_in_pages import page_catalogue
from cubepath.protocol.scenes.specs import scene_from_spec
from cubepath.protocol.systems.lattice import LatticeSystem
from oracles import complexes
from oracles.cells import cells_of

LINE = [(0, 0), (1, 0), (2, 0)]
TRIANGLE = [(0, 0), (1, 0), (0, 1)]
HEXAGONS = LatticeSystem(page_catalogue("hexagons-1"))


def test_three_hexagons_have_the_shape_complex_of_the_paper() -> None:
    """Eleven shapes, 24 edges, nine squares."""
    assert shape_complex(scene_from_spec("hex:n=3")).complex.f_vector == (11, 24, 9)


@pytest.mark.parametrize("count", [2, 3, 4])
def test_it_is_the_obvious_quotient(count: int) -> None:
    """The same counts as by putting every cube of every shape to its normal place."""
    scene = scene_from_spec(f"hex:n={count}")
    found = shape_complex(scene)
    found.complex.check()
    assert list(found.complex.f_vector) == complexes.shape_f_vector(scene)
    assert check_links(found.complex).npc


def test_arms_have_shapes_too() -> None:
    """On lattice edges a translation keeps the axis; an arm with a fixed base is as it was."""
    shapes = shape_complex(scene_from_spec("arm:n=4"))
    assert shapes.complex.f_vector[0] == 16
    assert shapes.complex.euler == 1


@pytest.mark.parametrize("spec", ["hex-open:n=3", "agv", "hex:n=3,base=1", "hex-connected"])
def test_where_translations_do_not_act_it_is_refused(spec: str) -> None:
    """Workspaces, obstacles, graphs and non-local systems have no shapes up to translation."""
    with pytest.raises(InputError, match=spec.split(":", maxsplit=1)[0]):
        shape_complex(scene_from_spec(spec))


def test_too_many_shapes_are_refused() -> None:
    """The limit is told."""
    with pytest.raises(CheckError, match="more than 100 shapes"):
        shape_complex(scene_from_spec("hex:n=5"), max_states=100)


def test_a_macro_lifts_to_many_places_and_ends_in_its_shape() -> None:
    """One path from a line to a triangle serves wherever nothing is in the way."""
    plan = macro(HEXAGONS, LINE, TRIANGLE)
    assert len(plan.cubes) > 0
    for at in [(0, 0), (5, -3), (-40, 7)]:
        found = lift(HEXAGONS, plan, at)
        assert found.refusal is None
        assert found.cubes is not None
        state: set[Site] = {(q + at[0], r + at[1]) for q, r in cells_of(plan.start)}
        for actions in found.cubes:
            for action in actions:
                apply_in_place(action, state)
        assert normal_place(HEXAGONS.catalogue.lattice, frozenset(state))[0] == plan.end


def test_a_macro_has_as_few_cubes_as_any() -> None:
    """Two ends that move at once take one cube where two moves are needed."""
    bent = [(0, 0), (1, 0), (2, 0), (3, 0)]
    plan = macro(HEXAGONS, bent, [(0, 1), (1, 0), (2, 0), (2, 1)])
    assert len(plan.cubes) == 1
    assert len(plan.cubes[0]) == 2


def test_where_an_obstacle_is_in_the_way_the_lift_is_refused_with_the_reason() -> None:
    """An occupied cell where a module has to go: which cube, which action, which site."""
    plan = macro(HEXAGONS, LINE, TRIANGLE)
    lifted = lift(HEXAGONS, plan, (0, 0))
    assert lifted.cubes is not None
    (goal,) = set(lifted.cubes[0][0].trace) - set(LINE)
    walled = LatticeSystem(page_catalogue("hexagons-1"), filled=[goal])
    found = lift(walled, plan, (0, 0))
    assert found.cubes is None
    assert found.refusal is not None
    assert found.refusal.startswith("cube 1: pivot-")
    started = lift(LatticeSystem(page_catalogue("hexagons-1"), filled=[(1, 0)]), plan, (0, 0))
    assert started.refusal == "a module would start at (1, 0), an obstacle or no place"


def test_what_leaves_the_workspace_is_refused() -> None:
    """Walls refuse a lift as obstacles do, a free place on the other side takes it."""
    plan = macro(HEXAGONS, LINE, TRIANGLE)
    cells = [(q, r) for q in range(-4, 9) for r in range(-4, 5)]
    walled = LatticeSystem(page_catalogue("hexagons-1"), workspace=cells)
    assert lift(walled, plan, (0, 0)).refusal is None
    assert "leave the workspace" in (lift(walled, plan, (0, 4)).refusal or "")


def test_modules_are_counted() -> None:
    """A macro between aggregates of unlike size, or of nothing, is refused."""
    with pytest.raises(InputError, match="from 3 modules to 2"):
        macro(HEXAGONS, LINE, LINE[:2])
    with pytest.raises(InputError, match="from 0 modules to 0"):
        macro(HEXAGONS, [], [])


@pytest.mark.parametrize("at", [(1,), (1, 2, 3), (0.5, 0)])
def test_a_place_is_as_many_integers_as_the_lattice_has_dimensions(at: tuple[int, ...]) -> None:
    """Anything else is refused as such."""
    with pytest.raises(InputError, match="a place is 2 integers"):
        lift(HEXAGONS, macro(HEXAGONS, LINE, TRIANGLE), at)


def test_a_system_that_is_not_local_has_no_macros() -> None:
    """A rule for the whole would have to be asked at every place."""
    system = LatticeSystem(page_catalogue("hexagons-2"), connected=True)
    with pytest.raises(InputError, match="not local"):
        macro(system, LINE, TRIANGLE)
    with pytest.raises(InputError, match="not local"):
        lift(system, macro(HEXAGONS, LINE, TRIANGLE), (0, 0))


def test_the_lattice_of_a_whole_lattice_scene() -> None:
    """Only then is there one."""
    assert lattice_of(scene_from_spec("hex:n=3")) == HEXAGONS.catalogue.lattice
