"""Catalogues: the three systems give the numbers that the paper states."""

import re
from typing import Any

import pytest
from msgspec.structs import replace

from cubepath.protocol.core.actions import Action, admissible, apply
from cubepath.protocol.core.catalogue import (
    DODECAHEDRA,
    EDGES,
    HEX_DIRECTIONS,
    HEXAGONS,
    SQUARES,
    Catalogue,
    Cell,
    Generator,
)
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.scenes.built_in_pages import page_catalogue
from cubepath.protocol.scenes.specs import scene_from_spec
from cubepath.protocol.systems.lattice import LatticeSystem
from oracles.complexes import f_vector, shape_f_vector, states_of

STEP = Generator(
    "step",
    support=((0, 0), (1, 0), (0, 1), (1, 1)),
    trace=((0, 0), (1, 0)),
    before=((0, 0),),
    after=((1, 0),),
    motion=(((0, 0), (1, 0)),),
    free=((0, 1), (1, 1)),
    guards=(((0, 1), (1, 1)),),
)
PUSH = Generator(
    "push",
    support=((0, 0), (1, 0), (2, 0)),
    trace=((0, 0), (1, 0), (2, 0)),
    before=((0, 0), (1, 0)),
    after=((1, 0), (2, 0)),
    motion=(((1, 0), (2, 0)), ((0, 0), (1, 0))),
)


def turned(generator: Generator) -> Generator:
    """Return a generator read backwards."""
    motion = tuple((target, source) for source, target in generator.motion)
    return replace(generator, before=generator.after, after=generator.before, motion=motion)


def moved(generator: Generator, by: Cell) -> Generator:
    """Return a generator that is listed elsewhere."""

    def put(cells: tuple[Cell, ...]) -> tuple[Cell, ...]:
        return tuple(SQUARES.shift(cell, by) for cell in cells)

    def pairs(cells: tuple[tuple[Cell, Cell], ...]) -> tuple[tuple[Cell, Cell], ...]:
        return tuple((SQUARES.shift(one, by), SQUARES.shift(other, by)) for one, other in cells)

    return Generator(
        generator.name,
        put(generator.support),
        put(generator.trace),
        put(generator.before),
        put(generator.after),
        pairs(generator.motion),
        put(generator.free),
        pairs(generator.guards),
    )


@pytest.mark.parametrize("generator", [STEP, PUSH])
@pytest.mark.parametrize("by", [(0, 0), (3, -2)])
def test_equal_generators_are_reported(generator: Generator, by: Cell) -> None:
    """By their names, wherever they are listed and in whatever direction; others are none."""
    for again in (moved(generator, by), moved(turned(generator), by)):
        other = replace(again, name="other")
        why = f"^generator 'other' equals '{generator.name}', up to a translation: expected each"
        with pytest.raises(InputError, match=why):
            Catalogue(SQUARES, (STEP, PUSH, other))
    Catalogue(SQUARES, (STEP, PUSH, replace(STEP, name="free", guards=())))


@pytest.mark.parametrize(
    "site", [(0, 0), (0, 0, 0, 0), [0, 0, 1], (0, 0, True), (0, 0.0, 1), "abc"]
)
def test_a_site_of_a_lattice_is_integers(site: Any) -> None:
    """As many as the lattice has entries, and neither booleans nor anything else."""
    assert EDGES.check((3, -1, 1)) == (3, -1, 1)
    with pytest.raises(InputError) as caught:
        EDGES.check(site)
    assert str(caught.value) == f"a site of lattice edges is 3 integers, found {site!r}"


def test_a_translation_leaves_the_orbit_as_it_is() -> None:
    """Only the first entries are moved, and there is none between two orbits."""
    assert EDGES.shift((1, 2, 1), (10, -20)) == (11, -18, 1)
    assert EDGES.between((1, 2, 1), (11, -18, 1)) == (10, -20)
    assert EDGES.between((1, 2, 1), (11, -18, 0)) is None
    assert HEXAGONS.between((1, 2), (0, 5)) == (-1, 3)


