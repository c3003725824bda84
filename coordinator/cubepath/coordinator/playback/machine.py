"""The player as a pure machine: time and orders come in as data, effects come out as data.

It reads the recording, knows no clock and publishes nothing: its driver tells it the time and
carries out its effects. So a test plays an hour in no time. Answers are JSON on the wire:
docs/replay.md specifies the keys.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from itertools import islice
from typing import Literal, TypeAlias

import msgspec

from cubepath.coordinator.playback.selection import PlayedMessages
from cubepath.coordinator.playback.timeline import (
    START,
    Cursor,
    PlaybackRate,
    Timeline,
    TimelinePosition,
    read_pace,
    read_spot,
)
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.options import known_name, whole_number
from cubepath.protocol.core.sites import Site
from cubepath.protocol.recordings.stored_messages import Record
from cubepath.protocol.wire.keys import ROOT

Unit: TypeAlias = Literal["message", "round"]
Why: TypeAlias = Literal["from", "seek", "back", "loop"]
UNITS: tuple[Unit, ...] = ("message", "round")
COUNT_MAX = 1_000_000_000


class Order(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What a player is to do: the name of an order, and its parameters; docs/replay.md has each."""

    name: str
    unit: str = "message"
    count: int = 1
    to: str = ""
    rate: str = ""
    times: float = 0.0


ORDERS: dict[str, tuple[str, ...]] = {
    "play": (),
    "resume": (),
    "pause": (),
    "toggle": (),
    "step": ("unit", "count"),
    "back": ("unit", "count"),
    "seek": ("to",),
    "rate": ("rate", "times"),
    "stop": (),
    "status": (),
}
"""The parameters of each order, by its name, which is the last part of its key."""


class PlayerStatus(msgspec.Struct, frozen=True):
    """Where a player stands."""

    run: str
    state: Literal["playing", "paused", "ended", "stopped"]
    """"ended" if all is played, and it waits for what comes next."""
    message: int
    """The number of the next message in the recording."""
    messages: int
    """How many messages the recording has."""
    round: int
    """The round of the next message, or its level."""
    time_s: float
    """When the next message was published, in seconds since the first one."""
    seconds: float
    """The same of the last message."""
    rate: str
    """ "10" rounds or levels a second, "2x" as fast as it was, or "max"."""
    laps: int
    """How often it has begun again."""


class Position(msgspec.Struct, frozen=True, tag_field="kind", tag="position"):
    """The position has jumped: what was put before no longer leads here.

    It is published before the first message from there. `sites` are all sites that are on, in
    order, `modules` the site of each module by its number, both at the end of round (or after
    level) `after`, the last one that was over there.

    >>> import json
    >>> from cubepath.protocol import open_client
    >>> with Player("logs/golden/hex-5.mcap", topics=["reports"], run="shown") as player:
    ...     with open_client(player.endpoint) as session:
    ...         jumps = session.declare_subscriber("cubepath/shown/player/position")
    ...         _ = list(session.get("cubepath/shown/player/status"))  # so it has been heard
    ...         _ = player.step(), player.seek("12"), player.step()
    ...         jump = json.loads(jumps.recv().payload.to_bytes())
    >>> jump["why"], jump["round"], jump["after"], jump["modules"][0]
    ('seek', 12, 11, [...])
    """

    run: str
    why: Why
    message: int
    round: int
    time_s: float
    after: int
    sites: list[Site]
    modules: list[Site]


class Refusal(msgspec.Struct, frozen=True):
    """Why an order was refused, in one line."""

    error: str


def position_key(run: str) -> str:
    """Return the key on which jumps are published."""
    return f"{player_key(run)}/position"


def player_key(run: str) -> str:
    """Return the beginning of the keys of a player."""
    return f"{ROOT}/{run}/player"


