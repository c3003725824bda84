"""Replaying: the recorded bytes go back on zenoh, and a fresh coordinator gathers them again.

Room: coordinator. The messages of module processes go through a router from one session to another,
under their original keys but a new run id; in recordings of format 1 modules put messages of their
own, which go on the key of their topic. Without rounds what keepers say is put back too. Anything
else that is connected to the router receives them as well.
"""

from __future__ import annotations

import contextlib
import time
import uuid
from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass
from queue import Empty, SimpleQueue
from typing import Any

import zenoh

from cubepath.coordinator.runs.edge_path import Gathered
from cubepath.coordinator.runs.free_gatherer import FreeGatherer, keepers_in
from cubepath.coordinator.runs.gatherer import Gatherer
from cubepath.coordinator.verification.certificate import check_certificate
from cubepath.coordinator.verification.transcript import RECOVERED
from cubepath.protocol.core.actions import Action
from cubepath.protocol.core.errors import CheckError, CubepathError, InputError
from cubepath.protocol.core.input_files import Source
from cubepath.protocol.core.sites import site_from_json
from cubepath.protocol.recordings.recording import Record, Recording, recording_of
from cubepath.protocol.wire.credentials import COORDINATOR
from cubepath.protocol.wire.free_messages import decode_free, free_key
from cubepath.protocol.wire.keys import everything, key_of, topic_in_key, topic_key
from cubepath.protocol.wire.messages import (
    Certified,
    Cube,
    Edges,
    Message,
    Report,
    Summary,
    decode,
    parts_of,
)
from cubepath.protocol.wire.router import Router
from cubepath.protocol.wire.sessions import open_client, put, subscribe, wait_for_subscriber

_PARTS = ("here", "note", "claim", "verdict", "report", "observed")
"""What modules say, which is put back; in format 1 each as a message of its own."""
SAID = ("said", "reports", "observations", *_PARTS)
"""The kinds of messages that are put back."""
FREE_SAID = ("ask", "pass", "tell", "shows", "moved", "turns", "tail")
"""The same of a run without rounds: what modules and keepers say."""

Progress = Callable[[int], object]
"""Called now and then with the number of messages that have arrived since the last call."""
Announce = Callable[[str, str], object]
"""Called with the endpoint and the run id before the first message is put."""

_PATIENCE_S_MAX = 30.0
_REST_S_MAX = 3600.0
"""The longest single wait: the system's clock cannot count the seconds of any rate."""


@dataclass(frozen=True, slots=True)
class Replayed:
    """The result of a replay; `same` says whether it agrees with the recording.

    `differences` has one line for each place where it does not, where the recording has nothing to
    compare with, and for what could not be read of the recording.
    """

    log: str
    run: str
    endpoint: str
    rounds: int
    moves: int
    reduced_moves: int
    cubes: int
    max_cube_dimension: int
    path_digest: str
    same: bool
    compared: bool
    """Whether the recording has a result, or says that it was recovered; otherwise it is cut off,
    and there may be more of it elsewhere."""
    complete: bool
    """Whether the recording has a result and can all be read. What was recovered of a run that was
    cut off can be the same without."""
    differences: tuple[str, ...]
    messages: int
    seconds: float

    @property
    def result(self) -> str:
        """Return in words how the replay compares with the recording."""
        if self.same:
            return "the same as recorded" + ("" if self.complete else ", as far as it goes")
        return "differs from the recording" if self.compared else "nothing to compare it with"

    def document(self) -> dict[str, Any]:
        """Return the keys of ``cubepath replay --json``."""
        found = {key: getattr(self, key) for key in self.__slots__}
        return found | {"differences": list(self.differences)}


def replay(
    recording: Recording | Source,
    *,
    rate: float | None = None,
    kinds: Collection[str] | None = None,
    endpoint: str | None = None,
    announce: Announce | None = None,
    progress: Progress | None = None,
) -> Replayed:
    """Put the messages of modules back on zenoh, gather them from there, and compare the results.

    `rate` is in rounds or levels a second, or times as fast as it was if log time is the wall clock
    (as fast as possible if None); `kinds` are the kinds of `SAID` or `FREE_SAID` to put (all of
    them if None), and `endpoint` is where the router listens, for example "tcp/127.0.0.1:7447";
    None means a unix socket at which others of this user can listen. InputError for bad options and
    malformed messages, and if a path is no recording; CheckError if reports contradict each other
    or messages do not arrive.

    >>> found = replay("logs/golden/hex-5.mcap")
    >>> found.same, found.rounds, found.moves
    (True, 29, 28)
    """
    if rate is not None and not rate > 0:
        raise InputError(f"rate={rate}: expected more than 0 rounds a second")
    recording = recording_of(recording)
    said, gathered = (
        (FREE_SAID, {"moved", "tail"})
        if recording.clock == "free"
        else (SAID, {"reports", "report"})
    )
    kinds = said if kinds is None else kinds
    stray = sorted(set(kinds) - set(said))
    if stray:
        raise InputError(f"unknown kind {stray[0]!r}, expected some of {', '.join(said)}")
    if not gathered & set(kinds):
        named = "commits" if recording.clock == "free" else "reports"
        raise InputError(f"kinds without {named}: without {named} there is nothing to gather")
    with contextlib.ExitStack() as resources:
        router = resources.enter_context(Router(endpoint))
        player = _Player(recording, router, resources)
        if announce is not None:
            announce(router.endpoint, player.run)
        return player.play(kinds, rate, progress)


