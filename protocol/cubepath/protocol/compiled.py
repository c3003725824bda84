"""Compiled functions: numba's `njit(cache=True)`, made when there is enough work for it.

Loops over arrays that numpy alone has no words for are compiled to machine code, once for each
set of argument types; the result is kept on disk, beside the module or, where that is read-only,
in the user's cache folder (`NUMBA_CACHE_DIR` names another), so only the first use after an
installation waits for the compiler. numba is imported when the first function is compiled or
loaded; until then small work is done by the same functions in plain Python, see
`Compiled.for_work`. Source: https://numba.readthedocs.io, "Compiling Python code with @jit" and
"Notes on Caching".
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterator
from contextlib import suppress
from functools import update_wrapper
from hashlib import sha256
from operator import index
from pathlib import Path
from pickle import UnpicklingError
from secrets import token_hex
from types import FunctionType, ModuleType
from typing import Any, Generic, ParamSpec, TypeVar, cast

import numpy as np

_Arguments = ParamSpec("_Arguments")
_Result = TypeVar("_Result")

PLAIN_STEPS = 300_000
"""Steps in plain Python that take about as long as importing numba and loading what is kept."""


class Allowance:
    """How many steps this process may still make in plain Python, for all functions together.

    It is used up by the first work that is too large for what is left: from then on all is compiled
    code. So what is done in plain Python never takes much longer than loading that would have.
    """

    def __init__(self, left: int) -> None:
        """Allow this many steps."""
        self.left = left

    def grant(self, steps: int) -> bool:
        """Take so many steps away; return whether more than these were left."""
        self.left = max(self.left - steps, 0)
        return self.left > 0


allowance = Allowance(PLAIN_STEPS)

_files: dict[str, str] = {}
"""By module with compiled functions, its file as it was when it was imported."""
_names: dict[str, dict[str, Any]] = {}
"""By module with compiled functions, its names."""
_stamps: dict[str, str] = {}
"""By module, what the code of its compiled functions depends on, as far as it was asked for."""
_plain_names: dict[str, dict[str, Any]] = {}
"""By module, its names with plain functions in the place of compiled ones."""


def _stamp(module: str) -> str:
    """Return what the code of a module's compiled functions depends on; "" where it has none."""
    if module not in _stamps:
        _stamps[module] = ""  # for a module that takes something from one that takes from it
        if module in _files:
            depends = "\n".join(sorted({_files[module], *_taken(module, _names[module])}))
            _stamps[module] = sha256(depends.encode()).hexdigest()
    return _stamps[module]


def _taken(module: str, names: dict[str, Any]) -> Iterator[str]:
    """Yield in words all that the compiled functions of a module can take from other modules.

    That is the stamps of the modules of which its names hold a function, a type or the module
    itself, the fields of tuple types, and constants, which become part of the machine code.
    """
    for name, value in names.items():
        if isinstance(value, ModuleType):
            yield _stamp(value.__name__)
        elif isinstance(value, (Compiled, FunctionType, type)) and value.__module__ != module:
            yield _stamp(value.__module__)
        if isinstance(value, type) and issubclass(value, tuple):
            yield f"{name}: {', '.join(inspect.get_annotations(value))}"
        elif isinstance(value, (int, float, complex, np.generic)):
            yield f"{name} = {value!r}"


def _file_of(function: FunctionType) -> str:
    """Return what tells the file of a function from how it was before and will be later."""
    try:
        status = Path(inspect.getfile(function)).stat()
    except (OSError, TypeError):  # in an archive, or typed in: as if it were new each time
        return token_hex()
    return f"{status.st_mtime_ns} {status.st_size}"


def _plain_names_of(module: str) -> dict[str, Any]:
    """Return a module's names as its functions see them in plain Python.

    Compiled functions are plain ones, and a numpy type for an index is a plain integer.
    """
    found = _plain_names.get(module)
    if found is None:
        found = _plain_names[module] = dict(_names[module])
        for name, value in _names[module].items():
            if isinstance(value, Compiled):
                found[name] = value.in_python
            elif isinstance(value, type) and issubclass(value, np.integer):
                found[name] = index
    return found


