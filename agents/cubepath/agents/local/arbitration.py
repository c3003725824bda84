"""What a round makes of claims, as one module finds it out: conflict, rank, verdict, where it ends.

Room: agents. Pure functions from what a module knows to what follows for it: data in, data out.
`ModuleCore` asks them as messages come in, `World` for every module at once; there is no second
rule. A claim is executed iff every claim that outranks it and does not commute with it is lost.
Ranks are a total order, so this defines one set, the greedy one in order of rank: what is executed
commutes pairwise, and no claim could be added to it.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from hashlib import blake2b
from typing import Literal, TypeAlias

from cubepath.protocol.core.actions import commute
from cubepath.protocol.core.catalogue import Move
from cubepath.protocol.core.sites import Site

Priority: TypeAlias = tuple[int, int]
Outcome: TypeAlias = Literal["none", "granted", "lost"]
"""What came of a module's claim in a round; "none" where it made none."""


@dataclass(frozen=True, slots=True)
class RankedClaim:
    """The move that a module claims in a round, with the rank of its claim."""

    module: int
    move: Move
    priority: Priority


def priority(seed: int, round_number: int, module: int) -> Priority:
    """Return the rank of a module's claim in a round; the greater outranks.

    A keyed hash, so that it favours no module over a run and is the same in every process.
    """
    digest = blake2b(f"{seed}/{round_number}/{module}".encode(), digest_size=8).digest()
    return int.from_bytes(digest), module


def ranked(module: int, move: Move, *, seed: int, round_number: int) -> RankedClaim:
    """Return a module's claim in a round with its rank."""
    return RankedClaim(module, move, priority(seed, round_number, module))


def conflict(one: RankedClaim, other: RankedClaim) -> bool:
    """Tell whether two claims cannot both be executed: their actions do not commute."""
    return not commute(one.move.action, other.move.action)


def outranks(one: RankedClaim, other: RankedClaim) -> bool:
    """Tell whether the first claim goes before the second where they conflict."""
    return one.priority > other.priority


def outranked_by(claim: RankedClaim, heard: Iterable[RankedClaim]) -> frozenset[int]:
    """Return the modules that go before a claim: they conflict with it and outrank it."""
    return frozenset(
        other.module for other in heard if outranks(other, claim) and conflict(claim, other)
    )


def waiting_for(claim: RankedClaim, heard: Iterable[RankedClaim]) -> frozenset[Site]:
    """Return the sites of the modules that wait for the verdict on a claim.

    Those who conflict with it and do not outrank it, and those whom its move would take along.
    """
    rivals = {
        other.move.source
        for other in heard
        if not outranks(other, claim) and conflict(claim, other)
    }
    return frozenset(rivals | {source for source, _ in claim.move.motion[1:]})


def taking_along(site: Site, heard: Iterable[RankedClaim]) -> frozenset[int]:
    """Return the modules whose claimed moves would take along the module at `site`."""
    return frozenset(
        other.module
        for other in heard
        if any(source == site for source, _ in other.move.motion[1:])
    )


def verdict(outranking: Iterable[int], verdicts: Mapping[int, bool]) -> bool | None:
    """Return whether a claim is granted; None while that is open.

    `outranking` are the modules that go before it, `verdicts` what is known of claims by module:
    True for granted, False for lost. It is granted when all that go before it are lost, and lost as
    soon as one of them is granted.
    """
    known = [verdicts.get(module) for module in outranking]
    if any(known):
        return False
    return None if None in known else True


def outcome(granted: bool | None) -> Outcome:  # noqa: FBT001 - a verdict, as `verdict` returns it
    """Return the word for a verdict, or for none, in a report."""
    if granted is None:
        return "none"
    return "granted" if granted else "lost"


def site_after(site: Site, executed: Iterable[Move]) -> Site:
    """Return where the module at `site` stands after a round in which these moves are executed.

    Moved by itself, taken along by another's move, or where it was; executed moves commute, so at
    most one of them takes it anywhere.
    """
    for move in executed:
        for source, target in move.motion:
            if source == site:
                return target
    return site
