"""Traps: they note and control what a rule's code uses of the process around it.

Traps stay for the life of the process, so each play has its own process. In place of the clock, the
process id and global random numbers, a rule gets what `Conditions` define: a function of the
conditions, the module and the round. So two plays differ only in what was changed between them.
Audit hooks note the rest: files, network, other processes, frames, what the collector knows.
"""

import datetime as dt
import inspect
import linecache
import os
import random
import socket
import sys
import threading
import time
import traceback
from collections.abc import Callable, Generator
from contextlib import contextmanager
from hashlib import blake2b
from pathlib import Path
from typing import Any

import numpy as np

from cubepath.agents.locality.plays import Conditions, OutsideAccess
from cubepath.agents.rules.policy import read_network

CLOCK, RANDOM, PROCESS, ENVIRONMENT = "clock", "random", "process", "environment"
FILES, NETWORK, FRAMES, MEMORY = "files", "network", "frames", "memory"

_EVENTS = {
    "open": FILES,
    "os.": FILES,
    "shutil.": FILES,
    "tempfile.": FILES,
    "glob.": FILES,
    "pathlib.": FILES,
    "mmap.": FILES,
    "sqlite3.": FILES,
    "socket.": NETWORK,
    "urllib.": NETWORK,
    "http.": NETWORK,
    "ftplib.": NETWORK,
    "smtplib.": NETWORK,
    "subprocess.": PROCESS,
    "os.fork": PROCESS,
    "os.forkpty": PROCESS,
    "os.exec": PROCESS,
    "os.posix_spawn": PROCESS,
    "os.spawn": PROCESS,
    "os.system": PROCESS,
    "os.kill": PROCESS,
    "os.putenv": ENVIRONMENT,
    "os.unsetenv": ENVIRONMENT,
    "_thread.": PROCESS,
    "signal.": PROCESS,
    "sys._getframe": FRAMES,
    "sys._getframemodulename": FRAMES,
    "sys._current_": FRAMES,
    "sys.settrace": FRAMES,
    "sys.setprofile": FRAMES,
    "gc.": MEMORY,
    "ctypes.": MEMORY,
}
"""Audit events by their beginning, the longest that fits: what kind of access they are."""
_FRAME_ATTRIBUTES = {"tb_frame", "gi_frame", "cr_frame", "ag_frame"}
_BY_FRAMES = {inspect.__file__, traceback.__file__}
"""A library may look at frames for itself; through these a rule does."""
_READS_SOURCES = {
    linecache.__file__,
    inspect.__file__,
    traceback.__file__,
    read_network.__code__.co_filename,
}
"""What reads sources may look at files; a network that was learned is as much a part of a rule."""
_CLOCKS = ("time", "monotonic", "perf_counter", "process_time", "thread_time")
_BEGAN_S = 1_900_000_000.0
_ROUND_S = 10.0
"""The clock of a play: when it begins, and how long a round takes; each reading takes 1 ms."""


def place(environment: int) -> str:
    """Return the folder that a rule is told to be in, under these conditions."""
    return "/home/elsewhere" if environment else "/home/here"