def read_order(name: str, given: Mapping[str, object]) -> Order:
    """Return the order of a name with these parameters; InputError in one line if it is none.

    >>> read_order("step", {"unit": "round"}).count, read_order("seek", {"to": "3.5s"}).to
    (1, '3.5s')
    """
    known_name("order ", name, ORDERS)
    for key in given:
        known_name(f"{name}: ", key, ORDERS[name])
    try:
        order = msgspec.convert({"name": name, **given}, Order, strict=False)
    except msgspec.ValidationError as error:
        raise InputError(f"{name}: {error}") from None
    if name in {"step", "back"}:
        known_name("unit=", order.unit, UNITS)
        whole_number("count", order.count, 1, COUNT_MAX)
    elif name == "seek":
        read_spot(order.to)
    elif name == "rate":
        if bool(order.rate) == bool(order.times):
            raise InputError("rate: expected either rate, such as 2x, or times, such as 1.1")
        if order.rate:
            read_pace(order.rate)
        elif not 1e-6 <= order.times <= 1e6:
            raise InputError(f"times={order.times:g}: expected from 0.000001 to 1000000")
    return order


class PendingOrder:
    """An order that waits to be carried out, and who receives its result."""

    def __init__(
        self,
        order: Order,
        answer: Callable[[PlayerStatus], object],
        refuse: Callable[[str], object] = lambda _: None,
        *,
        at_end: bool = False,
    ) -> None:
        """The player answers it when it was carried out or (`at_end`) when all is played."""
        self.at_end = at_end
        self.order = order
        self.answer = answer
        self.refuse = refuse


_BEFORE_MAX = 10.0
"""What is slower than as fast as possible, by default: rounds a second."""


@dataclass(frozen=True, slots=True)
class PutMessage:
    """Put this message now."""

    record: Record
    mark: Cursor


@dataclass(frozen=True, slots=True)
class PositionJump:
    """Say that the position has jumped."""

    why: Why


@dataclass(frozen=True, slots=True)
class WaitForOrder:
    """Do nothing until an order comes, or until it is so late, in seconds of the caller's clock."""

    until: float | None = None


@dataclass(frozen=True, slots=True)
class PlaybackEnd:
    """All is played; it continues if an order says so."""


Deed: TypeAlias = PutMessage | PositionJump | WaitForOrder | PlaybackEnd


