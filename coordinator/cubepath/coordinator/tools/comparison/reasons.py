"""Why a module chose otherwise, and why a claim was granted in only one of the runs.

A cause is not guessed: the rule is asked again with one thing exchanged at a time, and whatever
then makes it choose as in the other run is the cause. Where a rule cannot be asked, the report says
what differs, and not what that caused.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

from cubepath.coordinator.tools.comparison import moves
from cubepath.coordinator.tools.comparison.lockstep import ClaimOutcomes
from cubepath.coordinator.tools.comparison.results import (
    NAMES,
    Cause,
    ChoiceContext,
    ChoiceDifference,
    OutcomeDifference,
)
from cubepath.coordinator.tools.comparison.rule_replay import (
    ChoiceOnRecord,
    ModuleHistory,
    ReplayedChoice,
    RuleSource,
    follow,
    seed_at,
    way_of,
)
from cubepath.coordinator.verification.rounds import rank
from cubepath.coordinator.verification.transcript import RecordedRound
from cubepath.protocol.core.actions import Action, commute
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.formatting import counted
from cubepath.protocol.core.sites import site_text
from cubepath.protocol.core.system import System
from cubepath.protocol.recordings.recording import Recording
from cubepath.protocol.wire.messages import Claim

NOT_BY_RULE = (
    "by its rule as installed it does otherwise, so the rule has changed since, or the record has"
    " ('cubepath verify' checks all of it)"
)
_CAUSES: tuple[Cause, ...] = ("inputs", "rule", "seed", "hesitate")
_WORDS = {"rule": "rule", "seed": "seed", "hesitate": "hesitation", "inputs": "surroundings"}


def explain_choice(
    open_again: Callable[[int], moves.Reading],
    number: int,
    module: int,
    own: tuple[str | None, str | None],
    since: Mapping[int, int],
) -> ChoiceDifference:
    """Explain a choice of a module in a round that differs, by reading both runs up to it.

    `open_again` opens a run anew; `own` are the their own rules that processes named for the
    module, and `since` has, for modules that stood elsewhere by then, the round since which they
    did.
    """
    readings = open_again(0), open_again(1)
    one, two = (
        way_of(reading.recording, module, number, name)
        for reading, name in zip(readings, own, strict=True)
    )
    changed = one.differs(two)
    exchanged = [one.exchanged(name, two) for name in changed]
    try:
        a = follow(readings[0], module, number, [one, *exchanged])
        b = follow(readings[1], module, number, [two, one])
    except moves.Contradiction as error:
        empty = ChoiceContext("", {}, {}, "")
        line = f"{error}: the recording contradicts itself, so there is no explanation"
        return ChoiceDifference(number, module, empty, empty, ("record",), (line,))
    scene = moves.scenes_text(*(reading.recording.scene for reading in readings))
    causes, why = _causes((a, b), (one, two), changed, since, scene)
    return ChoiceDifference(number, module, _side(a), _side(b), causes, why)


def _side(trail: ModuleHistory) -> ChoiceContext:
    recorded = trail.recorded
    played = trail.played[0] if trail.played else None
    by_rule = None
    if played is not None:
        note = None if recorded.note is None else played.note
        by_rule = _choice_text(ChoiceOnRecord(played.action, played.failed, note))
    return ChoiceContext(
        site_text(trail.site),
        trail.sensed,
        trail.received,
        _choice_text(recorded),
        by_rule,
        None if played is None else played.drew,
        None if played is None else played.doubt,
    )


def _choice_text(chosen: ChoiceOnRecord) -> str:
    text = "stays" if chosen.action is None else f"claims {moves.action_text(*chosen.action)}"
    if chosen.note is not None:
        text += f", notes {list(chosen.note)}"
    return text if chosen.failed is None else f"{text}, gives up: {chosen.failed}"


def _causes(
    trails: tuple[ModuleHistory, ModuleHistory],
    ways: tuple[RuleSource, RuleSource],
    changed: list[str],
    since: Mapping[int, int],
    scene: str | None,
) -> tuple[tuple[Cause, ...], tuple[str, ...]]:
    begins = min(way.begins for way in ways)
    other_inputs = _first_other(trails, begins)
    lines = list(_surroundings(trails, other_inputs, since, begins))
    lines += [_parameter(name, ways) for name in changed]
    lines += _hesitations(trails, ways)
    everything = [*(["inputs"] if other_inputs is not None else []), *changed]
    if scene is not None:  # a rule knows of it from birth, and it cannot be exchanged
        lines.append(f"what its rule knows from birth differs as well ({scene})")
        everything.append("scene")
    # What a rule remembers from rounds that are not on record may differ, too.
    firsts = [next(iter(trail.inputs)) for trail in trails]
    if any(first > way.begins for first, way in zip(firsts, ways, strict=True)):
        everything.append("memory")
    asked = [
        AskedRule(trail.played, trail.refused[0] if trail.refused else None, trail.recorded.is_by)
        for trail in trails
    ]
    causes, more = causes_of(asked[0], asked[1], changed, everything)
    return causes, (*lines, *more)


class AskedRule(NamedTuple):
    """The rule of a module asked again in one of the runs."""

    played: Sequence[ReplayedChoice | None]
    """What it chose, and with one thing after another of the other run; None if it was not asked"""
    refused: str | None
    """Why it could not be asked."""
    is_by: Callable[[ReplayedChoice], bool]
    """Returns whether the recorded choice is this."""


def causes_of(
    a: AskedRule, b: AskedRule, changed: list[str], everything: list[str]
) -> tuple[tuple[Cause, ...], list[str]]:
    """Return what makes the difference, with lines on it.

    `a` was asked with each of `changed` of `b`, and `b` with what `a` follows, but its own inputs;
    `everything` is all that differs.
    """
    sides = list(zip(NAMES, (a, b), strict=True))
    first = {name: side.played[0] if side.played else None for name, side in sides}
    unknown = [
        f"{name}: what it drew is not known: {side.refused or 'its rule could not be asked'}"
        for name, side in sides
        if first[name] is None
    ]
    if unknown:  # a cause is reported only if nothing else can be it
        sole: tuple[Cause, ...] = tuple(name for name in _CAUSES if everything == [name])
        return sole or ("unknown",), unknown
    forged = [
        f"{name}: {NOT_BY_RULE}"
        for name, side in sides
        if (played := first[name]) is not None and not side.is_by(played)
    ]
    if forged:
        return ("record",), forged
    exchanged = [*zip(changed, a.played[1:], strict=True), ("inputs", b.played[1])]
    enough = {
        name
        for name, played in exchanged
        if name in everything and played is not None and b.is_by(played)
    }
    causes: tuple[Cause, ...] = tuple(name for name in _CAUSES if name in enough)
    if not causes:
        alone = "no one of these alone makes the difference"
        return ("together",) if everything else ("unknown",), [alone] if everything else []
    words = " or the ".join(_WORDS[name] for name in causes)
    line = f"with the {words} of b alone it would choose in a what it chose in b"
    return causes, [line] if len(everything) > 1 else []


def _hesitations(
    trails: tuple[ModuleHistory, ModuleHistory], ways: tuple[RuleSource, RuleSource]
) -> Iterator[str]:
    for name, trail, way in zip(NAMES, trails, ways, strict=True):
        doubt = trail.played[0].doubt if trail.played and trail.played[0] is not None else None
        if doubt is not None and way.hesitate is not None and doubt < way.hesitate:
            yield f"{name} hesitates: {doubt:.4f} is less than {way.hesitate}, so it claims nothing"


def _first_other(trails: tuple[ModuleHistory, ModuleHistory], begins: int) -> int | None:
    """Return the first round from `begins` on in which the module was given something else."""
    one, two = (trail.inputs for trail in trails)
    rounds = (number for number in one if number >= begins and number in two)
    return next((number for number in rounds if one[number] != two[number]), None)


def _surroundings(
    trails: tuple[ModuleHistory, ModuleHistory],
    other: int | None,
    since: Mapping[int, int],
    begins: int,
) -> Iterator[str]:
    a, b = trails
    now = a.moment.round
    if other is None:
        before = max(begins, *(next(iter(trail.inputs)) for trail in trails))
        which = "in this round"
        if before == 1:
            which += " and all before"
        elif before < now:
            which += f" and those before from round {before} on"
        yield f"it sensed and heard the same in both, {which}"
        return
    if a.inputs[now] == b.inputs[now]:
        yield f"it senses and hears the same now, but did not in round {other}"
        return
    if a.site != b.site:
        yield f"it stands at {site_text(a.site)} in a, and at {site_text(b.site)} in b"
    met: set[int] = set()
    yield from _other_places(a, b, met)
    for sender in sorted({*a.received, *b.received}):
        notes = [each.received.get(sender) for each in (a, b)]
        if notes[0] != notes[1]:
            one, two = ("nothing" if each is None else str(each) for each in notes)
            yield f"{sender} says: {one} in a, {two} in b"
            met.add(_module_in(sender))
    moments = a.moment, b.moment
    for module in sorted(met):
        if all(module < len(each.sites) for each in moments) and since.get(module, now) < now:
            one, two = (site_text(each.sites[module]) for each in moments)
            how = "from the start" if not since[module] else f"since round {since[module]}"
            yield f"module_{module} stands at {one} in a and at {two} in b {how}"


def _other_places(a: ModuleHistory, b: ModuleHistory, met: set[int]) -> Iterator[str]:
    """Yield what is elsewise at places that it senses, and add the modules that are there."""
    alone = [0, 0]
    for place in sorted({*a.sensed, *b.sensed}):
        there = [each.sensed.get(place) for each in (a, b)]
        modules = [each for each in there if each is not None and each.startswith("module_")]
        if there[0] == there[1]:
            continue
        if None in there and not modules:
            alone[1 - there.index(None)] += 1
            continue
        one, two = ("not sensed" if each is None else each for each in there)
        yield f"at {place}: {one} in a, {two} in b"
        met.update(map(_module_in, modules))
    for name, count in zip(NAMES, alone, strict=True):
        if count:
            yield f"in {name} alone it senses {counted(count, 'more place')}, with no module there"


def _module_in(text: str) -> int:
    return int(text.removeprefix("module_").split()[0])


def _parameter(name: str, ways: tuple[RuleSource, RuleSource]) -> str:
    if name == "rule":
        one, two = map(_rule_text, ways)
        if one == two:
            return "the schedules differ, or the rules that processes name for their modules"
    else:
        one, two = (value_text(getattr(way, name)) for way in ways)
    return f"{name} is {one} in a, and {two} in b"


def _rule_text(way: RuleSource) -> str:
    rule = value_text(way.own or way.rule)
    return rule if way.begins == 1 else f"{rule}, which began in round {way.begins} with no memory,"


def value_text(value: object) -> str:
    """Return a parameter in words."""
    return "not known" if value is None else str(value)


# Claims that were granted in one run alone.


def explain_outcome(found: ClaimOutcomes, a: Recording, b: Recording) -> OutcomeDifference:
    """Explain why a claim was granted in one run alone: by the claims of the round and by ranks."""
    rounds, runs = (found.a, found.b), (a, b)
    claims = tuple(
        _claims(recorded, run.scene.system) for recorded, run in zip(rounds, runs, strict=True)
    )
    seeds = seed_at(a, found.round), seed_at(b, found.round)
    why: list[str] = []
    for side in (0, 1):
        contest = _contest(found, claims[side], rounds[side], seeds[side])
        why += [f"{NAMES[side]}: {line}" for line in contest]
    if _same_claims(claims):
        if seeds[0] != seeds[1]:
            why.append("the claims are the same; ranks follow from the seeds, which differ")
        else:
            why.append("claims and seed are the same, so one of the records is wrong")
    texts = [_outcome_text(recorded, found.module) for recorded in rounds]
    claim = rounds[0].messages.get(("claim", found.module))
    text = moves.action_text(claim.generator, claim.at) if isinstance(claim, Claim) else "stays"
    return OutcomeDifference(found.round, found.module, text, texts[0], texts[1], tuple(why))


_Claims = dict[int, tuple[str, Action]]


def _claims(recorded: RecordedRound, system: System) -> _Claims:
    found: _Claims = {}
    for (kind, module), message in recorded.messages.items():
        if kind != "claim" or not isinstance(message, Claim):
            continue
        at: Any = message.at  # what is none is none of the system
        try:
            action = system.action(message.generator, at)
        except (InputError, TypeError, ValueError, IndexError):
            continue
        found[module] = moves.action_text(message.generator, message.at), action
    return found


def _same_claims(claims: tuple[_Claims, ...]) -> bool:
    one, two = ({module: name for module, (name, _) in each.items()} for each in claims)
    return one == two


def _contest(
    found: ClaimOutcomes, claims: _Claims, recorded: RecordedRound, seed: int | None
) -> Iterator[str]:
    """Yield who conflicted with a claim, and who of them went before it."""
    module, number = found.module, found.round
    own = claims.get(module)
    if own is None:
        return
    rivals = [
        each
        for each, (_, action) in sorted(claims.items())
        if each != module and not commute(action, own[1])
    ]
    if not rivals:
        yield "no other module claims anything that conflicts"
    for rival in rivals:
        what = f"module_{rival} claims {claims[rival][0]}"
        come = _outcome_text(recorded, rival)
        if seed is None:
            yield f"{what}, which conflicts, and is {come}"
            continue
        above = rank(seed, number, rival) > rank(seed, number, module)
        order = "outranks it" if above else "ranks below it"
        yield f"{what}, which conflicts, {order}, and is {come}"


def _outcome_text(recorded: RecordedRound, module: int) -> str:
    report = recorded.reports.get(module)
    return "not reported" if report is None else report.claim