class Traps:
    """Notes what the rule's code uses; `home` are the files that are the rule's."""

    def __init__(self, conditions: Conditions, home: Callable[[str], bool]) -> None:
        """Note nothing yet; `install` sets the traps."""
        self.accesses: set[OutsideAccess] = set()
        self.home = home
        self._conditions = conditions
        self._asked: tuple[int, int] | None = None
        self._busy = False
        self._drawn = 0
        self._seed_random = random.seed
        self._seed_numpy = np.random.seed
        self._readings = 0

    @contextmanager
    def asking(self, module: int, round_number: int) -> Generator[None]:
        """Note what is used from here on; round 0 is that in which rules are made."""
        self._asked = (module, round_number)
        self._drawn = self._readings = 0
        if self._conditions.trapped:
            salt = self._number(self._conditions.random, "global")
            self._seed_random(salt)
            self._seed_numpy(salt % 2**32)
        try:
            yield
        finally:
            self._asked = None

    def install(self) -> None:
        """Set the traps in this process, unless the conditions leave it as it is."""
        if not self._conditions.trapped:
            return
        self._trap_clock()
        self._trap_random()
        self._trap_process()
        self._trap_environment()
        sys.addaudithook(self._heard)

    def _number(self, salt: int, what: str) -> int:
        """Return a 64-bit number that follows from the salt, the module and the round."""
        text = f"{salt}/{what}/{self._asked}".encode()
        return int.from_bytes(blake2b(text, digest_size=8).digest())

    def note(self, kind: str, what: str) -> None:
        """Note an access by the rule's code; one by anything else is passed over."""
        if self._asked is None or self._busy:
            return
        self._busy = True
        try:
            where = self._where(kind)
            if where is not None:
                self.accesses.add(OutsideAccess(kind, what, where))
        finally:
            self._busy = False

    def _where(self, kind: str) -> str | None:
        """Return the line of the rule's code that is being run; None if it is not to blame."""
        frame = inspect.currentframe()
        between: set[str] = set()
        while frame is not None:
            file = frame.f_code.co_filename
            if self.home(file):
                blamed = not any("importlib" in each for each in between)
                if kind == FRAMES:
                    blamed = between <= _BY_FRAMES
                elif kind in (FILES, ENVIRONMENT) and between & _READS_SOURCES:
                    blamed = False
                return f"{Path(file).name}:{frame.f_lineno}" if blamed else None
            if file != __file__:
                between.add(file)
            frame = frame.f_back
        return None

    def _heard(self, event: str, arguments: tuple[Any, ...]) -> None:
        if self._asked is None or self._busy:
            return
        if event == "object.__getattr__":
            if arguments[1] in _FRAME_ATTRIBUTES:
                self.note(FRAMES, str(arguments[1]))
            return
        begins = [start for start in _EVENTS if event.startswith(start)]
        if begins:
            self.note(_EVENTS[max(begins, key=len)], event)

    def _trapped(self, kind: str, what: str, give: Callable[..., Any]) -> Callable[..., Any]:
        def trapped(*arguments: Any, **keywords: Any) -> Any:
            self.note(kind, what)
            return give(*arguments, **keywords)

        return trapped

    def _replace(self, owner: Any, name: str, kind: str, give: Callable[..., Any] | None) -> None:
        """Put a trap in the place of a function, if there is one; by default it gives the same."""
        known = getattr(owner, name, None)
        if known is not None:
            prefix = getattr(owner, "__name__", "os.environ")
            setattr(owner, name, self._trapped(kind, f"{prefix}.{name}", give or known))

    # The clock.

    def _seconds(self) -> float:
        """Return the time of day; it continues within a round, and from round to round."""
        self._readings += 1
        number = 0 if self._asked is None else self._asked[1]
        jump = self._number(self._conditions.clock, "clock") % 7919 / 1000
        return _BEGAN_S + number * _ROUND_S + jump + self._readings / 1000

    def _trap_clock(self) -> None:
        def nanoseconds() -> int:
            return int(self._seconds() * 1e9)

        for name in _CLOCKS:
            self._replace(time, name, CLOCK, self._seconds)
            self._replace(time, f"{name}_ns", CLOCK, nanoseconds)
        self._replace(time, "clock_gettime", CLOCK, lambda _: self._seconds())
        self._replace(time, "clock_gettime_ns", CLOCK, lambda _: nanoseconds())
        for name in ("localtime", "gmtime", "ctime"):
            self._replace(time, name, CLOCK, self._by_default(getattr(time, name)))
        self._trap_dates()

    def _by_default(self, known: Callable[[float], Any]) -> Callable[..., Any]:
        def give(seconds: float | None = None) -> Any:
            return known(self._seconds() if seconds is None else seconds)

        return give

    def _trap_dates(self) -> None:
        traps = self

        class Trapped(dt.datetime):
            """A `datetime` whose present is that of the play."""

            @classmethod
            def now(cls, tz: Any = None) -> Any:
                traps.note(CLOCK, "datetime.now")
                return cls.fromtimestamp(traps._seconds(), tz)

            @classmethod
            def utcnow(cls) -> Any:
                return cls.now(dt.UTC).replace(tzinfo=None)

            @classmethod
            def today(cls) -> Any:
                return cls.now()

        class TrappedDate(dt.date):
            """A `date` whose present is that of the play."""

            @classmethod
            def today(cls) -> Any:
                return Trapped.now().date()

        dt.datetime = Trapped  # type: ignore[misc]
        dt.date = TrappedDate  # type: ignore[misc]

    # Random numbers that are not the module's own.

    def _bytes(self, count: int) -> bytes:
        found = b""
        while len(found) < count:
            self._drawn += 1
            found += self._number(self._conditions.random, f"bytes {self._drawn}").to_bytes(8)
        return found[:count]

    def _trap_random(self) -> None:
        for owner, method in ((random, random.random), (np.random, np.random.random)):
            shared = type(getattr(method, "__self__"))  # noqa: B009 - no annotation says so
            for name in dir(owner):
                if type(getattr(getattr(owner, name), "__self__", None)) is shared:
                    self._replace(owner, name, RANDOM, None)
        self._replace(np.random, "seed", RANDOM, None)
        for owner, name in ((os, "urandom"), (random, "_urandom"), (os, "getrandom")):
            self._replace(owner, name, RANDOM, lambda count, *_: self._bytes(count))
        traps, known = self, np.random.default_rng

        class Trapped(random.Random):
            """A `Random` that is noted if nothing seeds it."""

            def seed(self, a: Any = None, version: int = 2) -> None:
                if a is None:
                    traps.note(RANDOM, "random.Random without a seed")
                    a = traps._bytes(8)
                super().seed(a, version)

        def default_rng(seed: Any = None) -> np.random.Generator:
            if seed is None:
                self.note(RANDOM, "numpy.random.default_rng without a seed")
                seed = int.from_bytes(self._bytes(8))
            return known(seed)

        random.Random = Trapped  # type: ignore[misc]
        np.random.default_rng = default_rng

    # The process and what is around it.

    def _trap_process(self) -> None:
        for name in ("getpid", "getppid"):
            self._replace(os, name, PROCESS, lambda name=name: self._identity(name))
        for name in ("times", "getloadavg"):
            self._replace(os, name, PROCESS, None)
        for name in ("get_ident", "get_native_id"):
            self._replace(threading, name, PROCESS, None)

    def _identity(self, name: str) -> int:
        """Return an identity of the process; under other conditions each module has another."""
        process = self._conditions.process
        alone = self._asked[0] if self._asked is not None and process else 0
        digest = blake2b(f"{process}/{name}/{alone}".encode(), digest_size=2).digest()
        return 1000 + int.from_bytes(digest)

    def _trap_environment(self) -> None:
        for name in ("uname", "cpu_count", "getlogin"):
            self._replace(os, name, ENVIRONMENT, None)
        # Each play has its own folder; by their names two plays would differ.
        self._replace(os, "getcwd", ENVIRONMENT, lambda: place(self._conditions.environment))
        self._replace(socket, "gethostname", ENVIRONMENT, None)
        for name in ("stat", "lstat", "access"):
            self._replace(os, name, FILES, None)
        traps, known = self, type(os.environ)

        class Trapped(known):  # type: ignore[valid-type, misc]
            """An `os.environ` that notes who looks into it."""

            def __getitem__(self, key: Any) -> Any:
                traps.note(ENVIRONMENT, "os.environ")
                return super().__getitem__(key)

            def __iter__(self) -> Any:
                traps.note(ENVIRONMENT, "os.environ")
                return super().__iter__()

        os.environ.__class__ = Trapped