def _view(argument: Any) -> Any:
    """Return what plain Python reads and writes an array with: much faster than numpy's own."""
    if isinstance(argument, np.ndarray):
        return argument.data
    if isinstance(argument, tuple):
        make: Any = getattr(argument, "_make", tuple)
        return make(map(_view, argument))
    return argument


class Compiled(Generic[_Arguments, _Result]):
    """A function that is compiled, or loaded as it was compiled before, when it is first called."""

    def __init__(self, function: Callable[_Arguments, _Result]) -> None:
        """Take note of the function and of its file as it is now; see `compiled`."""
        update_wrapper(self, function)
        self._function = cast("FunctionType", function)
        self._dispatcher: Any = None
        self._in_python: FunctionType | None = None
        module = self._function.__module__
        _files[module], _names[module] = _file_of(self._function), self._function.__globals__
        for known in (_stamps, _plain_names):  # of the module before it was loaded again
            known.pop(module, None)

    def __call__(self, *arguments: _Arguments.args, **named: _Arguments.kwargs) -> _Result:
        """Call the compiled function."""
        return cast("_Result", (self._dispatcher or self.dispatcher)(*arguments, **named))

    def for_work(self, steps: int, *, by_entries: bool = False) -> Callable[_Arguments, _Result]:
        """Return what to call for about so many steps, of a microsecond each in plain Python.

        As long as the `allowance` of the process lasts that is `plain`, or `plain_by_entries`, then
        the compiled function. The results are the same, and both go on with what the other left in
        the arrays.
        """
        if allowance.grant(steps):
            return self.plain_by_entries if by_entries else self.plain
        return self

    def plain(self, *arguments: _Arguments.args, **named: _Arguments.kwargs) -> _Result:
        """Call the function in plain Python: the same results, some hundred times as slow.

        Signed integers must stay within the types of the arrays that they come from; unsigned ones
        wrap around as in compiled code.
        """
        with np.errstate(over="ignore"):
            return cast("_Result", self.in_python(*arguments, **named))

    def plain_by_entries(self, *arguments: _Arguments.args, **named: _Arguments.kwargs) -> _Result:
        """Call the function in plain Python on memory views: several times as fast as `plain`.

        In it integers are Python's. So the function takes the entries of arrays one by one, and
        returns a number, a boolean or nothing; and its integers stay within their types.
        """
        found = self.in_python(
            *map(_view, arguments), **{name: _view(each) for name, each in named.items()}
        )
        return cast("_Result", found)

    @property
    def in_python(self) -> FunctionType:
        """The function itself; what it calls is not compiled either."""
        if self._in_python is None:
            function = self._function
            self._in_python = FunctionType(
                function.__code__,
                _plain_names_of(function.__module__),
                function.__name__,
                function.__defaults__,
                function.__closure__,
            )
        return self._in_python

    @property
    def dispatcher(self) -> Any:
        """What numba makes of the function; imports numba."""
        if self._dispatcher is None:
            from numba import njit  # noqa: PLC0415 - takes longer than most of what is done plainly

            try:
                found: Any = njit(cache=True)(self._function)
            except RuntimeError:  # numba found no folder to write to
                found = njit(self._function)
            else:
                _keep_until_a_callee_changes(found, _stamp(self._function.__module__))
            self._dispatcher = found
        return self._dispatcher

    @property
    def _numba_type_(self) -> Any:
        # numba asks for this where compiled code calls the function.
        return self.dispatcher._numba_type_


def _keep_until_a_callee_changes(dispatcher: Any, stamp: str) -> None:
    """Have numba keep the function for as long as all that it depends on is the same.

    numba looks at the file of a function alone, and would keep what calls a changed function of
    another module. So in place of its stamp, by which it knows that file, it gets one that takes in
    those of the other modules. What is read or written badly is compiled anew.
    """
    kept = dispatcher._cache  # noqa: SLF001 - numba has no other way to what it keeps
    kept._cache_file._source_stamp = stamp  # noqa: SLF001
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


def compiled(function: Callable[_Arguments, _Result]) -> Compiled[_Arguments, _Result]:
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
    return Compiled(function)
