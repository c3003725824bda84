"""Compiled functions: numba's `njit(cache=True)` with the types of what it is put on.

Loops over arrays that numpy alone has no words for are compiled to machine code, once for each
set of argument types; the result is kept on disk beside the module, so only the first run after
an installation waits for the compiler. Source: https://numba.readthedocs.io, "Compiling Python
code with @jit".
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from pathlib import Path
from typing import Any, ParamSpec, TypeVar, cast

from numba import njit


def _forget_stale() -> None:
    """Remove what was compiled before any module with compiled functions was last changed.

    numba looks at the module of a function alone, and would keep what calls a changed function of
    another one.
    """
    room = Path(__file__).parent
    known = sorted(room.glob("__pycache__/*.nb[ic]"))
    sources = {room / f"{kept.name.partition('.')[0]}.py" for kept in known}
    changed = max((path.stat().st_mtime for path in sources if path.exists()), default=0.0)
    for kept in known:
        with contextlib.suppress(OSError):  # gone already, or not ours to remove
            if kept.stat().st_mtime < changed:
                kept.unlink()


_forget_stale()

_Arguments = ParamSpec("_Arguments")
_Result = TypeVar("_Result")


def compiled(function: Callable[_Arguments, _Result]) -> Callable[_Arguments, _Result]:
    """Return the function compiled in nopython mode, cached on disk, with its signature kept.

    What it takes and gives are numpy arrays, numbers, booleans and tuples of these; a compiled
    function may call another. Integers are of 64 bits and wrap around without a word; nothing is
    checked against the ends of an array. Errors: numba's own ``TypingError`` at the first call
    where the body is outside what numba can compile. Where nothing can be kept on disk, because it
    is full or not ours, the function is compiled all the same, in every process anew.
    """
    try:
        found: Any = njit(cache=True)(function)
    except RuntimeError:  # numba found no folder to write to
        return cast("Callable[_Arguments, _Result]", njit(function))
    keep = found._cache.save_overload  # noqa: SLF001 - numba lets an OSError through from here

    def keep_if_possible(*arguments: Any) -> None:
        with contextlib.suppress(OSError):
            keep(*arguments)

    found._cache.save_overload = keep_if_possible  # noqa: SLF001
    return cast("Callable[_Arguments, _Result]", found)
