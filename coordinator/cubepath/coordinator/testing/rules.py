"""Rules of a faulty network: which messages are lost, late, duplicated, held back or overtaken.

Where possible a rule does not depend on the time of arrival: with a probability, the bytes of a
message and the seed decide, so every run loses the same messages.
"""

import threading
import time
from collections import OrderedDict, deque
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import lru_cache
from hashlib import blake2b
from typing import Literal, TypeAlias, get_args

import zenoh

from cubepath.coordinator.testing.wire_messages import KNOWN, WireMessage
from cubepath.protocol.core.errors import CheckError, InputError
from cubepath.protocol.core.options import known_name, real_number, seconds, whole_number
from cubepath.protocol.wire.keys import topic_in_key

Action: TypeAlias = Literal["drop", "delay", "double", "hold", "reorder"]
Direction: TypeAlias = Literal["up", "down"]
"""From the process to the router, or from the router to the process."""
PHASES = ("join", "sense", "observe", "claim", "settle", "over", "stop")
"""The phases of runs with rounds, in order."""
SECONDS_MAX = 3600.0
"""No time that a test gives is longer."""
KEPT = 1000
"""The number of last messages that a rule remembers."""
COPIES_MAX = 1 << 18
"""Of this many messages that came last it remembers how often they came, where chance decides."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Pattern:
    """Which messages are meant: all of what is given must hold; None and empty stand for any.

    `kind` is that of the message or of one of its parts, and then `module` is of such a part.
    `sender` and `to` are names such as ``process_0``, ``keeper_1``, ``coordinator``; `to` may also
    be a region or a tile. `round` is the round, or without rounds the level. `key` is a key
    expression of zenoh, as ``robot/*/pose`` or ``robot/**``. `where` is asked last.
    """

    kind: str | None = None
    round: int | range | None = None
    phase: str | None = None
    module: int | None = None
    sender: str | None = None
    to: str | None = None
    key: str | None = None
    where: Callable[[WireMessage], bool] | None = None

    def __post_init__(self) -> None:
        """Check what is given; InputError tells what was expected, with the nearest name."""
        if self.kind is not None and self.kind not in KNOWN:
            known_name("kind=", self.kind, sorted(KNOWN))
        if self.phase is not None:
            known_name("phase=", self.phase, PHASES)
        if self.round is not None and not isinstance(self.round, range):
            whole_number("round", self.round, 0)
        if self.module is not None:
            whole_number("module", self.module, 0)
        for name, process in (("sender", self.sender), ("to", self.to)):
            sound = process is None or isinstance(process, str)  # pyright: ignore[reportUnnecessaryIsInstance]
            if not sound or process == "":
                raise InputError(f"{name}={process!r}: expected a name, as process_0")
        if self.key is not None:
            _key_expression(self.key)
        if not (self.where is None or callable(self.where)):
            raise InputError(f"where={self.where!r}: expected a function of a message")

    def holds(self, seen: WireMessage, receiver: str = "") -> bool:
        """Return whether a message is meant; on its way down a link it has a `receiver`."""
        return (
            # One that is put to a process is another message than the one that was put.
            (seen.link is None or bool(receiver) or seen.down == (self.to is not None))
            and (self.key is None or _key_expression(self.key).intersects(seen.key))
            and (self.sender is None or self.sender == seen.sender)
            and (self.to is None or self.to in (receiver, seen.to))
            and self._round(seen)
            and (self.phase is None or self.phase == seen.phase)
            and self._parts(seen)
            and (self.where is None or self.where(seen))
        )

    def _round(self, seen: WireMessage) -> bool:
        if self.round is None:
            return True
        return seen.round in (self.round if isinstance(self.round, range) else [self.round])

    def _parts(self, seen: WireMessage) -> bool:
        kind, module = self.kind, self.module
        whole = kind is None or kind == seen.kind
        if whole and module is None:
            return True
        return any((whole or kind == one) and module in (None, about) for one, about in seen.parts)

    def __str__(self) -> str:
        """Return what is given, as ``kind=bundle, round=3``."""
        given = {name: getattr(self, name) for name in self.__slots__}
        if self.where is not None:  # whatever it is, in one line
            given["where"] = getattr(self.where, "__name__", type(self.where).__name__)
        conditions = (f"{name}={value}" for name, value in given.items() if value is not None)
        return ", ".join(conditions) or "any message"


@lru_cache(maxsize=1024)
def _key_expression(text: str) -> zenoh.KeyExpr:
    """Return a key expression; InputError if it is none."""
    try:
        return zenoh.KeyExpr(text)
    except (zenoh.ZError, TypeError):
        raise InputError(
            f"key={text!r}: expected a key expression of zenoh, as 'robot/*/pose' or 'robot/**'"
        ) from None


ANYTHING = Pattern()
"""Any message."""


@dataclass(slots=True, kw_only=True, eq=False, repr=False)
class Rule:
    """What happens to the messages that a pattern means; made by `drop`, `delay` and their kin.

    It passes over the first `after` of them, then meets `times` of them at most, each with a
    `probability`. `seconds` are by how much a message is late, or its second copy; a rule that
    holds messages back stops this long after the first of them, with 0 never. `by` is how many
    later ones overtake a message.
    """

    action: Action
    pattern: Pattern = ANYTHING
    times: int | None = None
    after: int = 0
    probability: float = 1.0
    seed: int = 0
    seconds: float = 0.0
    by: int = 1
    overtaken: bool = False
    """Whether later messages overtake one that is delayed; otherwise they wait behind it."""
    upstream: frozenset[str] = frozenset()
    """Senders whose messages it meets at their source, and ignores on their way down."""
    count: int = 0
    """How many messages it met so far."""
    met: deque[WireMessage] = field(default_factory=lambda: deque(maxlen=KEPT))
    """The last of these."""
    on: bool = True
    _meant: int = field(default=0, init=False)
    _until: float | None = field(default=None, init=False)
    _copies: OrderedDict[bytes, int] = field(init=False, default_factory=OrderedDict)
    _changed: threading.Condition = field(init=False, default_factory=threading.Condition)
    _wake: list[Callable[[], None]] = field(init=False, default_factory=list)

    def __post_init__(self) -> None:
        """Check the numbers; InputError names the one that is out of bounds."""
        known_name("action=", self.action, get_args(Action))
        if not isinstance(self.pattern, Pattern):  # pyright: ignore[reportUnnecessaryIsInstance]
            raise InputError(f"pattern={self.pattern!r}: expected a Pattern")
        whole_number("seed", self.seed)
        if self.times is not None:
            whole_number("times", self.times, 1)
        whole_number("after", self.after, 0)
        if not 0.0 < real_number("probability", self.probability) <= 1.0:
            raise InputError(f"probability={self.probability}: expected more than 0, at most 1")
        seconds("seconds", self.seconds, SECONDS_MAX)
        whole_number("by", self.by, 1)

    def meets(self, seen: WireMessage, receiver: str = "") -> bool:
        """Return whether it meets a message that comes by, and count it."""
        if not self.on or (receiver and seen.sender in self.upstream):
            return False
        if not self.pattern.holds(seen, receiver):
            return False
        with self._changed:
            if self.times is not None and self.count >= self.times:
                return False
            self._meant += 1
            if self._meant <= self.after or not self._drawn(seen, receiver):
                return False
            self.count += 1
            self.met.append(seen)
            if self.action == "hold" and self.seconds and self._until is None:
                self._until = time.monotonic() + self.seconds
            self._changed.notify_all()
        return True

    def _drawn(self, seen: WireMessage, receiver: str) -> bool:
        """Return whether chance meets it: by its bytes, how often they came, and the seed."""
        if self.probability == 1.0:
            return True
        topic = topic_in_key(seen.key) if seen.link is None else seen.key
        what = blake2b(f"{receiver} {topic} ".encode() + seen.data, digest_size=8).digest()
        copy = self._copies[what] = self._copies.pop(what, 0) + 1
        if len(self._copies) > COPIES_MAX:
            self._copies.popitem(last=False)
        draw = blake2b(f"{self.seed}/{copy}/".encode() + what, digest_size=8).digest()
        return int.from_bytes(draw) < self.probability * (1 << 64)

    def stop(self) -> None:
        """Meet no more messages; what is held back passes."""
        self.on = False
        for wake in self._wake:
            wake()

    release = stop

    @property
    def until(self) -> float | None:
        """Return when it stops by itself, in monotonic seconds; None if it does not."""
        return self._until if self.on else None

    def on_stop(self, wake: Callable[[], None]) -> None:
        """Have this called when the rule stops; for links."""
        self._wake.append(wake)

    def wait(self, times: int = 1, timeout_s: float = 30.0) -> None:
        """Wait until it has met this many messages; CheckError if it does not within the time."""
        whole_number("times", times, 0)
        deadline = time.monotonic() + seconds("timeout_s", timeout_s, SECONDS_MAX)
        with self._changed:
            while self.count < times:
                if not self._changed.wait(max(0.0, deadline - time.monotonic())):
                    raise CheckError(
                        f"{self}: met {self.count} messages within {timeout_s:g} s, expected"
                        f" {times}; {self._meant} were meant"
                    )

    def __str__(self) -> str:
        return f"{self.action} {self.pattern}"

    def __repr__(self) -> str:
        """Return what it does to which messages, and how many it met."""
        return f"<{self}: met {self.count}{'' if self.on else ', stopped'}>"


@dataclass(slots=True)
class Fate:
    """What the rules together do to one message."""

    dropped: bool = False
    late_s: float = 0.0
    overtaken: bool = False
    copies: list[float] = field(default_factory=list)
    """By how much each further copy is later."""
    holder: Rule | None = None
    behind: int = 0


def fate_of(rules: list[Rule], seen: WireMessage, receiver: str = "") -> Fate | None:
    """Return what the rules that meet a message do to it; None if none meets it.

    They are asked in their order, and none after one that drops it.
    """
    fate: Fate | None = None
    for rule in rules:
        if not rule.meets(seen, receiver):
            continue
        fate = fate or Fate()
        match rule.action:
            case "drop":
                fate.dropped = True
                return fate
            case "delay":
                fate.late_s += rule.seconds
                fate.overtaken |= rule.overtaken
            case "double":
                fate.copies.append(rule.seconds)
            case "hold":
                fate.holder = fate.holder or rule
            case "reorder":
                fate.behind += rule.by
    return fate
