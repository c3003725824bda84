"""What a player is told to do, and what it answers: structs, which are JSON on the wire.

docs/replay.md specifies the keys.

Orders on their way to a player, and the queryable by which they come over zenoh.

A query on ``cubepath/RUN/player/NAME`` is the order NAME, its parameters are those of the selector.
The reply is a `PlayerStatus` as JSON, or as an error reply a `Refusal`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Literal, TypeAlias

import msgspec
import zenoh

from cubepath.coordinator.playback.timeline import read_pace, read_spot
from cubepath.protocol.core.catalogue import Json
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.formatting import did_you_mean
from cubepath.protocol.wire.keys import ROOT

Unit: TypeAlias = Literal["message", "round"]
Why: TypeAlias = Literal["from", "seek", "back", "loop"]
UNITS: tuple[Unit, ...] = ("message", "round")
COUNT_MAX = 1_000_000_000


class Play(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Play on, from where it stands."""


class Pause(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Put nothing more until told to."""


class Toggle(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Pause if it plays, and play on if it is paused."""


class StepForward(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Put the next messages, or all up to the end of a round, and pause there."""

    unit: Unit = "message"
    count: int = 1


class StepBack(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Go back by messages, or to where the round of the last message began, and pause there."""

    unit: Unit = "message"
    count: int = 1


class Seek(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Go to where a round, level or time begins: "12", "3.5s". It plays on if it did."""

    to: str


class Rate(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Play at another rate from now on: "10", "2x", "max"; or `times` as fast as before."""

    rate: str = ""
    times: float = 0.0


class Stop(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """End the replay."""


class StatusQuery(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Change nothing; answer where it stands."""


Order: TypeAlias = Play | Pause | Toggle | StepForward | StepBack | Seek | Rate | Stop | StatusQuery

ORDERS: dict[str, type[Order]] = {
    "play": Play,
    "resume": Play,
    "pause": Pause,
    "toggle": Toggle,
    "step": StepForward,
    "back": StepBack,
    "seek": Seek,
    "rate": Rate,
    "stop": Stop,
    "status": StatusQuery,
}
"""The last part of the key of each order."""


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
    ...         _ = list(session.get("cubepath/shown/player/status"))  # so it is heard by now
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
    sites: list[Json]
    modules: list[Json]


class Refusal(msgspec.Struct, frozen=True):
    """Why an order was refused, in one line."""

    error: str


def position_key(run: str) -> str:
    """Return the key on which jumps are published."""
    return f"{player_key(run)}/position"


def player_key(run: str) -> str:
    """Return the beginning of the keys of a player."""
    return f"{ROOT}/{run}/player"


def read_order(name: str, given: Mapping[str, str]) -> Order:
    """Return the order of a name with these parameters; InputError in one line if it is none.

    >>> read_order("step", {"unit": "round"}), read_order("seek", {"to": "3.5s"})
    (StepForward(unit='round', count=1), Seek(to='3.5s'))
    """
    kind = ORDERS.get(name)
    if kind is None:
        near = did_you_mean(name, ORDERS)
        raise InputError(f"unknown order {name!r}{near}, expected one of {', '.join(ORDERS)}")
    try:
        found: Order = msgspec.convert(dict(given), kind, strict=False)
    except msgspec.ValidationError as error:
        fields = ", ".join(kind.__struct_fields__) or "no parameters"
        raise InputError(f"{name}: {error}; expected {fields}") from None
    return checked(found)


def checked(order: Order) -> Order:
    """Return the order; InputError if what it says cannot be."""
    match order:
        case StepForward(unit=unit, count=count) | StepBack(unit=unit, count=count):
            known: Any = unit
            if known not in UNITS:
                raise InputError(f"unit={unit}: expected message or round")
            if isinstance(count, bool) or not 1 <= count <= COUNT_MAX:
                raise InputError(f"count={count}: expected 1 or more, and at most {COUNT_MAX}")
        case Seek(to=to):
            read_spot(to)
        case Rate(rate=rate, times=times):
            if bool(rate) == bool(times):
                raise InputError("rate: expected either rate, such as 2x, or times, such as 1.1")
            if rate:
                read_pace(rate)
            elif not 1e-6 <= times <= 1e6:
                raise InputError(f"times={times:g}: expected from 0.000001 to 1000000")
        case _:
            pass
    return order


class PendingOrder:
    """An order that waits to be carried out, and who is told what came of it."""

    def __init__(
        self,
        order: Callable[[], Order],
        answer: Callable[[PlayerStatus], object],
        refuse: Callable[[str], object],
        *,
        at_end: bool = False,
    ) -> None:
        """`order` returns the order, or raises InputError if it is none.

        It is answered by whoever plays, when it was carried out or (`at_end`) when all is played.
        """
        self.at_end = at_end
        self.order = order
        self.answer = answer
        self.refuse = refuse


def answer_queries(
    session: zenoh.Session, run: str, enqueue: Callable[[PendingOrder], object]
) -> zenoh.Queryable[Any]:
    """Put every order that comes over zenoh into a queue, until the queryable is undeclared."""

    def ask(query: zenoh.Query) -> None:
        enqueue(_asked(query, run))

    callback = zenoh.handlers.Callback(ask, indirect=False)
    return session.declare_queryable(f"{player_key(run)}/*", callback)


def _asked(query: zenoh.Query, run: str) -> PendingOrder:
    name = str(query.key_expr).rpartition("/")[2]
    told = [each.partition("=") for each in str(query.parameters).split(";") if each]
    given = {key: value for key, _, value in told}

    # A query is over when it is dropped, and these two hold it.
    def answer(status: PlayerStatus) -> None:
        query.reply(f"{player_key(run)}/{name}", msgspec.json.encode(status))
        query.drop()

    def refuse(why: str) -> None:
        query.reply_err(msgspec.json.encode(Refusal(why)))
        query.drop()

    return PendingOrder(lambda: read_order(name, given), answer, refuse)
