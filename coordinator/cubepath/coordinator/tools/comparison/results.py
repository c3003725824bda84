"""The results of comparing two runs, as data and for people.

Whatever has two sides has them as `a` and `b`, in the order of the arguments.
"""

import textwrap
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any, Literal, TypeAlias

import msgspec

from cubepath.coordinator.verification.parameters import stages_of
from cubepath.protocol.core.formatting import counted, visible

Cause: TypeAlias = Literal["rule", "seed", "hesitate", "inputs", "together", "record", "unknown"]
"""Why two choices differ.

Where both rules could be asked again, ``rule``, ``seed``, ``hesitate`` or ``inputs`` is what makes
the module of `a` choose as that of `b` did, when it alone is exchanged; ``together`` if only all
that differs does. ``record``: a choice in the recording is not what the installed rule chooses.
``unknown``: nothing that is known tells why.
"""


NAMES = ("a", "b")
"""What the two runs are called."""


NO_ROUNDS = "no rounds"
"""What was compared of runs of which one has no round."""


@dataclass(frozen=True, slots=True)
class MessageDifference:
    """The first message that differs, in the order of the run: round, phase, kind, module.

    `a` and `b` are its fields, None in the run that does not have it; `fields` names those that
    differ. Without rounds `round` is a level.
    """

    round: int
    kind: str
    module: int | None
    a: dict[str, Any] | None
    b: dict[str, Any] | None
    fields: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class ChoiceContext:
    """What a module sensed, received, drew and chose in one of the runs.

    `sensed` says of each place that it senses what is there: a module, ``empty``, ``closed``
    (outside the workspace) or ``filled`` (an obstacle); `received` has the notes of modules within
    reach. `drew` are the numbers that its rule drew from its random stream in this choice, 64 bits
    each, as fractions from 0 to 1; `doubt` is the one that is compared with how often it hesitates.
    Both are None if the rule could not be asked again. `by_rule` is what the installed rule
    chooses. `versions`, without rounds, are those of what it was shown, and `level` is that of the
    commit, None if that has no move.
    """

    site: str
    sensed: dict[str, str]
    received: dict[str, list[int]]
    chose: str
    by_rule: str | None = None
    drew: tuple[float, ...] | None = None
    doubt: float | None = None
    versions: dict[str, int] | None = None
    level: int | None = None


@dataclass(frozen=True, slots=True)
class ChoiceDifference:
    """The first choice that differs: of which module, in which round, and why.

    `also` are the modules that chose something else in the same round. `causes` says why in words
    for machines, and `why` in lines for people. Without rounds `round` is the least level of the
    commit in either run, and `number` says which of the module's commits that is, from 1.
    """

    round: int
    module: int
    a: ChoiceContext
    b: ChoiceContext
    causes: tuple[Cause, ...]
    why: tuple[str, ...]
    also: tuple[int, ...] = ()
    number: int | None = None


@dataclass(frozen=True, slots=True)
class OutcomeDifference:
    """The first claim that was made in both runs, and granted in one of them alone."""

    round: int
    module: int
    claim: str
    a: str
    b: str
    why: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class MoveDifference:
    """The first move that differs; None in the run in which the module makes none there.

    Without rounds it is the first of a module's commits with a move, and `round` its least level.
    """

    round: int
    module: int | None
    a: str | None
    b: str | None


@dataclass(frozen=True, slots=True)
class PathComparison:
    """The two edge paths as a whole; None where a path is not known.

    `same` is None if they are equal up to swapping moves that commute, and otherwise one line on
    the first difference; `homotopic` likewise, with moves that are undone taken out.
    """

    moves: tuple[int, int]
    cubes: tuple[int, int]
    identical: bool
    """Whether both have the same moves in the same rounds, so the same digest."""
    same: str | None
    homotopic: str | None
    end: str | None
    """One line on how the states at the end differ; None if they do not, or if it is not known."""
    end_unknown: str | None = None
    """One line on why it is not known whether they differ, None if it is."""


@dataclass(frozen=True, slots=True)
class DifferingRounds:
    """From the end of which round to the end of which the states differ.

    `end` is None if they still do at the end of the last round that is compared.
    """

    begin: int
    end: int | None


