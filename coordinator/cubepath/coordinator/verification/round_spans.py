"""Stretches of rounds in words."""

from collections.abc import Iterable, Sequence
from itertools import pairwise
from typing import TypeAlias

Span: TypeAlias = tuple[int, int]
"""Rounds without a gap, by the first and the last."""
_SHOWN = 4


def add_to_spans(spans: list[Span], number: int) -> None:
    """Add a number after all that were added before."""
    if spans and spans[-1][1] == number - 1:
        spans[-1] = spans[-1][0], number
    else:
        spans.append((number, number))


def gaps_between(spans: Sequence[Span], first: int, last: int | None) -> list[Span]:
    """Return what is missing between spans, of the numbers from `first` to `last`, None for all.

    >>> gaps_between([(1, 3), (6, 6), (8, 9)], 5, None)
    [(5, 5), (7, 7)]
    """
    found: list[Span] = []
    for (_, before), (after, _) in pairwise(spans):
        low, high = max(before + 1, first), after - 1 if last is None else min(after - 1, last)
        if low <= high:
            found.append((low, high))
    return found


def spans_text(spans: Iterable[Span]) -> str:
    """Return spans in words, the first of them.

    >>> spans_text([(1, 3), (7, 7)])
    '1 to 3, 7'
    """
    texts = [f"{low}" if low == high else f"{low} to {high}" for low, high in spans]
    return ", ".join(texts[:_SHOWN]) + (", ..." if len(texts) > _SHOWN else "")


def rounds_text(spans: Sequence[Span]) -> str:
    """Return spans of rounds in words.

    >>> rounds_text([(4, 4)]), rounds_text([(1, 3), (7, 7)])
    ('round 4', 'rounds 1 to 3, 7')
    """
    one = len(spans) == 1 and spans[0][0] == spans[0][1]
    return f"{'round' if one else 'rounds'} {spans_text(spans)}"
