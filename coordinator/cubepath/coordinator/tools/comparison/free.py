"""Two runs without rounds: the commits that differ first by what they depend on, and why.

The times of events differ between any two such runs, so they are not compared. A commit is the same
in both runs if it is the same move of the same module, writes the same, and depends on the same
commits, all of them the same; so runs whose commits are all the same are equal up to commuting. Of
the other commits, the first are those that depend on no other differing one.

The rule is asked again turn by turn, as in an audit, up to the turn that led to the commit.
"""

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from itertools import chain

from cubepath.agents.rules.rule import Choice
from cubepath.coordinator.tools.comparison.free_run import (
    CommitGraph,
    CommitId,
    CommitNode,
    ShownInTurn,
)
from cubepath.coordinator.tools.comparison.moves import advance, compare_paths, named, states_text
from cubepath.coordinator.tools.comparison.reasons import AskedRule, causes_of, value_text
from cubepath.coordinator.tools.comparison.results import (
    NAMES,
    Cause,
    ChoiceContext,
    ChoiceDifference,
    DifferingRounds,
    MoveDifference,
    PathComparison,
    RunComparison,
)
from cubepath.coordinator.tools.comparison.rule_replay import (
    ReplayedChoice,
    RuleReplayer,
    RuleSource,
    way_of,
)
from cubepath.coordinator.verification.choices import Observing
from cubepath.protocol.core.actions import Action
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.formatting import counted
from cubepath.protocol.core.sites import Site
from cubepath.protocol.recordings.recording import Recording
from cubepath.protocol.wire.free_messages import Commit, Turn

NOT_COMPARED = (
    "not compared, as it follows from timing: who was shown what when, turns in which a module"
    " stayed, attempts that were refused, and what keepers say to each other"
)


def compare_free(a: Recording, b: Recording) -> RunComparison:
    """Return where two runs without rounds part; see `diff`."""
    runs = CommitGraph(a), CommitGraph(b)
    same = _same(runs)
    _check_comparable(runs)
    pairs = _other(runs, same)
    more = tuple(sum(name not in same for name in run.commits) for run in runs)
    notes = [NOT_COMPARED, *_notes(runs)]
    choice = None
    if pairs:
        also = [one or two for one, two in pairs[1:]]
        others = {each.id[0] for each in also if each is not None}
        choice = explain_commit(runs, pairs[0], others)
    ends = _ends(runs)
    lost = any(run.missing or run.loose for run in runs)
    beginning = None
    if not pairs and any(more) and not lost:
        beginning = "b" if not more[1] else "a" if not more[0] else None
    whole = bool(pairs) or not any(more)
    return RunComparison(
        a=str(a.path),
        b=str(b.path),
        clock="free",
        same=whole and not (pairs or lost or ends) and runs[0].odd == runs[1].odd,
        compared=_compared(runs, same, more),
        notes=tuple(notes),
        choice=choice,
        move=_first_move(runs, same) if pairs else None,
        # Where commits are only missing, levels do not tell how far a run had come.
        states=tuple(_states(runs)) if whole else (),
        rounds=tuple(_levels(runs)) if whole else (),
        ends=ends,
        paths=_paths(runs) if whole else _paths_of(runs, same),
        beginning=beginning,
        limited=any(run.partial for run in runs),
    )


def _check_comparable(runs: tuple[CommitGraph, CommitGraph]) -> None:
    """Refuse runs of which nothing can be compared, as the first commits are missing."""
    for run in runs:
        if not run.commits and run.partial:
            why = [f"has {run.cut}"] if run.cut is not None else []
            why += [f"is damaged: {problem}" for problem in run.recording.problems[:1]]
            raise InputError(
                f"{run.recording.path}: nothing to compare, as its first commits are not on record:"
                f" it {', and '.join(why) or 'is cut off'}"
            )


