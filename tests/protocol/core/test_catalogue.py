"""Catalogues: the three systems give the numbers that the paper states."""

from dataclasses import replace

import pytest

from complexes import f_vector, shape_f_vector, states_of
from cubepath.protocol.core.actions import admissible, apply
from cubepath.protocol.core.catalogue import (
    HEX_DIRECTIONS,
    SQUARES,
    Catalogue,
    Cell,
    Generator,
)
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.scenes.families.hexagons import hex_catalogue
from cubepath.protocol.scenes.specs import scene_from_spec


def euler(counts: list[int]) -> int:
    return sum(count if k % 2 == 0 else -count for k, count in enumerate(counts))


def test_hexagonal_shape_complex_of_three() -> None:
    """Catalogue 1 with three modules: 11 vertices, 24 edges, nine squares (paper, appendix)."""
    assert shape_f_vector(scene_from_spec("hex:n=3")) == [11, 24, 9]


@pytest.mark.parametrize(("keeps", "size"), [(True, 8), (False, 6)])
def test_hexagonal_supports(keeps: bool, size: int) -> None:
    """Six generators, supports of eight and six cells, traces of two, one cell on beside them."""
    catalogue = hex_catalogue(keeps_topology=keeps)
    assert len(catalogue.generators) == 6
    for generator in catalogue.generators:
        assert len(set(generator.support)) == size
        assert len(generator.trace) == 2
        assert len(set(generator.before) & set(generator.after)) == 1


def test_the_generators_are_one_up_to_rotation() -> None:
    """Turning a generator by sixty degrees gives another generator of the catalogue."""
    catalogue = hex_catalogue(keeps_topology=True)

    def turn(cell: tuple[int, ...]) -> tuple[int, int]:
        return -cell[1], cell[0] + cell[1]

    assert [turn(d) for d in HEX_DIRECTIONS] == [*HEX_DIRECTIONS[1:], HEX_DIRECTIONS[0]]
    placed = {
        move.action for cell in [(0, 0), *HEX_DIRECTIONS] for move in catalogue.proposals(cell)
    }
    for generator in catalogue.generators:
        turned = type(generator)(
            name="turned",
            support=tuple(turn(c) for c in generator.support),
            trace=tuple(turn(c) for c in generator.trace),
            before=tuple(turn(c) for c in generator.before),
            after=tuple(turn(c) for c in generator.after),
            motion=tuple((turn(a), turn(b)) for a, b in generator.motion),
        )
        assert turned.place(catalogue.lattice, (0, 0)) in placed


def test_positive_arm_of_five_segments() -> None:
    """32 states, 48 edges, 18 squares and one 3-cube (paper, example robot arm)."""
    assert f_vector(scene_from_spec("arm:n=5")) == [32, 48, 18, 1]


@pytest.mark.parametrize("n", range(1, 7))
def test_positive_arm_has_euler_characteristic_one(n: int) -> None:
    """All words are reached, and the complex has the Euler characteristic of a point."""
    counts = f_vector(scene_from_spec(f"arm:n={n}"))
    assert counts[0] == 2**n
    assert euler(counts) == 1


def test_two_vehicles_on_k5() -> None:
    """A surface of Euler characteristic -5; labelled, twice that, genus 6 (paper)."""
    assert euler(f_vector(scene_from_spec("agv:graph=K5,n=2"))) == -5
    labelled = f_vector(scene_from_spec("agv-labelled:graph=K5,n=2"))
    assert labelled == [20, 60, 30]
    assert euler(labelled) == 2 - 2 * 6


def test_a_move_can_be_undone_by_the_same_module() -> None:
    """After a move, a module of it can propose the same action back."""
    for spec in ("hex:n=4", "hex-open:n=3", "arm:n=4", "agv:graph=K5", "agv-labelled:graph=C4"):
        scene = scene_from_spec(spec)
        system = scene.system
        for state in states_of(scene, most=40):
            for site in state:
                for move in system.moves(site):
                    if move is None or not admissible(move.action, state):
                        continue
                    after = apply(move.action, state)
                    assert move.target in after
                    back = [m for m in system.moves(move.target) if m and m.action == move.action]
                    assert [m.motion for m in back] == [tuple((b, a) for a, b in move.motion)]


Motion = tuple[tuple[Cell, Cell], ...]
STEP = Generator(
    "step", ((0, 0), (1, 0)), ((0, 0), (1, 0)), ((0, 0),), ((1, 0),), (((0, 0), (1, 0)),)
)


@pytest.mark.parametrize("cell", [(True, 0), (0, False), (0, 0, 0), (0.0, 1), "ab", 7])
def test_a_cell_is_whole_numbers(cell: object) -> None:
    """A boolean is none, though Python takes it for one; neither is a float."""
    with pytest.raises(InputError, match="a site of lattice squares is 2 integers"):
        SQUARES.check(cell)


def test_names_of_generators_stand_once() -> None:
    """Two of one name could not be told apart in a file of moves."""
    with pytest.raises(InputError, match="generator 'step' stands twice in the catalogue"):
        Catalogue(SQUARES, (STEP, replace(STEP, name="other"), STEP))


@pytest.mark.parametrize(
    "motion",
    [
        (((0, 0), (0, 0)),),
        (((0, 0), (0, 1)),),
        (((1, 0), (1, 0)),),
        (((1, 0), (0, 0)),),
        (((0, 0), (1, 0)), ((0, 0), (0, 0))),
    ],
)
def test_modules_go_where_the_local_states_say(motion: Motion) -> None:
    """From every site of the trace that is on before, to one that is on after, and no other."""
    with pytest.raises(InputError, match="'step': 'goes' must take every site of the trace"):
        replace(STEP, motion=motion)
