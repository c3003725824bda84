"""Moves that a short path between two states could use, found from both ends; and when.

A move in round t of k has its local state before within t - 1 rounds of the start, and the one
after within k - t rounds of the goal. So one of the two lies within half of the rounds, and moves
are looked for only there: the lattice may be infinite. Rounds are counted as if moves never stood
in each other's way, which leaves out nothing that a path can do.

The windows: a value is possible from some round after the start on, and up to some round before the
goal; a move needs its local state before at the round's begin, and leads to the other, from which
the goal must still be reached. Moves that fit nowhere are left out, and everything is computed
again, until nothing changes: the greatest fixpoint, whatever the order. docs/proofs.md has the
definition; Graphplan's levels (Blum and Furst 1997) are the forward half of it.

Of some groups of sites at most one, or exactly one, is on in every state: a vehicle is at one
vertex. Solvers do not see this from one round; it holds because it holds at the start and no move
breaks it. Groups are proposed by labels and places, and kept only if that is so.
"""

from __future__ import annotations

from array import array
from collections.abc import Callable, Iterable
from copy import copy
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from cubepath.protocol.compiled import compiled, inner
from cubepath.protocol.core.actions import Action, State
from cubepath.protocol.core.catalogue import GeneratorPlacement, Move
from cubepath.protocol.core.sites import Site, in_order, site_text
from cubepath.protocol.core.system import System

IN_TRACE, FREE = 4, 8
"""Flags of a site in a support; the two lowest bits are its values in the two local states."""


class MoveArrays(NamedTuple):
    """The supports of actions, one after another.

    The sites of action ``a`` are ``sites[starts[a]:starts[a + 1]]``, with their `codes`: bit 0 and
    bit 1 hold the values in its two local states, `IN_TRACE` and `FREE` say the rest. Its guards
    ``(p, q)``, if p is on then q is on, are rows of `guards`.
    """

    starts: Numbers
    sites: Numbers
    codes: Numbers
    guard_starts: Numbers
    guards: Numbers


Numbers = NDArray[np.int32]
NEVER = 1 << 30
"""Later than any round."""


class LiteralWindows(NamedTuple):
    """The windows of all values and directed moves on paths of `rounds` rounds.

    ``after[s, v]`` is the first time at which site s can have value v, and ``before[s, v]`` how
    many rounds before the end that is possible for the last time; `NEVER` if it is not. Directed
    move ``2 a + d``, action a from its local state d to the other, can be made in the rounds from
    `first` to `last`; it cannot be made at all if the first is greater.
    """

    rounds: int
    after: Numbers
    before: Numbers
    first: Numbers
    last: Numbers

    def value_possible(self) -> NDArray[np.bool_]:
        """Return whether each site can have each value at each time; shape (sites, 2, times)."""
        times = np.arange(self.rounds + 1)
        early = self.after[:, :, None] <= times
        return early & (times <= self.rounds - self.before[:, :, None])

    def refuted(self) -> bool:
        """Return whether some site is left without a value at some time: then there is no path."""
        begins, ends = self.after, self.rounds - self.before
        some = begins <= ends
        whole = some & (begins <= 0) & (ends >= self.rounds)
        for one in (0, 1):
            two = 1 - one
            joined = (begins[:, one] <= 0) & (begins[:, two] <= ends[:, one] + 1)
            whole[:, 0] |= some.all(axis=1) & joined & (ends[:, two] >= self.rounds)
        return not bool(whole.any(axis=1).all())


def first_times(moves: MoveArrays, on: NDArray[np.bool_], rounds: int) -> Numbers:
    """Return the first time up to `rounds` at which each value is possible; shape (sites, 2)."""
    count = 2 * (len(moves.starts) - 1)
    found = _at_end(on)
    _spread(*moves, np.ones(count, dtype=np.bool_), rounds, found, np.empty(count, dtype=np.int32))
    return found


