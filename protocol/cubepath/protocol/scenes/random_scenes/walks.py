"""Random walks: goals that can be reached, since a walk has reached them."""

from __future__ import annotations

from collections.abc import Sequence, Set as AbstractSet

from cubepath.protocol.core.actions import apply_in_place, end_at
from cubepath.protocol.core.catalogue import Move
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.sites import Site, in_order
from cubepath.protocol.core.system import System
from cubepath.protocol.scenes.family import Values, whole
from cubepath.protocol.scenes.random_scenes.stream import Stream

_MOVES_MAX = 100_000
_WORK_MAX = 1_000_000
"""The most moves times modules: at every step all modules are asked what they can do."""
WALK_KEY = ("", "the goal is where so many random moves lead, so it can be reached")


def walk_length(values: Values, modules: int) -> int | None:
    """Return the value of the key `walk`; None where it is left out, InputError for a bad one."""
    if not values["walk"]:
        return None
    most = min(_MOVES_MAX, _WORK_MAX // modules)
    return whole(values, "walk", least=1, most=most)


def walked(system: System, start: Sequence[Site], moves: int, stream: Stream) -> tuple[Site, ...]:
    """Return where the modules are after a random walk, in the order in which they start.

    Every step is one of the admissible moves, each equally likely, but not the last move back
    unless there is no other. A walk that ends where it began is one step shorter. InputError if no
    module can move.
    """
    sites = before = list(start)
    state = {*start, *system.filled}
    ask = system.discovery() or system.moves_at
    asked: set[Site] = set()
    known: dict[Site, list[Move]] = {}
    waiting: list[Site] = [*start, *in_order(system.filled)]
    last = None
    for _ in range(moves):
        for site in waiting:
            if site not in asked:
                asked.add(site)
                for move in ask(site):
                    known.setdefault(move.source, []).append(move)
        # A system may offer one action by several moves.
        options = {
            move.action: move
            for site in sites
            for move in known.get(site, ())
            if _can_be_made(move, state)
        }
        if len(options) > 1 and last is not None:
            options.pop(last, None)
        if not options:
            raise InputError(f"walk={moves}: no module can move")
        move = stream.choice(list(options.values()))
        place = {site: number for number, site in enumerate(sites)}
        before = list(sites)
        for source, target in move.motion:
            sites[place[source]] = target
        apply_in_place(move.action, state)
        waiting = [target for _, target in move.motion]
        last = move.action
    return tuple(before if set(sites) == set(start) else sites)


def _can_be_made(move: Move, state: AbstractSet[Site]) -> bool:
    """Return whether the action applies at the state, in the direction of this move."""
    end = end_at(move.action, state)
    return end is not None and all(source in move.action.ends[end] for source, _ in move.motion)
