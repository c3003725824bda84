"""Proofs of optimality in the obvious way, from docs/proofs.md alone: slow, in plain Python.

Here sites, moves and times stay what they are, in dictionaries, and every definition is one loop.
Nothing is shared with the checker, or with the code that makes proofs.
"""

import math
from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any

import numpy as np

from cubepath.protocol.core.actions import Action
from cubepath.protocol.core.catalogue import GeneratorPlacement
from cubepath.protocol.core.sites import Site, in_order
from cubepath.protocol.core.system import Scene, System
from cubepath.protocol.path_files.optimality_proofs import Group, Ladder, OptimalityProof
from cubepath.protocol.scenes.toml import scene_to_toml

Directed = tuple[Action, int]
State = frozenset[Site]
Meaning = tuple[object, ...]
Cubes = Sequence[Sequence[Action]]


def before(move: Directed, site: Site) -> bool:
    return site in move[0].ends[move[1]]


def after(move: Directed, site: Site) -> bool:
    return site in move[0].ends[1 - move[1]]


def toggles(move: Directed) -> State:
    return move[0].ends[0] ^ move[0].ends[1]


def fixed(move: Directed) -> State:
    return move[0].support - move[0].free


def moves_met(system: System, states: Iterable[State]) -> dict[Action, GeneratorPlacement]:
    """Return all moves of sites that any state could turn on, however far away in time."""
    found: dict[Action, GeneratorPlacement] = {}
    known: set[Site] = set().union(*states)
    waiting = list(in_order(known))
    while waiting:
        for move in system.moves_at(waiting.pop()):
            found.setdefault(move.action, GeneratorPlacement(move.generator, move.at))
            fresh = (move.action.ends[0] | move.action.ends[1]) - known
            known |= fresh
            waiting += in_order(fresh)
    return found


def moves_near(
    system: System, states: Iterable[State], layers: int
) -> dict[Action, GeneratorPlacement]:
    """Return the moves of sites that so many layers of moves could turn on."""
    found: dict[Action, GeneratorPlacement] = {}
    for state in states:
        known: set[Site] = set(state)
        for _ in range(layers):
            for site in in_order(known):
                for move in system.moves_at(site):
                    found.setdefault(move.action, GeneratorPlacement(move.generator, move.at))
                    known |= move.action.ends[0] | move.action.ends[1]
    return found


def times(state: State, moves: Sequence[Directed]) -> dict[tuple[Site, bool], float]:
    """Return the earliest time of each literal from a state on."""
    sites = set(state).union(*(move[0].support for move in moves))
    found = {(site, value): math.inf for site in sites for value in (False, True)}
    for site in sites:
        found[site, site in state] = 0
    changed = True
    while changed:
        changed = False
        for move in moves:
            first = first_round(move, found)
            for site in toggles(move):
                if first < found[site, after(move, site)]:
                    found[site, after(move, site)] = first
                    changed = True
    return found


def first_round(move: Directed, found: dict[tuple[Site, bool], float]) -> float:
    needs = [found[site, before(move, site)] for site in fixed(move)]
    needs += [min(found[one, False], found[other, True]) for one, other in move[0].guards]
    return 1 + max(needs, default=0)


def turned(move: Directed) -> Directed:
    return move[0], 1 - move[1]


