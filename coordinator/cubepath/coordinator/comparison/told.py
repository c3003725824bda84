"""The answer of a comparison in words, from what differs on the whole down to one choice.

Room: coordinator.
"""

from __future__ import annotations

import textwrap
from collections.abc import Iterator, Sequence

from cubepath.coordinator.comparison.lockstep import message_text
from cubepath.coordinator.comparison.results import (
    ChoiceDifference,
    Compared,
    MessageDifference,
    OutcomeDifference,
    Paths,
    Side,
)
from cubepath.protocol.core.control_characters import visible

_COLUMN = 38
"""The width of each of the two columns."""
_NAME = 15
"""The width of the names."""
_ROUNDS_MAX = 8
"""So many rounds with other moves are shown."""
_LINE = 100


def told(found: Compared) -> str:
    """Return what differs, for people."""
    lines = [*_line("a", found.a), *_line("b", found.b)]
    for name, (one, two) in found.parameters.items():
        lines += _line(name, f"{_or_none(one)} in a, {_or_none(two)} in b")
    if found.scene is not None:
        lines += _line("scene", found.scene)
    lines += _line("compared", found.compared)
    for note in found.notes:
        lines += _line("note", note)
    lines += _line("answer", answer(found))
    if found.ends is not None:
        lines += _line("ended", f"{found.ends[0]} in a, {found.ends[1]} in b")
    outcome, choice = found.outcome, found.choice
    # What comes of claims after the first other choice is no news.
    if outcome is not None and (choice is None or outcome.round < choice.round):
        lines += ["", *_outcome(outcome)]
    if choice is not None:
        lines += ["", *_choice(choice, found)]
    if found.message is not None:
        lines += ["", *_message(found.message, found)]
    lines += ["", *_moves(found)]
    return "\n".join(visible(line.rstrip()) for line in lines)


def _or_none(value: str | None) -> str:
    return "none" if value is None else value


def _unit(found: Compared) -> str:
    return {"lockstep": "round", "free": "level"}.get(found.clock, "move")


def answer(found: Compared) -> str:
    """Return where two runs part, in one line."""
    if found.identical:
        return "the same bytes"
    if found.same:
        return "no difference in what was done" if found.clock == "moves" else "the same run"
    choice, outcome = found.choice, found.outcome
    if choice is not None and choice.number is not None:
        return f"they part with commit {choice.number} of {_who(choice)}"
    if choice is not None and (outcome is None or choice.round <= outcome.round):
        return f"they part in round {choice.round}, with a choice of {_who(choice)}"
    if outcome is not None:
        return f"they part in round {outcome.round}, with the claim of module_{outcome.module}"
    alike = found.message is None and found.clock == "lockstep"
    return "no difference as far as both go; the notes say more" if alike else "they differ"


def _who(choice: ChoiceDifference) -> str:
    return f"module_{choice.module}"


def _line(name: str, text: str) -> list[str]:
    """Return a name with a text beside it, over as many lines as it takes."""
    wrapped = textwrap.wrap(text, _LINE - _NAME, break_long_words=False) or [""]
    return [f"{name if not number else '':<{_NAME}} {each}" for number, each in enumerate(wrapped)]


def _columns(name: str, a: str, b: str) -> Iterator[str]:
    """Yield two texts beside each other."""
    one, two = (textwrap.wrap(each, _COLUMN) or [""] for each in (a, b))
    for number in range(max(len(one), len(two))):
        cells = [each[number] if number < len(each) else "" for each in (one, two)]
        yield f"{name if not number else '':<{_NAME}} {cells[0]:<{_COLUMN}}  {cells[1]}"


def _choice(choice: ChoiceDifference, found: Compared) -> Iterator[str]:
    where = f"{_unit(found)} {choice.round}, {_who(choice)}"
    if choice.number is not None:
        where += f", its commit {choice.number}"
    if choice.also:
        others = ", ".join(f"module_{each}" for each in choice.also[:6])
        more = len(choice.also) - 6
        where += f" (so do {others}{f' and {more} more' if more > 0 else ''})"
    yield from _line("first choice", where)
    a, b = choice.a, choice.b
    yield from _columns("", "a", "b")
    rows: list[tuple[str, str, str]] = [
        ("  sensed", _sensed(a), _sensed(b)),
        ("  was told", _notes(a), _notes(b)),
        ("  drew", _drew(a), _drew(b)),
        ("  chose", a.chose, b.chose),
    ]
    if (a.by_rule, b.by_rule) != (a.chose, b.chose) and (a.by_rule or b.by_rule):
        rows.append(("  by its rule", _or_none(a.by_rule), _or_none(b.by_rule)))
    for name, one, two in rows:
        if one or two:
            yield from _columns(name, one, "the same" if one == two else two)
    for number, line in enumerate(choice.why):
        yield from _line("  why" if not number else "", line)


