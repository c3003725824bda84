"""Small tables of messages for the text of a failure: what was said around a place, and no more."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from cubepath.coordinator.testing.seen import Seen

ROWS_MAX = 12
"""A table has no more rows of messages."""
WHAT_MAX = 60
_LINE_MAX = 300
_TITLES = ("", "round", "phase", "kind", "from", "to", "what")


def short(text: str, most: int = _LINE_MAX) -> str:
    """Return a text in one line that is no longer than so many characters."""
    line = " ".join(text.split())
    return line if len(line) <= most else line[: most - 3] + "..."


def table(messages: Sequence[Seen], marked: Iterable[int] = (), title: str = "") -> str:
    """Return messages as a table, a line each, those at these places marked with ``>``.

    Of more than `ROWS_MAX` messages those around the first that is marked, or the last, are shown.
    """
    marks = sorted(set(marked))
    around = marks[0] if marks else len(messages) - 1
    first = max(0, min(around - ROWS_MAX // 2, len(messages) - ROWS_MAX))
    shown = range(first, min(first + ROWS_MAX, len(messages)))
    rows = [_TITLES, *(_row(messages[at], marked=at in marks) for at in shown)]
    widths = [max(len(row[column]) for row in rows) for column in range(len(_TITLES) - 1)]
    lines = [
        " ".join([*(f"{cell:<{width}}" for cell, width in zip(row, widths, strict=False)), row[-1]])
        for row in rows
    ]
    left_out = len(messages) - len(shown)
    more = [f"  ({left_out} more messages)"] if left_out else []
    head = [f"{title}:"] if title else []
    if not messages:
        return "\n".join([*head, "  no messages"])
    return "\n".join([*head, *("  " + line.rstrip() for line in lines), *more])


def _row(seen: Seen, *, marked: bool) -> tuple[str, ...]:
    number = "" if seen.round is None else str(seen.round)
    what = short(seen.what, WHAT_MAX)
    return (">" if marked else "", number, seen.phase, seen.kind, seen.sender, seen.to, what)
