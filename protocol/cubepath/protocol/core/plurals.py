"""Counts of things in words."""

from __future__ import annotations


def counted(count: int, what: str) -> str:
    """Return a count with its noun.

    >>> counted(1, "cube"), counted(2, "cube")
    ('1 cube', '2 cubes')
    """
    return f"{count} {what}" if count == 1 else f"{count} {what}s"
