"""What the variables, ladders and groups of a refutation mean, compared with what they must mean.

Part of `cubepath verify`: the variables that there must be follow from the windows, and here each
variable of a proof is found among them. A proof that has another variable, lacks one or has one
twice is refused, as is a ladder that is not needed or not of the moves that it must order, and a
group that some move does not keep.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from cubepath.coordinator.theory.proof_checking.refutation_clauses import (
    OFF,
    ON,
    READ,
    STAY,
    Groups,
    Ladders,
    Roles,
    Slots,
    collect,
    needs_ladder,
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
from cubepath.protocol.compiled import compiled
from cubepath.protocol.core.errors import CheckError
from cubepath.protocol.core.sites import Site, site_text
from cubepath.protocol.path_files.optimality_proofs import Group, Ladder, OptimalityProof

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
        told = [(site * (rounds + 1) + time) * 3 + role for site, time, role in self._ladder_list]
        keys, counts = np.unique(np.array(told, dtype=np.int64), return_counts=True)
        if (counts > 1).any():
            raise CheckError(f"two ladders of {self._key_text(int(keys[counts > 1][0]))}")
        for stray in np.setdiff1d(keys, needed).tolist():
            raise CheckError(
                f"ladder {told.index(stray)}: of {self._key_text(stray)}, expected pairs there:"
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
                f"ladder {bad}: its members are not {self._key_text(told[bad])}, each once"
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
