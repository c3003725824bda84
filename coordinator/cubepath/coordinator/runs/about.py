"""What a run says of itself to whoever comes to listen: its parameters, scene and schedule.

A run answers queries on ``cubepath/RUN/about`` with `About` as JSON, before its processes join and
whatever it is doing, as long as its router is there; and a liveliness token on the same key tells
whether it still goes on. Whoever may listen may ask.
"""

from __future__ import annotations

import time
from collections.abc import Callable

import msgspec
import zenoh

from cubepath.protocol.core.errors import CheckError, InputError
from cubepath.protocol.recordings.description import FORMATS

_AGAIN_S = 0.1
_ASK_S = 2.0


class About(msgspec.Struct, frozen=True):
    """A run, as a recording of it begins."""

    run: str
    """Its name in keys."""
    format: str
    """The format of its recordings."""
    parameters: dict[str, str]
    scene: str
    """As TOML."""
    schedule: str | None = None
    """The schedule that is carried out, as JSON Lines."""
    round: int = 0
    """The last complete round, or the greatest level, when it was asked."""
    is_replay: bool = False
    """Whether it is a recording that is played, back and forth, and not a run that goes on."""


def about_key(run: str) -> str:
    """Return the key on which a run says what it is; ``*`` is every run at a router."""
    return f"cubepath/{run}/about"


def offer(session: zenoh.Session, tell: Callable[[], About]) -> tuple[object, object]:
    """Answer whoever asks what a run is, until the session closes, or what is returned is dropped.

    `tell` is called in a thread of zenoh.
    """
    key = about_key(tell().run)

    def reply(query: zenoh.Query) -> None:
        query.reply(key, msgspec.json.encode(tell()))

    answers = zenoh.handlers.Callback(reply, indirect=False)
    return session.declare_queryable(key, answers), session.liveliness().declare_token(key)


def find_run(session: zenoh.Session, endpoint: str, run: str | None, patience_s: float) -> About:
    """Return what the run of this name says of itself, or the one that there is at the endpoint.

    It is waited for, so many seconds. CheckError if none answers in time; InputError if several do
    and none was named, or if it is of another version.
    """
    deadline = time.monotonic() + patience_s
    while True:
        left = max(_AGAIN_S, min(_ASK_S, deadline - time.monotonic()))
        replies = session.get(about_key(run or "*"), timeout=left)
        told = (_read(each.ok) for each in replies if each.ok is not None)
        found = {each.run: each for each in told if each is not None}
        if len(found) == 1:
            return next(iter(found.values()))
        if found:
            raise InputError(
                f"{len(found)} runs are at {endpoint}: expected --run, one of"
                f" {', '.join(sorted(found))}"
            )
        if time.monotonic() >= deadline:
            which = "no run" if run is None else f"no run {run}"
            raise CheckError(f"{which} answers at {endpoint}, in {patience_s:g} s")
        time.sleep(_AGAIN_S)


def _read(sample: zenoh.Sample) -> About | None:
    """Return what a run says; None for what others may say at a router that is open to all."""
    try:
        found = msgspec.json.decode(sample.payload.to_bytes(), type=About)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError):
        return None
    if str(sample.key_expr) != about_key(found.run):
        return None
    if found.format not in FORMATS:
        expected = " or ".join(map(repr, FORMATS))
        raise InputError(f"run {found.run}: format {found.format!r}, expected {expected}")
    return found
