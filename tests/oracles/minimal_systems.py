"""Sites, actions and systems as docs/files.md has them, for the minimal checker of proofs.

It shares no code with cubepath: every move is built from the page alone.
"""

import tomllib
from collections import defaultdict
from collections.abc import Callable, Hashable, Iterable
from functools import cache
from itertools import combinations
from operator import add, sub
from typing import Any, NamedTuple

Site = Hashable
State = frozenset[Site]


class RefusedError(Exception):
    """What does not hold."""


def need(holds: object, why: str) -> None:
    if not holds:
        raise RefusedError(why)


def site_of(value: Any) -> Site:
    if isinstance(value, list):
        return tuple(map(site_of, value))
    need(isinstance(value, str | int | float) and not isinstance(value, bool), "no site")
    return int(value) if isinstance(value, float) and value.is_integer() else value


def sites_of(values: Any) -> list[Site]:
    need(isinstance(values, list), "no list of sites")
    return [site_of(value) for value in values]


def rank(site: Any) -> Any:
    """Return what sites are in order by: numbers, then texts, then lists item by item."""
    if isinstance(site, tuple):
        return 2, [rank(item) for item in site]
    return (1, site) if isinstance(site, str) else (0, site)


class Action(NamedTuple):
    """Support, trace, local states 0 and 1, free sites, and guards."""

    support: State
    trace: State
    ends: tuple[State, State]
    free: State
    guards: frozenset[tuple[Site, Site]]


def action_of(table: dict[str, Any], place: Callable[[Any], Site] = site_of) -> Action:
    def part(key: str) -> State:
        return frozenset(place(value) for value in table.get(key, []))

    support, trace, before, after = (part(key) for key in ("support", "trace", "before", "after"))
    free = part("free")
    guards = frozenset((place(one), place(other)) for one, other in table.get("guards", []))
    guarded = {site for pair in guards for site in pair}
    need(trace | before | after | free | guarded <= support, "a site outside the support")
    need(before != after and before ^ after <= trace, "the local states differ off the trace")
    need(not free & (trace | before | after), "a free site that is not free")
    need(not guarded & trace, "a guard in the trace")
    ends = sorted((before, after), key=lambda end: sorted(map(rank, end - (before & after))))
    return Action(support, trace, (ends[0], ends[1]), free, guards)


def listed(table: dict[str, Any]) -> Action:
    """Return an action that a file lists without a system."""
    keys = {"support", "trace", "before", "after"}
    need(keys <= table.keys() <= {*keys, "free", "guards"}, "a key")
    return action_of(table)


