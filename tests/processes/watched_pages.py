"""Pages of runs for tests: scenes of every kind of system, and what is true of runs in them."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeAlias

from cubepath.agents.environments.rollouts import play
from cubepath.coordinator.normal_form.compiled_heap import FastHeap
from cubepath.coordinator.runs.states import Steps, snapshots
from cubepath.coordinator.tools.viewing.run_view import RunView
from cubepath.protocol.core.catalogue import SQUARES, Catalogue, Generator
from cubepath.protocol.core.sites import site_text
from cubepath.protocol.core.system import Scene
from cubepath.protocol.scenes.specs import scene_from_spec
from cubepath.protocol.systems.lattice import LatticeSystem

Open: TypeAlias = Callable[..., Any]
"""Opens a page of a browser."""
OWN = """format = "cubepath-system-1"
name = "</script><b>crawl"
start = [[0, 1], [2, 1]]

[lattice]
name = "squares"
filled = [[0, 0], [1, 0], [2, 0], [3, 0], [4, 0], [5, 0]]

[[lattice.generators]]
name = "</script><script>alert(1)</script>"
support = [[0, 0], [1, 0], [0, -1], [1, -1]]
trace = [[0, 0], [1, 0]]
before = [[0, 0], [0, -1], [1, -1]]
after = [[1, 0], [0, -1], [1, -1]]
goes = [[[0, 0], [1, 0]]]
"""
"""A user's own system, whose names would end the element that they stand in."""


def pivoting_squares() -> Scene:
    """Return three squares of which one can roll around the two others, as no built-in ones do.

    It turns by half around a module at a corner, and by a quarter along two; both need the cells
    free that it sweeps.
    """
    generators: list[Generator] = []
    for number in range(4):
        turned = (1, 1j, -1, -1j)[number]

        def cells(*spots: complex, turned: complex = turned) -> tuple[tuple[int, int], ...]:
            return tuple((round((s * turned).real), round((s * turned).imag)) for s in spots)

        for name, other, on, swept in (
            ("round", 1 - 1j, (-1j,), (1, 1j, 1 + 1j, 2, 2 - 1j)),
            ("along", 1, (-1j, 1 - 1j), (1j, 1 + 1j)),
        ):
            source, target, *rest = cells(0, other, *on, *swept)
            still = rest[: len(on)]
            generators.append(
                Generator(
                    f"{name}-{number}",
                    (source, target, *rest),
                    (source, target),
                    (source, *still),
                    (target, *still),
                    ((source, target),),
                )
            )
    system = LatticeSystem(Catalogue(SQUARES, tuple(generators)))
    return Scene("rolling.toml", "rolling", system, ((0, 1), (0, 0), (1, 0)))


KINDS = (
    "hex:n=5",
    "hex-open:n=4",
    "sliding:p=2,q=1,n=4",
    "agv:graph=K5,n=2",
    "agv-labelled:graph=grid3x3,n=3",
    "arm:n=4",
    "arms",
    "polygon:n=7",
    "triangulation:n=10",
    "words",
    "assembly:n=3",
    "own.toml",
)


@dataclass(frozen=True)
class Watched:
    """What a page shows, and the sites of the modules after each step of its two paths."""

    shown: RunView
    sites: tuple[list[list[str]], list[list[str]]]


def watched(spec: str, folder: Path, rounds: int = 12) -> Watched:
    """Play a scene by a rule that suits any."""
    if spec == "own.toml":
        path = folder / spec
        path.write_text(OWN)
        spec = str(path)
    scene = scene_from_spec(spec)
    played = play(scene, "random", seed=3, max_rounds=rounds)
    heap = FastHeap(telling=True)
    steps = played.steps
    heap.extend(played.path)
    cubes = heap.cube_path()
    shown = RunView(scene, steps, cubes, heap.normal_form())
    return Watched(shown, (followed(scene, steps), followed(scene, cubes)))


def followed(scene: Scene, steps: Steps) -> list[list[str]]:
    """Return the names of the sites of the modules at the start, and after each step."""
    return [[site_text(site) for site in each.sites] for each in snapshots(scene, steps)]


def until(page: Any, condition: str) -> None:
    """Wait until something holds in a page, whose policy lets nobody compile code in it."""
    for _ in range(2000):
        if page.evaluate(condition):
            return
        page.wait_for_timeout(5)
    live = page.query_selector("#live")
    raise AssertionError(f"never held: {condition}; {live and live.inner_text()}")