def windows_of(
    moves: MoveArrays,
    start: NDArray[np.bool_],
    goal: NDArray[np.bool_],
    rounds: int,
    spend: Callable[[int], object] = lambda _steps: None,
) -> LiteralWindows:
    """Return the windows of a path of `rounds` rounds; `start` and `goal` have shape (sites,).

    `spend` is called with 0 whenever all moves were looked at; what it raises ends this.
    """
    count = 2 * (len(moves.starts) - 1)
    alive = np.ones(count, dtype=np.bool_)
    first, last = np.empty(count, dtype=np.int32), np.empty(count, dtype=np.int32)
    while True:
        after, before = _at_end(start), _at_end(goal)
        _spread(*moves, alive, rounds, after, first)
        spend(0)
        # Backwards every move is made from its local state after to the one before.
        flipped = np.ascontiguousarray(alive.reshape(-1, 2)[:, ::-1]).ravel()
        _spread(*moves, flipped, rounds, before, last)
        spend(0)
        last = rounds + 1 - last.reshape(-1, 2)[:, ::-1].ravel()
        left = alive & (first <= last)
        if np.array_equal(left, alive):
            return LiteralWindows(rounds, after, before, first, last)
        alive = left


def _at_end(on: NDArray[np.bool_]) -> Numbers:
    found = np.full((len(on), 2), NEVER, dtype=np.int32)
    found[np.arange(len(on)), on.astype(np.int32)] = 0
    return found


@compiled
def _spread(
    starts: Numbers,
    sites: Numbers,
    codes: Numbers,
    guard_starts: Numbers,
    guards: Numbers,
    alive: NDArray[np.bool_],
    rounds: int,
    found: Numbers,
    first: Numbers,
) -> None:
    """Fill in when values become possible, and the round from which each directed move is.

    `found` has the values of the end from which this begins. Layer by layer: in the first, all
    moves are looked at; later those at whose sites a value became possible in the layer before.
    """
    first[:] = NEVER
    users, by_site = _users(starts, sites, guard_starts, guards, len(found))
    waiting = np.empty(len(first), dtype=np.int32)
    count = 0
    for move in range(len(first)):
        if alive[move]:
            waiting[count] = move
            count += 1
    looked = np.zeros(len(first), dtype=np.int32)
    changed = np.empty(2 * len(found), dtype=np.int32)
    for layer in range(1, rounds + 1):
        changes = 0
        for index in range(count):
            move = waiting[index]
            action, way = move // 2, move % 2
            ready = True
            for place in range(starts[action], starts[action + 1]):
                code = codes[place]
                if not code & FREE and found[sites[place], (code >> way) & 1] >= layer:
                    ready = False
                    break
            if ready:
                for place in range(guard_starts[action], guard_starts[action + 1]):
                    if found[guards[place, 0], 0] >= layer and found[guards[place, 1], 1] >= layer:
                        ready = False
                        break
            if not ready:
                continue
            first[move] = layer
            for place in range(starts[action], starts[action + 1]):
                code = codes[place]
                value = (code >> (1 - way)) & 1
                if not code & FREE and found[sites[place], value] > layer:
                    found[sites[place], value] = layer
                    changed[changes] = sites[place]
                    changes += 1
        count = 0
        for index in range(changes):
            site = changed[index]
            for place in range(users[site], users[site + 1]):
                for move in (2 * by_site[place], 2 * by_site[place] + 1):
                    if alive[move] and first[move] == NEVER and looked[move] < layer:
                        looked[move] = layer
                        waiting[count] = move
                        count += 1
        if not count:
            break


@inner
def _users(
    starts: Numbers, sites: Numbers, guard_starts: Numbers, guards: Numbers, count: int
) -> tuple[Numbers, Numbers]:
    """Return the actions with a site in their support or guards: of site s, users[s:s + 1]."""
    users = np.zeros(count + 1, dtype=np.int32)
    for site in sites:
        users[site + 1] += 1
    for one, other in guards:
        users[one + 1] += 1
        users[other + 1] += 1
    for site in range(count):
        users[site + 1] += users[site]
    free = users[:-1].copy()
    by_site = np.empty(users[count], dtype=np.int32)
    for action in range(len(starts) - 1):
        for place in range(starts[action], starts[action + 1]):
            by_site[free[sites[place]]] = action
            free[sites[place]] += 1
        for place in range(guard_starts[action], guard_starts[action + 1]):
            for site in guards[place]:
                by_site[free[site]] = action
                free[site] += 1
    return users, by_site


