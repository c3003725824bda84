"""The report of `cubepath complex` on a system: counts, curvature, homology, time."""

from collections.abc import Callable
from dataclasses import dataclass, field
from time import perf_counter
from typing import Any

from cubepath.coordinator.theory.complexes.collapses import contractibility
from cubepath.coordinator.theory.complexes.cubical_complex import CubicalComplex
from cubepath.coordinator.theory.complexes.exploration import MAX_STATES, Exploration, explore
from cubepath.coordinator.theory.complexes.homology_groups import Homology, homology
from cubepath.coordinator.theory.complexes.links import (
    Links,
    bytes_for_links,
    check_links,
    unfilled,
)
from cubepath.coordinator.theory.complexes.shape_complexes import (
    ShapeComplex,
    TooManyShapes,
    shape_complex,
)
from cubepath.coordinator.theory.complexes.state_complexes import (
    StateComplex,
    bytes_for,
    f_vector,
    state_complex,
)
from cubepath.coordinator.theory.complexes.state_masks import row_of
from cubepath.coordinator.theory.complexes.surfaces import pulled_apart, surface
from cubepath.protocol.core.errors import CheckError
from cubepath.protocol.core.system import Scene

BYTES_MAX = 8 << 30
"""The bound on the memory of the cubes."""
_WITNESSES = 5

Progress = Callable[[str, int, int], None]
"""Called with the current work, how much of it is done, and its total (0 if not known)."""


@dataclass(slots=True)
class ComplexReport:
    """The figures of one complex; None if they were not asked for or could not be computed."""

    system: str
    kind: str
    local: bool
    complete: bool
    states: int
    memory: int
    f_vector: tuple[int, ...] | None = None
    components: int | None = None
    surface: str | None = None
    orientable: bool | None = None
    """For complexes of dimension 2 with no edge in more than two squares."""
    homology: Homology | None = None
    homotopy: str | None = None
    npc: bool | None = None
    links_checked: int | None = None
    goal: bool | None = None
    """Whether the goal of the scene is among the states; None without a goal, or if not known."""
    witnesses: list[str] = field(default_factory=list)
    failing: int = 0
    """The number of states at which the link condition fails."""
    seconds: float = 0.0
    built: StateComplex | ShapeComplex | None = None

    @property
    def euler(self) -> int | None:
        """Return the Euler characteristic."""
        if self.f_vector is None:
            return None
        return sum(count if k % 2 == 0 else -count for k, count in enumerate(self.f_vector))

    @property
    def contractible(self) -> bool | None:
        """Return whether the complex is contractible, None if neither was proved."""
        return {None: None, "collapses to a point": True, "not contractible": False}.get(
            self.homotopy
        )

    def document(self) -> dict[str, Any]:
        """Return the report as JSON."""
        known = self.homology
        return {
            "system": self.system,
            "complex": self.kind,
            "local": self.local,
            "complete": self.complete,
            "states": self.states,
            "goal": self.goal,
            "f_vector": self.f_vector,
            "euler": self.euler,
            "components": self.components,
            "surface": self.surface,
            "orientable": self.orientable,
            "betti": None if known is None else known.betti,
            "torsion": None if known is None else known.torsion,
            "betti_z2": None if known is None else known.betti_z2,
            "npc": self.npc,
            "links_checked": self.links_checked,
            "links_failing": None if self.npc is None else self.failing,
            "witnesses": self.witnesses,
            "contractible": self.contractible,
            "homotopy": self.homotopy,
            "bytes": self.memory,
            "seconds": round(self.seconds, 3),
        }


def complex_report(
    scene: Scene,
    *,
    shape: bool = False,
    with_homology: bool = False,
    with_links: bool = False,
    keep: bool = False,
    max_states: int = MAX_STATES,
    progress: Progress | None = None,
) -> ComplexReport:
    """Return the figures of the state complex, or of the shape complex, of a scene.

    With `keep` the cubes themselves are kept in `built`. If there are more than `max_states`
    states, `complete` is False and the report holds only what is known then.
    """
    began = perf_counter()
    tell: Progress = progress or (lambda _what, _done, _total: None)
    if shape:
        found = _of_shapes(scene, max_states, tell)
        if isinstance(found.built, ShapeComplex):
            _examine(found, found.built.complex, with_homology, with_links, tell)
        found.seconds = perf_counter() - began
        return found
    explored = explore(
        scene, max_states=max_states, progress=lambda done, known: tell("states", done, known)
    )
    found = ComplexReport(
        system=scene.spec,
        kind="state complex",
        local=scene.system.local,
        complete=explored.complete,
        states=len(explored.states),
        memory=explored.memory,
        goal=_has_goal(explored),
    )
    if not explored.complete:
        if with_links:
            _link_by_link(found, explored, tell)
    elif with_homology or with_links or keep:
        built = _built(explored, with_links=with_links)
        found.built, found.memory = built, built.memory
        found.f_vector = built.complex.f_vector
        _examine(found, built.complex, with_homology, with_links, tell)
    else:
        found.f_vector = f_vector(explored)
    found.seconds = perf_counter() - began
    return found