@dataclass
class Refutation:
    """The claim that there is no schedule of `rounds` rounds, as variables and clauses."""

    actions: list[Action]
    start: State
    goal: State
    rounds: int
    labelled: System | None = None

    def __post_init__(self) -> None:
        moves = [(action, end) for action in self.actions for end in (0, 1)]
        while True:
            self.ahead = times(self.start, moves)
            self.behind = times(self.goal, [turned(move) for move in moves])
            self.first = {move: first_round(move, self.ahead) for move in moves}
            self.last = {
                move: self.rounds + 1 - first_round(turned(move), self.behind) for move in moves
            }
            left = [move for move in moves if self.first[move] <= self.last[move]]
            if left == moves:
                break
            moves = left
        self.moves = moves
        self.sites = in_order({site for site, _ in self.ahead} | {site for site, _ in self.behind})
        self.variables: dict[Meaning, int] = {}
        self.clauses: list[list[int]] = []
        self.ladders: list[Ladder] = []
        self.groups: list[Group] = []
        self.contradiction = False
        for site in self.sites:
            for time in range(self.rounds + 1):
                possible = self.possible(site, time)
                if not possible:
                    self.contradiction = True
                if len(possible) == 2:
                    self.variable("site", site, time)
        for move in self.moves:
            for time in self.window(move):
                self.variable("move", move, time)
        if self.contradiction:
            self.variables.clear()
            self.clauses.append([])
            return
        self.say()

    def window(self, move: Directed) -> range:
        return range(int(self.first[move]), int(self.last[move]) + 1)

    def possible(self, site: Site, time: int) -> set[bool]:
        """Return which values a site can have at a time."""
        return {
            value
            for value in (False, True)
            if self.ahead.get((site, value), 0 if value == (site in self.start) else math.inf)
            <= time
            <= self.rounds
            - self.behind.get((site, value), 0 if value == (site in self.goal) else math.inf)
        }

    def variable(self, *meaning: object) -> int:
        return self.variables.setdefault(meaning, len(self.variables) + 1)

    def site_is(self, site: Site, time: int, value: bool) -> int | bool:
        possible = self.possible(site, time)
        if len(possible) == 2:
            number = self.variable("site", site, time)
            return number if value else -number
        return value in possible

    def clause(self, *literals: int | bool) -> None:
        if any(literal is True for literal in literals):
            return
        self.clauses.append([literal for literal in literals if literal is not False])

    def in_round(self, time: int) -> list[tuple[Directed, int]]:
        return [
            (move, self.variable("move", move, time))
            for move in self.moves
            if time in self.window(move)
        ]

    def say(self) -> None:
        for time in range(1, self.rounds + 1):
            made = self.in_round(time)
            for move, made_it in made:
                self.say_move(move, made_it, time)
            for site in self.sites:
                for value in (True, False):
                    togglers = [
                        number
                        for move, number in made
                        if site in toggles(move) and after(move, site) is value
                    ]
                    self.clause(
                        self.site_is(site, time, not value),
                        self.site_is(site, time - 1, value),
                        *togglers,
                    )
                    self.at_most_one(site, time, "on" if value else "off", togglers)
                holders = [
                    number
                    for move, number in made
                    if site in move[0].trace and site not in toggles(move)
                ]
                readers = [
                    number for move, number in made if site in move[0].support - move[0].trace
                ]
                if holders:
                    self.at_most_one(site, time, "stay", holders, readers)
        if self.labelled is not None:
            self.say_groups(self.labelled)

    def say_move(self, move: Directed, made: int, time: int) -> None:
        for site in in_order(fixed(move)):
            self.clause(-made, self.site_is(site, time - 1, before(move, site)))
            self.clause(-made, self.site_is(site, time, after(move, site)))
        for site in in_order(move[0].free):
            for value in (True, False):
                self.clause(
                    -made, self.site_is(site, time - 1, not value), self.site_is(site, time, value)
                )
        for one, other in move[0].guards:
            self.clause(
                -made, self.site_is(one, time - 1, False), self.site_is(other, time - 1, True)
            )

    def at_most_one(
        self, site: Site, time: int, kind: str, members: list[int], readers: Sequence[int] = ()
    ) -> None:
        count = len(members)
        if count * (count + len(readers)) <= 36 if kind == "stay" else count <= 6:
            for one, other in combinations(members, 2):
                self.clause(-one, -other)
            for one in members:
                for reader in readers:
                    self.clause(-one, -reader)
            return
        self.ladder(site, time, kind, members, readers)

    def ladder(
        self, site: Site, time: int, kind: str, members: list[int], readers: Sequence[int]
    ) -> None:
        number = len(self.ladders)
        self.ladders.append(Ladder(self.sites.index(site), time, kind, members))  # type: ignore[arg-type]
        prefixes = [
            self.variable("prefix", number, place)
            for place in range(1, len(members) + (kind == "stay"))
        ]
        for place, member in enumerate(members):
            if place < len(prefixes):
                self.clause(-member, prefixes[place])
            if 0 < place < len(prefixes):
                self.clause(-prefixes[place - 1], prefixes[place])
            if place > 0:
                self.clause(-member, -prefixes[place - 1])
        for reader in readers:
            self.clause(-reader, -prefixes[-1])

    def say_groups(self, system: System) -> None:
        labels: dict[object, list[int]] = defaultdict(list)
        places: dict[object, list[int]] = defaultdict(list)
        for number, site in enumerate(self.sites):
            labels[system.label_of(site)].append(number)
            places[system.place_of(site)].append(number)
        for sites in labels.values():
            self.say_group(Group("exactly one", sites))
        for sites in places.values():
            self.say_group(Group("at most one", sites))

    def say_group(self, group: Group) -> None:
        self.groups.append(group)
        for time in range(self.rounds + 1):
            on = [self.sites[number] for number in group.sites]
            on = [site for site in on if True in self.possible(site, time)]
            if len(on) <= 64:
                for one, other in combinations(on, 2):
                    self.clause(self.site_is(one, time, False), self.site_is(other, time, False))
            if group.kind == "exactly one":
                self.clause(*(self.site_is(site, time, True) for site in on))

    def rows(self, actions: Sequence[Action]) -> np.ndarray[tuple[int, int], np.dtype[np.int32]]:
        """Return the variables as the file has them."""
        site: dict[object, int] = {each: number for number, each in enumerate(self.sites)}
        action: dict[object, int] = {each: number for number, each in enumerate(actions)}
        found: list[tuple[int, int, int]] = []
        for meaning in self.variables:
            match meaning:
                case ("site", each, int(time)):
                    found.append((0, site[each], time))
                case ("move", (each, int(end)), int(time)):
                    found.append((1, 2 * action[each] + end, time))
                case (_, int(ladder), int(place)):
                    found.append((2, ladder, place))
                case _:
                    raise AssertionError(meaning)
        return np.array(found, dtype=np.int32).reshape(-1, 3)


