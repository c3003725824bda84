"""Small scenes on each lattice in space: cubes, rhombic dodecahedra, and edges of cubes."""

from dataclasses import replace
from itertools import product
from pathlib import Path

from cubepath.protocol.core.catalogue import Cell
from cubepath.protocol.core.system import Scene
from cubepath.protocol.scenes.specs import scene_from_spec
from cubepath.protocol.systems.lattice import LatticeSystem

STICKS = str(Path(__file__).parents[1] / "data/pages/cube-edges.toml")
SPACE = ("sliding-cubes:n=3", "rolling-dodecahedra:n=3", f"{STICKS}:n=3")


def boxed(spec: str) -> Scene:
    """Return a scene without a goal, in a box one wider than its start on each side."""
    scene = scene_from_spec(spec)
    system = scene.system
    assert isinstance(system, LatticeSystem)
    lattice = system.catalogue.lattice
    axes = list(zip(*map(lattice.check, scene.start), strict=True))[: lattice.dimension]
    sides: list[range] = [range(min(axis) - 1, max(axis) + 2) for axis in axes]
    sides += [range(lattice.dimension)] * (lattice.arity - lattice.dimension)
    cells: list[Cell] = [cell for cell in product(*sides) if not (lattice.even and sum(cell) % 2)]
    walls = LatticeSystem(system.catalogue, workspace=cells)
    return replace(scene, system=walls, goal=None, goals=())
