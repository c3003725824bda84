"""Compiled functions: numba's `njit(cache=True)`, applied once there is enough work for it.

Array loops that numpy alone cannot express are compiled to machine code, once for each set of
argument types. The result is kept on disk, beside the module or, where that is read-only, in the
user's cache folder (or the one that `NUMBA_CACHE_DIR` names), so only the first use after an
installation waits for the compiler. numba is imported when the first function is compiled or
loaded; until then the same functions do small work in plain Python, see `Compiled.for_work`.
Source: https://numba.readthedocs.io, "Compiling Python code with @jit" and "Notes on Caching".
"""

import fcntl
import inspect
import os
import time
from collections.abc import Callable, Generator, Iterator
from contextlib import ExitStack, contextmanager, suppress
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
_WAIT_S_MAX = 60.0
"""Seconds that a process waits for another one that compiles the same function."""


class Allowance:
    """How many steps this process may still make in plain Python, for all functions together.

    The first work that exceeds the rest uses it up; from then on everything runs as compiled
    code. So the time spent in plain Python never much exceeds the time to load the compiled code.
    """

    def __init__(self, left: int) -> None:
        """Allow this many steps."""
        self.left = left

    def grant(self, steps: int) -> bool:
        """Subtract `steps` from the allowance; return whether any are left."""
        self.left = max(self.left - steps, 0)
        return self.left > 0


allowance = Allowance(PLAIN_STEPS)

_files: dict[str, str] = {}
"""By module with compiled functions, the version of its file when it was imported."""
_names: dict[str, dict[str, Any]] = {}
"""By module with compiled functions, its names."""
_stamps: dict[str, str] = {}
"""By module, a hash of what its compiled functions depend on, once it was asked for."""
_plain_names: dict[str, dict[str, Any]] = {}
"""By module, its names with plain functions in place of compiled ones."""


def _stamp(module: str) -> str:
    """Return a hash of what a module's compiled functions depend on; "" if it has none."""
    if module not in _stamps:
        _stamps[module] = ""  # ends the recursion where modules import from each other
        if module in _files:
            depends = "\n".join(sorted({_files[module], *_taken(module, _names[module])}))
            _stamps[module] = sha256(depends.encode()).hexdigest()
    return _stamps[module]


def _taken(module: str, names: dict[str, Any]) -> Iterator[str]:
    """Yield, as text, all that the compiled functions of a module can take from other modules.

    That is: the stamp of each module that its names refer to, directly or by a function or a type;
    the fields of tuple types; and constants, which become part of the machine code.
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
    """Return what identifies this version of a function's file: when it changed, and its size."""
    try:
        status = Path(inspect.getfile(function)).stat()
    except (OSError, TypeError):  # in an archive, or typed in: treated as new each time
        return token_hex()
    return f"{status.st_mtime_ns} {status.st_size}"


def _plain_names_of(module: str) -> dict[str, Any]:
    """Return a module's names as its functions see them in plain Python.

    Compiled functions are replaced by plain ones, and numpy integer types by `operator.index`.
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
    """Return a memory view of an array, which plain Python reads and writes much faster."""
    if isinstance(argument, np.ndarray):
        return argument.data
    if isinstance(argument, tuple):
        make: Any = getattr(argument, "_make", tuple)
        return make(map(_view, argument))
    return argument


_UNREADABLE = (EOFError, UnpicklingError, ImportError, AttributeError)
"""What reading kept code raises if it was cut off, or names a type that has gone or moved since."""


class Compiled(Generic[_Arguments, _Result]):
    """A function that is compiled on its first call, or loaded if it was compiled before."""

    def __init__(self, function: Callable[_Arguments, _Result], *, for_python: bool = True) -> None:
        """Record the function and the current version of its file; see `compiled` and `inner`."""
        update_wrapper(self, function)
        self._for_python = for_python
        self._function = cast("FunctionType", function)
        self._dispatcher: Any = None
        self._in_python: FunctionType | None = None
        module = self._function.__module__
        _files[module], _names[module] = _file_of(self._function), self._function.__globals__
        for known in (_stamps, _plain_names):  # stale after the module was reloaded
            known.pop(module, None)

    def __call__(self, *arguments: _Arguments.args, **named: _Arguments.kwargs) -> _Result:
        """Call the compiled function; TypeError for an `inner` one."""
        if not self._for_python:
            raise TypeError(f"{self._function.__name__} can be called by compiled functions only")
        return cast("_Result", (self._dispatcher or self.dispatcher)(*arguments, **named))

    def for_work(self, steps: int, *, by_entries: bool = False) -> Callable[_Arguments, _Result]:
        """Return what to call for about `steps` steps, each a microsecond in plain Python.

        While the `allowance` of the process lasts, that is `plain` or `plain_by_entries`;
        afterwards it is the compiled function. The results are the same, and each continues from
        what the other left in the arrays.
        """
        if allowance.grant(steps):
            return self.plain_by_entries if by_entries else self.plain
        return self

    def plain(self, *arguments: _Arguments.args, **named: _Arguments.kwargs) -> _Result:
        """Call the function in plain Python: the same results, about a hundred times slower.

        Signed integers must stay within the types of the arrays that they come from; unsigned ones
        wrap around as in compiled code.
        """
        with np.errstate(over="ignore"):
            return cast("_Result", self.in_python(*arguments, **named))

    def plain_by_entries(self, *arguments: _Arguments.args, **named: _Arguments.kwargs) -> _Result:
        """Call the function in plain Python on memory views: several times as fast as `plain`.

        Integers are then Python's own. So the function must take array entries one by one, return a
        number, a boolean or nothing, and keep its integers within their types.
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

    def kept(self) -> bool:
        """Return whether compiled code of this version is on disk; imports numba."""
        with suppress(OSError, *_UNREADABLE):
            cache = self.dispatcher._cache  # noqa: SLF001 - numba has no public access to its cache
            return bool(cache._cache_file._load_index())  # noqa: SLF001
        return False

    @property
    def dispatcher(self) -> Any:
        """The dispatcher that numba makes of the function; imports numba."""
        if self._dispatcher is None:
            from numba import njit  # noqa: PLC0415 - takes longer than most work in plain Python

            if not self._for_python:
                within: Any = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}
                self._dispatcher = njit(**within)(self._function)
                return self._dispatcher
            try:
                found: Any = njit(cache=True)(self._function)
            except RuntimeError:  # numba found no folder to write to
                found = njit(self._function)
            else:
                _keep_until_a_callee_changes(found, _stamp(self._function.__module__))
                _compile_in_one_process(found)
            self._dispatcher = found
        return self._dispatcher

    @property
    def _numba_type_(self) -> Any:
        # numba asks for this where compiled code calls the function.
        return self.dispatcher._numba_type_