def log_of(variables: int, clauses: Sequence[Sequence[int]]) -> bytes | None:
    """Return a solver's log that refutes the clauses, None if there is a schedule."""
    import pysolvers
    from pysat.solvers import Cadical195

    if any(not clause for clause in clauses):
        return b""
    solver: Any = Cadical195(bootstrap_with=clauses, with_proof=True)
    try:
        if solver.solve():
            return None
        pysolvers.flushpr(solver.prfp)
        solver.prfile.seek(0)
        found: bytes = solver.prfile.read()
        return found
    finally:
        solver.delete()


def proof_of(
    scene: Scene, cubes: Cubes, goal: State, *, listed: Sequence[Action] | None = None
) -> OptimalityProof | None:
    """Return a proof that a schedule is a shortest one; None if it is not.

    With `listed` moves there is no system, and no others exist.
    """
    claim, found = claim_of(scene, cubes, goal, listed=listed)
    log = log_of(len(found.variables), found.clauses)
    return None if log is None else replace(claim, log=[log])


def claim_of(
    scene: Scene,
    cubes: Cubes,
    goal: State,
    *,
    listed: Sequence[Action] | None = None,
    refuted: int | None = None,
) -> tuple[OptimalityProof, Refutation]:
    """Return a proof without its log, and its clauses."""
    refuted = len(cubes) - 1 if refuted is None else refuted
    start, system = scene.start_state, scene.system
    named: dict[Action, GeneratorPlacement] | None = None
    if listed is not None:
        actions = list(dict.fromkeys(listed))
    else:
        near = (refuted + 1) // 2 + 1
        named = (
            moves_met(system, (start, goal))
            if system.bounded
            else moves_near(system, (start, goal), near)
        )
        actions = list(named)
    labelled = system if system.labels is not None and listed is None else None
    found = Refutation(actions, start, goal, refuted, labelled)
    mine = list(
        dict.fromkeys(
            [
                *(listed or ()),
                *(move[0] for move in found.moves),
                *(action for cube in cubes for action in cube),
            ]
        )
    )
    claim = OptimalityProof(
        system=None if named is None else scene_to_toml(scene),
        start=in_order(start),
        goal=in_order(goal),
        refuted=refuted,
        cubes=len(cubes),
        solver="cadical195",
        moves=mine if named is None else [named[action] for action in mine],
        sites=() if found.contradiction else found.sites,
        variables=found.rows(mine),
        ladders=found.ladders,
        groups=found.groups,
        schedule=[[mine.index(action) for action in cube] for cube in cubes],
    )
    return claim, found
