"""The rule of a module that executes its part of a schedule: its own moves, each in its round.

From birth a module knows the moves of which it is the mover, by round, and no others. In the round
of such a move it finds the move among its admissible ones and claims it; the moves of a cube
commute, so every claim is granted. If the move is not admissible, the module stays and says why,
from what it senses, so that no further round of the schedule begins.
"""

from __future__ import annotations

from collections.abc import Mapping

from cubepath.agents.local.observation import STAY, View
from cubepath.agents.rules.rule import Choice, InitialKnowledge, Rule, RuleType
from cubepath.protocol.core.actions import why_inadmissible
from cubepath.protocol.core.catalogue import Move
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.names import GeneratorPlacement
from cubepath.protocol.core.sites import Site, in_order, site_from_json, site_text
from cubepath.protocol.path_files.schedules import OwnMoves

SCHEDULE = "schedule"


def scheduled(own: Mapping[int, OwnMoves]) -> RuleType:
    """Return the rule by which each module makes the moves of its own list in `own`."""

    def make(knowledge: InitialKnowledge) -> Rule:
        return _follow(own.get(knowledge.module, {}))

    return RuleType(
        name=SCHEDULE,
        summary="each module makes its own moves of a schedule, each in its round",
        source="own, see cubepath.agents.rules.schedule",
        fits=lambda _: True,
        make=make,
    )


def _follow(moves: OwnMoves) -> Rule:
    due = {
        number: (placed.generator, site_from_json(placed.at)) for number, placed in moves.items()
    }
    rounds = 0

    def choose(view: View) -> int | Choice:
        nonlocal rounds
        rounds += 1
        return _found(view, *due[rounds]) if rounds in due else STAY

    return choose


def move_due(view: View, placed: GeneratorPlacement) -> Choice:
    """Return the choice of a move by its name; of none, with the reason, if it cannot be made."""
    return _found(view, placed.generator, site_from_json(placed.at))


def _found(view: View, generator: str, at: Site) -> Choice:
    move = view.system.move_named(view.site, generator, at)
    if move is None:
        return Choice(failed=_none_such(generator, at, view))
    action = 1 + view.moves.index(move)
    return Choice(action) if view.mask[action] else Choice(failed=why_not(move, view))


def _none_such(generator: str, at: Site, view: View) -> str:
    """Return why there is no such move: an obstacle in its way, or the module stands elsewhere."""
    try:
        view.system.action(generator, at)
    except InputError as error:
        return str(error)
    return f"{named(generator, at)} is no move from {site_text(view.site)}"


def why_not(move: Move, view: View) -> str:
    """Return one line on the first wrong site in the support of a move, as the module senses it."""
    on: set[Site] = {view.site}
    for near, code in view.occupied.items():
        shown = view.system.site_at(near, code)
        if shown is not None:
            on.add(shown)
    action = move.action
    one, other = action.ends
    before = one if move.source in one else other
    wrong = in_order((before ^ (action.support & on)) - action.free)
    if not wrong:
        return why_inadmissible(action, on)
    site, text = wrong[0], site_text(wrong[0])
    if site not in on:
        how = f"site {text} is off, expected on"
    else:
        obstacle = " (an obstacle)" if site in view.system.filled else ""
        how = f"site {text} is on{obstacle}, expected off"
    return f"{named(move.generator, move.at)} is not admissible: {how}"


def named(generator: str, at: Site) -> str:
    """Return a move as text for people."""
    return f"{generator} at {site_text(at)}"
