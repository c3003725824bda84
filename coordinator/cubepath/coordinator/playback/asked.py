"""Orders on their way to a player, and the queryable by which they come over zenoh.

A query on ``cubepath/RUN/player/NAME`` is the order NAME, its parameters are those of the selector.
The reply is a `PlayerStatus` as JSON, or as an error reply a `Refusal`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import msgspec
import zenoh

from cubepath.coordinator.playback.orders import (
    Order,
    PlayerStatus,
    Refusal,
    player_key,
    read_order,
)


class Asked:
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
    session: zenoh.Session, run: str, enqueue: Callable[[Asked], object]
) -> zenoh.Queryable[Any]:
    """Put every order that comes over zenoh into a queue, until the queryable is undeclared."""

    def ask(query: zenoh.Query) -> None:
        enqueue(_asked(query, run))

    callback = zenoh.handlers.Callback(ask, indirect=False)
    return session.declare_queryable(f"{player_key(run)}/*", callback)


def _asked(query: zenoh.Query, run: str) -> Asked:
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

    return Asked(lambda: read_order(name, given), answer, refuse)
