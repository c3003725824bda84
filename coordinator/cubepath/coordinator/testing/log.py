"""The log of a run as a test queries it: what was sent, who claimed what when, what must hold.

What must hold is derived by `auditing` and `verification`, which share nothing with the run. A
failure names the place and shows the messages around it.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Literal, NoReturn, TypeAlias, get_args

from cubepath.coordinator.auditing.rule_audit import audit
from cubepath.coordinator.plugins import plugin
from cubepath.coordinator.runs.edge_path import Gathered
from cubepath.coordinator.runs.gathering import gathered_in_full
from cubepath.coordinator.testing.rules import Pattern
from cubepath.coordinator.testing.wire_messages import RESULTS, WireMessage, short, table
from cubepath.coordinator.verification.dependencies import difference
from cubepath.coordinator.verification.findings import Verification
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.options import known_name, whole_number
from cubepath.protocol.core.sites import Site, site_text
from cubepath.protocol.displays import Displayed
from cubepath.protocol.recordings.recording import Recording, read_recording
from cubepath.protocol.wire.free_messages import Attempt, Decision
from cubepath.protocol.wire.messages import Claim, Report, encode

__tracebackhide__ = True  # pytest shows no frames of this module
Result: TypeAlias = Literal["granted", "lost", "unknown"]
What: TypeAlias = "Pattern | str"
"""Which messages: a pattern, or a kind."""
_CHECKS_MAX = 3
_REASONS_MAX = 4
_ROUND = re.compile(r"\b(?:round|level) (\d+)")
_MODULE = re.compile(r"\bmodule_(\d+)")
_SPEAKER = re.compile(r"coordinator|(process|keeper)_\d+")
_MESSAGE = re.compile(r"\bmessage (\d+) \(")


@dataclass(frozen=True, slots=True)
class ClaimOutcome:
    """A claim of a module, and its result.

    `round` is that of the claim; without rounds it is the level of the move, and None if there was
    none. `why` says why it was refused, in runs without rounds.
    """

    round: int | None
    module: int
    generator: str
    at: Site
    result: Result
    why: str = ""


@dataclass(frozen=True, slots=True)
class ExecutedMove:
    """A move that was executed: in which round or at which level, by whom, and which."""

    round: int
    module: int
    generator: str
    at: Site


class RunLog(Displayed):
    """The log of a run.

    >>> log = RunLog.read("logs/golden/hex-5.mcap")
    >>> log.assert_legal()
    >>> log.assert_goal()
    >>> log.count("claim", round=1), log.claims(module=0, round=1)[0].result
    (1, 'granted')
    """

    def __init__(self, recording: Recording) -> None:
        """Ask a recording; InputError if it is none."""
        if not isinstance(recording, Recording):  # pyright: ignore[reportUnnecessaryIsInstance]
            raise InputError(f"{recording!r}: expected a Recording, or Log.read(PATH)")
        self.recording = recording
        self.scene = recording.scene

    @classmethod
    def read(cls, path: Path | str) -> RunLog:
        """Return the log in a file; InputError if it is no recording."""
        return cls(read_recording(path))

    @cached_property
    def gathered(self) -> Gathered:
        """The edge path of the run, gathered again."""
        return gathered_in_full(self.recording)

    @property
    def free(self) -> bool:
        """Whether the run had no rounds."""
        return self.recording.clock == "free"

    @property
    def rounds(self) -> int:
        """The number of complete rounds, or the greatest level."""
        return self.gathered.rounds

    @property
    def sites(self) -> tuple[Site, ...]:
        """Where each module stands at the end."""
        return tuple(self.gathered.sites)

    @property
    def goal_reached(self) -> bool:
        """Whether the modules are at the goal."""
        return self.gathered.reached

    # Messages.

    @cached_property
    def all_deliveries(self) -> tuple[WireMessage, ...]:
        """All that is recorded in order, as it was on the wire: parts are not taken apart.

        The order is that in which the coordinator heard them. Of processes that say something in
        one phase, or without rounds at all, it says nothing of who was first.
        """
        records = self.recording.records
        return tuple(
            WireMessage(f"cubepath/log/{each.topic}", each.data, each.wall_ns / 1e9)
            for each in records
        )

    def messages(self, what: What = "", **pattern: Any) -> list[Any]:
        """Return the messages of a kind, or that a pattern means; the keys are those of `Pattern`.

        They are decoded, as `cubepath.protocol` has them. A message that a module sends, such as a
        `Claim`, is there once, however many deliveries carry it; so the same run has the same
        messages of modules in any number of processes. Kinds that belong to processes, such as
        ``bundle`` and ``ready``, come as they were on the wire. InputError for an unknown kind.
        """
        wanted = pattern_of(what, **pattern)
        found: dict[object, Any] = {}
        for place in self.places(wanted):
            seen = self.all_deliveries[place]
            if wanted.kind == seen.kind:
                found[place] = seen.message
                continue
            for (kind, module), part in zip(seen.parts, seen.contents, strict=True):
                if wanted.kind in (None, kind) and wanted.module in (None, module):
                    alone = part is seen.message
                    found.setdefault(place if alone else (seen.sender, encode(part)), part)
        return list(found.values())

    def count(self, what: What = "", **pattern: Any) -> int:
        """Return the number of such messages; keys as for `messages`."""
        return len(self.messages(what, **pattern))

    def deliveries(self, what: What = "", **pattern: Any) -> list[WireMessage]:
        """Return what was put on the wire that is such a message or carries one; keys as above.

        A process puts one delivery to each region, with all messages of its modules that are
        addressed there. So the number of deliveries depends on the number of processes.
        """
        return [self.all_deliveries[place] for place in self.places(what, **pattern)]

    def places(self, what: What = "", **pattern: Any) -> list[int]:
        """Return the places of such deliveries in `all_deliveries`; keys as for `messages`."""
        found = pattern_of(what, **pattern)
        self._check_module(found.module)
        if found.sender is not None and not _SPEAKER.fullmatch(found.sender):
            senders = {each.sender for each in self.all_deliveries}
            known_name("sender=", found.sender, sorted(senders))
        return [place for place, each in enumerate(self.all_deliveries) if found.holds(each)]

    # What was done.

    @property
    def moves(self) -> list[ExecutedMove]:
        """The moves that were executed, by rounds or levels."""
        return [
            ExecutedMove(step.round, move.module, move.generator, move.at)
            for step in self.gathered.steps
            for move in step.executed
        ]

    def claims(
        self,
        module: int | None = None,
        round: int | None = None,  # noqa: A002 - the word of all messages
        result: Result | None = None,
    ) -> list[ClaimOutcome]:
        """Return who claimed what when, with the results, in the order of the log.

        Without rounds an attempt to move is a claim, and one that was refused is lost. InputError
        for a module that is not there, or another result.
        """
        self._check_module(module)
        if round is not None:
            whole_number("round", round, 0)
        if result is not None:
            known_name("result=", result, get_args(Result))
        found = self._attempts if self.free else self._claims
        return [
            each
            for each in found
            if module in (None, each.module)
            and round in (None, each.round)
            and result in (None, each.result)
        ]

    def grants(self, module: int | None = None) -> list[ClaimOutcome]:
        """Return the claims that were granted."""
        return self.claims(module, result="granted")

    def _check_module(self, module: object) -> None:
        if module is not None:
            whole_number("module", module, 0, len(self.scene.start) - 1)

    def _parts(self, *kinds: type[Any]) -> Iterator[Any]:
        for seen in self.all_deliveries:
            found: Any = seen.message
            for part in getattr(found, "parts", (found,)):
                if isinstance(part, kinds):
                    yield part

    @cached_property
    def _claims(self) -> tuple[ClaimOutcome, ...]:
        claims: dict[tuple[int, int], Claim] = {}
        results: dict[tuple[int, int], Result] = {}
        for part in self._parts(Claim, Report):
            if isinstance(part, Claim):
                claims.setdefault((part.round, part.module), part)
            elif part.claim != "none":
                results[part.round, part.module] = part.claim
        return tuple(
            ClaimOutcome(*name, each.generator, each.at, results.get(name, "unknown"))
            for name, each in claims.items()
        )

    @cached_property
    def _attempts(self) -> tuple[ClaimOutcome, ...]:
        attempts: dict[tuple[int, int, int], Attempt] = {}
        decided: dict[tuple[int, int, int], Decision] = {}
        for part in self._parts(Attempt, Decision):
            name = part.module, part.epoch, part.number
            if isinstance(part, Decision):
                decided.setdefault(name, part)
            elif part.generator is not None:
                attempts.setdefault(name, part)
        return tuple(_came_of(each, decided.get(name)) for name, each in sorted(attempts.items()))

    # What must hold.

    @cached_property
    def verification(self) -> Verification:
        """What verifying the log finds, the installed rules of its modules asked again."""
        return audit(self.recording)

    def assert_legal(self, rules: Collection[str] = ()) -> None:
        """Check that everything in the recording is as it must be: as ``cubepath verify`` does.

        Every move was admissible and claimed, what was done at one time commutes, everyone heard
        what they should, and chose as their rule says. A rule in a file is asked again if `rules`
        has it, as FILE.py:NAME. AssertionError tells what fails, with the messages around it.
        """
        found = audit(self.recording, rules=rules) if rules else self.verification
        wrong = [check for check in found.checks if not check.ok]
        if not wrong:
            return
        lines = [f"{check.name}: {short(check.detail)}" for check in wrong[:_CHECKS_MAX]]
        more = len(wrong) - len(lines)
        lines += [f"and {more} more checks"] if more > 0 else []
        self._fail("the log is not legal: " + "\n  ".join(lines), *self._places_in(wrong[0].detail))

    def assert_goal(self) -> None:
        """Check that the modules are at their goal at the end; AssertionError tells who is not."""
        if self.goal_reached:
            return
        goals = self.scene.goals or ((self.scene.goal,) if self.scene.goal else ())
        wanted = {site for goal in goals for site in goal}
        away = [
            f"module_{module} at {site_text(site)}"
            for module, site in enumerate(self.sites)
            if site not in wanted
        ]
        where = f": {', '.join(away)} stand elsewhere" if away else ""
        self._fail(short(f"the goal is not reached after {self.rounds} {self._unit}s{where}"))

    def assert_same_run(self, other: RunLog, *, homotopic: bool = False) -> None:
        """Check that both are the same run up to swapping neighbouring moves that commute.

        With `homotopic` also up to moves that are undone: both have the same normal cube path.
        AssertionError tells the first difference, where the runs part and why, and the first round
        that has other moves.
        """
        if not isinstance(other, RunLog):  # pyright: ignore[reportUnnecessaryIsInstance]
            raise InputError(f"{other!r}: expected another Log")
        one, two = self.gathered, other.gathered
        starts = one.scene.start_state, two.scene.start_state
        found = difference(one.path, two.path, starts, homotopic=homotopic)
        if found is None:
            return
        word = "homotopic" if homotopic else "the same run"
        mine, theirs = (_by_round(each.moves) for each in (self, other))
        first = next(
            (at for at in sorted({*mine, *theirs}) if mine.get(at) != theirs.get(at)), None
        )
        lines = [f"not {word}: {short(found)}"]
        lines += _parting(self.recording, other.recording)
        if first is not None:
            for name, moves in (("first", mine), ("second", theirs)):
                recorded = ", ".join(moves.get(first, ())) or "none"
                lines.append(f"{self._unit} {first}, {name}: {short(recorded)}")
        self._fail("\n  ".join(lines), first)

    def assert_order(self, first: What, then: What) -> None:
        """Check that the first message of one kind or pattern comes before the first of another.

        AssertionError if either is missing, or if they come the other way round. See
        `all_deliveries` for what the order of a log means.
        """
        one, two = self.places(first), self.places(then)
        for what, found in ((first, one), (then, two)):
            if not found:
                self._fail(f"no message is {_named(what)}, expected one")
        if one[0] > two[0]:
            self._fail(
                f"{_named(then)} comes before {_named(first)}: message {two[0]} before {one[0]}",
                place=two[0],
                also=one[0],
            )

    def assert_count(self, expected: int | range, what: What = "", **pattern: Any) -> None:
        """Check the number of such messages; keys as for `messages`.

        `expected` is a number, or a range that has it. AssertionError tells how many there are, and
        shows the first of them.
        """
        if not isinstance(expected, range):
            whole_number("expected", expected, 0)
        found = self.count(what, **pattern)
        if isinstance(expected, range):
            holds, due = found in expected, f"{expected.start} to {expected.stop - 1}"
        else:
            holds, due = found == expected, str(expected)
        if holds:
            return
        name = _named(pattern_of(what, **pattern))
        places = self.places(what, **pattern)
        self._fail(
            f"{found} messages are {name}, expected {due}", place=places[0] if places else None
        )

    def assert_claimed(
        self,
        module: int,
        round: int | None = None,  # noqa: A002 - as above
        result: Result | None = None,
    ) -> None:
        """Check that a module made a claim, in this round, with this result.

        AssertionError lists what it did claim.
        """
        if self.claims(module, round, result):
            return
        own = [
            f"{self._unit} {each.round}: {each.generator} at {each.at}, {each.result}"
            for each in self.claims(module)
        ]
        asked = f" in {self._unit} {round}" if round is not None else ""
        asked += f" that was {result}" if result is not None else ""
        claims = short("; ".join(own)) if own else "it made none"
        self._fail(f"module_{module} made no claim{asked}: {claims}", round, module)

    # The text of a failure.

    @property
    def _unit(self) -> str:
        return "level" if self.free else "round"

    def _places_in(self, detail: str) -> tuple[int | None, int | None, int | None]:
        """Return the round, the module and the message that a line names."""
        found = (each.search(detail) for each in (_ROUND, _MODULE, _MESSAGE))
        at, module, message = (int(each[1]) if each is not None else None for each in found)
        return at, module, message

    def _fail(
        self,
        line: str,
        at: int | None = None,
        module: int | None = None,
        place: int | None = None,
        also: int | None = None,
    ) -> NoReturn:
        """Raise AssertionError with the messages around a place, or of a round and a module."""
        everything = self.all_deliveries
        marked = [each for each in (place, also) if each is not None]
        title = "the messages around it"
        if not marked and at is not None:
            means: Callable[[WireMessage], bool] = Pattern(round=at, module=module).holds
            marked = [each for each, seen in enumerate(everything) if means(seen)]
            title = f"the messages around {self._unit} {at}"
            title += "" if module is None else f" of module_{module}"
        if marked:
            raise AssertionError(f"{line}\n{table(everything, marked, title)}")
        messages = [each for each in everything if each.kind not in RESULTS]
        raise AssertionError(f"{line}\n{table(messages, title='the last messages')}")


def pattern_of(what: What = "", **pattern: Any) -> Pattern:
    """Return a pattern, or one of a kind; the keys of `Pattern` are added to either.

    InputError for what is neither, and for other keys.
    """
    for key in pattern:
        known_name("", key, Pattern.__slots__)
    if isinstance(what, Pattern):
        return replace(what, **pattern)
    if not isinstance(what, str):  # pyright: ignore[reportUnnecessaryIsInstance]
        raise InputError(f"{what!r}: expected a kind of message, or a Pattern")
    if what and "kind" in pattern:
        raise InputError(f"kind={pattern['kind']}: expected one kind, found {what} beside it")
    return Pattern(kind=what or pattern.pop("kind", None), **pattern)


def _named(what: What) -> str:
    return f"'{what}'"


def _came_of(attempt: Attempt, decision: Decision | None) -> ClaimOutcome:
    result: Result = "unknown"
    level, why = None, ""
    if decision is not None:
        result = "lost" if decision.commit is None else "granted"
        level = None if decision.commit is None else decision.commit.level
        why = decision.reason
    name = attempt.generator or ""
    return ClaimOutcome(level, attempt.module, name, attempt.at, result, why)


def _parting(a: Recording, b: Recording) -> list[str]:
    """Return in lines where two runs part, and why."""
    try:
        parted = plugin("diff")(a, b)
    except InputError as error:  # nothing that both have on record
        return [short(str(error))]
    lines = [] if parted.same else [short(parted.answer)]
    if parted.choice is not None:
        lines += [
            f"first: {short(parted.choice.a.chose)}",
            f"second: {short(parted.choice.b.chose)}",
            *(f"why: {short(line)}" for line in parted.choice.why[:_REASONS_MAX]),
        ]
    return lines


def _by_round(moves: Sequence[ExecutedMove]) -> dict[int, list[str]]:
    found: dict[int, list[str]] = {}
    for each in moves:
        line = f"module_{each.module} {each.generator} at {each.at}"
        found.setdefault(each.round, []).append(line)
    return found