class _Player:
    """One replay: a session that puts, a session that gathers, and a router between them."""

    def __init__(
        self, recording: Recording, router: Router, resources: contextlib.ExitStack
    ) -> None:
        self.run = uuid.uuid4().hex[:12]
        endpoint = self._endpoint = router.endpoint
        self._recording = recording
        self._free = recording.clock == "free"
        self._lockstep_gatherer = Gatherer(recording.scene)
        self._free_gatherer = (
            FreeGatherer(recording.scene, keepers_in(recording)) if self._free else None
        )
        self._gatherer: Gathered = self._free_gatherer or self._lockstep_gatherer
        self._queue: SimpleQueue[tuple[str, bytes]] = SimpleQueue()
        self._arrived = 0
        self._progress: Progress | None = None
        # It speaks for all modules, which the coordinator alone may.
        self._mouth = open_client(endpoint, credentials=router.credentials(COORDINATOR))
        resources.callback(self._mouth.close)
        subscriber = open_client(endpoint)
        resources.callback(subscriber.close)
        resources.callback(subscribe(subscriber, everything(self.run), self._enqueue).undeclare)
        # Messages put before the subscriber is known here would be lost silently.
        wait_for_subscriber(self._mouth, topic_key(self.run, "report", "all"), _PATIENCE_S_MAX)

    def _enqueue(self, sample: zenoh.Sample) -> None:
        self._queue.put((str(sample.key_expr), sample.payload.to_bytes()))

    def play(
        self, kinds: Collection[str], rate: float | None, progress: Progress | None
    ) -> Replayed:
        began = time.monotonic()
        self._progress = progress
        sent = 0
        first: int | None = None
        for record in self._recording.records:
            if record.kind not in kinds:
                continue
            if first is None:
                first = record.wall_ns
            key = self._key(record)
            if rate is not None:
                by_wall = self._recording.parameters.get("log_time") == "wall"
                passed = (record.wall_ns - first) / 1e9 if by_wall else record.round - 1
                self._rest_until(began + passed / rate)
            put(self._mouth, key, record.data)
            sent += 1
            self._gather_what_is_there()
        self._gather(sent)
        differences = tuple(self._differences())
        ended = any(self._recording.of_kind("summary"))
        heap = self._gatherer.heap
        return Replayed(
            log=str(self._recording.path),
            run=self.run,
            endpoint=self._endpoint,
            rounds=self._gatherer.rounds,
            moves=heap.moves,
            reduced_moves=heap.reduced_moves,
            cubes=heap.cubes,
            max_cube_dimension=heap.max_cube_dimension,
            path_digest=self._gatherer.digest,
            same=not differences,
            compared=ended or self._recovered,
            complete=ended and not self._recording.problems,
            differences=differences,
            messages=self._arrived,
            seconds=round(time.monotonic() - began, 3),
        )

    def _key(self, record: Record) -> str:
        if not self._free:
            return key_of(self.run, _message(self._recording, record))
        try:
            return free_key(self.run, decode_free(record.data))
        except CubepathError as error:
            raise InputError(f"{_where(self._recording, record)}: {error}") from None

    def _rest_until(self, due: float) -> None:
        while (left := due - time.monotonic()) > 0:
            with contextlib.suppress(Empty):
                self._take(*self._queue.get(timeout=min(left, _REST_S_MAX)))

    def _gather_what_is_there(self) -> None:
        with contextlib.suppress(Empty):
            while True:
                self._take(*self._queue.get_nowait())

    def _gather(self, sent: int) -> None:
        while self._arrived < sent:
            try:
                self._take(*self._queue.get(timeout=_PATIENCE_S_MAX))
            except Empty:
                raise CheckError(
                    f"{self._arrived} of {sent} messages arrived, and none for"
                    f" {_PATIENCE_S_MAX:.0f} s"
                ) from None

    def _take(self, key: str, data: bytes) -> None:
        self._arrived += 1
        if topic_in_key(key).startswith(("reports/", "report/")):
            for part in parts_of(decode(data)):
                if isinstance(part, Report):
                    self._lockstep_gatherer.receive(part)
        elif self._free_gatherer is not None:
            self._free_gatherer.take(decode_free(data))
        if self._progress is not None:
            self._progress(1)

    def _differences(self) -> Iterator[str]:
        """Yield each difference between the gathered run and the one on record."""
        yield from self._recording.problems
        edges: dict[int, Edges] = {}
        cubes: dict[int, Cube] = {}
        summary: Summary | None = None
        for record in self._recording.of_kind("edges", "cube", "summary"):
            match _message(self._recording, record):
                case Edges() as message:
                    edges[message.round] = message
                case Cube() as message:
                    cubes[message.index] = message
                case Summary() as message:
                    summary = message
                case _:
                    pass
        cut_off = self._recovered and summary is None
        if not cut_off and self._gatherer.unfinished is not None:
            yield self._gatherer.unfinished
        yield from self._other_edges(edges, cut_off=cut_off)
        if summary is None and not self._recovered:
            yield "no summary is on record, so there is no result to compare with"
            return
        yield from self._other_cubes(cubes, all_of_them=summary is not None)
        if summary is not None:
            yield from self._other_numbers(summary)
        yield from self._not_proved()

    def _other_edges(self, recorded: dict[int, Edges], *, cut_off: bool) -> Iterator[str]:
        steps, step_name = self._gatherer.steps, "level" if self._free else "round"
        for step in steps:
            known = recorded.pop(step.round, None)
            # A run that was killed may have had no time to write the edges of its last round.
            if known is None and not (cut_off and step is steps[-1]):
                yield f"{step_name} {step.round}: gathered, but its edges are not on record"
            elif known is not None and known.moves != list(step.executed):
                yield f"{step_name} {step.round}: other moves were gathered than are on record"
        if recorded:
            why = "no keeper reported a move of it" if self._free else "not all modules reported it"
            yield f"{step_name} {min(recorded)}: edges on record, but {why}"

    @property
    def _recovered(self) -> bool:
        """Whether the recording says that it holds what could be read of another."""
        return RECOVERED in self._recording.parameters

    def _other_cubes(self, recorded: dict[int, Cube], *, all_of_them: bool) -> Iterator[str]:
        found = self._gatherer.heap.cube_path()
        # Of a run that was cut off the first cubes may be on record, or none.
        most = len(found) if all_of_them else max(recorded, default=0)
        for index in sorted({*recorded, *range(1, most + 1)}):
            cube = recorded.get(index)
            told = None if cube is None else self._actions(cube)
            if not 1 <= index <= len(found) or told != frozenset(found[index - 1]):
                yield f"cube {index} is another than on record"

    def _actions(self, cube: Cube) -> frozenset[Action]:
        system = self._recording.scene.system
        return frozenset(
            system.action(move.generator, site_from_json(move.at)) for move in cube.moves
        )

    def _not_proved(self) -> Iterator[str]:
        path = [action for step in self._gatherer.steps for action in step.actions]
        start = self._recording.scene.start_state
        for record in self._recording.of_kind("certificate"):
            message = _message(self._recording, record)
            if not isinstance(message, Certified):
                continue
            for check, why in check_certificate(message.certificate, path, start).items():
                if why is not None:
                    yield f"the certificate does not prove what was gathered: {check}: {why}"

    def _other_numbers(self, summary: Summary) -> Iterator[str]:
        gatherer = self._gatherer
        found = {
            "rounds": gatherer.rounds,
            "moves": gatherer.heap.moves,
            "reduced_moves": gatherer.heap.reduced_moves,
            "cubes": gatherer.heap.cubes,
            "max_cube_dimension": gatherer.heap.max_cube_dimension,
            "goal_reached": gatherer.reached,
            "path_digest": gatherer.digest,
        }
        for key, value in found.items():
            if getattr(summary, key) != value:
                yield f"{key} is {value}, on record is {getattr(summary, key)}"


def _message(recording: Recording, record: Record) -> Message:
    try:
        return decode(record.data)
    except CubepathError as error:
        raise InputError(f"{_where(recording, record)}: {error}") from None


def _where(recording: Recording, record: Record) -> str:
    return f"{recording.path}: message {record.sequence} ({record.topic})"