def test_dodecahedra_lie_at_points_with_an_even_sum() -> None:
    """A site or a translation with an odd sum is refused."""
    assert DODECAHEDRA.check((1, -1, 2)) == (1, -1, 2)
    with pytest.raises(InputError, match=r"with an even sum, found \(1, 0, 0\)$"):
        DODECAHEDRA.check((1, 0, 0))
    roll = Generator("roll", ends := ((0, 0, 0), (1, 1, 0)), ends, ends[:1], ends[1:], (ends,))
    system = LatticeSystem(Catalogue(DODECAHEDRA, (roll,)))
    assert system.action("roll", (0, 1, 1)).label == "roll at [0, 1, 1]"
    with pytest.raises(InputError, match=r"'at' is 3 integers with an even sum"):
        system.action("roll", (1, 0, 0))


def test_a_generator_is_placed_with_all_that_it_says() -> None:
    """Support, trace, local states, free sites and guards, each moved by as much."""
    assert STEP.place(SQUARES, (5, 7)) == Action(
        [(5, 7), (6, 7), (5, 8), (6, 8)],
        [(5, 7), (6, 7)],
        [(5, 7)],
        [(6, 7)],
        free=[(5, 8), (6, 8)],
        guards=[((5, 8), (6, 8))],
    )
    assert STEP.place(SQUARES, (5, 7)).label == "step at [5, 7]"


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"motion": ()}, "generator 'push': no module goes anywhere"),
        ({"support": (), "trace": ()}, "generator 'push': a local state holds (0, 0), which"),
        ({"trace": ()}, "generator 'push': the trace is empty"),
        ({"motion": PUSH.motion[:1]}, "generator 'push': 'goes' must take every site of the"),
        ({"motion": (((1, 0), (2, 0)), ((0, 0), (2, 0)))}, "generator 'push': 'goes' must take"),
        ({"motion": (((1, 0), (2, 0)), ((1, 0), (1, 0)))}, "generator 'push': 'goes' must take"),
    ],
)
def test_a_generator_says_where_each_of_its_modules_goes(
    changes: dict[str, Any], message: str
) -> None:
    """From every site of the trace that is on before to every one that is on after."""
    with pytest.raises(InputError, match=f"^{re.escape(message)}"):
        replace(PUSH, **changes)


def test_a_generator_may_read_what_stays_on() -> None:
    """Only the sites of the trace have to go somewhere."""
    held = replace(STEP, before=((0, 0), (0, 1)), after=((1, 0), (0, 1)), free=(), guards=())
    assert held.place(SQUARES, (0, 0)).reads == {(0, 1), (1, 1)}


def test_a_catalogue_is_of_generators_that_can_be_told_apart() -> None:
    """At least one, no name twice, and all cells of the lattice."""
    for generators, message in (
        ((), "a catalogue has at least one generator, found none"),
        ((STEP, PUSH, STEP), "generator 'step' stands twice in the catalogue"),
    ):
        with pytest.raises(InputError, match=f"^{message}$"):
            Catalogue(SQUARES, generators)
    with pytest.raises(InputError, match="a site of lattice edges is 3 integers"):
        Catalogue(EDGES, (STEP,))


def test_a_catalogue_is_its_lattice_and_generators() -> None:
    """What follows from these is neither shown nor compared, so catalogues can be kept in sets."""
    one, other = (Catalogue(SQUARES, (STEP, PUSH)) for _ in range(2))
    assert {one} == {other}
    assert one != Catalogue(SQUARES, (PUSH, STEP))
    assert repr(one) == f"Catalogue(lattice={SQUARES!r}, generators={(STEP, PUSH)!r})"


