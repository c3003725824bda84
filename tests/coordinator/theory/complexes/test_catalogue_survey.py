"""What is said of catalogues, against counts from other sources and against brute force."""

from itertools import product

import pytest

from cubepath.coordinator.theory.complexes.catalogue_survey import (
    FAR,
    catalogue_survey,
    never_admissible,
)
from cubepath.protocol.core.actions import commute
from cubepath.protocol.core.catalogue import EDGES, SQUARES, Catalogue, Generator
from cubepath.protocol.scenes.built_in_pages import page_catalogue
from cubepath.protocol.scenes.specs import scene_from_spec
from cubepath.protocol.systems.lattice import LatticeSystem

SHAPES = {"hex": (1, 3, 11, 44, 186), "sliding:n=2": (1, 2, 6, 19, 63), "sliding-cubes": (1, 3, 15)}
"""Fixed polyhexes (OEIS A001207), polyominoes (A001168) and polycubes (A001931)."""


def met_pairs(catalogue: Catalogue, far: int) -> tuple[int, int]:
    """Return the pairs of placed generators that meet, and those that commute, one by one."""
    meeting = commuting = 0
    here = [each.place(catalogue.lattice, (0, 0)) for each in catalogue.generators]
    for by in product(range(-far, far + 1), repeat=2):
        there = [each.place(catalogue.lattice, by) for each in catalogue.generators]
        for one, other in product(here, there):
            if one != other and one.support & other.support:
                meeting += 1
                commuting += commute(one, other)
    return meeting // 2, commuting // 2


@pytest.mark.slow
@pytest.mark.parametrize("name", ["hexagons-1", "hexagons-3"])
def test_pairs_are_those_of_brute_force(name: str) -> None:
    """Each pair of generators in each place where their supports meet counts once."""
    catalogue = page_catalogue(name)
    found = catalogue_survey(LatticeSystem(catalogue), 1)
    assert (found.meeting, found.commuting) == met_pairs(catalogue, 7)


@pytest.mark.slow
@pytest.mark.parametrize(("spec", "counts"), SHAPES.items())
def test_all_aggregates_are_tried(spec: str, counts: tuple[int, ...]) -> None:
    """They are the fixed animals of the lattice."""
    found = catalogue_survey(scene_from_spec(spec).system, len(counts))
    assert found.aggregates == sum(counts)


@pytest.mark.thorough
def test_what_moves_of_hexagons_do() -> None:
    """The first catalogue keeps aggregates whole, holes too; the second takes three apart."""
    keeps, splits = (
        catalogue_survey(scene_from_spec(name).system, 6) for name in ("hex", "hex-open")
    )
    assert (keeps.splits, keeps.holes, keeps.sensed, keeps.farthest) == (None, None, 18, 2)
    assert splits.splits is not None
    assert len(splits.splits.before) == 3
    assert splits.holes is not None  # a ring of six opens
    assert len(splits.holes.before) == 6


@pytest.mark.slow
def test_a_rule_for_the_whole_aggregate_is_not_seen() -> None:
    """The witnesses agree wherever the mover looks, and one of them would fall apart."""
    system = scene_from_spec("hex-connected").system
    found = catalogue_survey(system, 6)
    assert found.unseen is not None
    one, other = found.unseen
    views = [
        [cell in each.before for cell in system.sensed(each.move.source)] for each in (one, other)
    ]
    assert views[0] == views[1]
    assert system.legal(one.after)
    assert not system.legal(other.after)


def test_guards_may_exclude_every_state() -> None:
    """A cell that is on needs one that is off."""
    cells = (0, 0), (1, 0), (0, 1), (0, 2)
    for on, never in (((0, 1),), True), (((0, 1), (0, 2)), False):
        guarded = Generator(
            "slide",
            cells,
            cells[:2],
            ((0, 0), *on),
            ((1, 0), *on),
            (cells[:2],),
            guards=(((0, 1), (0, 2)),),
        )
        assert never_admissible(guarded) is never
        assert Catalogue(SQUARES, (guarded,)).generators == (guarded,)


def test_witnesses_look_alike_to_movers_in_one_direction() -> None:
    """An edge that flips out and one that flips back may see the same, but are not compared."""
    ends = (0, 0, 0), (0, 0, 1)
    off = (1, 0, 0), (1, 0, 1), (1, -1, 1)
    flip = Generator("flip", (*ends, *off), ends, ends[:1], ends[1:], (ends,))
    system = LatticeSystem(Catalogue(EDGES, (flip,)), connected=True)
    found = catalogue_survey(system, 3)
    assert found.unseen is not None
    one, other = (system.encode_site(each.move.source)[-1] for each in found.unseen)
    assert one == other


def test_far_cells_do_not_take_for_ever() -> None:
    """Nor does a cell that no step leads to; the survey says that they are far."""
    for lattice, far in (SQUARES, (10**9, 0)), (EDGES, (0, 0, 7)):
        cells = (0,) * lattice.arity, (1,) + (0,) * (lattice.arity - 1)
        slide = Generator("slide", (*cells, far), cells, cells[:1], cells[1:], (cells,))
        assert catalogue_survey(LatticeSystem(Catalogue(lattice, (slide,))), 2).farthest == FAR
