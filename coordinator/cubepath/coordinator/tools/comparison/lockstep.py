"""Two runs with rounds, read side by side: what differs first, round by round.

Nothing is derived here: the messages of modules are compared, each once, in the order of the run.
Memory is that of the rounds in progress and a few numbers for each round.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import msgspec

from cubepath.coordinator.tools.comparison.moves import Path, Reading, action_text, start_of
from cubepath.coordinator.tools.comparison.results import (
    DifferingRounds,
    MessageDifference,
    MoveDifference,
)
from cubepath.coordinator.verification.parameters import stages_in
from cubepath.coordinator.verification.round_spans import Span, add_to_spans, gaps_between
from cubepath.coordinator.verification.transcript import RecordedRound
from cubepath.protocol.core.sites import Site
from cubepath.protocol.recordings.recording import Recording
from cubepath.protocol.wire.messages import Claim, Note, Report

_KINDS = ("presence", "note", "claim", "verdict", "report", "edges")
"""The messages of a round, in this order."""


@dataclass(frozen=True)
class ComparisonScope:
    """The rounds that are compared."""

    first: int = 1
    last: int | None = None

    @property
    def limited(self) -> bool:
        """Whether not all rounds are asked for."""
        return self.first > 1 or self.last is not None


@dataclass(frozen=True)
class ClaimOutcomes:
    """A claim with another result: what is recorded of its round in both runs."""

    round: int
    module: int
    a: RecordedRound
    b: RecordedRound


@dataclass
class FoundDifferences:
    """What differs, as it is found."""

    message: MessageDifference | None = None
    choices: dict[int, int] = field(default_factory=dict)
    """By module the first round in which it chose otherwise."""
    acted: set[int] = field(default_factory=set)
    """Those of them that claimed something else in that round, or gave up in one run alone."""
    outcome: ClaimOutcomes | None = None
    move: MoveDifference | None = None
    states: list[DifferingRounds] = field(default_factory=list)
    rounds: list[tuple[int, int, int, int]] = field(default_factory=list)
    moved_apart: dict[int, int] = field(default_factory=dict)
    """By module that stood elsewhere in the other run when choices first differed, since when."""
    compared: list[Span] = field(default_factory=list)
    """The rounds that were compared."""
    only: tuple[int, int] = (0, 0)
    """How many rounds each run has in the recording after the last that the other has."""
    lacking: tuple[set[str], set[str]] = field(default_factory=lambda: (set(), set()))
    """Kinds of messages that are missing in a run which has not all, and so were not compared."""
    present: tuple[set[str], set[str]] = field(default_factory=lambda: (set(), set()))
    """Kinds of messages of rounds that each run has."""
    silent: set[tuple[int, int]] = field(default_factory=set)
    """The runs, 0 or 1, with the rounds in which another rule begins and nobody says what was noted
    before, if the other run has notes in such a round."""
    followed: bool = True
    """Whether the rounds that one run alone has count as what it did after the other ended."""


class SideBySide:
    """Goes through two recordings at once."""

    def __init__(self, a: Reading, b: Reading, asked: ComparisonScope) -> None:
        """Begin at the first round that is whole in both."""
        self.readings = a, b
        self.found = FoundDifferences()
        self.paths = Path(a.recording.scene.system), Path(b.recording.scene.system)
        self.begin = max(a.first, b.first)
        self.starts: tuple[frozenset[Site], frozenset[Site]] | None = None
        """What was on before the first round that is compared; None if there is none."""
        self.broken = False
        """Whether rounds are missing between those whose moves were taken."""
        self._asked = asked
        self._rounds = self._from_begin(a), self._from_begin(b)
        self._since = self._due = 0
        self._silent = _silent(a.recording), _silent(b.recording)
        self._states = ModuleStates(a.recording.scene.start, b.recording.scene.start)

    def go(self) -> FoundDifferences:
        """Compare all rounds; OutOfOrder as for `Reading.rounds`."""
        only = [0, 0]
        one, two = (next(each, None) for each in self._rounds)
        while one is not None or two is not None:
            number = min(each[0] for each in (one, two) if each is not None)
            if self._asked.last is not None and number > self._asked.last:
                break  # every round that is to be compared was
            if one is not None and two is not None:
                if one[0] == two[0]:
                    self._round(number, one[1], two[1])
            else:
                only[one is None] += 1
                self._alone(one, two)
            # Of a round that is missing in one run the other waits for the next.
            here = [each is not None and each[0] == number for each in (one, two)]
            one = next(self._rounds[0], None) if here[0] else one
            two = next(self._rounds[1], None) if here[1] else two
        self.found.only = (only[0], only[1])
        self.found.states = self._states.ended()
        return self.found

    def read_on(self) -> None:
        """Read both to the end, so that it is known which rounds they have."""
        for rounds in self._rounds:
            for _ in rounds:
                pass

    def gaps(self, side: int) -> list[Span]:
        """Return the rounds that are to be compared and are missing between others of a run."""
        first = max(self._asked.first, self.begin)
        return gaps_between(self.readings[side].spans, first, self._asked.last)

    def ends(self) -> tuple[frozenset[Site], frozenset[Site]]:
        """Return what was on at the end of each run, by the word of its modules."""
        one, two = (
            reading.recording.scene.system.filled | frozenset(sites)
            for reading, sites in zip(self.readings, self._states.sites, strict=True)
        )
        return one, two

    def _from_begin(self, reading: Reading) -> Iterator[_Numbered]:
        return (each for each in reading.rounds() if each[0] >= self.begin)

    def _alone(self, one: _Numbered | None, two: _Numbered | None) -> None:
        """Take the moves of a round that the other run does not have, if that had ended."""
        side = int(one is None)
        number, recorded = one or two or (0, RecordedRound())
        self.found.followed = self.readings[1 - side].ended
        if not self.found.followed or number < self._asked.first:
            return
        self.broken = self.broken or bool(self._due and number != self._due)
        self._due = number + 1
        for report in recorded.reports.values():
            self.paths[side].add(number, report)
        self._states.move(number, *(recorded.reports if n == side else {} for n in (0, 1)))

    def _round(self, number: int, a: RecordedRound, b: RecordedRound) -> None:
        if number != self._due:
            self._since = number
            one, two = (
                start_of(reading, number, recorded)
                for reading, recorded in zip(self.readings, (a, b), strict=True)
            )
            self._states.place(one, two, number - 1)
        self._due = number + 1
        if number < self._asked.first:
            self._states.move(number, a.reports, b.reports)
            return
        if self.starts is None:
            self.starts = self.ends()
            self._states.note(number - 1)
        elif number == self._since:
            self.broken = True
            self._states.note(number - 1)
        add_to_spans(self.found.compared, number)
        for reading, present, recorded in zip(
            self.readings, self.found.present, (a, b), strict=True
        ):
            if reading.partial:
                present.update(kind for kind, _ in recorded.messages)
                present.update(("report",) if recorded.edges is None else ("report", "edges"))
        if a.messages != b.messages or a.reports != b.reports or a.edges != b.edges:
            self._differ(number, a, b)
        for side, recorded in enumerate((a, b)):
            for report in recorded.reports.values():
                self.paths[side].add(number, report)
        self._states.move(number, a.reports, b.reports)
        self._states.note(number)

    def _differ(self, number: int, a: RecordedRound, b: RecordedRound) -> None:
        """Take down what differs in a round in which something does."""
        found = self.found
        lists = _messages(a), _messages(b)
        different = [
            key
            for key in sorted({*lists[0], *lists[1]}, key=_place)
            if not self._is_lacking(number, key, lists)
            and _content(lists[0].get(key)) != _content(lists[1].get(key))
        ]
        if different and found.message is None:
            kind, module = different[0]
            found.message = message_difference(
                number,
                kind,
                None if module < 0 else module,
                *(each.get((kind, module)) for each in lists),
            )
        known = bool(found.choices)
        self._choices(number, a, b, different)
        if found.choices and not known:
            found.moved_apart = dict(self._states.moved_apart)
        self._moves(number, a, b)

    def _is_lacking(
        self, number: int, key: tuple[str, int], lists: tuple[_Messages, _Messages]
    ) -> bool:
        """Return whether a message is missing in a recording with gaps."""
        for reading, messages, lacking in zip(
            self.readings, lists, self.found.lacking, strict=True
        ):
            # The edges come after the round, which may have been the last one.
            if key not in messages and (key[0] == "edges" or reading.lacks(number)):
                lacking.add(key[0])
                return True
        return False

    def _choices(
        self, number: int, a: RecordedRound, b: RecordedRound, different: list[tuple[str, int]]
    ) -> None:
        """Note which modules chose otherwise, and the first claim with another result."""
        found = self.found
        for kind, module in different:
            # The place from which a note is sent follows from moves; what it says was chosen.
            noted = kind == "note" and note_of(a, module) != note_of(b, module)
            silent = {(side, number) for side in (0, 1) if number in self._silent[side]}
            if noted and silent:
                found.silent |= silent
            elif noted and number > max(self._since, self._asked.first):
                found.choices.setdefault(module, number - 1)
        for module in sorted(a.reports.keys() & b.reports.keys()):
            if any(
                _claim_is_lost(recorded, module) and reading.lacks(number)
                for reading, recorded in zip(self.readings, (a, b), strict=True)
            ):
                continue
            if chosen(a, module) != chosen(b, module):
                if found.choices.setdefault(module, number) == number:
                    found.acted.add(module)
            elif found.outcome is None and _outcome(a, module) != _outcome(b, module):
                found.outcome = ClaimOutcomes(number, module, a, b)

    def _moves(self, number: int, a: RecordedRound, b: RecordedRound) -> None:
        one, two = _moves(a), _moves(b)
        if one == two:
            return
        common = sum(1 for module, move in one.items() if two.get(module) == move)
        self.found.rounds.append((number, len(one), len(two), common))
        if self.found.move is None:
            modules = sorted({*one, *two})
            module = next(each for each in modules if one.get(each) != two.get(each))
            mine, theirs = (
                action_text(*moves[module]) if module in moves else None for moves in (one, two)
            )
            self.found.move = MoveDifference(number, module, mine, theirs)


class ModuleStates:
    """Where modules stand in both runs by their own word, and whether the same sites are on."""

    def __init__(self, a: tuple[Site, ...], b: tuple[Site, ...]) -> None:
        self.moved_apart: dict[int, int] = {}
        self._apart: list[DifferingRounds] = []
        self._begin: int | None = None
        self.place(a, b, 0)

    def place(self, a: tuple[Site, ...], b: tuple[Site, ...], since: int) -> None:
        """Go on from where modules stand at the end of round `since`, 0 for the start."""
        self.sites: tuple[list[Site], list[Site]] = list(a), list(b)
        self._balance: dict[Site, int] = {}
        for side, sites in enumerate((a, b)):
            for site in sites:
                self._count(site, 1 - 2 * side)
        for module in range(max(len(a), len(b))):
            if a[module : module + 1] == b[module : module + 1]:
                self.moved_apart.pop(module, None)
            else:
                self.moved_apart.setdefault(module, since)

    def move(self, number: int, a: dict[int, Report], b: dict[int, Report]) -> None:
        """Take the reports at the end of a round."""
        touched: set[int] = set()
        for side, reports in enumerate((a, b)):
            sites = self.sites[side]
            for module, report in reports.items():
                if report.site == report.before:
                    continue
                site = report.site
                if site is not None and site != sites[module]:
                    self._count(sites[module], 2 * side - 1)
                    self._count(site, 1 - 2 * side)
                    sites[module] = site
                    touched.add(module)
        one, two = self.sites
        for module in touched:
            if one[module : module + 1] == two[module : module + 1]:
                self.moved_apart.pop(module, None)
            else:
                self.moved_apart.setdefault(module, number)

    def ended(self) -> list[DifferingRounds]:
        """Return from when to when the states differed."""
        if self._begin is not None:
            self._apart.append(DifferingRounds(self._begin, None))
        return self._apart

    def _count(self, site: Site, by: int) -> None:
        now = self._balance.get(site, 0) + by
        if now:
            self._balance[site] = now
        else:
            self._balance.pop(site, None)

    def note(self, number: int) -> None:
        """Note whether the states differ at the end of a round, 0 for the start."""
        if self._balance and self._begin is None:
            self._begin = number
        elif not self._balance and self._begin is not None:
            self._apart.append(DifferingRounds(self._begin, number))
            self._begin = None


def _silent(recording: Recording) -> set[int]:
    """Return the rounds in which another rule begins, and does not hear what was noted before."""
    return {stage.begins for stage in stages_in(recording)[1:] if not stage.heard}


_Numbered = tuple[int, RecordedRound]
_Messages = dict[tuple[str, int], Any]


def _messages(this: RecordedRound) -> _Messages:
    """Return the messages of a round, by kind and module."""
    found: _Messages = dict(this.messages)
    found.update((("report", module), report) for module, report in this.reports.items())
    if this.edges is not None:
        found["edges", -1] = this.edges
    return found


def _place(key: tuple[str, int]) -> tuple[int, int]:
    return _KINDS.index(key[0]), key[1]


def _content(message: Any) -> dict[str, Any] | None:
    """Return the fields of a message."""
    return None if message is None else msgspec.to_builtins(message)


def message_difference(
    number: int, kind: str, module: int | None, one: Any, two: Any
) -> MessageDifference:
    """Return how two messages of a kind differ, None where there is none."""
    a, b = _content(one), _content(two)
    names = [*(a or {}), *(name for name in b or {} if name not in (a or {}))]
    absent = object()
    fields = tuple(
        name for name in names if (a or {}).get(name, absent) != (b or {}).get(name, absent)
    )
    return MessageDifference(number, kind, module, a, b, fields)


Chosen = tuple[str, Site | None] | None
"""The move that a module chose, by generator and place; None if it stayed."""


def chosen(this: RecordedRound, module: int) -> tuple[Chosen, str | None]:
    """Return what a module chose: its move, and why it gave up.

    A claim that nobody could receive was not sent; of that the report tells, if it was granted.
    """
    claim, report = this.messages.get(("claim", module)), this.reports.get(module)
    failed = None if report is None else report.failed
    if isinstance(claim, Claim):
        return (claim.generator, claim.at), failed
    if report is not None and report.move is not None:
        return (report.move.generator, report.move.at), failed
    return None, failed


def note_of(this: RecordedRound, module: int) -> tuple[int, ...] | None:
    """Return the note that a module sent in a round."""
    note = this.messages.get(("note", module))
    return tuple(note.note) if isinstance(note, Note) else None


def _claim_is_lost(this: RecordedRound, module: int) -> bool:
    """Return whether a module claimed what is not recorded, and did not come to do it."""
    report = this.reports[module]
    return ("claim", module) not in this.messages and report.claim != "none" and report.move is None


def _outcome(this: RecordedRound, module: int) -> str | None:
    report = this.reports.get(module)
    return None if report is None else report.claim


def _moves(this: RecordedRound) -> dict[int, tuple[str, Any]]:
    return {
        module: (report.move.generator, report.move.at)
        for module, report in this.reports.items()
        if report.move is not None
    }
