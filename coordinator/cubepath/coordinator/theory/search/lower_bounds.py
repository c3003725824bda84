"""Lower bounds on the number of cubes between two states, whatever the homotopy class.

Each bound is a few lines with its proof beside it; the greatest one counts. All rest on one fact:
the moves of a cube write disjoint sets of sites, so a module takes part in at most one move a
round. What a system says of its paths comes from a class that may belong to another distribution:
an error in its methods is reported in one line that names the class and the method.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from typing import ParamSpec, TypeVar

from cubepath.coordinator.theory.search.budget import Budget, SpentError
from cubepath.coordinator.theory.search.vehicle_lns import prepare
from cubepath.protocol.core.actions import Action, State
from cubepath.protocol.core.catalogue import Catalogue
from cubepath.protocol.core.errors import CubepathError, InputError
from cubepath.protocol.core.sites import Site, in_order
from cubepath.protocol.core.system import Bound, System, Ways

_P = ParamSpec("_P")
_T = TypeVar("_T")


def ways_of(system: System) -> Ways | None:
    """Return where modules can go, None if the system does not say."""
    found = _named(system, "ways", system.ways)()
    if found is None:
        return None
    near = _named(system, "ways", lambda site: tuple(found.near(site)))
    return Ways(near, found.one_to_one)


def bounds_of(
    system: System, start: State, goal: State, *, within: int, budget: Budget | None = None
) -> list[Bound]:
    """Return the bounds that the system itself has, as far as the budget goes.

    None further is asked for once one is `within` cubes.
    """

    def ask() -> list[Bound]:
        found: list[Bound] = []
        for bound in system.bounds(start, goal):
            found.append(bound)
            if bound.cubes >= within or (budget is not None and budget.spent):
                break
        return found

    return _named(system, "bounds", ask)()


def potential_of(system: System, goal: State) -> Callable[[Site], int] | None:
    """Return how far a site is from the goal, None if the system does not say."""
    found = _named(system, "potential", system.potential)(goal)
    return None if found is None else _named(system, "potential", found)


def paths_of(
    system: System, start: State, goal: State, *, seed: int, known: Iterable[Action]
) -> Iterator[Sequence[Action] | None] | None:
    """Return the system's own search for paths, None if it has none."""
    ask = _named(system, "paths", system.paths)
    found = ask(start, goal, seed=seed, known=known)
    return None if found is None else _steps(_named(system, "paths", found.__next__))


def prepare_for(system: System) -> bool:
    """Compile, or load, what the search for paths of this system uses; return whether it does."""
    if system.graph is not None:
        prepare()
    own = _named(system, "prepare_paths", system.prepare_paths)()
    return own or system.graph is not None


def _steps(step: Callable[[], Sequence[Action] | None]) -> Iterator[Sequence[Action] | None]:
    while True:
        try:
            found = step()
        except StopIteration:
            return
        yield found


def _named(system: System, method: str, ask: Callable[_P, _T]) -> Callable[_P, _T]:
    """Return `ask` with its errors as one-line InputErrors; the project's own pass unchanged."""

    def asked(*args: _P.args, **kwargs: _P.kwargs) -> _T:
        try:
            return ask(*args, **kwargs)
        except (CubepathError, StopIteration):
            raise
        except Exception as error:
            kind, text = system.__class__, " ".join(str(error).split())
            raise InputError(
                f"{kind.__name__}.{method} of {kind.__module__}: {type(error).__name__}: {text}"
            ) from error

    return asked


Neighbours = Callable[[Site], Iterable[Site]]


def lower_bound(
    system: System | None, start: State, goal: State, *, within: int, budget: Budget | None = None
) -> Bound:
    """Return the greatest of the bounds that hold for the system.

    `within` is the number of cubes of a known path, which bounds all searches. Without a system all
    that is known of the moves is that they change something. A bound that exceeds the `budget` is
    left out; a step of the budget is a site met on the way of a module.

    >>> scene = scene_from_spec("agv:graph=grid3x3,n=2")
    >>> found = lower_bound(scene.system, scene.start_state, scene.goal, within=20)
    >>> found.cubes, found.why
    (3, 'way of a module')
    """
    found = [Bound(0 if start == goal else 1, "the ends differ" if start != goal else "no move")]
    if system is not None and start != goal:
        with suppress(SpentError):
            farthest = module_bound(system, start, goal, within=within, budget=budget)
            found.append(Bound(farthest, "way of a module"))
        found += bounds_of(system, start, goal, within=within, budget=budget)
    return max(found, key=lambda bound: bound.cubes)