@dataclass(frozen=True, slots=True, kw_only=True)
class RunComparison:
    """Where two runs part, and why.

    >>> found = diff("logs/golden/hex-5.mcap", "logs/golden/hex-5.mcap")
    >>> found.same, found.choice, found.paths.cubes
    (True, None, (19, 19))
    """

    a: str
    b: str
    clock: str
    """"lockstep", "free", or "moves" if only the moves can be compared."""
    same: bool
    """Whether nothing differs that modules sent and did, and nothing is missing in one alone or
    between rounds that were compared."""
    identical: bool = False
    """Whether both files have the same bytes."""
    parameters: dict[str, tuple[str | None, str | None]] = field(default_factory=dict)
    """The parameters that differ; None where one is missing."""
    scene: str | None = None
    """One line on the first difference of the scenes, None if they are equal."""
    compared: str
    """What was compared, in one line."""
    notes: tuple[str, ...]
    """What is odd with a recording, and what was not compared."""
    message: MessageDifference | None = None
    choice: ChoiceDifference | None = None
    outcome: OutcomeDifference | None = None
    move: MoveDifference | None = None
    states: tuple[DifferingRounds, ...] = ()
    rounds: tuple[tuple[int, int, int, int], ...] = ()
    """For each round with other moves: its number, the moves in `a`, in `b`, and in both."""
    beginning: str | None = None
    """The run, "a" or "b", that is the beginning of the other: that continues where it ends."""
    limited: bool = False
    """Whether this is a part of the runs: rounds were asked for, or both begin later, or the end of
    one is not on record."""
    ends: tuple[str, str] | None = None
    """How each run ended, if they ended otherwise."""
    paths: PathComparison | None = None

    @property
    def answer(self) -> str:
        """Where they part, in one line."""
        return answer(self)

    def __str__(self) -> str:
        return comparison_text(self)

    def document(self) -> dict[str, Any]:
        """Return the keys of ``cubepath diff --json``."""
        return asdict(self)


_COLUMN = 38
"""The width of each of the two columns."""
_NAME = 15
"""The width of the names."""
_ROUNDS_MAX = 8
"""This many rounds with other moves are shown."""
_LINE = 100
_CHECKSUMS, _CHECKSUM = ("parent_sha256", "parent_path_digest", "path_digest"), 12
"""The number of characters of a parameter that are shown."""


def comparison_text(found: RunComparison) -> str:
    """Return what differs, for people."""
    lines = [*_line("a", found.a), *_line("b", found.b)]
    for name, values in found.parameters.items():
        one, two = (_or_none(_value(name, each)) for each in values)
        lines += _line(name, f"{one} in a, {two} in b")
    if found.scene is not None:
        lines += _line("scene", found.scene)
    lines += _line("compared", found.compared)
    for note in found.notes:
        lines += _line("note", note)
    lines += _line("answer", answer(found))
    if found.ends is not None:
        lines += _line("ended", f"{found.ends[0]} in a, {found.ends[1]} in b")
    outcome, choice = found.outcome, found.choice
    # The results of claims after the first other choice are no news.
    if outcome is not None and (choice is None or outcome.round < choice.round):
        lines += ["", *_outcome(outcome)]
    if choice is not None:
        lines += ["", *_choice(choice, found)]
    if found.message is not None:
        lines += ["", *_message(found.message, found)]
    moves = [*_moves(found)]
    lines += ["", *moves] if moves else []
    return "\n".join(visible(line.rstrip()) for line in lines)


def _or_none(value: str | None) -> str:
    return "none" if value is None else value or "empty"


def _value(name: str, value: str | None) -> str | None:
    """Return a parameter in words: checksums shortened, stages as who follows what from when."""
    if value is not None and name in _CHECKSUMS and len(value) > _CHECKSUM:
        return f"{value[:_CHECKSUM]}..."
    if value is None or name != "stages":
        return value
    stages = stages_of(value)
    texts = [
        f"{', '.join(f'{rule} for {modules}' for rule, modules in each.rules.items())} from round"
        f" {each.begins} on (seed {each.seed}, hesitate {each.hesitate})"
        for each in stages
    ]
    return "; ".join(texts) or value


def _unit(found: RunComparison) -> str:
    return {"lockstep": "round", "free": "level"}.get(found.clock, "move")


def answer(found: RunComparison) -> str:
    """Return where two runs part, in one line."""
    if found.identical and not found.limited:
        return "the same bytes"
    choice, outcome = found.choice, found.outcome
    if choice is not None and choice.number is not None:
        return f"they part with commit {choice.number} of {_module_text(choice)}"
    if choice is not None and (outcome is None or choice.round <= outcome.round):
        return f"they part in round {choice.round}, with a choice of {_module_text(choice)}"
    if outcome is not None:
        return f"they part in round {outcome.round}, with the claim of module_{outcome.module}"
    return _no_choice(found)