class Machine:
    """A player: `order` tells it what to do, and `next` what is to be done now.

    >>> reel = Timeline(read_recording("logs/golden/hex-5.mcap"))
    >>> machine = Machine(reel, PlayedMessages(reel.recording), pace=PlaybackRate(2))
    >>> kinds = []
    >>> while not isinstance(deed := machine.next(100.0), WaitForOrder):
    ...     kinds.append(deed.record.kind)
    >>> len(kinds), deed  # the second round begins half a second later
    (12, WaitForOrder(until=100.5))
    """

    def __init__(
        self,
        reel: Timeline,
        selection: PlayedMessages,
        *,
        pace: PlaybackRate | None = None,
        begin: TimelinePosition | None = None,
        until: TimelinePosition | None = None,
        loop: bool = False,
        paused: bool = False,
        max_gap_s: float | None = None,
    ) -> None:
        """Stand at `begin`, and end after `until`; InputError if nothing lies in between."""
        self.reel = reel
        self.selection = selection
        self.pace = PlaybackRate() if pace is None else pace
        self.begin = reel.settled(START) if begin is None else reel.find(begin)
        self.end = reel.end if until is None else reel.find(until, after=True)
        self.mark = self.begin
        if begin is not None or until is not None:
            self._check_ends(begin, until)
        self.loop = loop
        self.paused = paused
        self.stopped = False
        self.laps = 0
        self._jump: Why | None = "from" if begin is not None else None
        self._max_gap_s = max_gap_s
        self._anchor: tuple[float, float] | None = None
        """When it played which beat; None before the next message is due at once."""
        self._last_due = 0.0
        """When the last message since then was due, or when it began to play."""
        self._held: float | None = None
        """The beat at which it was paused."""
        self._burst: int | Cursor | None = None
        """How many messages, or up to where, it puts at once although it is paused."""
        self._put_in_lap = False

    def _check_ends(self, begin: TimelinePosition | None, until: TimelinePosition | None) -> None:
        """Raise InputError if nothing is played from one place until the other."""
        reel = self.reel
        spans = [f"{name} {at}" for name, at in (("from", begin), ("until", until)) if at]
        where = " ".join(spans)
        if begin is not None and until is not None and begin.comes_after(until):
            raise InputError(f"{where}: expected a range upwards")
        last = TimelinePosition(step=reel.step_at(reel.end)), TimelinePosition(seconds=reel.seconds)
        if until is not None and any(until.comes_after(each) for each in last):
            raise InputError(
                f"until {until}: not on record, which ends with {self._name} {last[0]} after"
                f" {reel.seconds:.3f} s"
            )
        if self.ended:
            what = "nothing is" if self.begin >= self.end else "nothing that is played is"
            raise InputError(
                f"{where}: {what} on record there; it goes from {self._name} {reel.step_at(START)}"
                f" to {last[0]} and lasts {reel.seconds:.3f} s"
            )
        self.mark = self.begin

    @property
    def _name(self) -> str:
        return "level" if self.reel.recording.clock == "free" else "round"

    @property
    def busy(self) -> bool:
        """Whether it carries out a step, or is about to say that it has jumped."""
        return not self.stopped and (self._burst is not None or self._jump is not None)

    @property
    def ended(self) -> bool:
        """Whether nothing is left to play."""
        return self._following() is None

    def _following(self) -> tuple[Cursor, Record] | None:
        """Go to the next message that is played, and return it; None at the end."""
        takes, kinds = self.selection.takes, self.selection.kinds
        found = self.reel.next(self.mark, kinds)
        while found is not None and found[0] < self.end:
            mark, record = found
            if takes(record):
                self.mark = mark
                return found
            found = self.reel.next(Cursor(mark.chunk, mark.place + 1), kinds)
        self.mark = max(self.mark, self.end)
        return None

    # What is to be done.

    def next(self, now: float) -> Deed:
        """Return what is to be done at a time, in seconds of a clock that never goes back."""
        if self._jump is not None and not self.stopped:
            why, self._jump = self._jump, None
            return PositionJump(why)
        following = None if self.stopped else self._following()
        if self._takes_step(following is None):
            return self._put(following)
        if following is None:
            if self.stopped or self.paused or not (self.loop and self._put_in_lap):
                return PlaybackEnd()
            self._go(self.begin, "loop")
            self.laps += 1
            return self.next(now)
        due = self._due(following[1], now)
        if due is None or due > now:
            return WaitForOrder(due)
        self._last_due = due
        return self._put(following)

    def _takes_step(self, at_end: bool) -> bool:  # noqa: FBT001 - the one thing that it is told
        """Return whether the next message is part of a step; a step that is done is forgotten."""
        left = self._burst
        if left is None:
            return False
        if at_end or (left <= 0 if isinstance(left, int) else self.mark >= left):
            self._burst = None
            return False
        if isinstance(left, int):
            self._burst = left - 1
        return True

    def _put(self, following: tuple[Cursor, Record] | None) -> PutMessage:
        if following is None:
            raise AssertionError("nothing to put")  # the caller has looked
        mark, record = following
        self.mark = Cursor(mark.chunk, mark.place + 1)
        self._put_in_lap = True
        return PutMessage(record, mark)

    def _beat(self, record: Record) -> float:
        if self.pace.by == "clock":
            return self.reel.time_of(record)
        return record.round if not self.reel.by_wall else self.reel.step_at(self.mark)

    def _due(self, record: Record, now: float) -> float | None:
        """Return when to put a message; None if not before an order comes."""
        rate = self.pace.rate
        if self.paused:
            return None
        if rate is None:
            return now
        beat = self._beat(record)
        if self._anchor is None:
            self._anchor = now, beat if self._held is None else min(self._held, beat)
            self._held = None
            self._last_due = now
        at, played = self._anchor
        due = at + (beat - played) / rate
        if self._max_gap_s is not None and due > self._last_due + self._max_gap_s:
            latest = self._last_due + self._max_gap_s
            self._anchor = at - (due - latest), played
            due = latest
        return due

    # Orders.

    def order(self, order: Order, now: float) -> None:
        """Do what an order says; InputError, and nothing is changed, if that cannot be."""
        match order.name:
            case "play" | "resume":
                self._resume()
            case "pause":
                self._pause(now)
            case "toggle":
                self._resume() if self.paused else self._pause(now)
            case "step":
                self._pause(now)
                self._held = None
                self._step(order.unit, order.count)
            case "back":
                self._pause(now)
                self._back(order.unit, order.count)
            case "seek":
                self._go(self._within(read_spot(order.to)), "seek")
            case "rate":
                self._change(order.rate, order.times, now)
            case _:
                self.stopped = self.stopped or order.name == "stop"

    def _pause(self, now: float) -> None:
        if self._anchor is not None and self.pace.rate is not None and not self.paused:
            at, played = self._anchor
            self._held = played + (now - at) * self.pace.rate
        self.paused = True
        self._anchor = self._burst = None

    def _resume(self) -> None:
        self.paused = False
        self._burst = None

    def _change(self, rate: str, times: float, now: float) -> None:
        new = read_pace(rate, by_wall=self.reel.by_wall) if rate else self._faster(times)
        if new.by == self.pace.by and self._anchor is not None and self.pace.rate is not None:
            at, played = self._anchor
            self._anchor = now, played + (now - at) * self.pace.rate
        else:
            self._anchor = self._held = None
        self.pace = new

    def _faster(self, times: float) -> PlaybackRate:
        if self.pace.rate is None and times < 1:
            return PlaybackRate(1, "clock") if self.reel.by_wall else PlaybackRate(_BEFORE_MAX)
        return self.pace.times(times)

    def _go(self, mark: Cursor, why: Why) -> None:
        self.mark = mark
        self._jump = why
        self._anchor = self._held = self._burst = None
        self._put_in_lap = False

    def _within(self, spot: TimelinePosition) -> Cursor:
        """Return where a place is, which must lie between the ends of what is played."""
        found = self.reel.find(spot)
        if found == self.reel.end and spot != TimelinePosition(step=self.reel.step_at(found)):
            raise InputError(
                f"to {spot}: not on record, which ends with {self._name}"
                f" {self.reel.step_at(found)} after {self.reel.seconds:.3f} s"
            )
        if not self.begin <= found <= self.end:
            raise InputError(f"to {spot}: not in the part that is played (--from, --until)")
        return found

    def _step(self, unit: str, count: int) -> None:
        if unit == "message":
            self._burst = count
        elif (following := self._following()) is not None:
            step = self.reel.step_at(following[0])
            mark, _ = following
            after = Cursor(mark.chunk, mark.place + 1)
            self._burst = max(
                self.reel.find(TimelinePosition(step=step + count - 1), after=True), after
            )

    def _back(self, unit: str, count: int) -> None:
        mark = self.mark
        if unit == "message":
            for where in islice(self._before(mark), count):
                mark = where
        else:
            for _ in range(count):
                last = next(self._before(mark), None)
                if last is None:
                    break
                begins = self.reel.find(TimelinePosition(step=self.reel.step_at(last)))
                mark = max(min(begins, last), self.begin)
        self._go(mark, "back")

    def _before(self, mark: Cursor) -> Iterator[Cursor]:
        """Yield where the messages stand that are played before a mark, the last one first."""
        for where, record in self.reel.backward(mark, self.selection.kinds):
            if where < self.begin:
                return
            if self.selection.takes(record):
                yield where
