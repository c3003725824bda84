"""Asking a run for its status, description or moves over zenoh: every guest may ask.

A run answers queries on ``cubepath/RUN/state`` with its `Status` as JSON: the status after the last
complete round, so it answers immediately whatever the run is doing. A run without rounds also
answers on ``cubepath/RUN/path?from=N`` with its moves from the N-th on, counted from 0, in an order
in which they could have been made.

On ``cubepath/RUN/about`` it answers with `RunInfo` as JSON: its parameters, scene and schedule. It
does so before its processes join and as long as its router runs; a liveliness token on the same key
shows whether the run is still under way.
"""

import re
import time
from collections.abc import Callable, Sequence
from typing import TypeAlias

import msgspec
import zenoh
from msgspec.structs import replace

from cubepath.protocol.core.errors import CheckError, CubepathError, InputError
from cubepath.protocol.core.options import seconds
from cubepath.protocol.core.sites import Site, site_hook
from cubepath.protocol.recordings.description import FORMATS
from cubepath.protocol.wire.credentials import GUEST, Credentials
from cubepath.protocol.wire.sessions import open_client

_AGAIN_S = 0.1
_ASK_S = 2.0


class RunInfo(msgspec.Struct, frozen=True):
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
    """Whether it is a recording that is played, back and forth, and not a run that continues."""


def about_key(run: str) -> str:
    """Return the key on which a run says what it is; ``*`` is every run at a router."""
    return f"cubepath/{run}/about"


def offer(session: zenoh.Session, tell: Callable[[], RunInfo]) -> tuple[object, object]:
    """Answer queries about a run, until the session closes, or what is returned is dropped.

    `tell` is called in a thread of zenoh.
    """
    key = about_key(tell().run)

    def reply(query: zenoh.Query) -> None:
        query.reply(key, msgspec.json.encode(tell()))

    answers = zenoh.handlers.Callback(reply, indirect=False)
    return session.declare_queryable(key, answers), session.liveliness().declare_token(key)


def find_run(session: zenoh.Session, endpoint: str, run: str | None, patience_s: float) -> RunInfo:
    """Return what the run of this name says of itself, or the one that there is at the endpoint.

    It is waited for, this many seconds. CheckError if none answers in time; InputError if several
    do and none was named, or if it is of another version.
    """
    deadline = time.monotonic() + patience_s
    while True:
        left = max(_AGAIN_S, min(_ASK_S, deadline - time.monotonic()))
        replies = session.get(about_key(run or "*"), timeout=left)
        answers = (_read_about(each.ok) for each in replies if each.ok is not None)
        found = {each.run: each for each in answers if each is not None}
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


def _read_about(sample: zenoh.Sample) -> RunInfo | None:
    """Return what a run says; None for what others may say at a router that is open to all."""
    try:
        found = msgspec.json.decode(sample.payload.to_bytes(), type=RunInfo)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError):
        return None
    if str(sample.key_expr) != about_key(found.run):
        return None
    if found.format not in FORMATS:
        expected = " or ".join(map(repr, FORMATS))
        raise InputError(f"run {found.run}: format {found.format!r}, expected {expected}")
    return found


_FROM = re.compile(r"from=([0-9]{1,15})")


class Status(msgspec.Struct, frozen=True):
    """Where a run stands."""

    round: int
    """The last complete round, or the greatest level."""
    sites: tuple[Site, ...]
    """Where each module stands."""
    moves: int
    cubes: int
    """How many cubes the normal cube path has so far."""
    goal_reached: bool
    ended: str | None
    """How the run has ended, None if it continues."""


class Released(msgspec.Struct, frozen=True, array_like=True):
    """A move of a run without rounds, with its level."""

    level: int
    generator: str
    at: Site


Release: TypeAlias = Callable[[int, int], Sequence[tuple[int, str, Site]]]
"""Returns the moves from a place on, this many at most; called in any thread."""
MOVES_MAX = 10_000
"""At most this many moves are answered at one time."""


class _Answer(msgspec.Struct, frozen=True):
    run: str
    round: int
    sites: list[Site]
    moves: int
    cubes: int
    goal_reached: bool


def state_key(run: str) -> str:
    """Return the key on which a run answers; ``*`` is every run at a router."""
    return f"cubepath/{run}/state"


def path_key(run: str) -> str:
    """Return the key on which a run without rounds answers with its moves."""
    return f"cubepath/{run}/path"