def _no_choice(found: RunComparison) -> str:
    """Return the answer for runs in which nobody chose otherwise, as far as that is known."""
    if found.clock == "moves" and found.paths is not None:
        text = "no difference in what was done" if found.same else "they differ"
    elif found.move is not None and (
        found.message is None or found.move.round < found.message.round
    ):
        text = f"they part in round {found.move.round}, with a move of module_{found.move.module}"
    elif found.message is not None:
        text = f"they differ in round {found.message.round}"
    elif found.same:
        text = f"the same in {_both(found)}" if found.limited else "the same run"
    elif found.beginning is not None:
        text = _beginning(found, found.beginning)
    elif found.paths is None and found.scene is not None:
        text = found.scene
    else:
        text = f"no difference in {_both(found)}; the notes say more"
    return text


def _both(found: RunComparison) -> str:
    return "the commits that both have" if found.clock == "free" else found.compared


def _beginning(found: RunComparison, name: str) -> str:
    other = NAMES[name == "a"]
    if found.compared == NO_ROUNDS:
        return f"{name} ends before the first round, and {other} continues"
    where = "" if found.clock == "free" else f" in {found.compared}"
    return f"{name} is the beginning of {other}: the same{where}, and then {name} ends"


def _module_text(choice: ChoiceDifference) -> str:
    return f"module_{choice.module}"


def _line(name: str, text: str) -> list[str]:
    """Return a name with a text beside it, over as many lines as it takes."""
    wrapped = textwrap.wrap(text, _LINE - _NAME, break_long_words=False) or [""]
    return [f"{name if not number else '':<{_NAME}} {each}" for number, each in enumerate(wrapped)]


def _lines(name: str, texts: Iterable[str]) -> Iterator[str]:
    """Yield a name with texts beside it, each on lines that it does not share."""
    for number, text in enumerate(texts):
        yield from _line(name if not number else "", text)


def _columns(name: str, a: str, b: str) -> Iterator[str]:
    """Yield two texts beside each other."""
    one, two = (textwrap.wrap(each, _COLUMN) or [""] for each in (a, b))
    for number in range(max(len(one), len(two))):
        cells = [each[number] if number < len(each) else "" for each in (one, two)]
        yield f"{name if not number else '':<{_NAME}} {cells[0]:<{_COLUMN}}  {cells[1]}"


def _choice(choice: ChoiceDifference, found: RunComparison) -> Iterator[str]:
    where = f"{_unit(found)} {choice.round}, {_module_text(choice)}"
    if choice.number is not None:
        where = f"{_module_text(choice)}, its commit {choice.number}{_levels(choice)}"
    if choice.also:
        others = ", ".join(f"module_{each}" for each in choice.also[:6])
        more = len(choice.also) - 6
        where += f" (so do {others}{f' and {more} more' if more > 0 else ''})"
    yield from _line("first choice", where)
    a, b = choice.a, choice.b
    yield from _columns("", "a", "b")
    rows: list[tuple[str, str, str]] = [
        ("  sensed", _sensed(a), _sensed(b)),
        ("  received", _notes(a), _notes(b)),
        ("  drew", _drew(a), _drew(b)),
        ("  chose", a.chose, b.chose),
    ]
    if (a.by_rule, b.by_rule) != (a.chose, b.chose) and (a.by_rule or b.by_rule):
        by_rule = [each.by_rule or "not asked" for each in (a, b)]
        rows.append(("  by its rule", by_rule[0], by_rule[1]))
    for name, one, two in rows:
        if one or two:
            yield from _columns(name, one, "the same" if one == two else two)
    yield from _lines("  why", choice.why)


def _levels(choice: ChoiceDifference) -> str:
    """Return at which level the commit stands in each run, if it has a move."""
    levels = [
        f"at level {side.level} in {name}"
        for name, side in zip(NAMES, (choice.a, choice.b), strict=True)
        if side.level is not None
    ]
    return f", {', '.join(levels)}" if levels else ", of notes alone"


def _sensed(side: ChoiceContext) -> str:
    modules = {what: place for place, what in side.sensed.items() if what.startswith("module_")}
    others = Counter(what for what in side.sensed.values() if what not in modules)
    texts = [f"{what} at {place}" for what, place in modules.items()]
    return ", ".join([*texts, *(f"{count} {what}" for what, count in others.items())])


def _notes(side: ChoiceContext) -> str:
    return ", ".join(f"{sender}: {note}" for sender, note in side.received.items())


