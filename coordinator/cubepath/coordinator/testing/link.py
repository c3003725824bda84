"""A link between one process and the router of a run, that a test can cut, slow down and falsify.

At its far end is a session that is a router, at a socket of its own, where the process connects; at
its near end a client of the router of the run, with the credentials of the process. Messages,
liveliness tokens and queries pass in both directions, each in its order, through the rules of the
link. Neither the process nor the router knows of it.
"""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Callable, Iterable
from typing import Any, Self

import zenoh

from cubepath.coordinator.testing.lane import WAITING_MAX, Lane
from cubepath.coordinator.testing.rules import Direction, Rule
from cubepath.protocol.core.errors import CheckError, InputError
from cubepath.protocol.core.output_files import new_file
from cubepath.protocol.wire.credentials import GUEST, Credentials
from cubepath.protocol.wire.messages import MESSAGE_BYTES_MAX
from cubepath.protocol.wire.sessions import open_client, open_router
from cubepath.protocol.wire.sockets import (
    PASSWORDS,
    clear,
    discard,
    is_private,
    new_endpoint,
)

ALL = "**"
_ASK_S_MAX = 60.0
_ON_LOOPBACK = "tcp/127.0.0.1:0"


class Link:
    """A link, as a context manager that takes it away.

    >>> with Link("process_0", endpoint, credentials) as link:   # doctest: +SKIP
    ...     start_the_process_at(link.endpoint)
    ...     link.add(Rule(action="drop", pattern=Pattern(kind="said"), times=3))
    """

    def __init__(self, name: str, endpoint: str, credentials: Credentials = GUEST) -> None:
        """Stand between the process of this name and the router at an endpoint.

        With a private router the process shows its own credentials to both. Otherwise the link
        listens at a port of this machine. InputError if the endpoint takes certificates.
        """
        if not isinstance(endpoint, str):  # pyright: ignore[reportUnnecessaryIsInstance]
            raise InputError(f"endpoint={endpoint!r}: expected where the router is")
        if endpoint.startswith("tls/"):
            raise InputError(
                f"endpoint {endpoint}: a link has no certificate, expected tcp/HOST:PORT"
            )
        self.name = name
        self._tokens: dict[tuple[Direction, str], zenoh.LivelinessToken | None] = {}
        """What is shown by each direction; None while it is being declared."""
        self._lock = threading.Lock()
        self._resources = contextlib.ExitStack()
        try:
            self._open(endpoint, credentials)
        except BaseException:
            self.close()
            raise

    def _open(self, endpoint: str, credentials: Credentials) -> None:
        guard: dict[str, Any] = {}
        where = _ON_LOOPBACK
        if is_private(endpoint):
            where = new_endpoint()
            self._resources.callback(discard, where)
            words = clear(where) / PASSWORDS
            named = {GUEST.name: GUEST.password, credentials.name: credentials.password}
            with new_file(words, 0o600) as file:
                file.write("".join(f"{name}:{word}\n" for name, word in named.items()).encode())
            guard["transport/auth/usrpwd/dictionary_file"] = str(words)
        near = open_client(endpoint, None, credentials=credentials)
        self._resources.callback(near.close)
        far, self.endpoint = open_router(where, guard, MESSAGE_BYTES_MAX)
        self._resources.callback(far.close)
        self.up = Lane("up", self.name, near)
        self._resources.callback(self.up.close)
        self.down = Lane("down", self.name, far)
        self._resources.callback(self.down.close)
        self._listen(near, self.down)
        self._listen(far, self.up)
        self._watch(near, far, self.down)
        self._watch(far, near, self.up)
        far.declare_queryable(ALL, _callback(lambda query: self._asked(near, query)))

    def _listen(self, session: zenoh.Session, lane: Lane) -> None:
        # What a session puts itself does not come back to it.
        session.declare_subscriber(ALL, _callback(lane.take), allowed_origin=zenoh.Locality.REMOTE)

    def _watch(self, one: zenoh.Session, other: zenoh.Session, lane: Lane) -> None:
        """Show at one end the liveliness tokens of the other."""
        back: Direction = "up" if lane.direction == "down" else "down"

        def changed(sample: zenoh.Sample) -> None:
            key, there = str(sample.key_expr), sample.kind == zenoh.SampleKind.PUT
            lane.do(lambda: show(key, there))

        def show(key: str, there: bool) -> None:  # noqa: FBT001 - as zenoh tells it
            with self._lock:
                if (back, key) in self._tokens:
                    return  # it is shown here by the other direction
                known = self._tokens.get((lane.direction, key))
                if there and known is None:
                    self._tokens[lane.direction, key] = None
                elif not there:
                    self._tokens.pop((lane.direction, key), None)
            if there and known is None:
                self._tokens[lane.direction, key] = other.liveliness().declare_token(key)
            elif known is not None and not there:
                known.undeclare()

        one.liveliness().declare_subscriber(ALL, _callback(changed), history=True)

    def _asked(self, near: zenoh.Session, query: zenoh.Query) -> None:
        """Pass a question on to the router, and each answer back."""

        def answered(reply: zenoh.Reply) -> None:
            self.down.do(lambda: _pass_on(query, reply))

        def ask() -> None:
            near.get(
                query.selector,
                _callback(answered),
                payload=query.payload,
                encoding=query.encoding,
                attachment=query.attachment,
                timeout=_ASK_S_MAX,
            )

        self.up.do(ask)

    def listens(self, key: str) -> bool:
        """Return whether the process listens to any key of an expression."""
        return self.down.listens(key)

    def add(self, rule: Rule, directions: Iterable[Direction] = ("up", "down")) -> Rule:
        """Have a rule decide on the messages of these directions from now on; return it."""
        for direction in directions:
            found = self.up if direction == "up" else self.down
            rule.on_stop(found.wake)
            found.rules = [*found.rules, rule]
        return rule

    @property
    def speaks_as(self) -> str:
        """Return the name by which the process at the far end speaks: that of its token, if any."""
        with self._lock:
            alive = [key for way, key in self._tokens if way == "up" and "/alive/" in key]
        return alive[0].rpartition("/")[2] if alive else self.name

    def clear(self) -> None:
        """Take all rules away, and heal the link; what is held back passes."""
        for lane in (self.up, self.down):
            for rule in lane.rules:
                rule.stop()
            lane.rules, lane.error, lane.broken = [], None, None
        self.heal()

    def cut(self, *, keep: bool = False) -> None:
        """Let nothing through in either direction.

        What is said meanwhile is lost, or if kept comes when the link is healed. Who is alive, and
        questions, are kept in both cases: nobody is told that the link is cut.
        """
        self.up.cut = self.down.cut = "kept" if keep else "lost"
        for lane in (self.up, self.down):
            lane.wake()

    def heal(self) -> None:
        """Let everything through again."""
        self.up.cut = self.down.cut = ""
        for lane in (self.up, self.down):
            lane.wake()

    def check(self) -> None:
        """Raise CheckError if a rule raised, or messages were lost because too many waited."""
        for lane in (self.up, self.down):
            if lane.error is not None:
                raise CheckError(
                    f"a rule of the link of {self.name} raised {lane.error!r}"
                ) from lane.error
            if lane.broken is not None:
                raise CheckError(
                    f"the link of {self.name} raised {lane.broken!r} on the way {lane.direction}"
                ) from lane.broken
            if lane.overflowed:
                raise CheckError(
                    f"the link of {self.name} lost {lane.overflowed} messages on the way"
                    f" {lane.direction}: more than {WAITING_MAX} waited"
                )

    def close(self) -> None:
        """Take the link away."""
        self._resources.close()
        self._tokens.clear()

    def __enter__(self) -> Self:
        """Return the link."""
        return self

    def __exit__(self, *_: object) -> None:
        """Take the link away."""
        self.close()


def _callback(act: Callable[[Any], object]) -> Any:
    return zenoh.handlers.Callback(act, indirect=False)


def _pass_on(query: zenoh.Query, reply: zenoh.Reply) -> None:
    if reply.ok is not None:
        query.reply(reply.ok.key_expr, reply.ok.payload, encoding=reply.ok.encoding)
    elif reply.err is not None and reply.err.payload.to_string() != "Timeout":
        query.reply_err(reply.err.payload, encoding=reply.err.encoding)