def _notes(runs: tuple[CommitGraph, CommitGraph]) -> Iterator[str]:
    for name, run in zip(NAMES, runs, strict=True):
        for problem in run.recording.problems:
            yield f"{name} is damaged: {problem}"
        if run.cut is not None:
            yield f"{name} has {run.cut}"
        yield from (f"{name}: {each}" for each in run.odd)
        if run.missing:
            are = "is" if run.missing == 1 else "are"
            yield f"{name}: {counted(run.missing, 'commit')} {are} not on record"
        if run.loose:
            follow = "follows" if run.loose == 1 else "follow"
            yield (
                f"{name}: {counted(run.loose, 'commit')} {follow} on others that are not on record,"
                " and cannot be compared"
            )
        if run.summary is None and run.cut is None:
            yield f"{name} is cut off: no summary"


def _compared(
    runs: tuple[CommitGraph, CommitGraph], same: set[CommitId], more: tuple[int, ...]
) -> str:
    one, two = (len(run.commits) for run in runs)
    if not any(more):
        return f"{counted(one, 'commit')}, by what they depend on"
    return (
        f"{counted(one, 'commit')} in a, {two} in b, by what they depend on: {len(same)} of them"
        " are the same"
    )


_Pair = tuple[CommitNode | None, CommitNode | None]


def _same(runs: tuple[CommitGraph, CommitGraph]) -> set[CommitId]:
    """Return the commits that are the same in both, with all that they depend on."""
    one, two = (run.commits for run in runs)
    same: set[CommitId] = set()
    for name, commit in one.items():
        other = two.get(name)
        if (
            other is not None
            and (commit.content, commit.before) == (other.content, other.before)
            and commit.before <= same
        ):
            same.add(name)
    return same


def _other(runs: tuple[CommitGraph, CommitGraph], same: set[CommitId]) -> list[_Pair]:
    """Return the commits that differ and depend on none that does, by level and module.

    With each comes the commit of the same module and number in the other run, if there is one. What
    a run lacks that has not all its commits in the recording is no difference.
    """
    one, two = (run.commits for run in runs)
    found: dict[CommitId, _Pair] = {}
    for commit in chain(one.values(), two.values()):
        if commit.id in same or not commit.before <= same:
            continue
        pair = one.get(commit.id), two.get(commit.id)
        lacks = zip(runs, pair, strict=True)
        if not any(run.partial and each is None for run, each in lacks):
            found[commit.id] = pair
    return sorted(found.values(), key=_place)


def _first_move(
    runs: tuple[CommitGraph, CommitGraph], same: set[CommitId]
) -> MoveDifference | None:
    """Return the first commit with a move that is not the same in both, by level and module."""
    one, two = (run.commits for run in runs)
    pairs = [
        (one.get(name), two.get(name))
        for name in {**one, **two}
        if name not in same and any(run.get(name) is not None for run in (one, two))
    ]
    moved = [
        pair
        for pair in pairs
        if any(each is not None and each.move is not None for each in pair)
        and not any(run.partial and each is None for run, each in zip(runs, pair, strict=True))
    ]
    if not moved:
        return None
    pair = min(moved, key=_place)
    level, module, _ = _place(pair)
    texts = [
        None if each is None or each.move is None else f"{each.move} (level {each.moved.level})"
        for each in pair
    ]
    return MoveDifference(level, module, texts[0], texts[1])


def _place(pair: _Pair) -> tuple[int, int, int]:
    return min(each.place for each in pair if each is not None)


def _ends(runs: tuple[CommitGraph, CommitGraph]) -> tuple[str, str] | None:
    endings = ["not on record" if run.summary is None else run.summary.ended for run in runs]
    return (endings[0], endings[1]) if endings[0] != endings[1] else None


_Named = tuple[int, str, Site]


def _by_level(run: CommitGraph) -> dict[int, list[_Named]]:
    found: dict[int, list[_Named]] = {}
    for moved, _ in run.moves():
        named = moved.module, str(moved.generator), moved.at
        found.setdefault(moved.level, []).append(named)
    return found


def _levels(runs: tuple[CommitGraph, CommitGraph]) -> list[tuple[int, int, int, int]]:
    one, two = (_by_level(run) for run in runs)
    found: list[tuple[int, int, int, int]] = []
    for level in sorted({*one, *two}):
        mine, theirs = set(one.get(level, ())), set(two.get(level, ()))
        if mine != theirs:
            found.append((level, len(mine), len(theirs), len(mine & theirs)))
    return found