def _drew(side: ChoiceContext) -> str:
    drew = side.drew or ()
    text = ", ".join(f"{each:.4f}" for each in drew[:4])
    text += f" and {len(drew) - 4} more" if len(drew) > 4 else ""
    doubt = "" if side.doubt is None else f"{side.doubt:.4f} for hesitation"
    return "; ".join(filter(None, [text, doubt]))


def _outcome(outcome: OutcomeDifference) -> Iterator[str]:
    yield from _line(
        "first outcome",
        f"round {outcome.round}, module_{outcome.module} claims {outcome.claim}:"
        f" {outcome.a} in a, {outcome.b} in b",
    )
    yield from _lines("  why", outcome.why)


def _message(message: MessageDifference, found: RunComparison) -> Iterator[str]:
    module = "" if message.module is None else f" of module_{message.module}"
    yield from _line("first message", f"{_unit(found)} {message.round}, {message.kind}{module}")
    if message.a is None or message.b is None:
        for name, fields in (("a", message.a), ("b", message.b)):
            yield from _line(f"  {name}", message_text(message.kind, fields) or "has none")
    else:
        for name in message.fields:
            one, two = (
                field_text(each[name]) if name in each else "none"
                for each in (message.a, message.b)
            )
            yield from _columns(f"  {name}", one, two)


def _moves(found: RunComparison) -> Iterator[str]:
    move, unit = found.move, _unit(found)
    if move is not None:
        module = "" if move.module is None else f", module_{move.module}"
        texts = [each or "none" for each in (move.a, move.b)]
        where = (
            f"{unit} {move.round}{module}" if found.clock != "free" else module.removeprefix(", ")
        )
        yield from _line("first move", f"{where}: {texts[0]} in a, {texts[1]} in b")
    yield from _lines("states", (_apart(each, unit) for each in found.states[:_ROUNDS_MAX]))
    if len(found.states) > _ROUNDS_MAX:
        yield from _line("", f"and apart {counted(len(found.states) - _ROUNDS_MAX, 'more time')}")
    yield from _table(found.rounds, unit)
    if found.paths is not None:
        yield from _paths(found.paths)


def _apart(states: DifferingRounds, unit: str) -> str:
    begin = f"from the end of {unit} {states.begin} on" if states.begin else "from the start"
    again = f"together again after {unit} {states.end}"
    return f"apart {begin}, {'to the last compared' if states.end is None else again}"


def _table(rounds: Sequence[tuple[int, int, int, int]], unit: str) -> Iterator[str]:
    for number, (at, one, two, both) in enumerate(rounds[:_ROUNDS_MAX]):
        if not number:
            yield f"{'other moves':<{_NAME}} {unit:>6}  moves in a, in b, in both"
        bars = "=" * both + "a" * (one - both) + "b" * (two - both)
        yield f"{'':<{_NAME}} {at:>6}  {one:>4} {two:>4} {both:>4}  {bars[:_COLUMN]}"
    if len(rounds) > _ROUNDS_MAX:
        yield from _line("", f"and {counted(len(rounds) - _ROUNDS_MAX, f'more {unit}')}")


def _paths(paths: PathComparison) -> Iterator[str]:
    if paths.identical:
        yield from _line("edge paths", f"identical: {counted(paths.moves[0], 'move')}")
    else:
        yield from _line("moves", f"{paths.moves[0]} in a, {paths.moves[1]} in b")
    one, two = paths.cubes
    yield from _line("cubes", f"{one} in both" if one == two else f"{one} in a, {two} in b")
    if not paths.identical:
        yield from _line("commutation", _equal(paths.same, "equal up to moves that commute"))
        yield from _line("homotopy", _equal(paths.homotopic, "homotopic"))
        unknown = None if paths.end_unknown is None else f"not known: {paths.end_unknown}"
        yield from _line("end", unknown or paths.end or "the same state")


def _equal(difference: str | None, word: str) -> str:
    return word if difference is None else f"not {word}: {difference}"


def message_text(kind: str, fields: dict[str, Any] | None) -> str:
    """Return a message in one line, empty if there is none."""
    if fields is None:
        return ""
    inside = (
        f"{name}={field_text(value)}"
        for name, value in fields.items()
        if name not in ("kind", "round", "module")
    )
    module = f" of module_{fields['module']}" if "module" in fields else ""
    return f"{kind}{module}: {' '.join(inside)}"


def field_text(value: Any) -> str:
    """Return the value of a field as JSON."""
    return msgspec.json.encode(value).decode()
