"""Drawn generators: what a drawing means, its orientations, connectivity, and mistakes."""

from itertools import combinations, product
from typing import Any

import pytest
from hypothesis import given, strategies as st

from cubepath.protocol.core.actions import apply, commute
from cubepath.protocol.core.catalogue import (
    CUBES,
    DODECAHEDRA,
    EDGES,
    HEXAGONS,
    LATTICES,
    SQUARES,
    Catalogue,
    Cell,
    Generator,
    Lattice,
)
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.symmetries import orientations
from cubepath.protocol.scenes import drawn_generators
from cubepath.protocol.scenes.built_in_pages import page_catalogue
from cubepath.protocol.scenes.drawings import DrawingError, drawing_text
from cubepath.protocol.scenes.drawn_generators import generator_marks, generators_of
from cubepath.protocol.scenes.families.arms import free_arm_catalogue
from cubepath.protocol.scenes.families.compression import compression_catalogue
from cubepath.protocol.scenes.families.shapes import sliding_catalogue
from oracles.hexagon_generators import catalogues

SIZES = {"hexagons": 6, "squares": 4, "edges": 4, "cubes": 24, "dodecahedra": 24, "cube-edges": 24}


def drawn(lattice: Lattice, before: str, after: str, **more: Any) -> list[Generator]:
    table = {"name": "move", "before": before, "after": after, **more}
    return generators_of(lattice, table, {"before": (10, 0), "after": (20, 0)})


@pytest.mark.parametrize(("name", "catalogue"), catalogues().items())
def test_hexagonal_pages_are_the_catalogues_of_the_paper(name: str, catalogue: Catalogue) -> None:
    """Names, order and cells are those that directions give, so files and hashes stay."""
    assert page_catalogue(name) == catalogue


@pytest.mark.parametrize("lattice", LATTICES.values(), ids=LATTICES)
def test_symmetries_keep_contacts(lattice: Lattice) -> None:
    """There are as many as known, all different, and cells that touch still do."""
    found = list(orientations(lattice, mirrored=True))
    assert len({each.matrix for each in found}) == len(found) == 2 * SIZES[lattice.name]
    for way, (one, other) in product(found, lattice.contacts):
        assert way.moved(lattice, other) in lattice.beside(way.moved(lattice, one))


def test_cells_of_every_lattice() -> None:
    """Columns, rows, layers and vertices give the cells that they stand for."""
    moves = {
        HEXAGONS: (" . #\n  a", " a #\n  .", ((0, 0), (-1, 1)), (0, 1)),
        CUBES: ("a\n--\n. #", ".\n--\na #", ((0, 0, 0), (0, 0, 1)), (1, 0, 1)),
        DODECAHEDRA: ("a #\n--\n  .", ". #\n--\n  a", ((0, 0, 0), (1, 0, 1)), None),
        EDGES: ("+ a +\n.\n+ #", "+ . +\na\n+ #", ((0, 0, 0), (0, -1, 1)), (0, -1, 0)),
    }
    for lattice, (before, after, motion, pivot) in moves.items():
        if pivot is None:  # a cell one step to the side is none of this lattice
            with pytest.raises(InputError, match=r"line 10, column 3.*between two cells"):
                drawn(lattice, before, after)
            continue
        (generator,) = drawn(lattice, before, after)
        assert generator.motion == (motion,)
        assert set(generator.before) == {motion[0], pivot}


CATALOGUES = {
    "arm-free": free_arm_catalogue(),
    "sliding": sliding_catalogue(3),
    **{
        name: page_catalogue(name)
        for name in ("hexagons-3", "sliding-cubes", "pivoting-cubes", "rolling-dodecahedra")
    },
}


@pytest.mark.parametrize("catalogue", CATALOGUES.values(), ids=CATALOGUES)
def test_what_is_shown_is_read_back(catalogue: Catalogue) -> None:
    """A generator that is drawn, with its arrows, layers and vertices, is the same one again."""
    lattice = catalogue.lattice
    for each in catalogue.generators[:30]:
        before, after = (drawing_text(lattice, marks) for marks in generator_marks(lattice, each))
        (again,) = drawn(lattice, before, after)
        assert again.canonical(lattice) == each.canonical(lattice)


def components(lattice: Lattice, cells: set[Cell]) -> int:
    """Return how many pieces cells have, by joining them pair by pair."""
    pieces = [{cell} for cell in cells]
    for one, other in combinations(cells, 2):
        if other in lattice.beside(one):
            first, second = (next(p for p in pieces if cell in p) for cell in (one, other))
            if first is not second:
                first |= second
                pieces.remove(second)
    return len(pieces)


HEX_STEPS = drawn(HEXAGONS, "a .", ". a", symmetry="rotations", connected="near")
CUBE_SLIDES = drawn(CUBES, "a .\n# #", ". a\n# #", symmetry="rotations", connected="near")
CORNERS = drawn(
    SQUARES, ". . .\n? a .\n? # .", ". . .\n? . .\n? # a", symmetry="all", connected="near"
)
PAIR = "a .     b .\n# #     # #", ". a     . b\n# #     # #"
APART = drawn(SQUARES, *PAIR, connected="near")
"""Two that slide at once, each along its own side of what may be connected elsewhere."""