def _keep_until_a_callee_changes(dispatcher: Any, stamp: str) -> None:
    """Make numba's cached code valid only while everything it depends on is unchanged.

    numba checks only the file of the function itself, so it would reuse code that calls a changed
    function of another module. The stamp by which numba knows that file is therefore replaced by
    one that covers the other modules too. Code that cannot be read is compiled anew; code that
    cannot be written is not kept.
    """
    kept = dispatcher._cache  # noqa: SLF001 - numba has no public access to its cache
    kept._cache_file._source_stamp = stamp  # noqa: SLF001
    load, save = kept.load_overload, kept.save_overload

    def load_if_possible(*arguments: Any) -> Any:
        try:
            return load(*arguments)
        except OSError:  # not ours to read
            return None
        except _UNREADABLE:  # begin again
            with suppress(OSError):
                kept.flush()
            return None

    def save_if_possible(*arguments: Any) -> None:
        with suppress(OSError):  # the disk is full, or the folder is not ours any more
            save(*arguments)

    kept.load_overload, kept.save_overload = load_if_possible, save_if_possible


def _compile_in_one_process(dispatcher: Any) -> None:
    """Make other processes that need a function wait for the one that compiles it, and load it."""
    kept = dispatcher._cache  # noqa: SLF001 - numba has no public access to its cache
    lock = Path(f"{kept._cache_file._index_path}.lock")  # noqa: SLF001
    load, compile_or_load = kept.load_overload, dispatcher.compile
    held = ExitStack()

    def load_or_wait(*arguments: Any) -> Any:
        found = load(*arguments)
        if found is None:
            held.enter_context(_locked(lock))
            found = load(*arguments)
        return found

    def compile_and_release(signature: Any) -> Any:
        with held:
            return compile_or_load(signature)

    kept.load_overload, dispatcher.compile = load_or_wait, compile_and_release


@contextmanager
def _locked(path: Path) -> Generator[None]:
    """Hold the lock of a file; go without where it cannot be had, or not within `_WAIT_S_MAX`."""
    try:
        file = os.open(path, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW, 0o666)
    except OSError:
        yield
        return
    try:
        last = time.monotonic() + _WAIT_S_MAX
        while time.monotonic() < last:
            with suppress(BlockingIOError):
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
                break
            time.sleep(0.02)
        yield
    finally:
        os.close(file)


def compiled(function: Callable[_Arguments, _Result]) -> Compiled[_Arguments, _Result]:
    """Return the function compiled in nopython mode, cached on disk, with its signature kept.

    Its arguments and results are numpy arrays, numbers, booleans and tuples of them; it may call
    other compiled functions. Integers have 64 bits and wrap around silently; array bounds are not
    checked. A change to a function that it calls, to the fields of a named tuple or to a number
    from another module makes it compile anew; a change to an array or a tuple of another module
    does not, so it takes those as arguments. Raises numba's ``TypingError`` at the first call if
    the body is outside what numba can compile. If nothing can be kept on disk, because it is full
    or not ours, the function is still compiled, anew in every process.
    """
    return Compiled(function)


def inner(function: Callable[_Arguments, _Result]) -> Compiled[_Arguments, _Result]:
    """Return the function compiled for others that are compiled to call, with its signature kept.

    As `compiled`, but without what takes arguments over from Python, which for a function of many
    arrays takes the compiler as long as the function itself; and it is kept on disk as a part of
    those that call it, not on its own. A call from Python raises TypeError; `plain` works.
    """
    return Compiled(function, for_python=False)
