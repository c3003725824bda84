"""What actions do to sites, as arrays: the form in which paths are checked and shortened.

Actions and sites are numbers. `supports_of` makes the arrays of actions, and `TabledActions` makes
an action of its row only where somebody asks for it.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple, overload

import numpy as np
from numpy.typing import NDArray

from cubepath.protocol.core.actions import Action, action_of_parts
from cubepath.protocol.core.sites import Ordinals, Site, in_order

Numbers = NDArray[np.int32]
Bytes = NDArray[np.int8]
Totals = NDArray[np.int64]

# What an action says about a site, as bits: on in local state 0, on in 1, in the trace, free.
FIRST, SECOND, TRACE, FREE = 1, 2, 4, 8


class SupportRows(NamedTuple):
    """The supports of all actions in compressed rows, and the pairs of sites of their guards.

    Action a has the sites ``sites[starts[a]:starts[a + 1]]``, each once, and of each `says` what
    it does there, in the bits above. `stated` tells whether its local states are known. Both starts
    have shape (actions + 1,), and `guards` (pairs, 2).
    """

    starts: Numbers
    sites: Numbers
    says: Bytes
    guard_starts: Numbers
    guards: Numbers
    stated: NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Supports:
    """The rows of distinct actions, and the sites by number."""

    rows: SupportRows
    sites: Sequence[Site]

    @cached_property
    def order(self) -> Totals:
        """The rank of each site in canonical order; equal sites share one."""
        rank = {site: number for number, site in enumerate(in_order(dict.fromkeys(self.sites)))}
        return np.array([rank[site] for site in self.sites], dtype=np.int64)

    @cached_property
    def places_in_order(self) -> Totals:
        """The places of all entries, row by row, those of a row in the canonical order of sites."""
        rows = np.repeat(np.arange(len(self.rows.starts) - 1), np.diff(self.rows.starts))
        return np.lexsort((self.order[self.rows.sites], rows))

    def part(self, bits: int, value: int) -> tuple[Numbers, Numbers]:
        """Return starts and sites of those entries whose `bits` have this value."""
        starts, sites, says = self.rows[:3]
        chosen = (says & bits) == value
        before = np.zeros(len(sites) + 1, dtype=np.int32)
        np.cumsum(chosen, out=before[1:])
        return before[starts], sites[chosen]

    def entries(self, numbers: Numbers) -> Totals:
        """Return the places of the entries of these actions, row by row."""
        starts = self.rows.starts.astype(np.int64)
        sizes = (starts[1:] - starts[:-1])[numbers]
        skipped = np.cumsum(sizes) - sizes
        found: Totals = np.arange(int(sizes.sum())) + np.repeat(starts[numbers] - skipped, sizes)
        return found

    def shown_first(self, numbers: Numbers, ends: Bytes) -> frozenset[Site]:
        """Return the sites that are on where the first of these actions with the site shows it.

        Each action shows one of its local states, 0 or 1, which are its `ends`.
        """
        places = self.entries(numbers)
        met, first = np.unique(self.rows.sites[places], return_index=True)
        shown = np.repeat(ends, np.diff(self.rows.starts)[numbers])[first]
        on = (self.rows.says[places[first]] >> shown) & FIRST
        return frozenset([self.sites[site] for site in met[on > 0].tolist()])


def supports_of(actions: Iterable[Action], stated: Sequence[bool]) -> Supports:
    """Return the supports of distinct actions."""
    numbers = Ordinals[Site]()
    starts, guard_starts = [0], [0]
    sites: list[int] = []
    says: list[int] = []
    guards: list[tuple[int, int]] = []
    for action in actions:
        (first, second), trace, free = action.ends, action.trace, action.free
        for site in action.support:
            sites.append(numbers[site])
            says.append(
                FIRST * (site in first)
                + SECOND * (site in second)
                + TRACE * (site in trace)
                + FREE * (site in free)
            )
        guards += [(numbers[one], numbers[other]) for one, other in action.guards]
        starts.append(len(sites))
        guard_starts.append(len(guards))
    rows = SupportRows(
        np.array(starts, dtype=np.int32),
        np.array(sites, dtype=np.int32),
        np.array(says, dtype=np.int8),
        np.array(guard_starts, dtype=np.int32),
        np.array(guards, dtype=np.int32).reshape(-1, 2),
        np.array(stated, dtype=np.bool_),
    )
    return Supports(rows, list(numbers))


class TabledActions(Sequence[Action]):
    """Actions without free sites and guards, each made of its row when it is asked for, and kept.

    `label` returns the label of an action by number. Rows are known to fit the definition.
    """

    def __init__(self, supports: Supports, label: Callable[[int], str]) -> None:
        self.supports = supports
        self._label = label
        self._made: dict[int, Action] = {}

    @property
    def made(self) -> int:
        """The number of actions that were asked for."""
        return len(self._made)

    def __len__(self) -> int:
        return len(self.supports.rows.starts) - 1

    @overload
    def __getitem__(self, index: int) -> Action: ...
    @overload
    def __getitem__(self, index: slice) -> list[Action]: ...
    def __getitem__(self, index: int | slice) -> Action | list[Action]:
        if isinstance(index, slice):
            return [self[number] for number in range(*index.indices(len(self)))]
        number = index + len(self) if index < 0 else index
        found = self._made.get(number)
        if found is None:
            found = self._made[number] = self._action(number)
        return found

    def _action(self, number: int) -> Action:
        if not 0 <= number < len(self):
            raise IndexError(number)
        starts, numbers, says = self.supports.rows[:3]
        row = slice(int(starts[number]), int(starts[number + 1]))
        names = self.supports.sites
        support = [names[site] for site in numbers[row].tolist()]
        marked = says[row].tolist()
        return action_of_parts(
            frozenset(support),
            frozenset([site for site, state in zip(support, marked, strict=True) if state & TRACE]),
            (
                frozenset(
                    [site for site, state in zip(support, marked, strict=True) if state & FIRST]
                ),
                frozenset(
                    [site for site, state in zip(support, marked, strict=True) if state & SECOND]
                ),
            ),
            label=self._label(number),
        )


class GrowingRows:
    """The rows of distinct actions without free sites and guards, while they are found."""

    def __init__(self) -> None:
        self._number: dict[tuple[frozenset[int], ...], int] = {}
        self._starts = [0]
        self._sites: list[int] = []
        self._says: list[int] = []

    def add(
        self, support: Iterable[int], trace: Iterable[int], before: list[int], after: list[int]
    ) -> tuple[int, int] | None:
        """Return the number of an action, and its local state `before`; None if it is none.

        Sites are given by number.
        """
        row, traced, first, second = map(frozenset, (support, trace, before, after))
        changed = first ^ second
        if not (changed and changed <= traced <= row and first | second <= row):
            return None
        found = self._number.get((row, traced, first, second))
        if found is not None:
            return found, 0
        found = self._number.get((row, traced, second, first))
        if found is not None:
            return found, 1
        found = self._number[row, traced, first, second] = len(self._number)
        self._sites += row
        self._says += [
            FIRST * (site in first) + SECOND * (site in second) + TRACE * (site in traced)
            for site in row
        ]
        self._starts.append(len(self._sites))
        return found, 0

    def supports(
        self, sites: Sequence[Site], stated: Iterable[bool]
    ) -> tuple[Supports, NDArray[np.bool_]]:
        """Return what was found, and of which actions the local states were exchanged."""
        rows = SupportRows(
            np.array(self._starts, dtype=np.int32),
            np.array(self._sites, dtype=np.int32),
            np.array(self._says, dtype=np.int8),
            np.zeros(len(self._starts), dtype=np.int32),
            np.zeros((0, 2), dtype=np.int32),
            np.array(stated, dtype=np.bool_),
        )
        supports = Supports(rows, sites)
        return supports, canonical(rows, supports.order)


def canonical(rows: SupportRows, order: Totals) -> NDArray[np.bool_]:
    """Exchange the local states of actions whose states are in the other order than an action's.

    `order` holds the rank of each site. Changes `rows.says`; returns which actions were changed.
    The order is that of `cubepath.protocol.core.actions.Action`: of the sites where the two differ,
    those that are on in the first come before those that are on in the second, and as both lists
    have no site in common, their least sites decide; an empty list is first.
    """
    starts, sites, says = rows[:3]
    if len(starts) <= 1:
        return np.zeros(0, dtype=np.bool_)
    least: list[Totals] = []
    for own in (FIRST, SECOND):
        alone = (says & (FIRST | SECOND)) == own
        values = np.where(alone, order[sites], len(order))
        found = np.minimum.reduceat(values, starts[:-1])
        least.append(np.where(found == len(order), -1, found))
    swapped = least[0] > least[1]
    entries = np.repeat(swapped, np.diff(starts))
    both = says[entries]
    says[entries] = (both & TRACE) | (both & FIRST) << 1 | (both & SECOND) >> 1
    return swapped