def module_bound(
    system: System, start: State, goal: State, *, within: int, budget: Budget | None = None
) -> int:
    """Return how far the module with the farthest way must go, in the best pairing.

    Definition. Two sites are neighbours if some move of the system takes a module from one to the
    other, and distances are those of this graph, whatever else stands there. The bound is the least
    r such that the modules at the start can be paired with the sites that are on at the goal at
    distances of at most r (bottleneck matching). For labelled vehicles the pairing is forced, and
    this is the longest shortest path; for words, the letters of a position.

    Proof. Follow the modules through any path to the goal: a move takes each module of its trace to
    one site of the trace, one to one, so this pairs start and goal. The moves of a cube write
    disjoint sites, so a cube takes no module further than to a neighbour, and the path has at least
    as many cubes as the distance of the farthest pair of *its* pairing. The least over all pairings
    is no greater.

    If a move does not take modules one to one (a file may say so), each end is only compared with
    the nearest other end. 0 if the system does not say where modules can go. Costs a breadth-first
    search for each module and augmenting paths over all pairs: modules^2 to modules^3 steps.
    SpentError if these exceed the budget.
    """
    budget = Budget() if budget is None else budget
    ways = ways_of(system)
    if ways is None:
        return 0
    near, one_to_one = ways
    sources, targets = in_order(start - system.filled), in_order(goal - system.filled)
    if system.labels is not None:
        return _farthest(system, near, sources, targets, (within, budget))
    if system.catalogue is not None and system.open:
        away = _free_distances(system.catalogue, near, sources, targets, (within, budget))
    else:
        away = [_distances(near, site, targets, (within, budget)) for site in sources]
    if one_to_one and len(sources) == len(targets):
        return bottleneck(away, within, budget)
    rows = [min(row, default=0) for row in away]
    columns = [min(column) for column in zip(*away, strict=True)]
    return min(within, max(rows + columns, default=0))


_Limits = tuple[int, Budget]
"""The greatest distance to look at, and the budget."""


def _distances(near: Neighbours, site: Site, targets: Sequence[Site], limits: _Limits) -> list[int]:
    """Return the distance of each target from a site; beyond the limit, the limit plus one."""
    within, budget = limits
    waiting, known, layer, distance = set(targets), {site}, [site], 0
    found = dict.fromkeys(targets, within + 1)
    while layer:
        budget.spend(len(layer))
        for here in layer:
            if here in waiting:
                waiting.remove(here)
                found[here] = distance
        if not waiting or distance == within:
            break
        distance += 1
        following: list[Site] = []
        for here in layer:
            for there in near(here):
                if there not in known:
                    known.add(there)
                    following.append(there)
        layer = following
    return [found[target] for target in targets]


def _farthest(
    system: System,
    near: Neighbours,
    sources: Sequence[Site],
    targets: Sequence[Site],
    limits: _Limits,
) -> int:
    """Return the longest of the shortest paths of labelled modules."""
    ends = {system.label_of(site): site for site in targets}
    labelled = [(site, ends[system.label_of(site)]) for site in sources]
    farthest = max(_distances(near, one, [end], limits)[0] for one, end in labelled)
    return min(limits[0], farthest)


def _free_distances(
    catalogue: Catalogue,
    near: Neighbours,
    sources: Sequence[Site],
    targets: Sequence[Site],
    limits: _Limits,
) -> list[list[int]]:
    """Return all distances on a lattice without obstacles, where only differences matter."""
    lattice = catalogue.lattice
    cells = [lattice.check(site) for site in sources]
    shifted = [
        [
            lattice.shift(lattice.check(site), tuple(-by for by in cell[: lattice.dimension]))
            for site in targets
        ]
        for cell in cells
    ]
    known: dict[Site, dict[Site, int]] = {}
    for orbit in dict.fromkeys(map(catalogue.orbit, cells)):
        mine = [
            row for cell, row in zip(cells, shifted, strict=True) if catalogue.orbit(cell) == orbit
        ]
        wanted = in_order({site for row in mine for site in row})
        known[orbit] = dict(zip(wanted, _distances(near, orbit, wanted, limits), strict=True))
    return [
        [known[catalogue.orbit(cell)][site] for site in row]
        for cell, row in zip(cells, shifted, strict=True)
    ]


def bottleneck(away: Sequence[Sequence[int]], within: int, budget: Budget | None = None) -> int:
    """Return the least r such that a perfect matching has no entry above r, at most `within`.

    `away` is a square matrix. The threshold rises from the greatest of the least entries of rows
    and columns, and augmenting paths extend the current matching.

    >>> bottleneck([[0, 2], [1, 5]], 9)
    2
    """
    if not away:
        return 0
    columns = list(zip(*away, strict=True))
    threshold: int = max(*map(min, away), *map(min, columns))
    entries = sorted({entry for row in away for entry in row if entry > threshold})
    row_of: list[int | None] = [None] * len(away)
    for row in range(len(away)):
        if budget is not None:
            budget.spend(len(away))
        while threshold < within and not _augment(away, row, row_of, threshold):
            threshold = entries.pop(0) if entries else within
    return min(threshold, within)


def _augment(
    away: Sequence[Sequence[int]], row: int, row_of: list[int | None], threshold: int
) -> bool:
    """Find a column for a row, breadth first; rows that have a column may switch to another."""
    came: dict[int, int] = {}
    waiting = [row]
    for one in waiting:
        for column, entry in enumerate(away[one]):
            if entry > threshold or column in came:
                continue
            came[column] = one
            holder = row_of[column]
            if holder is not None:
                waiting.append(holder)
                continue
            held = {other: place for place, other in enumerate(row_of) if other is not None}
            free: int | None = column
            while free is not None:
                owner = came[free]
                row_of[free] = owner
                free = held.get(owner)
            return True
    return False
