"""Checking a proof of optimality: nothing shorter exists, and this schedule is one.

Part of `cubepath verify`. What a proof says is derived again from the moves: windows, variables,
clauses, then each lemma of its log, then its schedule. The variables that there must be follow from
the windows, and each variable of a proof is found among them: a proof that has another variable,
lacks one or has one twice is refused, as is a ladder that is not needed or not of the moves that it
must order, and a group that some move does not keep. See docs/proofs.md; nothing is shared with the
code that makes proofs but the format of the file.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence, Set as AbstractSet
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from cubepath.coordinator.normal_form.definitions import is_cube
from cubepath.coordinator.theory.proof_checking.refutation_clauses import (
    OFF,
    ON,
    READ,
    STAY,
    Groups,
    Ladders,
    ProofClauses,
    Roles,
    Slots,
    clauses_of,
    collect,
    needs_ladder,
    roles_of,
    slots_of,
)
from cubepath.coordinator.theory.proof_checking.refutation_moves import (
    IS_FREE,
    Ints,
    Longs,
    Moves,
    ProofWindows,
    SupportTable,
)
from cubepath.coordinator.theory.proof_checking.unit_propagation import Refuter, dimacs
from cubepath.coordinator.verification.rounds import make, why_not
from cubepath.protocol.compiled import compiled
from cubepath.protocol.core.actions import Action
from cubepath.protocol.core.errors import CheckError, InputError
from cubepath.protocol.core.sites import Site, in_order, site_text
from cubepath.protocol.core.system import Scene, System
from cubepath.protocol.path_files.optimality_proofs import Group, Ladder, OptimalityProof
from cubepath.protocol.scenes.toml import scene_from_toml

_SITE, _MOVE, _PREFIX = 0, 1, 2
_ROLES = {"on": ON, "off": OFF, "stay": STAY}
_OF_ROLE = {
    ON: "the moves that turn {} on",
    OFF: "the moves that turn {} off",
    STAY: "the moves that hold {} in their trace",
}
_Index = NDArray[np.int64]


class Meanings:
    """The variables of a proof by what they mean; CheckError in one line if they are others."""

    def __init__(
        self,
        proof: OptimalityProof,
        moves: Moves,
        table: SupportTable,
        windows: ProofWindows,
        actions: Sequence[int],
    ) -> None:
        """Find the variables of `proof`; `actions` are the numbers here of its actions.

        An action that no schedule could use has the number -1.
        """
        self._moves, self._table = moves, table
        self._windows = windows
        self._names: list[Site] = list(moves.sites)
        self._proof = proof
        self._site_numbers = _sites_of(proof, moves)
        self._ladder_list = [self._ladder(*each) for each in enumerate(proof.ladders)]
        sizes = [len(each.members) - (each.kind != "stay") for each in proof.ladders]
        self.slots = slots_of(windows, np.array(sizes, dtype=np.int64))
        self._fill(np.array([*actions, -1], dtype=np.int64))

    def _site(self, number: int, where: str) -> int:
        """Return the number here of a site of the proof."""
        if number >= len(self._proof.sites):
            raise CheckError(
                f"{where}: site number {number}, expected less than {len(self._proof.sites)}"
            )
        return int(self._site_numbers[number])

    def _ladder(self, number: int, ladder: Ladder) -> tuple[int, int, int]:
        """Return the site, the round and the role of a ladder."""
        where = f"ladder {number}"
        site = self._site(ladder.site, where)
        if site < 0 or not 1 <= ladder.round <= self._windows.rounds or not ladder.members:
            name = site_text(self._proof.sites[ladder.site])
            raise CheckError(
                f"{where}: of {len(ladder.members)} moves at site {name} in round {ladder.round},"
                " expected none there"
            )
        return site, ladder.round, _ROLES[ladder.kind]

    def _fill(self, actions: _Index) -> None:
        """Give each slot its variable, and refuse what has none."""
        slots, rows = self.slots, self._proof.variables.astype(np.int64)
        kinds, index, time = rows.T
        found = np.full(len(rows), -1, dtype=np.int64)
        for kind, (numbers, first, at) in {
            _SITE: (np.append(self._site_numbers, -1), slots.x_first.astype(np.int64), slots.x_at),
            _MOVE: (
                np.where(actions < 0, -1, 2 * actions).repeat(2)
                + np.tile([0, 1], len(actions)) * (actions >= 0).repeat(2),
                slots.first.astype(np.int64),
                slots.y_at,
            ),
            _PREFIX: (
                np.append(np.arange(len(slots.p_at) - 1), -1),
                np.ones(len(slots.p_at) - 1, dtype=np.int64),
                slots.p_at,
            ),
        }.items():
            of_kind = np.flatnonzero(kinds == kind)
            named = index[of_kind]
            named = numbers[np.where((named < 0) | (named >= len(numbers)), -1, named)]
            of_kind, named = of_kind[named >= 0], named[named >= 0]
            place = time[of_kind] - first[named]
            there = (place >= 0) & (place < at[named + 1] - at[named])
            found[of_kind[there]] = (at[named] + place)[there]
        stray = np.flatnonzero(found < 0)
        if len(stray):
            number = int(stray[0])
            raise CheckError(
                f"variable {number + 1}: {self._row_text(number)}: the windows leave no such"
                " variable"
            )
        order = np.argsort(found, kind="stable")
        twice = np.flatnonzero(np.diff(found[order]) == 0)
        if len(twice):
            one, other = sorted(order[twice[0] : twice[0] + 2].tolist())
            raise CheckError(
                f"variable {other + 1}: {self._row_text(other)}: so is variable {one + 1}"
            )
        slots.variable[found] = np.arange(1, len(rows) + 1)
        missing = np.flatnonzero(slots.variable == 0)
        if len(missing):
            raise CheckError(
                f"{len(missing)} variables are missing, the first: {self._slot_text(missing[0])}"
            )
        self._slot_of = np.concatenate((np.full(1, -1, dtype=np.int64), found))

    def _row_text(self, number: int) -> str:
        """Return in words what a row of the file says that a variable means."""
        kind, index, time = self._proof.variables[number].tolist()
        if kind == _SITE and 0 <= index < len(self._proof.sites):
            return f"site {site_text(self._proof.sites[index])} at time {time}"
        if kind == _MOVE and 0 <= index < 2 * len(self._proof.moves):
            return f"move number {index // 2} from its local state {index % 2} in round {time}"
        if kind == _PREFIX and 0 <= index < len(self._proof.ladders):
            return f"one of the first {time} moves of ladder {index}"
        return f"kind {kind}, index {index}, time {time}"

    def _slot_text(self, slot: int) -> str:
        """Return in words what the variable of a slot means."""
        slots = self.slots
        if slot < slots.x_at[-1]:
            site = int(np.searchsorted(slots.x_at, slot, "right")) - 1
            time = slots.x_first[site] + slot - slots.x_at[site]
            return f"site {site_text(self._names[site])} at time {time}"
        if slot < slots.y_at[-1]:
            move = int(np.searchsorted(slots.y_at, slot, "right")) - 1
            time = slots.first[move] + slot - slots.y_at[move]
            return f"{self._moves.move_text(move)} in round {time}"
        ladder = int(np.searchsorted(slots.p_at, slot, "right")) - 1
        return f"one of the first {slot - slots.p_at[ladder] + 1} moves of ladder {ladder}"

    def ladders(self, roles: Roles) -> Ladders:
        """Return the ladders of the proof; CheckError unless they are those that there must be."""
        slots, rounds = self.slots, self._windows.rounds
        needed = np.empty(0, dtype=np.int64)
        needed = np.empty(_needed(slots, roles, needed), dtype=np.int64)
        _needed(slots, roles, needed)
        stated = [(site * (rounds + 1) + time) * 3 + role for site, time, role in self._ladder_list]
        keys, counts = np.unique(np.array(stated, dtype=np.int64), return_counts=True)
        if (counts > 1).any():
            raise CheckError(f"two ladders of {self._key_text(int(keys[counts > 1][0]))}")
        for stray in np.setdiff1d(keys, needed).tolist():
            raise CheckError(
                f"ladder {stated.index(stray)}: of {self._key_text(stray)}, expected pairs there:"
                " they are few"
            )
        for missing in np.setdiff1d(needed, keys).tolist():
            raise CheckError(f"there is no ladder of {self._key_text(missing)}, expected one")
        sizes = [len(each.members) for each in self._proof.ladders]
        flat = [member for each in self._proof.ladders for member in each.members]
        members = np.array(flat, dtype=np.int64)
        at = np.concatenate((np.zeros(1, dtype=np.int64), np.cumsum(sizes, dtype=np.int64)))
        wrong = (members < 1) | (members >= len(self._slot_of))
        places = self._slot_of[np.where(wrong, 0, members)] - slots.x_at[-1]
        places[places >= slots.y_at[-1] - slots.x_at[-1]] = -1
        places = np.maximum(places, -1)
        owner = np.searchsorted(slots.y_at - slots.x_at[-1], places, "right") - 1
        time = slots.first[owner] + places - (slots.y_at[owner] - slots.x_at[-1])
        in_round = time == np.repeat([each[1] for each in self._ladder_list], np.diff(at))
        owner[(places < 0) | ~in_round.astype(np.bool_)] = -1
        sites, times, kinds = np.array(self._ladder_list, dtype=np.int32).reshape(-1, 3).T.copy()
        found = Ladders(sites, times, kinds, at, members.astype(np.int32))
        bad = _unlike(slots, roles, found, owner)
        if bad >= 0:
            raise CheckError(
                f"ladder {bad}: its members are not {self._key_text(stated[bad])}, each once"
            )
        return found

    def _key_text(self, key: int) -> str:
        key, role = divmod(key, 3)
        site, time = divmod(key, self._windows.rounds + 1)
        return f"{_OF_ROLE[role].format(site_text(self._names[site]))} in round {time}"

    def groups(self) -> Groups:
        """Return the groups of the proof; CheckError unless all states have what they say."""
        listed = [self._group(*each) for each in enumerate(self._proof.groups)]
        sizes = [len(each) for each in listed]
        found = Groups(
            np.array([each.kind == "exactly one" for each in self._proof.groups], dtype=np.bool_),
            np.concatenate((np.zeros(1, dtype=np.int64), np.cumsum(sizes, dtype=np.int64))),
            np.array([site for each in listed for site in each], dtype=np.int32),
        )
        count = len(self._names)
        order = np.argsort(found.sites, kind="stable")
        of_site = np.repeat(np.arange(len(sizes), dtype=np.int32), sizes)[order].astype(np.int32)
        at = np.searchsorted(found.sites[order], np.arange(count + 1)).astype(np.int64)
        move, group = _breaking(
            self._table, self._windows.first, self._windows.last, found, at, of_site
        )
        if move >= 0:
            raise CheckError(
                f"group {group}: not {self._proof.groups[group].kind} is on after"
                f" {self._moves.move_text(move)}, or that is not known"
            )
        return found

    def _group(self, number: int, group: Group) -> list[int]:
        where = f"group {number}"
        sites = [self._site(site, where) for site in group.sites]
        if len(set(group.sites)) != len(group.sites):
            raise CheckError(f"{where}: a site stands twice in it")
        # A site that no state can have on changes nothing.
        known = [site for site in sites if site >= 0]
        on = sum(self._names[site] in self._moves.start for site in known)
        if on > 1 or (group.kind == "exactly one" and on == 0):
            raise CheckError(f"{where}: {on} of its sites are on at the start, said: {group.kind}")
        return known


def _sites_of(proof: OptimalityProof, moves: Moves) -> _Index:
    """Return the numbers here of the sites of a proof, -1 of those that nothing turns on."""
    if len(set(proof.sites)) != len(proof.sites):
        seen: set[Site] = set()
        for site in proof.sites:
            if site in seen:
                raise CheckError(f"site {site_text(site)} stands twice among the sites")
            seen.add(site)
    return np.array([moves.sites.get(site, -1) for site in proof.sites], dtype=np.int64)


@compiled
def _needed(slots: Slots, roles: Roles, found: Longs) -> int:
    """Fill in the keys of the ladders that there must be, as far as there is room; count them."""
    moves = np.empty(len(slots.first), np.int32)
    count = 0
    for site in range(len(slots.x_first)):
        for time in range(1, slots.rounds + 1):
            for role in range(3):
                size = collect(slots, roles, site, role, time, moves)
                readers = 0
                if role == STAY and size:
                    readers = collect(slots, roles, site, READ, time, moves)
                if needs_ladder(role, size, readers):
                    if count < len(found):
                        found[count] = (site * (slots.rounds + 1) + time) * 3 + role
                    count += 1
    return count


@compiled
def _unlike(slots: Slots, roles: Roles, ladders: Ladders, owners: Longs) -> int:
    """Return the first ladder whose members are not the moves that it must have, -1 if none."""
    moves = np.empty(len(slots.first), np.int32)
    wanted = np.zeros(len(slots.first), np.bool_)
    for ladder in range(len(ladders.sites)):
        site, role, time = ladders.sites[ladder], ladders.roles[ladder], ladders.rounds[ladder]
        count = collect(slots, roles, site, role, time, moves)
        begin, end = ladders.at[ladder], ladders.at[ladder + 1]
        if end - begin != count:
            return ladder
        for place in range(count):
            wanted[moves[place]] = True
        for place in range(begin, end):
            if owners[place] < 0 or not wanted[owners[place]]:
                return ladder
            wanted[owners[place]] = False
    return -1


@compiled
def _breaking(
    table: SupportTable, first: Ints, last: Ints, groups: Groups, at: Longs, of_site: Ints
) -> tuple[int, int]:
    """Return a move that may not keep a group, and the group; (-1, -1) if there is none.

    The groups of site ``s`` are ``of_site[at[s]:at[s + 1]]``. A move keeps a group of which it
    toggles no site. Of one that it does toggle, let ``g`` and ``h`` be how many sites of its
    support are on before and after it. None may be free, ``h`` must be 0 or 1, and equal to ``g``,
    or less; or if ``g`` is 0 the whole group must be in the support. Only ``h = g`` keeps that
    exactly one is on.
    """
    count = len(groups.exact)
    before, after = np.zeros(count, np.int64), np.zeros(count, np.int64)
    held, free = np.zeros(count, np.int64), np.zeros(count, np.int64)
    touched = np.zeros(count, np.bool_)
    for move in range(len(first)):
        if first[move] > last[move]:
            continue
        action, end = move >> 1, move & 1
        for turn in range(2):
            for place in range(table.starts[action], table.starts[action + 1]):
                site, says = table.sites[place], table.says[place]
                on, then = says >> end & 1, says >> (1 - end) & 1
                for at_group in range(at[site], at[site + 1]):
                    group = of_site[at_group]
                    if turn == 0:
                        before[group], after[group], held[group], free[group] = 0, 0, 0, 0
                        touched[group] = False
                    elif says & IS_FREE:
                        free[group] += 1
                    else:
                        before[group] += on
                        after[group] += then
                        held[group] += 1
                        touched[group] |= on != then
        for place in range(table.starts[action], table.starts[action + 1]):
            site = table.sites[place]
            for at_group in range(at[site], at[site + 1]):
                group = of_site[at_group]
                if not touched[group]:
                    continue
                one, other = before[group], after[group]
                whole = held[group] == groups.at[group + 1] - groups.at[group]
                kept = one == other if groups.exact[group] else (one >= other or whole)
                if free[group] or other > 1 or not kept:
                    return move, group
    return -1, -1


Tell = Callable[[str, int], object]
"""Called with what is being done, and how much of it was done since the last call."""


@dataclass(frozen=True, slots=True)
class ProofResult:
    """What a proof proves that was checked.

    No schedule has `refuted` rounds or fewer, and one has `cubes`. `lemmas` is how many of the log
    were needed; none if unit propagation of the clauses alone refutes them, and there are no
    clauses if the windows alone do.
    """

    refuted: int
    cubes: int
    moves: int
    variables: int
    clauses: int
    lemmas: int

    @property
    def optimal(self) -> bool:
        """Whether no schedule is shorter than this one."""
        return self.cubes == self.refuted + 1


def check_optimality(proof: OptimalityProof) -> ProofResult:
    """Check a proof and return what it proves.

    Raises CheckError, in one line, for the first thing that does not hold.

    >>> left, right = Action([1, 2], [1, 2], [1], [2]), Action([2, 3], [2, 3], [2], [3])
    >>> found = check_optimality(OptimalityProof(
    ...     system=None, start=[1], goal=[3], refuted=1, cubes=2,
    ...     moves=[left, right], schedule=[[0], [1]],
    ... ))
    >>> found.optimal, found.clauses
    (True, 0)
    """
    return ClaimedRefutation(proof).checked()


class ClaimedRefutation:
    """The claim of a proof and its clauses, derived again; CheckError if it does not fit them."""

    def __init__(self, proof: OptimalityProof, tell: Tell | None = None) -> None:
        """Take a proof; what is derived from it is derived when it is asked for."""
        self.proof = proof
        self._tell: Tell = tell or (lambda _what, _count: None)
        self._start = _state("the start", proof.start)
        self._goal = _state("the goal", proof.goal)

    @cached_property
    def scene(self) -> Scene | None:
        """The scene that names the system of the claim, None if its moves are listed."""
        if self.proof.system is None:
            return None
        try:
            return scene_from_toml(self.proof.system, "the system")
        except InputError as error:
            raise CheckError(str(error)) from None

    @cached_property
    def system(self) -> System | None:
        """The system of the claim, None if its moves are listed."""
        if self.scene is None:
            return None
        system = self.scene.system
        if not system.local:
            raise CheckError("the system is not local, so it has no schedules")
        for name, state in (("the start", self._start), ("the goal", self._goal)):
            for site in in_order(system.filled - state):
                raise CheckError(f"{name}: the obstacle {site_text(site)} is off, expected on")
            for site in in_order(system.empty & state):
                raise CheckError(f"{name}: the obstacle {site_text(site)} is on, expected off")
        return system

    def action(self, number: int) -> Action:
        """Return an action of the proof, by the number that it gives it."""
        move = self.proof.moves[number]
        if isinstance(move, Action):
            if self.system is not None:
                raise CheckError(f"move {number}: has no name, expected one of the system")
            return move
        if self.system is None:
            raise CheckError(f"move {number}: has a name, and there is no system")
        try:
            return self.system.action(move.generator, move.at)
        except InputError as error:
            raise CheckError(f"move {number}: {error}") from None

    def _numbers(self, moves: Moves) -> list[int]:
        """Return the numbers in `moves` of the actions of the proof, -1 of what is not there."""
        found: list[int] = []
        places: dict[int | Action, int] = {}
        for place in range(len(self.proof.moves)):
            number, key = moves.numbered[place], None
            if number < 0:  # the proof has another name for it, or no schedule could use it
                key = self.action(place)
                number = moves.number(key)
            known = places.setdefault(key if key is not None and number < 0 else number, place)
            if known != place:
                raise CheckError(f"move {place}: is the same as move {known}, expected another")
            found.append(number)
        return found

    @cached_property
    def _clauses(self) -> tuple[int, ProofClauses] | None:
        """The number of moves that can be made, and the clauses; None if windows refute alone."""
        rounds, proof = self.proof.refuted, self.proof
        moves = Moves(self._start, self._goal, proof.moves)
        if self.system is None:
            for number in range(len(proof.moves)):
                moves.take(self.action(number))
            usable = np.ones(2 * len(proof.moves), dtype=np.bool_)
        else:
            usable = moves.find(self.system, rounds, lambda count: self._tell("moves", count))
        numbers = self._numbers(moves)
        table = moves.table
        windows = moves.windows(table, rounds, usable)
        if windows.refuting_site() is not None:
            for what, given in (
                ("variables", proof.variables),
                ("ladders", proof.ladders),
                ("groups", proof.groups),
            ):
                if len(given):
                    raise CheckError(f"there are {what}, and nothing that they would be needed for")
            return None
        self._tell("clauses", 0)
        meanings = Meanings(proof, moves, table, windows, numbers)
        roles = roles_of(table, windows, len(moves.sites))
        ladders, groups = meanings.ladders(roles), meanings.groups()
        found = clauses_of(table, meanings.slots, roles, ladders, groups)
        return int((windows.first <= windows.last).sum()), found

    @property
    def clauses(self) -> ProofClauses:
        """The clauses; an empty one if the windows alone refute the claim."""
        if self._clauses is None:
            return ProofClauses.empty()
        return self._clauses[1]

    def dimacs(self) -> Iterator[bytes]:
        """Yield the clauses as a DIMACS file, for other checkers."""
        return dimacs(len(self.proof.variables) if self._clauses else 0, *self.clauses)

    def other_task(
        self,
        system: System | None,
        start: AbstractSet[Site],
        goal: AbstractSet[Site],
        actions: Iterable[Action],
    ) -> str | None:
        """Return why the proof is not about these states and moves, None if it is.

        The moves are those of the system; without one they are `actions`.
        """
        for name, stated, given in (("start", self._start, start), ("goal", self._goal, goal)):
            apart = in_order(stated ^ given)
            if apart:
                where = "there" if apart[0] in given else "in the proof"
                return f"has another {name}: {site_text(apart[0])} is on only {where}"
        if (self.system is None) != (system is None):
            subject = "moves of a system" if system is None else "listed moves"
            return f"has other moves: the proof is about {subject}"
        if self.system is None or system is None:
            apart_moves = set(self.proof.moves) ^ set(actions)
            return "has other moves than the proof" if apart_moves else None
        same = (self.system.table, self.system.to_table()) == (system.table, system.to_table())
        return None if same else "has another system"

    def checked(self) -> ProofResult:
        """Return what the proof proves; CheckError for the first thing that does not hold."""
        proof = self.proof
        if proof.cubes <= proof.refuted:
            raise CheckError(
                f"the schedule has {proof.cubes} rounds, itself no more than the {proof.refuted}"
                " that are said to be impossible"
            )
        self._check_schedule()
        if self._clauses is None:
            if any(proof.log):
                raise CheckError("there is a log, and nothing that it would be needed for")
            return ProofResult(proof.refuted, proof.cubes, 0, 0, 0, 0)
        moves, (literals, ends) = self._clauses
        variables = len(proof.variables)
        lemmas = Refuter(variables, literals, ends).follow(proof.log, self._tell)
        return ProofResult(proof.refuted, proof.cubes, moves, variables, len(ends), lemmas)

    def _check_schedule(self) -> None:
        proof, state = self.proof, set(self._start)
        if len(proof.schedule) != proof.cubes:
            raise CheckError(
                f"the schedule has {len(proof.schedule)} cubes, expected the {proof.cubes} that"
                " the proof speaks of"
            )
        for number, cube in enumerate(proof.schedule, 1):
            self._carry_out(f"cube {number} of the schedule", cube, state)
        if frozenset(state) != self._goal:
            stray = in_order(state ^ self._goal)[0]
            is_on = "on" if stray in state else "off"
            raise CheckError(
                f"after the schedule {site_text(stray)} is {is_on}, which it is not at the goal"
            )

    def _carry_out(self, where: str, cube: Sequence[int], state: set[Site]) -> None:
        for number in cube:
            if number >= len(self.proof.moves):
                raise CheckError(
                    f"{where}: move number {number}, expected less than {len(self.proof.moves)}"
                )
        actions = [self.action(number) for number in cube]
        if not is_cube(actions):
            raise CheckError(f"{where}: its moves do not commute")
        for action in actions:
            why = why_not(action, state)
            if why is not None:
                raise CheckError(f"{where}: {why}")
            make(action, state)


def _state(name: str, sites: Sequence[Site]) -> frozenset[Site]:
    found = frozenset(sites)
    if len(found) != len(sites):
        twice = next(site for site in sites if sites.count(site) > 1)
        raise CheckError(f"{name}: {site_text(twice)} stands twice")
    return found
