"""Arbitration of claims, from one module's point of view: conflict, rank, verdict, final site.

Pure functions from what a module knows to what follows from it. `ModuleCore` calls them as messages
arrive, `World` for every module at once; no other code arbitrates. Two claims conflict iff their
actions do not commute, and a claim is executed iff every claim that conflicts with it and outranks
it is lost. Ranks are a total order, so this defines one set, the greedy one in order of rank:
executed actions commute pairwise, and no claim could be added.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal, TypeAlias

from cubepath.agents.local.random_streams import hashed, seed_key
from cubepath.protocol.core.actions import commute
from cubepath.protocol.core.catalogue import Move
from cubepath.protocol.core.sites import Site

Outcome: TypeAlias = Literal["none", "granted", "lost"]
"""The outcome of a module's claim in a round; "none" if it made none."""


@dataclass(frozen=True, slots=True)
class Contest:
    """The modules whose claims conflict with a module's own: those before it, and those after.

    It waits for the verdicts of those before it, and those after it wait for its own.
    """

    before: frozenset[int] = frozenset()
    after: frozenset[int] = frozenset()


UNCONTESTED = Contest()
RANK = 3
"""The purpose of the draws that rank claims, besides those of `random_streams`."""


@lru_cache(maxsize=1 << 12)
def priority(seed: int, round_number: int, module: int) -> tuple[int, int]:
    """Return the rank of a module's claim in a round; the greater outranks.

    It is a hash of all three, so it favours no module over a run and is the same in every process.
    """
    return hashed(hashed(seed_key(seed, RANK), round_number), module), module


def seed_in(round_number: int, seed: int, later: Sequence[tuple[int, int]]) -> int:
    """Return the seed of the ranks in a round: `seed`, or the last in `later` that began by then.

    `later` has seeds with the rounds from which on they hold, by increasing rounds.
    """
    for begins, each in later:
        if round_number < begins:
            break
        seed = each
    return seed


def contest(
    module: int, claim: Move, heard: Mapping[int, Move], *, seed: int, round_number: int
) -> Contest:
    """Return the contest of a module's claim with the claims that it `heard`, by module."""
    action = claim.action
    rivals = [other for other, move in heard.items() if not commute(action, move.action)]
    if not rivals:
        return UNCONTESTED
    mine = priority(seed, round_number, module)
    before = frozenset(other for other in rivals if priority(seed, round_number, other) > mine)
    return Contest(before, frozenset(rivals) - before)


def verdict(before: Iterable[int], verdicts: Mapping[int, bool]) -> bool | None:
    """Return whether a claim is granted; None while that is undecided.

    `before` are the modules whose claims go before it; `verdicts` holds the known verdicts by
    module: True for granted, False for lost. The claim is granted when all claims before it are
    lost, and lost as soon as one of them is granted.
    """
    known = [verdicts.get(module) for module in before]
    if any(known):
        return False
    return None if None in known else True


def waiting_for(claim: Move, outranked: Iterable[Move]) -> frozenset[Site]:
    """Return the sites of the modules that wait for the verdict on a claim.

    These are the movers of the claims that come after it, and the modules it would take along.
    """
    along = frozenset(source for source, _ in claim.motion[1:])
    return along.union(move.source for move in outranked)


def taking_along(site: Site, heard: Mapping[int, Move]) -> frozenset[int]:
    """Return the modules whose claimed moves would take along the module at `site`."""
    return frozenset(
        other
        for other, move in heard.items()
        if any(source == site for source, _ in move.motion[1:])
    )


def site_after(site: Site, executed: Iterable[Move]) -> Site:
    """Return where the module at `site` stands after a round in which these moves are executed.

    The module moved by itself, was taken along by another's move, or stayed. Executed moves
    commute, so at most one of them takes it anywhere.
    """
    for move in executed:
        for source, target in move.motion:
            if source == site:
                return target
    return site


def outcome(granted: bool | None) -> Outcome:  # noqa: FBT001 - a verdict, as `verdict` returns it
    """Return the word in a report for a verdict, or for no claim."""
    if granted is None:
        return "none"
    return "granted" if granted else "lost"
