"""Listeners of a run: functions that are called with its messages, and taps that hold them."""

from collections import deque
from collections.abc import Callable, Iterator
from functools import cache, partial
from typing import Any, TypeAlias, get_args, get_type_hints

import msgspec

from cubepath.coordinator.runs.edge_path import Gathered
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.formatting import did_you_mean
from cubepath.protocol.wire.free_messages import FREE_KINDS
from cubepath.protocol.wire.messages import KINDS

TAP_MAX = 1_000_000
"""At most this many messages wait in a tap; then the oldest are dropped, and counted."""


class TappedMessage(msgspec.Struct, frozen=True):
    """A message of a run, or a part of one: a claim comes in a `bundle`, a turn in `turns`."""

    kind: str
    round: int
    """The round, or the level."""
    message: Any
    """The message as `cubepath.protocol` has it: a `Claim`, a `Report`, a `Moved` ..."""
    wall_ns: int


@cache
def kinds_heard() -> tuple[str, ...]:
    """Return the kinds of all messages of runs, and of their parts, in alphabetical order."""
    found = {**KINDS, **FREE_KINDS}
    parts = [get_args(get_type_hints(each).get("parts", list[None]))[0] for each in found.values()]
    of_parts = {
        str(part.__struct_config__.tag)
        for each in parts
        for part in get_args(each) or (each,)
        if isinstance(part, type) and issubclass(part, msgspec.Struct)
    }
    return tuple(sorted({*found, *of_parts}))


def _check_kind(kind: object) -> None:
    known = kinds_heard()
    if not isinstance(kind, str):
        raise InputError(f"kind {kind!r}: expected the name of a kind, such as 'claim'")
    if kind not in known:
        near = did_you_mean(kind, known)
        raise InputError(f"unknown kind {kind!r}{near}, expected one of {', '.join(known)}")


class Tap:
    """What was heard since it was opened, and was not taken yet: an iterator that does not wait.

    With `kinds`, messages and parts of these kinds alone.

    >>> with start("hex:n=3", log="logs/tapped.mcap", processes=1) as run:
    ...     reports = run.tap("report")
    ...     more = run.step(2)
    ...     for heard in reports:
    ...         print(heard.round, heard.message.module, heard.message.claim)
    1 0 granted
    1 1 none
    1 2 none
    2 0 granted
    2 1 none
    2 2 none
    """

    def __init__(self, kinds: tuple[str, ...] = (), most: int = TAP_MAX) -> None:
        """Hold nothing yet; InputError if there is no such kind."""
        for kind in kinds:
            _check_kind(kind)
        self.dropped = 0
        """How many were dropped because nobody took them."""
        self._kinds = frozenset(kinds)
        self._waiting: deque[TappedMessage] = deque()
        self._most = most

    def __len__(self) -> int:
        return len(self._waiting)

    def __iter__(self) -> Iterator[TappedMessage]:
        """Take what waits, in the order in which it was heard."""
        while self._waiting:
            yield self._waiting.popleft()

    def hear(self, tapped: TappedMessage) -> None:
        """Put a message behind those that wait."""
        if self._kinds and tapped.kind not in self._kinds:
            return
        if len(self._waiting) >= self._most:
            self._waiting.popleft()
            self.dropped += 1
        self._waiting.append(tapped)


Watch: TypeAlias = Callable[[Gathered], None]
Hear: TypeAlias = Callable[[TappedMessage], None]


class Listeners:
    """The functions that are called with each message and after each round of a run.

    What they raise is remembered, so that it breaks no round, and raised after it.
    """

    def __init__(self) -> None:
        self.watches: list[Watch] = []
        self.hears: list[Hear] = []
        self._raised: BaseException | None = None

    def watch(self, gathered: Gathered) -> None:
        """Pass what was gathered to those that watch rounds."""
        for watch in tuple(self.watches):
            self._call(partial(watch, gathered))

    def hear(self, message: Any, wall_ns: int) -> None:
        """Pass a message, and then each of its parts, to those that hear messages."""
        if not self.hears:
            return
        for each in (message, *getattr(message, "parts", ())):
            kind = str(type(each).__struct_config__.tag)
            at = getattr(each, "round", getattr(each, "level", 0))
            tapped = TappedMessage(kind, at, each, wall_ns)
            for hear in tuple(self.hears):
                self._call(partial(hear, tapped))

    def _call(self, listener: Callable[[], object]) -> None:
        """Call a listener; what the first one raises is remembered.

        Interrupts, and that there is no memory left, end the run as they would anywhere in it.
        """
        try:
            listener()
        except (KeyboardInterrupt, MemoryError):
            raise
        except BaseException as raised:  # noqa: BLE001 - raised after the round, `pytest.fail` as well
            self._raised = self._raised or raised

    def raise_first(self) -> None:
        """Raise what the first listener raised that raised anything."""
        raised, self._raised = self._raised, None
        if raised is not None:
            raise raised