def _states(runs: tuple[CommitGraph, CommitGraph]) -> list[DifferingRounds]:
    """Return from the end of which level to that of which the states differ."""
    states = [set(run.recording.scene.start_state) for run in runs]
    paths = [list(run.moves()) for run in runs]
    places = [0, 0]
    last = max((moved.level for path in paths for moved, _ in path), default=0)
    found: list[DifferingRounds] = []
    begin = None if states[0] == states[1] else 0
    for level in range(1, last + 1):
        for side, path in enumerate(paths):
            while places[side] < len(path) and path[places[side]][0].level <= level:
                advance(states[side], path[places[side]][1])
                places[side] += 1
        if (states[0] == states[1]) == (begin is None):
            continue
        if begin is None:
            begin = level
        else:
            found.append(DifferingRounds(begin, level))
            begin = None
    return found if begin is None else [*found, DifferingRounds(begin, None)]


def _paths(runs: tuple[CommitGraph, CommitGraph]) -> PathComparison:
    one, two = ([_action(*each) for each in run.moves()] for run in runs)
    starts = [run.recording.scene.start_state for run in runs]
    end = states_text(*(frozenset(run.history.state) for run in runs))
    identical = _by_level(runs[0]) == _by_level(runs[1])
    return compare_paths(one, two, (starts[0], starts[1]), end, identical=identical)


def _paths_of(runs: tuple[CommitGraph, CommitGraph], same: set[CommitId]) -> PathComparison:
    """Return how the paths compare of the commits that are the same in both."""
    kept = [{run.commits[name].name for name in same} for run in runs]
    one, two = (
        [
            _action(moved, action)
            for moved, action in run.moves()
            if (moved.keeper, moved.serial) in names
        ]
        for run, names in zip(runs, kept, strict=True)
    )
    starts = [run.recording.scene.start_state for run in runs]
    return compare_paths(one, two, (starts[0], starts[1]), None, identical=False)


def _action(moved: Commit, action: Action) -> Action:
    place = moved.at
    if moved.generator is None or place is None:
        return action
    return named(action, moved.generator, place)


_Chosen = tuple[object, ...]
"""All of a choice, its move by name."""


@dataclass(frozen=True)
class _Trail:
    """The turns of a module up to that of a commit, with the results of asking rules again."""

    inputs: list[object]
    shown: ShownInTurn | None
    """What it was shown in the last of them."""
    chosen: _Chosen
    """What is recorded that it chose then."""
    played: list[ReplayedChoice | None]
    refused: str | None
    """Why rules could not be asked."""

    @property
    def asked(self) -> AskedRule:
        """Return what its rule chose when it was asked again."""
        return AskedRule(self.played, self.refused, lambda played: _chosen(played) == self.chosen)