class Answers:
    """What a run answers, until it is closed."""

    def __init__(
        self,
        endpoint: str,
        credentials: Credentials,
        status: Status,
        about: RunInfo,
        release: Release | None = None,
    ) -> None:
        """Open a session as the coordinator, and answer from now on."""
        run = self._run = about.run
        self._about = about
        self._status = status
        self._release = release
        self._session = open_client(endpoint, None, credentials=credentials)
        try:
            self._queryable = self._session.declare_queryable(
                state_key(run), zenoh.handlers.Callback(self._answer, indirect=False)
            )
            if release is not None:
                self._queryable_path = self._session.declare_queryable(
                    path_key(run), zenoh.handlers.Callback(self._answer_path, indirect=False)
                )
            self._offered = offer(self._session, self._tell)
        except BaseException as error:
            self._session.close()
            if isinstance(error, zenoh.ZError):  # the router may just have gone
                raise CubepathError(
                    f"no client can query the run at {endpoint}: {error}"
                ) from error
            raise

    def set(self, status: Status) -> None:
        """Answer this from now on."""
        self._status = status

    def _answer(self, query: zenoh.Query) -> None:
        # In a thread of zenoh; the status is never changed, only replaced.
        now = self._status
        sites = list(now.sites)
        answer = _Answer(self._run, now.round, sites, now.moves, now.cubes, now.goal_reached)
        query.reply(state_key(self._run), msgspec.json.encode(answer))

    def _answer_path(self, query: zenoh.Query) -> None:
        asked = _FROM.fullmatch(str(query.parameters))
        if self._release is None or asked is None:
            query.reply_err(b"expected from=N")
            return
        found = self._release(int(asked[1]), MOVES_MAX)
        query.reply(path_key(self._run), msgspec.json.encode(found))

    def _tell(self) -> RunInfo:
        return replace(self._about, round=self._status.round)

    def close(self) -> None:
        """Answer no more, and close the session."""
        self._session.close()


def ask(
    endpoint: str,
    run: str | None = None,
    *,
    credentials: Credentials = GUEST,
    timeout_s: float = 10.0,
) -> Status:
    """Ask a run how it stands: the one of this name, or the one that there is at the endpoint.

    CheckError if none answers in time, or several do and none was named; CubepathError if there is
    no router at the endpoint.

    >>> with start("hex:n=4", processes=2, log="logs/asked.mcap") as running:
    ...     running.step(5)
    ...     status = ask(running.endpoint)
    True
    >>> status.round, status.sites == running.sites
    (5, True)
    """
    timeout_s = seconds("timeout_s", timeout_s)
    if not isinstance(endpoint, str):  # pyright: ignore[reportUnnecessaryIsInstance]
        raise InputError(f"endpoint={endpoint!r}: expected where a run can be joined")
    with open_client(endpoint, timeout_s, credentials=credentials) as session:
        replies = list(session.get(state_key(run or "*"), timeout=timeout_s))
    found = [answer for each in replies if each.ok and (answer := _read(each.ok)) is not None]
    if not found:
        raise CheckError(f"{run or 'a run'} did not answer at {endpoint} in {timeout_s:g} s")
    if len(found) > 1:
        names = ", ".join(sorted(each.run for each in found))
        raise CheckError(f"{len(found)} runs answer at {endpoint}: expected one of {names}")
    (one,) = found
    sites = tuple(one.sites)
    return Status(one.round, sites, one.moves, one.cubes, one.goal_reached, None)


def _read(sample: zenoh.Sample) -> _Answer | None:
    """Return the answer of a run; None for what others may say at a router that is open to all."""
    try:
        found = msgspec.json.decode(sample.payload.to_bytes(), type=_Answer, dec_hook=site_hook)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError, CubepathError):
        return None
    return found if str(sample.key_expr) == state_key(found.run) else None


def ask_path(session: zenoh.Session, run: str, begin: int, timeout_s: float) -> list[Released]:
    """Return the moves of a run without rounds from a place on, `MOVES_MAX` at most.

    None are returned where no answer comes in time, or with anything else.
    """
    for each in session.get(f"{path_key(run)}?from={begin}", timeout=timeout_s):
        if each.ok is not None and str(each.ok.key_expr) == path_key(run):
            try:
                return msgspec.json.decode(
                    each.ok.payload.to_bytes(), type=list[Released], dec_hook=site_hook
                )
            except (msgspec.DecodeError, UnicodeDecodeError, RecursionError):
                return []
    return []
