"""Suggestions for unknown names: the nearest known one, if any is near."""

from __future__ import annotations

from collections.abc import Iterable
from difflib import get_close_matches


def did_you_mean(word: str, known: Iterable[str]) -> str:
    """Return a hint to append to an unknown name; empty if no known name is near.

    >>> did_you_mean("hexx", ["agv", "hex"])
    " (did you mean 'hex'?)"
    >>> did_you_mean("--expl", ["--explain", "--help"])
    " (did you mean '--explain'?)"
    >>> did_you_mean("robot", ["agv", "hex"])
    ''
    """
    names = sorted(known)
    least = len("--x")
    begun = [name for name in names if len(word) >= least and name.startswith(word)]
    near = begun or get_close_matches(word, names, n=1)
    return f" (did you mean {near[0]!r}?)" if near else ""
