"""A run recorded from outside, by a guest of the router.

Zenoh fills a bounded backlog, and a thread of the recorder empties it. The run is not affected: a
router waits up to a second for a guest that does not read, and then cuts it off. The guest
reconnects by itself, and what it missed is counted.
"""

import contextlib
import queue
import secrets
import threading
import time
from collections.abc import Callable, Iterable, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Self

import msgspec
import zenoh

from cubepath.coordinator.runs.asking import RunInfo, about_key, find_run
from cubepath.coordinator.runs.plan import name_part
from cubepath.coordinator.tools.recorder.backlog import (
    Backlog,
    ReceivedMessage,
    RecentMessages,
    RecordedMessage,
)
from cubepath.coordinator.tools.recorder.losses import LossCounter
from cubepath.coordinator.tools.recorder.parts import (
    KeyTopics,
    RecordingParts,
    SplitLimits,
    Topics,
    about_keys,
    numbered,
    stored_messages,
)
from cubepath.coordinator.tools.recorder.turns import MessageOrder, MessageTimes, OrderedMessage
from cubepath.protocol.core.errors import CheckError, CubepathError, InputError
from cubepath.protocol.core.formatting import counted
from cubepath.protocol.core.options import seconds
from cubepath.protocol.recordings.description import FORMAT, KEYS
from cubepath.protocol.wire.credentials import GUEST, Credentials, has_ended, is_private
from cubepath.protocol.wire.keys import everything
from cubepath.protocol.wire.router import check_secure
from cubepath.protocol.wire.sessions import check_endpoints, open_client, routers_of, watch


def guest_at(endpoint: str, secure: Path | str | None) -> Credentials:
    """Return the credentials of a guest at an endpoint; `secure` is a folder of certificates.

    InputError if a run cannot be listened to at such an endpoint, or if it takes certificates and
    none are given, or the other way round.

    >>> guest_at("tcp/127.0.0.1:7447", None).name
    'guest'
    """
    if not isinstance(endpoint, str):  # pyright: ignore[reportUnnecessaryIsInstance]
        raise InputError(f"endpoint={endpoint!r}: expected where a run can be joined")
    folder = None if secure is None else Path(secure)
    if not is_private(endpoint):
        try:
            check_endpoints(endpoint)
        except InputError as error:
            raise InputError(f"{error}, or the unixsock-stream/PATH that a run has said") from None
    check_secure(endpoint, folder)
    return GUEST if folder is None else Credentials(GUEST.name, "", str(folder))


MEMORY_MEGABYTES = 100.0
_STEP_S = 0.05
_LAST_S = 5.0
"""How long waiting messages are written when a recorder leaves."""
_QUIET_S = 0.3
"""A run that has summed up and whose token has gone has ended when nothing comes for this long."""
_WRITE_S_MAX = 10.0
_MEGABYTE = 1_000_000
_OF_KEYS = "keys"
"""Stands for the run in keys where there is none."""