def test_a_module_proposes_each_generator_in_both_directions() -> None:
    """In the order of the catalogue, there and back, each time from where its mover stands."""
    catalogue = Catalogue(SQUARES, (STEP, PUSH))
    assert catalogue.by_name == {"step": STEP, "push": PUSH}
    found = catalogue.proposals((4, 4))
    assert [(move.generator, move.at, move.motion) for move in found] == [
        ("step", (4, 4), (((4, 4), (5, 4)),)),
        ("step", (3, 4), (((4, 4), (3, 4)),)),
        ("push", (3, 4), (((4, 4), (5, 4)), ((3, 4), (4, 4)))),
        ("push", (2, 4), (((4, 4), (3, 4)), ((3, 4), (2, 4)))),
    ]
    assert [(move.source, move.target) for move in found] == [
        ((4, 4), (5, 4)),
        ((4, 4), (3, 4)),
        ((4, 4), (5, 4)),
        ((4, 4), (3, 4)),
    ]
    assert [move.action for move in found] == [
        catalogue.place(move.generator, move.at)  # type: ignore[arg-type]
        for move in found
    ]
    known = catalogue.place("step", (0, 0))
    assert [move.action for move in catalogue.proposals((4, 4), lambda *_: known)] == [known] * 4


def test_modules_of_another_orbit_propose_nothing() -> None:
    """On the edges of a lattice a generator belongs to one axis, its mover's."""
    step = Generator(
        "along",
        support=((0, 0, 1), (0, 1, 1)),
        trace=((0, 0, 1), (0, 1, 1)),
        before=((0, 0, 1),),
        after=((0, 1, 1),),
        motion=(((0, 0, 1), (0, 1, 1)),),
    )
    catalogue = Catalogue(EDGES, (step,))
    assert catalogue.orbit((4, 5, 1)) == (0, 0, 1)
    assert [move.at for move in catalogue.proposals((4, 5, 1))] == [(4, 5), (4, 4)]
    assert catalogue.proposals((4, 5, 0)) == ()


def test_a_move_is_possible_where_all_that_it_takes_along_stand() -> None:
    """At the other end of its action the mover may stand, and the rest does not."""
    there, back = Catalogue(SQUARES, (PUSH,)).proposals((1, 0))
    assert [there.at, back.at] == [(0, 0), (-1, 0)]
    assert there.possible({(0, 0), (1, 0)})
    assert not there.possible({(1, 0), (2, 0)})
    assert not there.possible({(1, 0)})
    assert not back.possible({(-1, 0), (0, 0)})
    assert back.possible({(0, 0), (1, 0)})
    step, undone = Catalogue(SQUARES, (STEP,)).proposals((0, 0))
    assert step.possible({(0, 0)})
    assert not step.possible({(1, 0)})
    assert not step.possible({(0, 0), (0, 1)})
    assert undone.possible({(0, 0)})
    assert not undone.possible({(-1, 0)})


def euler(counts: list[int]) -> int:
    return sum(count if k % 2 == 0 else -count for k, count in enumerate(counts))


def test_hexagonal_shape_complex_of_three() -> None:
    """Catalogue 1 with three modules: 11 vertices, 24 edges, nine squares (paper, appendix)."""
    assert shape_f_vector(scene_from_spec("hex:n=3")) == [11, 24, 9]


@pytest.mark.parametrize(("keeps", "size"), [(True, 8), (False, 6)])
def test_hexagonal_supports(keeps: bool, size: int) -> None:
    """Six generators, supports of eight and six cells, traces of two, one cell on beside them."""
    catalogue = page_catalogue("hexagons-1" if keeps else "hexagons-2")
    assert len(catalogue.generators) == 6
    for generator in catalogue.generators:
        assert len(set(generator.support)) == size
        assert len(generator.trace) == 2
        assert len(set(generator.before) & set(generator.after)) == 1


def test_the_generators_are_one_up_to_rotation() -> None:
    """Turning a generator by sixty degrees gives another generator of the catalogue."""
    catalogue = page_catalogue("hexagons-1")

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
