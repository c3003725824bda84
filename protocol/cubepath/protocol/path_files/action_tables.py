"""The table of actions of a binary file, from and to the arrays in which paths are checked.

Of each action the file lists the sites of its support, its trace and its two local states, as
numbers into one list of sites; docs/files.md describes the arrays.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray

from cubepath.protocol.core.names import GeneratorPlacement
from cubepath.protocol.core.sites import Site
from cubepath.protocol.path_files.moves import NAME, MoveName
from cubepath.protocol.path_files.supports import (
    FIRST,
    FREE,
    SECOND,
    TRACE,
    Growing,
    Rows,
    Supports,
    TabledActions,
    canonical,
    distinct,
)

Numbers = NDArray[np.int32]
Totals = NDArray[np.int64]
Listed = tuple[Totals, Totals]
"""Lists one after the other: where each starts, with the end of the last, and what is in them."""
_encode = msgspec.json.Encoder().encode


class ActionTable(NamedTuple):
    """The actions of a path as a file lists them: its sites, and the lists of each part by name.

    Each part is as in the file: where the list of each action starts, and the numbers of its sites.
    """

    sites: list[Site]
    parts: dict[str, tuple[Numbers, Numbers]]


def table_of(supports: Supports, names: Sequence[MoveName]) -> ActionTable:
    """Return the table of actions with these names, each list in canonical order.

    Sites are numbered in the order of the supports. The site that stands for an id is left out, and
    so are the local states of the actions that have one, since they mean nothing.
    """
    starts = supports.rows.starts
    places = supports.places_in_order
    row = np.repeat(np.arange(len(names)), np.diff(starts))
    stated = supports.rows.stated[row]
    shown = stated | (supports.rows.sites[places] != standing_for(supports, names)[row])
    row, places, stated = row[shown], places[shown], stated[shown]
    met, first = np.unique(supports.rows.sites[places], return_index=True)
    met = met[np.argsort(first)]
    number = np.zeros(len(supports.sites), dtype=np.int32)
    number[met] = np.arange(len(met))
    sites, says = number[supports.rows.sites[places]], supports.rows.says[places]
    parts: dict[str, tuple[Numbers, Numbers]] = {}
    for part, chosen in (
        ("support", np.ones(len(sites), dtype=np.bool_)),
        ("trace", says & TRACE != 0),
        ("before", stated & (says & FIRST != 0)),
        ("after", stated & (says & SECOND != 0)),
        ("free", says & FREE != 0),
    ):
        ends = np.cumsum(np.bincount(row[chosen], minlength=len(names)), dtype=np.int32)
        parts[part] = np.concatenate([_ZERO, ends]), sites[chosen]
    parts["guard"] = 2 * supports.rows.guard_starts, number[_guards_in_order(supports)].ravel()
    return ActionTable([supports.sites[site] for site in met.tolist()], parts)


_ZERO = np.zeros(1, dtype=np.int32)


def standing_for(supports: Supports, names: Sequence[MoveName]) -> Totals:
    """Return for each action the number of the site that stands for its id, -1 if none does."""
    found = np.full(len(names), -1, dtype=np.int64)
    unstated = np.flatnonzero(~supports.rows.stated).tolist()
    if unstated:
        number = {site: place for place, site in enumerate(supports.sites)}
        found[unstated] = [number.get((NAME, names[place]), -1) for place in unstated]
    return found


def _guards_in_order(supports: Supports) -> Numbers:
    guards, starts = supports.rows.guards, supports.rows.guard_starts
    if not len(guards):
        return guards
    rank = supports.order[guards]
    row = np.repeat(np.arange(len(starts) - 1), np.diff(starts))
    return guards[np.lexsort((rank[:, 1], rank[:, 0], row))]


class Tabled(NamedTuple):
    """Actions read from a table, and for each whether its `before` is its second local state."""

    actions: TabledActions
    turned: NDArray[np.bool_]


def actions_of(
    sites: list[Site], parts: Mapping[str, Listed], names: Sequence[MoveName], stated: list[bool]
) -> Tabled | None:
    """Return the actions of a table without building one; None if that takes a closer look.

    `parts` are the lists of `support`, `trace`, `before` and `after`. A closer look is needed for
    what is no action, for one action twice, and for some sites that stand for ids.
    """
    count = len(names)
    known = np.array(stated, dtype=np.bool_)
    if any(isinstance(site, tuple) and site[:1] == (NAME,) for site in sites):
        return None
    lists = [parts[part] for part in ("support", "trace", "before", "after")]
    sizes = np.stack([np.diff(starts) for starts, _ in lists], axis=1)
    if sizes[~known, 2:].any():
        return None
    unstated = np.flatnonzero(~known)
    ids = [(NAME, names[place]) for place in unstated.tolist()]
    if any(isinstance(name, GeneratorPlacement) for _, name in ids) or len(set(ids)) < len(ids):
        return None
    extra = np.full(count, -1, dtype=np.int32)
    extra[unstated] = np.arange(len(sites), len(sites) + len(ids))
    parts_at = np.zeros(4 * count + 1, dtype=np.int32)
    np.cumsum(sizes.ravel(), out=parts_at[1:])
    mentions = np.zeros(int(parts_at[-1]), dtype=np.int32)
    for part, (starts, numbers) in enumerate(lists):
        shifts = parts_at[part:-1:4] - starts[:-1]
        mentions[np.arange(len(numbers)) + np.repeat(shifts, sizes[:, part])] = numbers
    everything = [*sites, *ids]
    growing = Growing(
        starts=np.zeros(count + 2, dtype=np.int32),
        sites=np.zeros(len(mentions) + len(ids) + 1, dtype=np.int32),
        says=np.zeros(len(mentions) + len(ids) + 1, dtype=np.int8),
        stated=np.zeros(count + 1, dtype=np.bool_),
        slots=np.zeros(1 << (4 * count + 4).bit_length(), dtype=np.int64),
        marks=np.zeros(len(everything), dtype=np.int8),
    )
    find = distinct.for_work(3 * len(mentions), by_entries=True)
    told = np.zeros(count, dtype=np.int32), np.zeros(count, dtype=np.int8)
    if find(parts_at, mentions, extra, growing, 0, *told) != count:
        return None
    used = int(growing.starts[count])
    rows = Rows(
        growing.starts[: count + 1],
        growing.sites[:used],
        growing.says[:used],
        np.zeros(count + 1, dtype=np.int32),
        np.zeros((0, 2), dtype=np.int32),
        known,
    )
    supports = Supports(rows, everything)
    turned = canonical(rows, supports.order)
    return Tabled(TabledActions(supports, lambda number: _encode(names[number]).decode()), turned)