@cache
class System:
    """The moves of a scene: by name, and those in which a site is on before or after."""

    def __init__(self, text: str) -> None:
        scene = tomllib.loads(text)
        self.filled: State = frozenset()
        self.empty: State = frozenset()
        self.named: dict[Any, Action] = {}
        kinds = {"lattice", "graph", "listed", "triangulation"} & scene.keys()
        need(len(kinds) == 1, "another system")
        (kind,) = kinds
        getattr(self, f"_{kind}")(scene[kind])
        self.by_site: dict[Site, set[Action]] = defaultdict(set)
        for action in self.named.values():
            for site in action.ends[0] | action.ends[1]:
                self.by_site[site].add(action)

    def action(self, generator: str, place: Any) -> Action:
        at = site_of(place)
        if (generator, at) not in self.named and generator in self.generators:
            found = self._placed(generator, at)
            need(found is not None, "a place where the generator does not fit")
            return found  # type: ignore[return-value]
        key = frozenset(at) if generator == "flip" and isinstance(at, tuple) else at
        need((generator, key) in self.named, "a name of no move")
        return self.named[generator, key]

    def near(self, site: Site) -> Iterable[Action]:
        yield from self.by_site.get(site, ())
        for name, table in self.generators.items():
            for cell in table["support"]:
                size = self.dimension
                if isinstance(site, tuple) and list(site[size:]) == cell[size:]:
                    by = tuple(map(sub, site[:size], cell))
                    found = self._placed(name, by)
                    if found is not None:
                        yield found

    generators: dict[str, dict[str, Any]] = {}  # noqa: RUF012 - of a system that is no lattice
    workspace: State | None = None
    dimension = 2

    def _lattice(self, table: dict[str, Any]) -> None:
        need(not table.get("connected"), "not local")
        if table["name"] in ("cubes", "dodecahedra", "cube-edges"):
            self.dimension = 3
        self.generators = {each["name"]: each for each in table["generators"]}
        self.filled = frozenset(sites_of(table.get("filled", [])))
        self.empty = frozenset(sites_of(table.get("empty", [])))
        if "workspace" in table:
            self.workspace = frozenset(sites_of(table["workspace"]))

    @cache  # noqa: B019 - there are few systems
    def _placed(self, name: str, at: Any) -> Action | None:
        def place(cell: list[int]) -> Site:
            return (*map(add, cell, at), *cell[self.dimension :])

        found = action_of(self.generators[name], place)
        there = self.workspace is None or found.support <= self.workspace
        return found if there and not found.trace & (self.filled | self.empty) else None

    def _graph(self, table: dict[str, Any]) -> None:
        labels = table.get("labels")
        for one, other in table["edges"]:
            for label in [None] if labels is None else range(labels):
                ends = [[end] if labels is None else [[end, label]] for end in (one, other)]
                every = [[end, each] for end in (one, other) for each in range(labels or 0)]
                sides = {"trace": ends[0] + ends[1], "before": ends[0], "after": ends[1]}
                found = action_of({"support": every or sides["trace"], **sides})
                for at in ([one, other], [other, one]):
                    self.named["edge", site_of(at if labels is None else [*at, label])] = found

    def _listed(self, table: dict[str, Any]) -> None:
        self.filled = frozenset(sites_of(table.get("fixed", [])))
        for each in table["moves"]:
            self.named[each["generator"], site_of(each["at"])] = action_of(each)

    def _triangulation(self, table: dict[str, Any]) -> None:
        points = table["points"]

        def turn(a: int, b: int, c: int) -> int:
            (ax, ay), (bx, by), (cx, cy) = points[a], points[b], points[c]
            found: int = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
            return (found > 0) - (found < 0)

        def within(x: int, a: int, b: int, c: int) -> bool:
            return len({turn(a, b, x), turn(b, c, x), turn(c, a, x)} - {0}) < 2

        for corners in combinations(range(len(points)), 4):
            a, *rest = corners
            for b in rest:
                p, q = (each for each in rest if each != b)
                if turn(a, b, p) * turn(a, b, q) >= 0 or turn(p, q, a) * turn(p, q, b) >= 0:
                    continue
                others = set(range(len(points))) - set(corners)
                if any(within(x, a, b, p) or within(x, a, b, q) for x in others):
                    continue
                sides = [sorted(side) for side in ((a, p), (p, b), (b, q), (q, a))]
                one, other = [a, b], sorted((p, q))
                self.named["flip", frozenset(corners)] = action_of(
                    {
                        "support": [*sides, one, other],
                        "trace": [one, other],
                        "before": [*sides, one],
                        "after": [*sides, other],
                    }
                )

    def check_obstacles(self, *states: State) -> None:
        for state in states:
            need(self.filled <= state, "an obstacle that is off")
            need(not self.empty & state, "an obstacle that is on")

    def moves_near(self, start: State, goal: State, rounds: int) -> set[Action]:
        """Return all actions within half of the rounds of the start or the goal."""
        return self._within(start, (rounds + 1) // 2) | self._within(goal, rounds // 2)

    def _within(self, state: State, layers: int) -> set[Action]:
        found, known, fresh = set[Action](), set(state), set(state)
        for _ in range(layers):
            more = {action for site in fresh for action in self.near(site)} - found
            found |= more
            fresh = {site for action in more for end in action.ends for site in end} - known
            known |= fresh
        return found
