"""Why a commit differs between two runs without rounds: what its module was shown, by versions.

The rule is asked again turn by turn, as in an audit, up to the turn that led to the commit.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass

from cubepath.agents.rules.rule import Choice
from cubepath.coordinator.tools.comparison.free_run import Commit, FreeRun, Shown
from cubepath.coordinator.tools.comparison.playing import Played, Player, Way, way_of
from cubepath.coordinator.tools.comparison.reasons import (
    NOT_BY_RULE,
    only_cause,
    picture_of,
    value_text,
)
from cubepath.coordinator.tools.comparison.results import NAMES, Cause, ChoiceDifference, Side
from cubepath.coordinator.verification.choices import Observing
from cubepath.coordinator.verification.transcript import site_in
from cubepath.protocol.core.formatting import counted
from cubepath.protocol.core.sites import Site
from cubepath.protocol.core.system import System
from cubepath.protocol.wire.free_messages import Turn

_Chosen = tuple[object, ...]
"""All of a choice, its move by name."""
_Pair = tuple[Commit | None, Commit | None]


@dataclass(frozen=True)
class _Trail:
    """The turns of a module up to that of a commit, with what came of asking rules again."""

    inputs: list[object]
    shown: Shown | None
    """What it was shown in the last of them."""
    chosen: _Chosen
    """What is on record that it chose then."""
    played: list[Played | None]
    refused: str | None
    """Why rules could not be asked."""


def explain_commit(
    runs: tuple[FreeRun, FreeRun], pair: _Pair, also: Collection[int]
) -> ChoiceDifference:
    """Explain a commit that differs and depends on none that does."""
    known = [each for each in pair if each is not None]
    module, number = known[0].id
    a, b = (way_of(run.recording, module, 1) for run in runs)
    changed = a.differs(b)
    asked = [a, *(a.exchanged(name, b) for name in changed)], [b, a]
    trails = [
        None if commit is None else _follow(run, commit, ways)
        for run, commit, ways in zip(runs, pair, asked, strict=True)
    ]
    one, two = trails
    sides = [
        _side(commit, trail, module, run.history.system)
        for commit, trail, run in zip(pair, trails, runs, strict=True)
    ]
    causes, why = _causes(pair, one, two, changed)
    parameters = [
        f"{name} is {value_text(getattr(a, name))} in a, and {value_text(getattr(b, name))} in b"
        for name in changed
    ]
    level = min(commit.moved.level for commit in known)
    others = tuple(sorted({*also} - {module}))
    return ChoiceDifference(
        level, module, sides[0], sides[1], causes, (*parameters, *why), others, number
    )


def _follow(run: FreeRun, commit: Commit, ways: Sequence[Way]) -> _Trail | None:
    """Follow a module up to the turn of a commit; None if that is not on record."""
    scene, moved = run.recording.scene, commit.moved
    observing = Observing(scene)
    inputs: list[object] = []
    players: list[Player] = []
    played: list[Played | None] = [None] * len(ways)
    refused: str | None = None
    turn: Turn | None = None
    last = 0
    shown: Shown | None = None
    for turn, fresh, born in run.turns_to(commit):
        if fresh:
            last, refused = 0, None
            players = [Player(scene, moved.module, way, born, clock="free") for way in ways]
        if turn.turn != last + 1:
            refused = f"turn {last + 1} of epoch {turn.epoch} is not on record"
        last = turn.turn
        shown = run.shown(turn)
        if shown is None:
            refused = f"what it was shown in turn {turn.turn} is not on record"
            inputs.append(None)
            continue
        told = sorted(shown.told.items())
        inputs.append((fresh, shown.site, sorted(shown.who.items()), told, shown.register))
        if refused is None:
            played = [_play(observing, player, moved.module, shown) for player in players]
    if turn is None or (turn.epoch, turn.turn) != (moved.epoch, moved.turn):
        return None
    if refused is None and players:
        refused = players[0].why
    elif refused is not None:
        played = [None] * len(ways)
    return _Trail(inputs, shown, _recorded(run, turn), played, refused)


def _play(observing: Observing, player: Player, module: int, shown: Shown) -> Played | None:
    seen = observing.seen(
        module,
        shown.site,
        shown.standing,
        shown.notes,
        note_length=player.length,
        register=shown.register,
    )
    return player.play(shown.site, seen)


def _recorded(run: FreeRun, turn: Turn) -> _Chosen:
    site = site_in(turn.site)
    move = None
    if site is not None and turn.action:
        moves = run.history.system.moves(site)
        found = moves[turn.action - 1] if turn.action <= len(moves) else None
        move = None if found is None else (found.generator, found.at)
    return (
        move,
        None if turn.note is None else tuple(turn.note),
        turn.failed,
        tuple(map(site_in, turn.guards)),
        tuple(map(site_in, turn.heeds)),
        {site_in(place): tuple(note) for place, note in turn.exchanges},
    )


def _chosen(played: Played) -> _Chosen:
    choice: Choice = played.choice
    exchanges: dict[Site | None, tuple[int, ...]] = {
        place: tuple(note) for place, note in choice.exchanges.items()
    }
    note = None if choice.note is None else tuple(choice.note)
    return played.action, note, choice.failed, choice.guards, choice.heeds, exchanges


def _side(commit: Commit | None, trail: _Trail | None, module: int, system: System) -> Side:
    chose = "makes no such commit" if commit is None else commit.text()
    level = None if commit is None or commit.move is None else commit.moved.level
    if trail is None or trail.shown is None:
        return Side("", {}, {}, chose, level=level)
    shown, played = trail.shown, trail.played[0]
    told = {**shown.told, **({"its own register": shown.register} if shown.register else {})}
    by_rule = None
    if played is not None:
        by_rule = chose if _chosen(played) == trail.chosen else "something else"
    drew = None if played is None else played.drew
    picture = picture_of(system, module, shown.site, shown.who)
    doubt = None if played is None else played.doubt
    return Side(
        shown.text, shown.who, told, chose, by_rule, drew, doubt, shown.versions, picture, level
    )


def _causes(
    pair: _Pair, a: _Trail | None, b: _Trail | None, changed: list[str]
) -> tuple[tuple[Cause, ...], tuple[str, ...]]:
    one, two = pair
    if one is None or two is None:
        name = NAMES[0 if one is None else 1]
        return ("unknown",), (f"{name} has no such commit of this module on record",)
    lines = list(_dependencies(one, two))
    if one.content == two.content:
        return ("inputs",), ("the commit is the same, and depends on others", *lines)
    if a is None or b is None:
        name = NAMES[0 if a is None else 1]
        return ("unknown",), (*lines, f"{name}: the turn that led to it is not on record")
    lines += _shown(a, b)
    causes, more = _asked(a, b, changed)
    return causes, (*lines, *more)


def _asked(a: _Trail, b: _Trail, changed: list[str]) -> tuple[tuple[Cause, ...], tuple[str, ...]]:
    """Return what makes the difference, by what rules chose when they were asked again."""
    everything = [*(["inputs"] if a.inputs != b.inputs else []), *changed]
    for name, trail in zip(NAMES, (a, b), strict=True):
        if trail.played[0] is None:
            why = trail.refused or "its rule could not be asked"
            return only_cause(everything), (f"{name}: what it drew is not known: {why}",)
        if _chosen(trail.played[0]) != trail.chosen:
            return ("record",), (f"{name}: {NOT_BY_RULE}",)
    enough = {
        name: found is not None and _chosen(found) == b.chosen
        for name, found in [*zip(changed, a.played[1:], strict=True), ("inputs", b.played[1])]
        if name in everything
    }
    names: tuple[Cause, ...] = ("inputs", "rule", "seed", "hesitate")
    causes: tuple[Cause, ...] = tuple(name for name in names if enough.get(name))
    none: Cause = "together" if everything else "unknown"
    return causes or (none,), ()


def _dependencies(one: Commit, two: Commit) -> Iterator[str]:
    for name, mine, theirs in (("a", one, two), ("b", two, one)):
        alone = sorted(mine.before - theirs.before)
        if alone:
            told = ", ".join(f"commit {number} of module_{module}" for module, number in alone)
            yield f"in {name} alone it comes after {told}"


def _shown(a: _Trail, b: _Trail) -> Iterator[str]:
    one, two = a.shown, b.shown
    if one is None or two is None:
        return
    if len(a.inputs) != len(b.inputs):
        asked = counted(len(a.inputs), "time")
        yield f"its rule was asked {asked} in a and {len(b.inputs)} in b until then"
    if one.who == two.who and one.told == two.told and one.register == two.register:
        yield "it was shown the same in the turn that led there"
        return
    for place in sorted({*one.who, *two.who}):
        told = [
            f"{each.who[place]} (version {each.versions[place]})"
            if place in each.who
            else "not sensed"
            for each in (one, two)
        ]
        if one.who.get(place) != two.who.get(place):
            yield f"at {place}: {told[0]} in a, {told[1]} in b"
    for who in sorted({*one.told, *two.told}):
        notes = [each.told.get(who, "nothing") for each in (one, two)]
        if notes[0] != notes[1]:
            yield f"{who} says: {notes[0]} in a, {notes[1]} in b"
    if one.register != two.register:
        yield f"its own register: {one.register} in a, {two.register} in b"