class Recorder:
    """A recorder of a live run, as a context manager that leaves with its files closed.

    A file that cannot be written ends the recorder, and the error is raised when the block is left.

    >>> from cubepath.protocol import read_recording
    >>> with start("hex:n=4", processes=1, log="logs/inside.mcap") as running:
    ...     with Recorder(running.endpoint, "logs/outside.mcap") as recorder:
    ...         outcome = running.play()
    ...         recorder.wait(10)
    True
    >>> verify("logs/outside.mcap").ok, recorder.lost
    (True, {})
    """

    def __init__(
        self,
        endpoint: str,
        log: Path | str | None = None,
        *,
        run: str | None = None,
        keys: str | None = None,
        topics: Sequence[str] = (),
        exclude: Sequence[str] = (),
        split_megabytes: float | None = None,
        split_seconds: float | None = None,
        snapshot_seconds: float | None = None,
        memory_megabytes: float = MEMORY_MEGABYTES,
        secure: Path | str | None = None,
        patience_s: float = 10.0,
        say: Callable[[str], None] = lambda _: None,
    ) -> None:
        """Attach to a live run, and record it from now on.

        `endpoint` is where the run can be listened to (`Run.endpoint`; of linked routers all to
        try, separated by commas), `run` its name where there are several. With `keys`, a key
        expression such as ``robot/**``, the messages of any zenoh programs are recorded instead,
        until the recorder is stopped or the router is gone. The file `log` (None: a
        new one in ``logs/``) has the bytes that were on the wire. `topics` and `exclude` are globs
        over KIND/SENDER, or over keys. With `split_megabytes` (10**6 bytes) or `split_seconds`
        there are files NAME-000.mcap and so on. With `snapshot_seconds` nothing is written but the
        last seconds, when `snapshot` asks for them. This many megabytes wait to be written, or are
        kept, at most. `secure` is a folder with the certificate of `guest`. A run or router that is
        gone is waited for for `patience_s` seconds.

        InputError for bad options, CheckError if no run answers within `patience_s`, CubepathError
        if there is no router at the endpoint.
        """
        credentials = guest_at(endpoint, secure)
        _check_limits(
            split_megabytes=split_megabytes,
            split_seconds=split_seconds,
            snapshot_seconds=snapshot_seconds,
            memory_megabytes=memory_megabytes,
        )
        seconds("patience_s", patience_s)
        size = None if split_megabytes is None else int(split_megabytes * _MEGABYTE)
        given = {"topics": " ".join(topics), "exclude": " ".join(exclude)}
        self._given = {name: text for name, text in given.items() if text}
        self.endpoint = endpoint
        self._patience_s = patience_s
        self.ended: str | None = None
        """Why nothing more is recorded: "run ended", "run gone" without a word of how it ended,
        "router gone", "stopped" or "failed"."""
        self.cut_off = 0
        """How often the router was lost, or cut the recorder off, and was found again."""
        self.others = 0
        """How many messages came that are none of a run."""
        self.left_out = 0
        """How many messages came that are of no topic that was asked for."""
        self._keys = None if keys is None else about_keys(keys)
        if keys is not None and run is not None:
            raise InputError(f"run={run}: not with keys={keys}, which are of no run")
        self._topics = Topics(topics, exclude) if keys is None else KeyTopics(topics, exclude)
        self._memory_bytes = int(memory_megabytes * _MEGABYTE)
        self._asked: queue.SimpleQueue[zenoh.Query | None] = queue.SimpleQueue()
        self._snapshots: list[Path] = []
        self._in_snapshots = 0
        self._taken = threading.Condition()
        self._failed: BaseException | None = None
        self._whole: int | None = None
        """The first whole round as of the last round that began, or of the first message."""
        self._begins = False
        """Whether nothing was written since."""
        self._summed_up = False
        """Whether the run has published how it ended."""
        self._leaving = threading.Event()
        self._over = threading.Event()
        self._lock = threading.Lock()
        self._say = say
        self._window = None
        if snapshot_seconds is not None:
            self._window = RecentMessages(snapshot_seconds, self._memory_bytes)
        self._session = open_client(endpoint, patience_s, credentials=credentials)
        try:
            self._attach(run, log, SplitLimits(size, split_seconds), patience_s)
        except BaseException:
            self._session.close()
            raise
        self._thread = threading.Thread(target=self._work, name="cubepath-recorder", daemon=True)
        self._thread.start()

    def _attach(
        self, run: str | None, log: Path | str | None, splitting: SplitLimits, patience_s: float
    ) -> None:
        self.run = ""
        if self._keys is None:
            try:
                self.run = find_run(self._session, self.endpoint, run, patience_s).run
            except CheckError as error:
                hint = "; messages of your own programs are recorded with keys='**' (--keys)"
                raise CheckError(f"{error}{hint if run is None else ''}") from None
        self._alive: bool | None = None
        self._gone_s = self._heard_s = 0.0
        self._router = routers_of(self._session)
        self._router_lost_s: float | None = None
        self._listen()
        # The router knows who listens before it answers what was asked after that: from the
        # round that is returned on, nothing is missed.
        about = self._keys or find_run(self._session, self.endpoint, self.run, patience_s)
        self.about = about
        self._times = MessageTimes(about)
        free = about.format != FORMAT
        self._losses = LossCounter(free=None if self._keys else free)
        self._turns = MessageOrder(None if free else _processes(about), from_start=not about.round)
        self._path = _new_name(about) if log is None else Path(log)
        self._parts = RecordingParts(about, self._path, splitting, self._notes, self._given)

    def _listen(self) -> None:
        session, run = self._session, self.run
        self._links = session.info.declare_transport_events_listener(
            zenoh.handlers.Callback(self._linked, indirect=False)
        )
        if self._keys is None:
            self._token = watch(session, about_key(run), self._tell_alive)
            self._backlog = Backlog(session, everything(run), self._memory_bytes)
        else:
            keys = self._keys.parameters[KEYS]
            self._backlog = Backlog(session, keys, self._memory_bytes, of_run=False)
            # When this is answered, the router knows who listens.
            list(session.liveliness().get(about_key(_OF_KEYS)))
        if self._window is not None:
            name = secrets.token_hex(4)
            self._queryable = session.declare_queryable(
                f"cubepath/{run or _OF_KEYS}/recorder/{name}/snapshot",
                zenoh.handlers.Callback(self._asked.put, indirect=False),
            )

    # In threads of zenoh.

    def _tell_alive(self, _key: str, alive: bool) -> None:  # noqa: FBT001 - as `watch` tells it
        self._alive = alive
        self._gone_s = time.monotonic()

    def _linked(self, event: zenoh.TransportEvent) -> None:
        if event.kind == zenoh.SampleKind.PUT:
            self.cut_off += 1

    # In the thread of the recorder.

    def _work(self) -> None:
        try:
            while self.ended is None:
                self._hear(self._backlog.take(_STEP_S))
                self._write_all(self._turns.due())
                self._parts.flush_if_due()
                self._answer()
                self.ended = self._end()
            self._hear(self._backlog.take(_LAST_S))
            self._write_all(self._turns.rest())
            self._answer()
        except BaseException as error:  # noqa: BLE001 - it is raised where the block is left
            self._failed = error
            self.ended = "failed"
        finally:
            try:
                if self._window is None:
                    self._parts.close()
            except CubepathError as error:
                self._failed = self._failed or error
            self._over.set()
            with self._taken:
                self._taken.notify_all()

    def _hear(self, heard: Iterable[ReceivedMessage]) -> None:
        """Note what came, and write what is next in order."""
        each = None
        for each in heard:
            topic, wanted = self._topics.of(each.key)
            if topic is None:
                self.others += 1
                continue
            with self._lock:
                head = self._losses.take(topic, each)
            item = OrderedMessage(topic, each, head, wanted)
            self._write_all(self._turns.put(item))
        if each is not None:
            self._heard_s = time.monotonic()

    def _write_all(self, items: Iterable[OrderedMessage]) -> None:
        for item in items:
            self._write(item)

    def _write(self, item: OrderedMessage) -> None:
        """Write a message if it is wanted, or keep it for a snapshot."""
        topic, heard, head, wanted = item
        if heard.plain is not None:
            for message in stored_messages(topic, heard) if wanted else ():
                self._keep(message)
            self.left_out += not wanted
            return
        kind = topic.partition("/")[0]
        self._summed_up = self._summed_up or kind == "summary"
        at, begins, round_begins = self._times.of(kind, heard, head)
        if round_begins or self._whole is None:
            # What is not wanted begins a round as well: the next that is written is its first.
            self._whole, self._begins = begins, True
        if not wanted:
            self.left_out += 1
            return
        if self._times.is_repeated(topic, heard.data):
            return
        begins = self._whole if self._begins else begins
        message = RecordedMessage(topic, heard.data, at, heard.wall_ns, begins)
        self._keep(message, round_begins=self._begins)
        self._begins = False

    def _keep(self, message: RecordedMessage, *, round_begins: bool = True) -> None:
        if self._window is not None:
            self._window.put(message)
        else:
            self._parts.write(message, round_begins=round_begins)

    def _end(self) -> str | None:
        """Return why the recorder has to end, None if it continues."""
        if self._leaving.is_set():
            return "stopped"
        now = time.monotonic()
        routers = routers_of(self._session)
        if not routers:
            if self._summed_up:  # a separate router ends with the run
                return self._how_it_ended()
            self._router_lost_s = self._router_lost_s or now
            gone = has_ended(self.endpoint)
            over = gone or now - self._router_lost_s > self._patience_s
            # The router of a replay is its own, and goes with it.
            gone = gone or self.about.is_replay
            return (self._how_it_ended() if gone else "router gone") if over else None
        if routers != self._router:
            self._router, self._gone_s = routers, now
        self._router_lost_s = None
        # When its router has died it takes a while until its token is there again.
        patience_s = _QUIET_S if self._summed_up else self._patience_s
        if self._alive is False and now - max(self._gone_s, self._heard_s) > patience_s:
            return self._how_it_ended()
        return None

    def _how_it_ended(self) -> str:
        return "run ended" if self._summed_up else "run gone"

    def _answer(self) -> None:
        """Write the snapshots that were asked for."""
        while not self._asked.empty():
            query = self._asked.get_nowait()
            path = self._snapshot()
            with self._taken:
                self._snapshots.append(path)
                self._taken.notify_all()
            if query is not None:
                with contextlib.suppress(zenoh.ZError):  # who asked may be gone
                    query.reply(query.key_expr, msgspec.json.encode({"log": str(path.absolute())}))

    def _snapshot(self) -> Path:
        if self._window is None:
            raise AssertionError("a snapshot without a window")  # it is not asked for then
        number = len(self._snapshots)
        path = numbered(self._path, number)
        kept = self._window.at(time.time_ns())
        given = {**self._given, "snapshot": str(number)}
        parts = RecordingParts(self.about, path, SplitLimits(), self._notes, given)
        for each in kept:
            parts.write(each)
        parts.close()
        self._in_snapshots += len(kept)
        self._say(f"{path}: {counted(len(kept), 'message')} written")
        return path

    def _notes(self) -> dict[str, str]:
        """Return what a file says at its end of what is missing."""
        return {
            "lost": msgspec.json.encode(self.lost).decode(),
            "cut_off": str(self.cut_off),
            "others": str(self.others),
            "left_out": str(self.left_out),
        }

    # For the recorder.

    @property
    def logs(self) -> list[Path]:
        """Return the files so far, in their order; the last may be in work."""
        return list(self._parts.paths if self._window is None else self._snapshots)

    @property
    def messages(self) -> int:
        """Return how many messages were written, or lie in snapshots."""
        return self._parts.messages + self._in_snapshots

    @property
    def lost(self) -> dict[str, int]:
        """Return how many messages are known to be missing, by topic or by sender."""
        with self._lock:
            found = self._losses.by_sender()
        return {
            each: count
            for each, count in found.items()
            if not each.startswith(("bundle/", "reports/")) or self._topics.has(each)
        }

    @property
    def room(self) -> int:
        """Return how many messages wait to be written at most; then who publishes has to wait."""
        return self._backlog.most

    def wait(self, timeout_s: float | None = None) -> bool:
        """Wait until the run ends, or for this long; return whether the recorder has ended."""
        return self._over.wait(timeout_s)

    def snapshot(self) -> Path:
        """Write what came in the last seconds; return the file.

        InputError if the recorder was not asked to keep them, CheckError if it has ended.
        """
        if self._window is None:
            raise InputError("snapshot: the recorder writes all it hears, expected --snapshot")
        with self._taken:
            expected = len(self._snapshots) + 1
            self._asked.put(None)
            self._taken.wait_for(
                lambda: len(self._snapshots) >= expected or self._over.is_set(), _WRITE_S_MAX
            )
            if len(self._snapshots) < expected:
                raise CheckError(f"the recorder has ended ({self.ended}): expected one at work")
            return self._snapshots[expected - 1]

    def request_snapshot(self) -> None:
        """Have what came in the last seconds written, without waiting for it; as in a signal."""
        if self._window is not None:
            self._asked.put(None)

    def stop(self) -> None:
        """Leave: write what has been heard, and close the file; nothing if that has been done.

        CheckError if it could not be written.
        """
        self._leaving.set()
        self._thread.join()
        with self._backlog.emptied(), contextlib.suppress(zenoh.ZError):
            self._session.close()
        failed, self._failed = self._failed, None
        if failed is not None:
            raise failed

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()


def _check_limits(**limits: float | None) -> None:
    for name, value in limits.items():
        if value is not None and not value > 0:
            raise InputError(f"{name}={value}: expected more than 0")
    if limits["snapshot_seconds"] and (limits["split_megabytes"] or limits["split_seconds"]):
        raise InputError("snapshot_seconds: each snapshot is one file, expected no splitting")


def _processes(about: RunInfo) -> int:
    """Return how many processes a run says that it has; 1 if that is malformed."""
    stated = about.parameters.get("processes", "")
    return int(stated) if stated.isascii() and stated.isdigit() and len(stated) < 9 else 1


def _new_name(about: RunInfo) -> Path:
    family = name_part(about.parameters.get("family", "")) or ("run" if about.run else "messages")
    now = datetime.now(UTC).strftime("%Y%m%dT%H%M%S%f")
    return Path("logs") / f"{family}-attached-{now}.mcap"