def _has_goal(explored: Exploration) -> bool | None:
    scene = explored.scene
    if scene.goal is None:
        return None
    bits = {site: bit for bit, site in enumerate(explored.bits.sites)}
    on = scene.goal - scene.system.filled
    found = False
    if on <= bits.keys():  # others occur in no state
        row = row_of(sum(1 << bits[site] for site in on), explored.states.shape[1])
        found = bool((explored.states == row).all(axis=1).any())
    return found or (False if explored.complete else None)


def _built(explored: Exploration, *, with_links: bool) -> StateComplex:
    counts = f_vector(explored)
    needed = bytes_for(counts) + (bytes_for_links(counts) if with_links else 0)
    if needed > BYTES_MAX:
        raise CheckError(
            f"{explored.scene.spec}: its cubes take some {needed >> 20} MiB, expected at most"
            f" {BYTES_MAX >> 20}; without --homology, --link and files they are only counted"
        )
    return state_complex(explored)


def _of_shapes(scene: Scene, max_states: int, progress: Progress) -> ComplexReport:
    kind, local = "shape complex", scene.system.local
    found = ComplexReport(scene.spec, kind, local, complete=True, states=0, memory=0)
    try:
        built = shape_complex(
            scene,
            max_states=max_states,
            progress=lambda done, known: progress("shapes", done, known),
        )
    except TooManyShapes as error:
        found.complete, found.states = False, error.known
        return found
    found.built, found.states = built, len(built.shapes)
    found.memory = sum(array.nbytes for array in built.complex.faces)
    found.f_vector = built.complex.f_vector
    return found


def _examine(
    found: ComplexReport,
    complex_: CubicalComplex,
    with_homology: bool,  # noqa: FBT001 - as in `report`
    with_links: bool,  # noqa: FBT001
    progress: Progress,
) -> None:
    if with_links:
        progress("links", 0, 0)
        links = check_links(complex_)
        found.npc, found.links_checked, found.failing = links.npc, links.checked, links.failures
        found.witnesses = _witnesses(found, links)
    if with_homology:
        if complex_.dimension == 2:
            found.surface = surface(complex_).name
            unfolded = pulled_apart(complex_)
            found.orientable = None if unfolded is None else unfolded.orientable
        cells, done = sum(complex_.f_vector), 0

        def count(more: int) -> None:
            nonlocal done
            done += more
            progress("homology", done, cells)

        found.homology = homology(complex_, count)
        found.components = found.homology.betti[0]
        progress("collapse", 0, 0)
        found.homotopy = contractibility(complex_, found.homology)


def _witnesses(found: ComplexReport, links: Links) -> list[str]:
    """Return lines on the first failing links, with the moves that witness each failure."""
    lines = []
    for failing in links.failing:
        if not isinstance(found.built, StateComplex):
            lines.append(str(failing))
            continue
        labels = [found.built.cube(1, edge)[1][0].label for edge, _ in failing.ends]
        what = (
            "span no cube, though any two span a square"
            if not failing.simplices
            else f"span {failing.simplices} cubes, expected one"
        )
        lines.append(f"state {failing.vertex}: {'; '.join(labels)} {what}")
    return lines


def _link_by_link(found: ComplexReport, explored: Exploration, progress: Progress) -> None:
    """Check the links of the explored states one by one, by the definition."""
    total = len(explored.states)
    found.failing = 0
    for number in range(total):
        missing = unfilled(explored.scene, explored.state(number))
        found.failing += bool(missing)
        for actions in missing[: _WITNESSES - len(found.witnesses)]:
            labels = "; ".join(action.label for action in actions)
            found.witnesses.append(
                f"state {number}: {labels} span no cube, though any two span a square"
            )
        progress("links", number + 1, total)
    found.npc, found.links_checked = (None if not found.failing else False), total
