"""The shell around the machine: sessions, a router, the clock, and incoming orders.

Everything arrives through one queue, so zenoh's callbacks do no work, and orders from a keyboard,
from Python and from zenoh are carried out in their order of arrival.
"""

import contextlib
import time
import uuid
from collections import Counter
from collections.abc import Callable, Collection
from queue import Empty, SimpleQueue
from typing import Any, Literal, Self, TypeAlias, TypedDict, Unpack

import msgspec
import zenoh

from cubepath.coordinator.playback import replay_comparison, timeline
from cubepath.coordinator.playback.machine import (
    Machine,
    PendingOrder,
    PlaybackEnd,
    PlayerStatus,
    Position,
    PositionJump,
    PutMessage,
    Refusal,
    WaitForOrder,
    Why,
    player_key,
    position_key,
    read_order,
)
from cubepath.coordinator.playback.selection import (
    KeyMapping,
    PlayedMessages,
    RecordedStates,
    SegmentComparison,
    StateAt,
    check_run,
)
from cubepath.coordinator.runs.asking import RunInfo, offer
from cubepath.protocol.core.errors import CheckError, CubepathError, InputError
from cubepath.protocol.core.options import real_number, seconds
from cubepath.protocol.core.sites import in_order
from cubepath.protocol.recordings.description import LEFT_OUT
from cubepath.protocol.recordings.recording import Recording
from cubepath.protocol.recordings.stored_messages import Record
from cubepath.protocol.scenes.toml import scene_to_toml
from cubepath.protocol.wire import sessions
from cubepath.protocol.wire.credentials import COORDINATOR, GUEST
from cubepath.protocol.wire.keys import everything
from cubepath.protocol.wire.router import Router

_PATIENCE_S_MAX = 30.0
_REST_S_MAX = 0.5
"""The longest single wait: a signal that comes just before one is noticed after it."""
_LOOK_S = 0.05
_NAMED = 4
"""An error names no more keys."""

Progress: TypeAlias = Callable[[int], object]
"""Called now and then with the number of messages that have arrived since the last call."""
_Came: TypeAlias = tuple[str, bytes] | PendingOrder


class PlayOptions(TypedDict, total=False):
    """How a recording is replayed; every option may be left out.

    - ``rate``: rounds or levels a second as a number or as "10", or times as fast as it was, by the
      publish times, as "2x"; "max", the default, is as fast as possible. Where log time is the wall
      clock a number is times as fast as it was.
    - ``begin``, ``until``: a round or level such as 12, or a time such as "3.5s" since the first
      message; what is of that round or time itself is played.
    - ``loop``: begin again at the end.
    - ``paused``: put nothing before an order comes.
    - ``max_gap_s``: the most seconds between two messages; longer gaps are cut. None cuts none.
    - ``wait_for_subscribers``: wait until another session subscribes to a part of the run, for this
      many seconds at most. None waits for nobody.
    - ``topics``, ``exclude``: patterns over topics such as "reports/*", by default the messages of
      modules and keepers; "bundle" means "bundle/*".
    - ``remap``: pairs "FROM=TO" of topics or keys, or of how they begin.
    - ``run``: the run id in the keys, by default a new one.
    - ``endpoint``: where the router listens, for example "tcp/127.0.0.1:7447"; None means a unix
      socket at which others of this user can listen.
    - ``connect``: where a router listens that is there, in place of one of its own.
    - ``progress``: called now and then with the number of messages that have arrived since.
    """

    rate: float | str | None
    begin: int | str | None
    until: int | str | None
    loop: bool
    paused: bool
    max_gap_s: float | None
    wait_for_subscribers: float | None
    topics: Collection[str]
    exclude: Collection[str]
    remap: Collection[str]
    run: str | None
    endpoint: str | None
    connect: str | None
    progress: Progress | None


