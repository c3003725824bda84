"""What a round does, by the definitions read globally: the second way, for holding the core to it.

It shares `commute` and the catalogue with what it is held against, and nothing else: ranks, who
wins, where modules end and what they have been told are worked out anew, over all claims at once.
"""

from collections.abc import Iterable, Mapping

from cubepath.protocol.core.actions import commute
from cubepath.protocol.core.catalogue import Move
from cubepath.protocol.core.sites import Site


def draw(key: int, index: int) -> int:
    """Return number `index` of the generator SplitMix64 from this key on."""
    found = (key + (index + 1) * 0x9E3779B97F4A7C15) % 2**64
    found = (found ^ found >> 30) * 0xBF58476D1CE4E5B9 % 2**64
    found = (found ^ found >> 27) * 0x94D049BB133111EB % 2**64
    return found ^ found >> 31


def key_of(seed: int, purpose: int) -> int:
    """Return the key of a seed for a purpose."""
    key = draw(draw(0, purpose), seed % 2**64)
    while seed := seed >> 64:
        key = draw(key, seed % 2**64)
    return key


def rank(seed: int, number: int, module: int) -> tuple[int, int]:
    """Return the rank of a module's claim in a round."""
    return draw(draw(key_of(seed, 3), number), module), module


def maximal(claims: Mapping[int, Move], order: Iterable[int]) -> list[int]:
    """Return a maximal set of claims that commute, taken greedily in this order of modules."""
    winners: list[int] = []
    for module in order:
        if all(commute(claims[module].action, claims[other].action) for other in winners):
            winners.append(module)
    return winners


def settled(claims: Mapping[int, Move], seed: int, number: int) -> list[int]:
    """Return the modules whose claims are executed, in increasing order."""
    ranked = sorted(claims, key=lambda module: rank(seed, number, module), reverse=True)
    return sorted(maximal(claims, ranked))


def sites_after(sites: Iterable[Site], executed: Iterable[Move]) -> list[Site]:
    """Return where modules stand after these moves, each with all that it takes along."""
    motion = {source: target for move in executed for source, target in move.motion}
    return [motion.get(site, site) for site in sites]
