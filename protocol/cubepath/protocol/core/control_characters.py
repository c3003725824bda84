"""Text that is safe for a terminal: control characters are shown, not obeyed.

Names, ids and file names may hold any character, escape sequences and line breaks included.
"""

from __future__ import annotations

import re

_CONTROL = re.compile(r"[\x00-\x1f\x7f-\x9f]")


def visible(text: str) -> str:
    r"""Return a text as one line, each control character (C0, C1 and DEL) written as ``\xNN``.

    >>> print(visible("a\nb\x1b[31m"))
    a\x0ab\x1b[31m
    """
    return _CONTROL.sub(lambda found: f"\\x{ord(found[0]):02x}", text)