class MetMoves:
    """Sites and actions by number, as many as paths of a given length could use.

    `sites` and `actions` hold them, `names` what the system calls each action (None without one).
    """

    def __init__(
        self,
        system: System | None,
        listed: Iterable[Action],
        start: State,
        goal: State,
        *,
        spend: Callable[[int], object] = lambda _steps: None,
    ) -> None:
        """Take the moves of `system`, or without one the `listed` actions.

        `spend` is called with the number of sites or actions looked at; what it raises ends that.
        """
        self.spend = spend
        self.sites: list[Site] = []
        self.actions: list[Action] = []
        self.names: list[GeneratorPlacement | None] = []
        self._place: dict[Site, int] = {}
        self._number: dict[Action, int] = {}
        self._starts, self._guard_starts = array("i", [0]), array("i", [0])
        self._sites, self._codes, self._guards = array("i"), array("i"), array("i")
        self._system = system
        self._ask = None if system is None else system.discovery() or system.moves_at
        self._asked: set[int] = set()
        self._depth = 0
        self.ends = tuple(tuple(map(self._site, in_order(state))) for state in (start, goal))
        if system is None:
            for action in dict.fromkeys(listed):
                self.spend(1)
                self._add(action, None)

    def between(
        self, start: State, goal: State, *, spend: Callable[[int], object] = lambda _steps: None
    ) -> Self:
        """Return the moves of paths between two other states.

        What one of them learns of sites and moves, all know, so that it is learned once.
        """
        found = copy(self)
        found.spend, found._depth = spend, 0  # noqa: SLF001 - of this class
        found.ends = tuple(tuple(map(self._site, in_order(state))) for state in (start, goal))
        return found

    @property
    def complete(self) -> bool:
        """Return whether all moves are known, however many rounds a path has."""
        return self._ask is None

    def name_of(self, action: Action) -> GeneratorPlacement | None:
        """Return what the system calls an action, None if it was not met."""
        number = self._number.get(action)
        return None if number is None else self.names[number]

    def reach(self, rounds: int) -> None:
        """Find all moves that paths of up to this many rounds could use."""
        half = -(-rounds // 2)
        if self._ask is None or half <= self._depth:
            return
        for end in (0, 1):
            for layer in range(half):
                self._ask_about(end, layer, self._ask)
        self._depth = half

    def _ask_about(self, end: int, layer: int, moves_at: Callable[[Site], Iterable[Move]]) -> None:
        """Learn the moves at all sites that may be on this many rounds from one end."""
        first = first_times(self.arrays(), self.on(end), layer)
        self.spend(0)
        for site in np.flatnonzero(first[:, 1] <= layer).tolist():
            if site in self._asked:
                continue
            self.spend(1)
            for move in moves_at(self.sites[site]):
                self._add(move.action, GeneratorPlacement(move.generator, move.at))
            # Not before: if it ends in between, the site is asked about once more.
            self._asked.add(site)

    def on(self, end: int) -> NDArray[np.bool_]:
        """Return which sites are on at the start (0) or the goal (1); shape (sites,)."""
        found = np.zeros(len(self.sites), dtype=np.bool_)
        found[list(self.ends[end])] = True
        return found

    def arrays(self) -> MoveArrays:
        """Return the supports of all actions that are known."""
        return MoveArrays(
            np.array(self._starts, dtype=np.int32),
            np.array(self._sites, dtype=np.int32),
            np.array(self._codes, dtype=np.int32),
            np.array(self._guard_starts, dtype=np.int32),
            np.array(self._guards, dtype=np.int32).reshape(-1, 2),
        )

    def _site(self, site: Site) -> int:
        found = self._place.setdefault(site, len(self.sites))
        if found == len(self.sites):
            self.sites.append(site)
        return found

    def _add(self, action: Action, name: GeneratorPlacement | None) -> None:
        if action in self._number:
            return
        self._number[action] = len(self.actions)
        self.actions.append(action)
        self.names.append(name)
        first, second = action.ends
        for site in in_order(action.support):
            code = (site in first) | (site in second) << 1
            if site in action.trace:
                code |= IN_TRACE
            elif site in action.free:
                code |= FREE
            self._sites.append(self._site(site))
            self._codes.append(code)
        self._starts.append(len(self._sites))
        for one, other in sorted(action.guards, key=site_text):
            self._guards.extend((self._site(one), self._site(other)))
        self._guard_starts.append(len(self._guards) // 2)

    def proposed_groups(self) -> list[tuple[int, ...]]:
        """Return groups of sites of which one at most may be on: those of a label, or a place."""
        system = self._system
        if system is None or system.labels is None:
            return []
        found: dict[tuple[str, Site], list[int]] = {}
        for number, site in enumerate(self.sites):
            found.setdefault(("label", system.label_of(site)), []).append(number)
            found.setdefault(("place", system.place_of(site)), []).append(number)
        return [tuple(group) for group in found.values()]


_MOVES_A_STEP = 64


def window_bound(
    met: MetMoves, least: int, most: int, *, raised: Callable[[int], object] | None = None
) -> int:
    """Return the least number of rounds from `least` to `most` that the windows do not refute.

    No path between the ends of `met` has fewer cubes, if none has fewer than `least`. `raised` is
    called with each number that is refuted; what `met` spends may end this.

    Proof. A value is possible at a time only if the start reaches it by then, and the goal is
    reached from it in the rounds that are left, each as if moves never stood in each other's way.
    On a path every site has a value at every time, so where neither is possible there is no path.
    What fits into fewer rounds fits into more, by waiting first or last; so where all moves are
    known, and looking at many rounds finds no more of them, the least number is found by halving.

    >>> scene = scene_from_spec("agv:graph=grid3x3,n=2")
    >>> window_bound(MetMoves(scene.system, (), scene.start_state, scene.goal), 0, 9)
    3
    """

    def refuted(rounds: int) -> bool:
        met.reach(rounds)
        met.spend(len(met.actions) // _MOVES_A_STEP)
        found = windows_of(met.arrays(), met.on(0), met.on(1), rounds, met.spend).refuted()
        if found and raised is not None:
            raised(rounds)
        return found

    stride, open_from = 1, most
    while least < open_from:
        rounds = min(least + stride - 1, open_from - 1)
        if refuted(rounds):
            least = rounds + 1
            stride *= 2 if met.complete and open_from == most else 1
        else:
            open_from = rounds
        if met.complete and open_from < most:
            stride = max(1, (open_from - least + 1) // 2)
    return least


class SiteGroup(NamedTuple):
    """Sites, by number, of which at most one is on, or with `exactly` one."""

    exactly: bool
    sites: tuple[int, ...]


def groups_of(met: MetMoves, moves: MoveArrays, windows: LiteralWindows) -> tuple[SiteGroup, ...]:
    """Return the groups that are proposed for the system and hold."""
    found: list[SiteGroup] = []
    on, able = met.on(0), windows.first <= windows.last
    for sites in met.proposed_groups():
        if len(sites) > 1:
            exactly = _kept(sites, moves, able)
            count = int(on[list(sites)].sum())
            if exactly is not None and count <= 1:
                found.append(SiteGroup(exactly and count == 1, sites))
    return tuple(found)


def _kept(sites: tuple[int, ...], moves: MoveArrays, able: NDArray[np.bool_]) -> bool | None:
    """Return whether moves keep the number of sites that are on; None if it could exceed one."""
    inside = np.zeros(int(moves.sites.max(initial=0)) + 1, dtype=np.bool_)
    inside[[site for site in sites if site < len(inside)]] = True
    places = np.flatnonzero(inside[moves.sites])
    action = np.searchsorted(moves.starts, places, side="right") - 1
    codes = moves.codes[places]
    count = len(moves.starts) - 1
    size = np.bincount(action, minlength=count)
    free = np.bincount(action, (codes & FREE) != 0, count) > 0
    keeps = True
    for way in (0, 1):
        some = able[way::2] & (size > 0)
        old = np.bincount(action, (codes >> way) & 1, count)
        new = np.bincount(action, (codes >> (1 - way)) & 1, count)
        if (some & (free | (new > 1))).any():
            return None
        fewer = new < old
        # None was on among those that it reads, which must be all of them.
        first = (new > old) & (old == 0) & (size == len(sites))
        if (some & ~((new == old) | fewer | first)).any():
            return None
        keeps = keeps and not (some & (new != old)).any()
    return keeps