@pytest.mark.slow
@pytest.mark.parametrize(
    ("lattice", "generators"),
    [(HEXAGONS, HEX_STEPS), (CUBES, CUBE_SLIDES), (SQUARES, CORNERS), (SQUARES, APART)],
    ids=["hexagons", "cubes", "squares", "apart"],
)
@given(data=st.data())
def test_near_connectivity_keeps_aggregates_connected(
    lattice: Lattice, generators: list[Generator], data: st.DataObject
) -> None:
    """Whatever is grown around an allowed state: if it is connected, it is afterwards."""
    generator = data.draw(st.sampled_from(generators))
    action = generator.place(lattice, (0,) * lattice.dimension)
    for end in (0, 1):
        cells = set(map(lattice.check, action.ends[end]))
        for _ in range(data.draw(st.integers(0, 12))):
            border = sorted({n for c in cells for n in lattice.beside(c)} - action.support - cells)
            if border:
                cells.add(data.draw(st.sampled_from(border)))
        after = set(map(lattice.check, apply(action, cells)))
        if components(lattice, cells) == 1:
            assert components(lattice, after) == 1


@pytest.mark.slow
def test_near_connectivity_of_hexagons_has_the_moves_of_compression() -> None:
    """They are those 104 in each direction, and 13 that may surround a hole."""
    mine, theirs = (
        {each.canonical(HEXAGONS) for each in generators}
        for generators in (HEX_STEPS, compression_catalogue().generators)
    )
    assert theirs < mine
    assert len(mine) == 3 * (104 + 13)


def test_orientations_have_names_and_are_chosen_by_number() -> None:
    """A generator that looks the same after half a turn, read backwards, has two orientations."""
    slide = {"before": "a .\n# #", "after": ". a\n# #"}
    assert [each.name for each in drawn(SQUARES, **slide, symmetry="rotations")] == [
        f"move-{number}" for number in range(4)
    ]
    found = drawn(SQUARES, **slide, name="{turn}{side}", symmetry="all", turns=[1])
    assert [each.name for each in found] == ["1left", "1right"]
    first, second = (each.place(SQUARES, (0, 0)) for each in found)
    assert not commute(first, second)


MISTAKES = [
    ("a .", "a .", {}, r"line 20, column 1, generator 'move': after: module 'a' does not move"),
    ("b .", ". b", {}, r"line 10, generator 'move': before: expected the mover, 'a'"),
    ("a .", ". b", {}, r"line 10, column 1, .* module 'a' is missing afterwards"),
    ("a .", ". a\n#", {}, r"line 20, .* has 2 rows, but the drawing before 1 rows"),
    ("a . #", ". a .", {}, r"line 20, column 5, .* '#' before, '.' after, expected the same"),
    ("a #", ". a", {}, r"line 20, column 3, .* '#' before, 'a' after, expected a module or '.'"),
    ("a . a", ". a", {}, r"line 10, column 5, .* module 'a' stands twice"),
    ("a .%", ". a", {}, r"line 10, column 4, .* unknown mark '%', expected a b c"),
    ("a .#", ". a#", {}, r"line 10, column 4, .* stands between two cells"),
    ("a .\n--", ". a\n--\n", {}, r"line 11, column 1, .* a plane lattice has one layer"),
    ("a . >", ". a >", {}, r"line 10, column 5, .* neighbour that way is neither '#' nor free"),
    ("", "", {}, r"line 10, .* nothing is drawn"),
    ("a .", ". a", {"turns": [7]}, "turns: expected numbers of rotations, 0 to 3, found 7"),
    ("a .", ". a", {"turns": ["x"]}, r"turns\[0\]: expected a whole number, found"),
    ("a .", ". a", {"symmetry": "al"}, "symmetry: expected 'rotations' or 'all', found 'al'"),
    ("a .", ". a", {"connected": True}, "connected: expected a text, found true or false"),
    ("a .", ". a", {"name": 3}, "name: expected a text, found a whole number"),
]


@pytest.mark.parametrize(("before", "after", "more", "message"), MISTAKES)
def test_mistakes_name_line_and_column(
    before: str, after: str, more: dict[str, Any], message: str
) -> None:
    """Each is one line, at the mark in the drawing where it is."""
    with pytest.raises(InputError, match=message):
        drawn(SQUARES, before, after, **more)


def test_a_mistake_has_a_picture() -> None:
    """A caret stands under the mark."""
    with pytest.raises(DrawingError) as error:
        drawn(SQUARES, "a .\n# #", ". a\n# .")
    assert error.value.picture == ". a\n# .\n  ^"


def test_too_many_local_states_are_counted() -> None:
    """The 18 cells around a step of a dodecahedron are more than are tried."""
    with pytest.raises(
        InputError, match=r"18 cells .* 2\^18 = 262144 local states, expected at most 2\^12"
    ):
        drawn(DODECAHEDRA, "  .\na", "  a\n.", connected="near")


def test_too_many_orientations_of_local_states_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each drawing stands for so many generators that they can be read in seconds."""
    monkeypatch.setattr(drawn_generators, "_MOST", 40)
    with pytest.raises(InputError, match=r"'move': connected: \d+ local states .* more than 40"):
        drawn(CUBES, "a .\n# #", ". a\n# #", symmetry="all", connected="near")