def explain_commit(
    runs: tuple[CommitGraph, CommitGraph], pair: _Pair, also: Collection[int]
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
    sides = [_side(commit, trail) for commit, trail in zip(pair, trails, strict=True)]
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


def _follow(run: CommitGraph, commit: CommitNode, ways: Sequence[RuleSource]) -> _Trail | None:
    """Follow a module up to the turn of a commit; None if that is not recorded."""
    scene, moved = run.recording.scene, commit.moved
    observing = Observing(scene)
    inputs: list[object] = []
    players: list[RuleReplayer] = []
    played: list[ReplayedChoice | None] = [None] * len(ways)
    refused: str | None = None
    turn: Turn | None = None
    last = 0
    shown: ShownInTurn | None = None
    for turn, fresh, born in run.turns_to(commit):
        if fresh:
            last, refused = 0, None
            players = [RuleReplayer(scene, moved.module, way, born, clock="free") for way in ways]
        if turn.turn != last + 1:
            refused = f"turn {last + 1} of epoch {turn.epoch} is not on record"
        last = turn.turn
        shown = run.shown(turn)
        if shown is None:
            refused = f"what it was shown in turn {turn.turn} is not on record"
            inputs.append(None)
            continue
        notes = sorted(shown.received.items())
        inputs.append((fresh, shown.site, sorted(shown.occupants.items()), notes, shown.register))
        if refused is None:
            played = [_play(observing, player, moved.module, shown) for player in players]
    if turn is None or (turn.epoch, turn.turn) != (moved.epoch, moved.turn):
        return None
    if refused is None and players:
        refused = players[0].why
    elif refused is not None:
        played = [None] * len(ways)
    return _Trail(inputs, shown, _recorded(run, turn), played, refused)


def _play(
    observing: Observing, player: RuleReplayer, module: int, shown: ShownInTurn
) -> ReplayedChoice | None:
    seen = observing.seen(
        module,
        shown.site,
        shown.standing,
        shown.notes,
        note_length=player.length,
        register=shown.register,
    )
    return player.play(shown.site, seen)


def _recorded(run: CommitGraph, turn: Turn) -> _Chosen:
    site = turn.site
    move = None
    if site is not None and turn.action:
        moves = run.history.system.moves(site)
        found = moves[turn.action - 1] if turn.action <= len(moves) else None
        move = None if found is None else (found.generator, found.at)
    return (
        move,
        None if turn.note is None else tuple(turn.note),
        turn.failed,
        tuple(turn.guards),
        tuple(turn.heeds),
        {place: tuple(note) for place, note in turn.exchanges},
    )


def _chosen(played: ReplayedChoice) -> _Chosen:
    choice: Choice = played.choice
    exchanges: dict[Site | None, tuple[int, ...]] = {
        place: tuple(note) for place, note in choice.exchanges.items()
    }
    note = None if choice.note is None else tuple(choice.note)
    return played.action, note, choice.failed, choice.guards, choice.heeds, exchanges


def _side(commit: CommitNode | None, trail: _Trail | None) -> ChoiceContext:
    chose = "makes no such commit" if commit is None else commit.text()
    level = None if commit is None or commit.move is None else commit.moved.level
    if trail is None or trail.shown is None:
        return ChoiceContext("", {}, {}, chose, level=level)
    shown, played = trail.shown, trail.played[0]
    notes = {**shown.received, **({"its own register": shown.register} if shown.register else {})}
    by_rule = None
    if played is not None:
        by_rule = chose if _chosen(played) == trail.chosen else "something else"
    drew = None if played is None else played.drew
    doubt = None if played is None else played.doubt
    return ChoiceContext(
        shown.text, shown.occupants, notes, chose, by_rule, drew, doubt, shown.versions, level
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
    everything = [*(["inputs"] if a.inputs != b.inputs else []), *changed]
    causes, more = causes_of(a.asked, b.asked, changed, everything)
    return causes, (*lines, *more)


def _dependencies(one: CommitNode, two: CommitNode) -> Iterator[str]:
    for name, mine, theirs in (("a", one, two), ("b", two, one)):
        alone = sorted(mine.before - theirs.before)
        if alone:
            commits = ", ".join(f"commit {number} of module_{module}" for module, number in alone)
            yield f"in {name} alone it comes after {commits}"


def _shown(a: _Trail, b: _Trail) -> Iterator[str]:
    one, two = a.shown, b.shown
    if one is None or two is None:
        return
    if len(a.inputs) != len(b.inputs):
        asked = counted(len(a.inputs), "time")
        yield f"its rule was asked {asked} in a and {len(b.inputs)} in b until then"
    if (
        one.occupants == two.occupants
        and one.received == two.received
        and one.register == two.register
    ):
        yield "it was shown the same in the turn that led there"
        return
    for place in sorted({*one.occupants, *two.occupants}):
        texts = [
            f"{each.occupants[place]} (version {each.versions[place]})"
            if place in each.occupants
            else "not sensed"
            for each in (one, two)
        ]
        if one.occupants.get(place) != two.occupants.get(place):
            yield f"at {place}: {texts[0]} in a, {texts[1]} in b"
    for who in sorted({*one.received, *two.received}):
        notes = [each.received.get(who, "nothing") for each in (one, two)]
        if notes[0] != notes[1]:
            yield f"{who} says: {notes[0]} in a, {notes[1]} in b"
    if one.register != two.register:
        yield f"its own register: {one.register} in a, {two.register} in b"