class ReplaySession:
    """A replay: a session that puts, a session that gathers, and a router between them."""

    def __init__(self, recording: Recording, **options: Unpack[PlayOptions]) -> None:
        """Check all options; InputError if one of them is wrong. Nothing is opened yet."""
        given = PlayOptions(**options)
        self.recording = recording
        self.reel = timeline.Timeline(recording)
        pace = _pace(given.get("rate"), by_wall=self.reel.by_wall)
        self._selection = PlayedMessages(
            recording,
            topics=_several("topics", given.get("topics", ())),
            exclude=_several("exclude", given.get("exclude", ())),
        )
        name = given.get("run")
        self.run = uuid.uuid4().hex[:12] if name is None else name
        check_run(self.run)
        self._keys = KeyMapping(recording, self.run, _several("remap", given.get("remap", ())))
        self._endpoint, self._connect = given.get("endpoint"), given.get("connect")
        if self._connect is not None:
            sessions.check_endpoints(self._connect)
            if self._endpoint is not None:
                raise InputError(f"connect={self._connect}: not with an endpoint to listen at")
        self._keys.check_reach(private=(self._endpoint or self._connect) is None)
        self._keys.check_remap(self._selection.takes_topic)
        wait = given.get("wait_for_subscribers")
        self._wait_s = None if wait is None else seconds("wait_for_subscribers", wait)
        self._progress = given.get("progress")
        max_gap = given.get("max_gap_s")
        self._machine = Machine(
            self.reel,
            self._selection,
            pace=pace,
            begin=_spot("from", given.get("begin")),
            until=_spot("until", given.get("until")),
            loop=given.get("loop", False),
            paused=given.get("paused", False),
            max_gap_s=None if max_gap is None else seconds("max_gap_s", max_gap),
        )
        self._prepare()
        self._queue: SimpleQueue[_Came] = SimpleQueue()
        self._resources = contextlib.ExitStack()
        self._arrived = self._sent = 0
        self._played = Counter[str]()
        self._seen: list[tuple[timeline.Cursor, timeline.Cursor]] = []
        self._since = self._last = self._machine.mark
        self._own_keys = f"{player_key(self.run)}/"
        self._asked: list[PendingOrder] = []
        """Those who wait until what they asked for is done."""
        self.endpoint = ""
        self._began = time.monotonic()

    def _prepare(self) -> None:
        """Prepare what the run is gathered in, and compared with."""
        self._states = RecordedStates(self.reel)
        self._extent = replay_comparison.extent_of(self.recording)
        self._segments = SegmentComparison(self.recording, self._extent)

    def __enter__(self) -> Self:
        with contextlib.ExitStack() as opening:
            if self._connect is None:
                router = opening.enter_context(Router(self._endpoint))
                # It speaks for all modules, which the coordinator alone may.
                self.endpoint, lead = router.endpoint, router.credentials(COORDINATOR)
            else:
                self.endpoint, lead = self._connect, GUEST
            self._mouth = sessions.open_client(self.endpoint, credentials=lead)
            opening.callback(self._mouth.close)
            self._ear = sessions.open_client(self.endpoint, credentials=lead)
            opening.callback(self._ear.close)
            queries = answer_queries(self._mouth, self.run, self._queue.put)
            opening.callback(queries.undeclare)
            self._offer()
            if self._wait_s is None:
                opening.callback(self._listen())
            self._resources = opening.pop_all()
        self._began = time.monotonic()
        return self

    def __exit__(self, *_: object) -> None:
        self._resources.close()

    def _offer(self) -> None:
        """Answer those who look for a run."""
        recording = self.recording
        parameters = {**recording.parameters, LEFT_OUT[0]: "a replay"}
        scene = scene_to_toml(recording.scene)
        about = RunInfo(self.run, recording.format, parameters, scene, is_replay=True)
        self._offered = offer(self._mouth, lambda: about)

    def _listen(self) -> Callable[[], None]:
        """Listen to the run, and return what ends that."""
        heard = sessions.subscribe(self._ear, everything(self.run), self._enqueue)
        # Messages put before the subscriber is known here would be lost silently.
        own = f"{player_key(self.run)}/ear"
        sessions.wait_for_ear(self._ear, self._mouth, own, _PATIENCE_S_MAX)
        return heard.undeclare

    def _enqueue(self, sample: zenoh.Sample) -> None:
        self._queue.put((str(sample.key_expr), sample.payload.to_bytes()))

    def ask(self, asked: PendingOrder) -> None:
        """Give an order, from any thread; it is answered when it was carried out."""
        self._queue.put(asked)

    # Playing.

    def play(self, *, hold: bool = False) -> None:
        """Play to the end, or until told to stop; with `hold` it waits for orders at the end too.

        One that stands at the end and was paused waits for orders in any case.
        """
        self._wait_for_others()
        while True:
            self._take_what_is_there()
            self._answer()
            match self._machine.next(time.monotonic()):
                case PutMessage(record=record, mark=mark):
                    self._play(record, self._keys.key(record), mark)
                case PositionJump(why=why):
                    self._jumped(why)
                case WaitForOrder(until=until):
                    self._answer()
                    self._rest_until(until)
                case PlaybackEnd():
                    self._answer(at_end=True)
                    if self._asked:
                        continue  # somebody came meanwhile
                    if self._machine.stopped or not (hold or self._machine.paused):
                        break
                    self._rest_until(None)
        self._gather()
        self._answer(at_end=True)

    def _play(self, record: Record, key: str, mark: timeline.Cursor) -> None:
        self._put(record, key, mark)
        self._last = timeline.Cursor(mark.chunk, mark.place + 1)
        if not self._seen or not any(low <= mark < high for low, high in self._seen):
            self._played[record.kind] += 1

    def _put(self, record: Record, key: str, _mark: timeline.Cursor) -> None:
        sessions.put(self._mouth, key, record.data)
        if key.startswith(self._keys.within):
            self._sent += 1

    def _wait_for_others(self) -> None:
        if self._wait_s is None:
            return
        deadline = time.monotonic() + self._wait_s
        waited = self._waited_for()
        # The own ear listens only then: it would be the subscriber that is waited for.
        with contextlib.ExitStack() as declared:
            said = [
                declared.enter_context(sessions.publisher(self._mouth, each)) for each in waited
            ]
            while not (any(map(sessions.is_heard, said)) or self._machine.stopped):
                if time.monotonic() >= deadline:
                    named = " or ".join(waited[:_NAMED]) + " ..." * (len(waited) > _NAMED)
                    raise CheckError(f"no subscriber to {named} within {self._wait_s:g} s")
                self._rest_until(time.monotonic() + _LOOK_S)
                self._take_what_is_there()
                self._answer()
        self._resources.callback(self._listen())

    def _waited_for(self) -> list[str]:
        """Return the keys to one of which somebody has to subscribe."""
        return [everything(self.run)]

    def _jumped(self, why: Why) -> None:
        """Say that the position has jumped, and gather anew from there."""
        self._gather()
        self._cover()
        machine = self._machine
        state = self._states.at(machine.mark)
        self._tell_position(why, state)
        if self._is_start(machine.mark):
            self._segments.restart()
        else:
            self._segments.jump(state)

    def _tell_position(self, why: Why, state: StateAt) -> None:
        status = self.status()
        position = Position(
            run=self.run,
            why=why,
            message=status.message,
            round=status.round,
            time_s=status.time_s,
            after=state.step,
            sites=list(in_order(state.on)),
            modules=list(state.sites),
        )
        sessions.put(self._mouth, position_key(self.run), msgspec.json.encode(position))

    def _is_start(self, mark: timeline.Cursor) -> bool:
        """Return whether nothing that the run is gathered from stands before a mark."""
        needed = self._selection.needed
        return all(record.kind not in needed for _, record in self.reel.backward(mark, needed))

    def _cover(self) -> None:
        """Note which part was played, since what is played again counts once."""
        if self._last > self._since:
            merged: list[tuple[timeline.Cursor, timeline.Cursor]] = []
            for low, high in sorted([*self._seen, (self._since, self._last)]):
                if merged and low <= merged[-1][1]:
                    merged[-1] = merged[-1][0], max(merged[-1][1], high)
                else:
                    merged.append((low, high))
            self._seen = merged
        self._since = self._last = self._machine.mark

    # What comes in.

    def _rest_until(self, due: float | None) -> None:
        """Wait until then, or until something comes that is not what was put."""
        while True:
            left = _REST_S_MAX if due is None else min(due - time.monotonic(), _REST_S_MAX)
            if left <= 0:
                return
            with contextlib.suppress(Empty):
                if self._take(self._queue.get(timeout=left)):
                    return

    def _take_what_is_there(self) -> None:
        with contextlib.suppress(Empty):
            while True:
                self._take(self._queue.get_nowait())

    def _gather(self) -> None:
        since = time.monotonic()
        while self._arrived < self._sent:
            try:
                self._take(self._queue.get(timeout=min(_REST_S_MAX, _PATIENCE_S_MAX)))
                since = time.monotonic()
            except Empty:
                if time.monotonic() < since + _PATIENCE_S_MAX:
                    continue
                raise CheckError(
                    f"{self._arrived} of {self._sent} messages arrived, and none for"
                    f" {_PATIENCE_S_MAX:.0f} s"
                ) from None

    def _take(self, came: _Came) -> bool:
        """Take what has come; return whether it is an order."""
        if isinstance(came, PendingOrder):
            self._obey(came)
            return True
        key, data = came
        if not key.startswith(self._own_keys):
            self._arrived += 1
            self._segments.take(key, data)
            if self._progress is not None:
                self._progress(1)
        return False

    def _obey(self, asked: PendingOrder) -> None:
        try:
            self._machine.order(asked.order, time.monotonic())
        except CubepathError as error:
            asked.refuse(str(error))
        else:
            self._asked.append(asked)

    def _answer(self, *, at_end: bool = False) -> None:
        """Answer those whose order was carried out: a step or a jump may be under way."""
        if not self._asked or self._machine.busy:
            return
        asked, self._asked = self._asked, []
        for each in asked:
            if each.at_end and not at_end:
                self._asked.append(each)
                continue
            if each.at_end:
                self._gather()
            each.answer(self.status())

    def refuse_all(self, why: str) -> None:
        """Refuse what was asked and will not be done any more."""
        with contextlib.suppress(Empty):
            while True:
                came = self._queue.get_nowait()
                if isinstance(came, PendingOrder):
                    self._asked.append(came)
        for each in self._asked:
            each.refuse(why)

    # Results.

    def status(self) -> PlayerStatus:
        """Return the player's position; for the player to call."""
        machine, reel = self._machine, self.reel
        ended = machine.ended
        following = reel.next(machine.mark)
        records = len(self.recording.records)
        state: Literal["playing", "paused", "ended", "stopped"] = "playing"
        if machine.stopped:
            state = "stopped"
        elif ended:
            state = "ended"
        elif machine.paused:
            state = "paused"
        return PlayerStatus(
            run=self.run,
            state=state,
            message=records if following is None else following[1].sequence,
            messages=records,
            round=reel.step_at(machine.mark),
            time_s=round(reel.time_at(machine.mark), 6),
            seconds=round(reel.seconds, 6),
            rate=str(machine.pace),
            laps=machine.laps,
        )

    def result(self) -> replay_comparison.ReplayResult:
        """Return the result, compared with the recording where possible."""
        total = self.recording.counts().kinds
        left_out = {
            kind: count.messages - self._played[kind]
            for kind, count in sorted(total.items())
            if count.messages > self._played[kind]
        }
        segments, extent = self._segments, self._extent
        machine = self._machine
        whole = (
            not segments.jumped
            and not segments.resumed
            and machine.ended
            and machine.end == self.reel.end
            and not self._keys.remap
            and self._selection.needed.isdisjoint(left_out)
        )
        if whole:
            comparison = replay_comparison.Comparison(self.recording, segments.gathered, extent)
            differences, rounds = tuple(comparison.differences), comparison.rounds
            not_compared = comparison.not_compared
        else:
            differences, rounds = segments.compared(), segments.rounds
            last = self.reel.step_at(self.reel.end)
            not_compared = replay_comparison.not_compared_of(self.recording, rounds, last)
        figures = segments.gathered.figures
        del figures["goal_reached"]
        has_end = any(self.recording.of_kind("summary"))
        return replay_comparison.ReplayResult(
            log=str(self.recording.path),
            run=self.run,
            endpoint=self.endpoint,
            **figures,
            same=whole and not differences and not not_compared,
            compared=has_end or extent.cut_off,
            complete=has_end and not self.recording.problems and extent.lacking is None,
            differences=differences,
            messages=self._arrived,
            seconds=round(time.monotonic() - self._began, 3),
            not_compared=tuple(not_compared),
            rounds_compared=len(rounds),
            left_out=left_out,
            has_end=has_end,
            problems=self.recording.problems,
            lacking=extent.lacking,
            after=segments.after,
            clock=self.recording.clock,
        )


