"""Text for messages: counts, nearest known names, and text that is safe for a terminal.

Names, ids and file names may hold any character, escape sequences and line breaks included. In text
that is safe for a terminal, control characters are shown, not obeyed.
"""

import re
from collections.abc import Iterable
from difflib import get_close_matches

_CONTROL = re.compile(r"[\x00-\x1f\x7f-\x9f]")


def visible(text: str) -> str:
    r"""Return a text as one line, each control character (C0, C1 and DEL) written as ``\xNN``.

    >>> print(visible("a\nb\x1b[31m"))
    a\x0ab\x1b[31m
    """
    return _CONTROL.sub(lambda found: f"\\x{ord(found[0]):02x}", text)


def counted(count: int, what: str) -> str:
    """Return a count with its noun.

    >>> counted(1, "cube"), counted(2, "cube")
    ('1 cube', '2 cubes')
    """
    return f"{count} {what}" if count == 1 else f"{count} {what}s"


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
