"""Properties of a whole session of tests: what always holds, and what must be met at least once.

They count in this process. The plugin for pytest adds up what the workers of pytest-xdist have met,
and fails the session if something was never met; so does `cubepath simulate` after its seeds.
"""

from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from traceback import extract_stack
from typing import TypeAlias

from cubepath.protocol.core.errors import InputError

Tally: TypeAlias = dict[str, tuple[str, int, bool]]
"""By text where it stands, how often it was called, and whether it was ever true."""
_tallies: list[Tally] = [{}]


def always(condition: object, what: str) -> None:
    """Raise AssertionError with this text unless the condition is true."""
    __tracebackhide__ = True
    text = _checked(what)
    if not condition:
        raise AssertionError(text)


def sometimes(condition: object, what: str) -> None:
    """Expect that the condition is true at least once in the session.

    Calls with the same text are about the same property, wherever they stand.
    """
    _note(what, met=bool(condition))


def reached(what: str) -> None:
    """Note that this line is reached, as the marker ``reaches=[what]`` of a test expects."""
    _note(what, met=True)


def _note(what: str, *, met: bool) -> None:
    known = _tallies[-1].get(_checked(what))
    if known is None:
        caller = extract_stack(limit=3)[0]
        known = f"{caller.filename}:{caller.lineno}", 0, False
    _tallies[-1][what] = known[0], known[1] + 1, known[2] or met


def _checked(what: object) -> str:
    if not isinstance(what, str):
        raise InputError(f"what={what!r}: expected a text, after the condition")
    return what


def tally() -> Tally:
    """Return what was counted."""
    return _tallies[-1]


def add(counts: Tally) -> None:
    """Add what another process has counted, or what is expected and was called 0 times."""
    for what, (where, times, met) in counts.items():
        first, before, known = tally().get(what, (where, 0, False))
        # In any order of the processes the same line is named.
        tally()[what] = min(first, where), before + times, known or met


@contextmanager
def apart() -> Generator[None]:
    """Count what happens inside apart from the rest."""
    _tallies.append({})
    try:
        yield
    finally:
        _tallies.pop()


def unmet() -> list[str]:
    """Return a line for each property that was never met: ``FILE:LINE``, its text, how often."""
    here = f"{Path.cwd()}/"
    return sorted(
        f"{where.removeprefix(here)}: '{' '.join(what.split())}' was "
        + (f"false in {times} of {times} calls" if times else "never reached")
        for what, (where, times, met) in tally().items()
        if not met
    )
