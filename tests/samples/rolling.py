"""Cubes and dodecahedra that turn about an edge, and cubes that slide."""

from cubepath.protocol.core.catalogue import CUBES, DODECAHEDRA, Catalogue, Cell, Generator, Lattice
from cubepath.protocol.core.system import Scene
from cubepath.protocol.systems.lattice import LatticeSystem


def turn(name: str, on: tuple[Cell, ...], there: Cell, swept: tuple[Cell, ...] = ()) -> Generator:
    """Return a generator that takes a module from the origin past cells that stay on."""
    here = (0, 0, 0)
    support = (here, there, *on, *swept)
    return Generator(name, support, (here, there), (here, *on), (there, *on), ((here, there),))


FLOOR: tuple[Cell, ...] = ((0, 0, -1), (1, 0, -1))
CUBE_TURNS = (
    turn("along", FLOOR, (1, 0, 0), ((0, 0, 1), (1, 0, 1))),
    turn("round", FLOOR[:1], (1, 0, -1), ((0, 0, 1), (1, 0, 1), (1, 0, 0), (2, 0, 0), (2, 0, -1))),
    turn("across", ((0, 0, -1), (0, 1, -1)), (0, 1, 0), ((0, 0, 1), (0, 1, 1))),
)
SLIDE = turn("slide", FLOOR, (1, 0, 0))
ROLL = turn("roll", ((-1, -1, 0),), (0, -1, 1))


def on_a_lattice(
    lattice: Lattice,
    generators: tuple[Generator, ...],
    start: tuple[Cell, ...],
    goal: tuple[Cell, ...] = (),
    filled: tuple[Cell, ...] = (),
) -> Scene:
    """Return a scene of a catalogue on a whole lattice."""
    system = LatticeSystem(Catalogue(lattice, generators), filled=filled)
    return Scene("own", "own", system, start, frozenset(goal) if goal else None)


def rolling_cubes() -> Scene:
    """Return a cube on two others, which can turn along them and around the second."""
    start, goal = ((0, 0, 1), (0, 0, 0), (1, 0, 0)), ((2, 0, 0), (0, 0, 0), (1, 0, 0))
    return on_a_lattice(CUBES, CUBE_TURNS, start, goal)


def rolling_dodecahedra() -> Scene:
    """Return a dodecahedron that can roll past another, about the edge that three share."""
    return on_a_lattice(DODECAHEDRA, (ROLL,), ((1, 1, 0), (0, 0, 0)), ((1, 0, 1), (0, 0, 0)))
