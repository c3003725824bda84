"""Which claims of a round are executed: rank, conflict, and the settled set.

Room: agents. A claim is executed iff every claim that outranks it and does not commute with it is
lost. Ranks are a total order, so this defines one set, the greedy one in order of rank: what is
executed commutes pairwise, and no claim could be added to it. Modules find it by messages among
themselves (`ModuleCore`); `settled` computes it at once where all claims are in one process.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from hashlib import blake2b

from cubepath.protocol.core.actions import Action, commute
from cubepath.protocol.core.sites import Site


def priority(seed: int, round_number: int, module: int) -> tuple[int, int]:
    """Return the rank of a module's claim in a round; the greater outranks.

    A keyed hash, so that it favours no module over a run and is the same in every process.
    """
    digest = blake2b(f"{seed}/{round_number}/{module}".encode(), digest_size=8).digest()
    return int.from_bytes(digest), module


class Conflicts:
    """Actions found again by the sites they touch, to ask which ones do not commute with another.

    Asking costs what the neighbourhood holds, not what the aggregate holds.
    """

    def __init__(self) -> None:
        """Start with no action."""
        self._at: dict[Site, list[tuple[int, Action]]] = {}

    def add(self, owner: int, action: Action) -> None:
        """Add the action of a module."""
        for site in action.support:
            self._at.setdefault(site, []).append((owner, action))

    def with_action(self, action: Action) -> set[int]:
        """Return the owners of the added actions that do not commute with `action`."""
        found: set[int] = set()
        for site in action.support:
            for owner, other in self._at.get(site, ()):
                if owner not in found and not commute(action, other):
                    found.add(owner)
        return found


def settled(claims: Mapping[int, Action], seed: int, round_number: int) -> list[int]:
    """Return the modules whose claims are executed, in increasing order."""
    by_priority = sorted(
        claims, key=lambda number: priority(seed, round_number, number), reverse=True
    )
    return sorted(maximal(claims, by_priority))


def maximal(claims: Mapping[int, Action], order: Iterable[int]) -> list[int]:
    """Return a maximal commuting set of claims, taken greedily in the given order of modules."""
    executed = Conflicts()
    winners = []
    for module in order:
        if not executed.with_action(claims[module]):
            executed.add(module, claims[module])
            winners.append(module)
    return winners
