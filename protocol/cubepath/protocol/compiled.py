"""Compiled functions: numba's `njit(cache=True)` with the types of what it is put on.

Loops over arrays that numpy alone has no words for are compiled to machine code, once for each
set of argument types; the result is kept on disk, beside the module or, where that is read-only,
in the user's cache folder (`NUMBA_CACHE_DIR` names another), so only the first run after an
installation waits for the compiler. Source: https://numba.readthedocs.io, "Compiling Python
code with @jit" and "Notes on Caching".
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterator
from contextlib import suppress
from hashlib import sha256
from pickle import UnpicklingError
from secrets import token_hex
from types import FunctionType, ModuleType
from typing import Any, ParamSpec, TypeVar, cast

import numpy as np
from numba import njit
from numba.core.dispatcher import Dispatcher

_Arguments = ParamSpec("_Arguments")
_Result = TypeVar("_Result")

_stamps: dict[str, str] = {}
"""By module, what the code of its compiled functions depends on, as far as it is decorated."""


def _taken(module: str, names: dict[str, Any]) -> Iterator[str]:
    """Yield in words all that the compiled functions of a module can take from other modules.

    That is the stamps of the modules of which its names hold a function, a type or the module
    itself, the fields of tuple types, and constants, which become part of the machine code.
    """
    for name, value in names.items():
        if isinstance(value, ModuleType):
            yield _stamps.get(value.__name__, "")
        elif isinstance(value, (Dispatcher, FunctionType, type)) and value.__module__ != module:
            yield _stamps.get(value.__module__, "")
        if isinstance(value, type) and issubclass(value, tuple):
            yield f"{name}: {', '.join(inspect.get_annotations(value))}"
        elif isinstance(value, (int, float, complex, np.generic)):
            yield f"{name} = {value!r}"


def _keep_until_a_callee_changes(function: Any, module: str, names: dict[str, Any]) -> None:
    """Have numba keep the function for as long as all that it depends on is the same.

    numba looks at the file of a function alone, and would keep what calls a changed function of
    another module. So its stamp, by which it knows that file, is extended by those of the other
    modules: they were imported before. What is read or written badly is compiled anew.
    """
    kept = function._cache  # noqa: SLF001 - numba has no other way to what it keeps
    file = kept._cache_file  # noqa: SLF001
    depends = "\n".join(sorted({repr(file._source_stamp), *_taken(module, names)}))  # noqa: SLF001
    file._source_stamp = _stamps[module] = sha256(depends.encode()).hexdigest()  # noqa: SLF001
    load, save = kept.load_overload, kept.save_overload

    def load_if_possible(*arguments: Any) -> Any:
        try:
            return load(*arguments)
        except OSError:  # not ours to read
            return None
        except (EOFError, UnpicklingError):  # cut off: begin again
            with suppress(OSError):
                kept.flush()
            return None

    def save_if_possible(*arguments: Any) -> None:
        with suppress(OSError):  # the disk is full, or the folder is not ours any more
            save(*arguments)

    kept.load_overload, kept.save_overload = load_if_possible, save_if_possible


def compiled(function: Callable[_Arguments, _Result]) -> Callable[_Arguments, _Result]:
    """Return the function compiled in nopython mode, cached on disk, with its signature kept.

    What it takes and gives are numpy arrays, numbers, booleans and tuples of these; a compiled
    function may call another. Integers are of 64 bits and wrap around without a word; nothing is
    checked against the ends of an array. A change of what it calls, of a named tuple's fields or
    of a number from another module makes it compile anew; an array or a tuple of another module
    that changes does not, so it takes those as arguments. Errors: numba's own ``TypingError`` at
    the first call where the body is outside what numba can compile. Where nothing can be kept on
    disk, because it is full or not ours, the function is compiled all the same, in every process
    anew.
    """
    try:
        found: Any = njit(cache=True)(function)
    except RuntimeError:  # numba found no folder to write to
        _stamps[function.__module__] = token_hex()  # so what calls it is not kept either
        return cast("Callable[_Arguments, _Result]", njit(function))
    _keep_until_a_callee_changes(found, function.__module__, function.__globals__)
    return cast("Callable[_Arguments, _Result]", found)