def _sensed(side: Side) -> str:
    by_what: dict[str, list[str]] = {}
    for place, what in side.sensed.items():
        by_what.setdefault(what if what.startswith("module_") else f"\0{what}", []).append(place)
    told = [f"{what} at {places[0]}" for what, places in by_what.items() if what[0] != "\0"]
    for what, places in by_what.items():
        if what[0] == "\0":
            told.append(f"{len(places)} {what[1:]}")
    return ", ".join(told)


def _notes(side: Side) -> str:
    return ", ".join(f"{who}: {note}" for who, note in side.told.items())


def _drew(side: Side) -> str:
    told = "" if side.drew is None else ", ".join(f"{each:.4f}" for each in side.drew[:4])
    if side.drew is not None and len(side.drew) > 4:
        told += f" and {len(side.drew) - 4} more"
    if side.doubt is not None:
        told += f"{'; ' if told else ''}{side.doubt:.4f} for hesitation"
    return told


def _outcome(outcome: OutcomeDifference) -> Iterator[str]:
    yield from _line(
        "first outcome",
        f"round {outcome.round}, module_{outcome.module} claims {outcome.claim}:"
        f" {outcome.a} in a, {outcome.b} in b",
    )
    for number, line in enumerate(outcome.why):
        yield from _line("  why" if not number else "", line)


def _message(message: MessageDifference, found: Compared) -> Iterator[str]:
    who = "" if message.module is None else f" of module_{message.module}"
    yield from _line("first message", f"{_unit(found)} {message.round}, {message.kind}{who}")
    if message.a is None or message.b is None:
        for name, fields in (("a", message.a), ("b", message.b)):
            yield from _line(f"  {name}", message_text(message.kind, fields) or "has none")
    else:
        for name in message.fields:
            one, two = (str(each.get(name, "none")) for each in (message.a, message.b))
            yield from _columns(f"  {name}", one, two)
    for one, two in message.around:
        mark = " " if one == two else "<" if not two else ">" if not one else "|"
        yield f"    {mark} {one or two}"
        if mark == "|":
            yield f"      {two}"


def _moves(found: Compared) -> Iterator[str]:
    move, unit = found.move, _unit(found)
    if move is not None:
        who = "" if move.module is None else f", module_{move.module}"
        told = [each or "none" for each in (move.a, move.b)]
        yield from _line("first move", f"{unit} {move.round}{who}: {told[0]} in a, {told[1]} in b")
    for number, apart in enumerate(found.states[:_ROUNDS_MAX]):
        begin = "from the start" if not apart.begin else f"from the end of {unit} {apart.begin} on"
        end = "to the end" if apart.end is None else f"together again after {unit} {apart.end}"
        yield from _line("states" if not number else "", f"apart {begin}, {end}")
    if len(found.states) > _ROUNDS_MAX:
        yield from _line("", f"and apart {len(found.states) - _ROUNDS_MAX} times more")
    yield from _table(found.rounds, unit)
    if found.paths is not None:
        yield from _paths(found.paths)


def _table(rounds: Sequence[tuple[int, int, int, int]], unit: str) -> Iterator[str]:
    for number, (at, one, two, both) in enumerate(rounds[:_ROUNDS_MAX]):
        if not number:
            yield f"{'other moves':<{_NAME}} {unit:>6}  moves in a, in b, in both"
        bars = "=" * both + "a" * (one - both) + "b" * (two - both)
        yield f"{'':<{_NAME}} {at:>6}  {one:>4} {two:>4} {both:>4}  {bars[:_COLUMN]}"
    if len(rounds) > _ROUNDS_MAX:
        yield from _line("", f"and {len(rounds) - _ROUNDS_MAX} more {unit}s")


def _paths(paths: Paths) -> Iterator[str]:
    if paths.identical:
        yield from _line("edge paths", f"identical: {paths.moves[0]} moves")
    else:
        yield from _line("moves", f"{paths.moves[0]} in a, {paths.moves[1]} in b")
    yield from _line(
        "cubes",
        f"{paths.cubes[0]} in both"
        if paths.cubes[0] == paths.cubes[1]
        else f"{paths.cubes[0]} in a, {paths.cubes[1]} in b",
    )
    if not paths.identical:
        yield from _line("commutation", _equal(paths.same, "equal up to moves that commute"))
        yield from _line("homotopy", _equal(paths.homotopic, "homotopic"))
        yield from _line("end", paths.end or "the same state")


def _equal(difference: str | None, word: str) -> str:
    return word if difference is None else f"not {word}: {difference}"