def _pace(given: float | str | None, *, by_wall: bool) -> timeline.PlaybackRate:
    if given is None:
        return timeline.PlaybackRate()
    if isinstance(given, str):
        return timeline.read_pace(given, by_wall=by_wall)
    rate = real_number("rate", given)
    if not rate > 0:
        raise InputError(f"rate={given}: expected more than 0 rounds a second")
    return timeline.PlaybackRate(rate, "clock" if by_wall else "step")


def _spot(name: str, given: int | str | None) -> timeline.TimelinePosition | None:
    return None if given is None else timeline.read_spot(given, name)


def _several(name: str, given: Collection[str]) -> Collection[str]:
    if isinstance(given, str):
        raise InputError(f"{name}={given!r}: expected a list of texts")
    return given


def answer_queries(
    session: zenoh.Session, run: str, enqueue: Callable[[PendingOrder], object]
) -> zenoh.Queryable[Any]:
    """Put every order that comes over zenoh into a queue, until the queryable is undeclared."""

    def ask(query: zenoh.Query) -> None:
        asked = _asked(query, run)
        if asked is not None:
            enqueue(asked)

    callback = zenoh.handlers.Callback(ask, indirect=False)
    return session.declare_queryable(f"{player_key(run)}/*", callback)


def _asked(query: zenoh.Query, run: str) -> PendingOrder | None:
    """Return what a query orders; None if that is no order, which is answered."""
    name = str(query.key_expr).rpartition("/")[2]
    pairs = [each.partition("=") for each in str(query.parameters).split(";") if each]
    given = {key: value for key, _, value in pairs}

    # A query is over when it is dropped, and these two hold it.
    def answer(status: PlayerStatus) -> None:
        query.reply(f"{player_key(run)}/{name}", msgspec.json.encode(status))
        query.drop()

    def refuse(why: str) -> None:
        query.reply_err(msgspec.json.encode(Refusal(why)))
        query.drop()

    try:
        return PendingOrder(read_order(name, given), answer, refuse)
    except InputError as error:
        refuse(str(error))
        return None
