"""Compiled functions in plain Python and compiled, and the border between the two."""

from collections.abc import Generator
from contextlib import contextmanager

from cubepath.protocol.compiled import allowance

PLAIN, COMPILED = 10**9, 0


@contextmanager
def plain_steps(left: int) -> Generator[None]:
    """Let so many steps be made in plain Python, then as many as before."""
    known = allowance.left
    allowance.left = left
    try:
        yield
    finally:
        allowance.left = known
