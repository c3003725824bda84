"""Recordings: one MCAP file per run, written during the run and checked when read back.

A recording holds every message as the exact bytes that were on the wire, on the topic KIND/SENDER,
with its JSON Schema. Log time is the round, in a run without rounds the level, or on request the
wall clock; publish time is the wall clock in nanoseconds, and sequence the order of writing. The
parameters and versions of the run are a metadata record, the scene is the attachment `scene.toml`,
and an executed schedule is `schedule.jsonl`.

Chunks carry CRCs. A chunk is written when it is full, when half a second has passed, and when the
caller asks for it, which a run does after each round: so a killed process loses less than a second,
and no finished round.

Messages are read back in whole rounds.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence, Set as AbstractSet
from dataclasses import dataclass
from math import inf
from pathlib import Path
from typing import TYPE_CHECKING

from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.input_files import Source, opened
from cubepath.protocol.core.system import Scene
from cubepath.protocol.displays import Displayed
from cubepath.protocol.recordings import description, stored_messages
from cubepath.protocol.recordings.mcap_file import StoredBytes
from cubepath.protocol.recordings.salvaging import Salvage, outline, salvage
from cubepath.protocol.recordings.tables import Columns, claims_of, frame_of, moves_of

if TYPE_CHECKING:
    import pandas as pd


_UNSTORED = 1000
"""Messages in a chunk of a recording that is in no file."""


@dataclass(frozen=True, slots=True)
class Recording(Displayed):
    """What could be read of a recording; `problems` is empty if that is everything.

    Its messages may stay in the file, and are then read whenever they are asked for.
    """

    path: Path
    parameters: Mapping[str, str]
    stored_scene: Scene | None
    """None if it is of messages on any keys, or lost."""
    records: Sequence[stored_messages.Record]
    problems: tuple[str, ...]
    schedule: bytes | None = None
    """The text of the schedule that was executed, if any."""
    size: int = 0
    """Number of bytes read."""
    format: str = description.FORMAT

    @property
    def of_keys(self) -> bool:
        """Return whether it is of messages on any keys, and of no run."""
        return self.format == description.KEYS_FORMAT

    @property
    def scene(self) -> Scene:
        """Return the scene of the run; InputError if it is of no run, or the scene is lost."""
        if self.stored_scene is None:
            what = "messages on any keys" if self.of_keys else "its scene is lost"
            raise InputError(f"{self.path}: {what}, expected the recording of a run")
        return self.stored_scene

    @property
    def clock(self) -> description.Clock:
        """Return the clock of the run: "lockstep" has rounds, "free" has none, nor has no run."""
        return description.clock_of(self.format)

    def of_kind(self, *kinds: str) -> Iterator[stored_messages.Record]:
        """Yield the messages of these kinds in order, also those that are parts of batches."""
        batches = {
            batch for batch, held in description.BATCHES.items() if not held.isdisjoint(kinds)
        }
        for record in self.written({*kinds, *batches}):
            if record.kind in kinds:
                yield record
            else:
                for part in record.parts():
                    # What cannot be decoded may have held some.
                    if part.kind in kinds or part.kind in batches:
                        yield part

    def written(
        self, kinds: AbstractSet[str] | None = None, rounds: range | None = None
    ) -> Iterator[stored_messages.Record]:
        """Yield the messages of these kinds and log times in order, batches as they stand.

        Chunks of the file that hold none are not read.
        """
        records: Iterable[stored_messages.Record] = self.records
        if isinstance(records, stored_messages.StoredRecords):
            records = records.near(kinds, rounds)
        for record in records:
            if (kinds is None or record.kind in kinds) and (
                rounds is None or record.round in rounds
            ):
                yield record

    def messages(
        self, kinds: str | Iterable[str] | None = None, rounds: int | range | None = None
    ) -> Iterator[stored_messages.LoggedMessage]:
        """Yield messages, decoded, in the order of writing, with the times of the log.

        The file is read a chunk at a time while the iterator is consumed, so a recording of any
        length takes the memory of a chunk; chunks without what is asked for are not read.

        >>> recording = read_recording("logs/golden/hex-5.mcap")
        >>> claims = [found.message for found in recording.messages("claim", rounds=3)]
        >>> {(claim.round, claim.module, claim.generator) for claim in claims}
        {(3, 0, 'pivot-0-left')}

        Args: kinds: the kind of message, or several, such as "claim" or ["claim", "verdict"]; the
            parts of batches are kinds too, and come in the place of their batch. A part that was
            sent to two regions appears twice. By default all messages, batches as they are. rounds:
            a log time, or a range of them; by default all.

        InputError if there is no such kind, and where a message cannot be decoded.
        """
        return stored_messages.messages_of(self, kinds, rounds)

    def moves(self) -> Columns:
        """Return the moves of the run: arrays of one length by name, in canonical order.

        >>> moves = read_recording("logs/golden/hex-5.mcap").moves()
        >>> len(moves["round"]), int(moves["module"][0]), moves["from"][0], moves["to"][0]
        (28, 0, (0, 0), (1, -1))

        - ``round``, int64: the round, or without rounds the level;
        - ``module``, int64: the mover;
        - ``generator``, ``at``, objects: the name of the move and the site where it is placed;
        - ``from``, ``to``, objects: the sites of the mover before and after it;
        - ``wall_ns``, int64: the publish time of what reported it.

        They are in order of rounds and then of movers, or without rounds of levels and then of
        generators and places. `InputError` as for `messages`.
        """
        return moves_of(self)

    def claims(self) -> Columns:
        """Return the claims of the run, each with its outcome: arrays of one length by name.

        >>> claims = read_recording("logs/golden/agv-6.mcap").claims()
        >>> len(claims["outcome"]), int((claims["outcome"] == "lost").sum())
        (42, 2)

        - ``round``, int64: the round; of a run without rounds the log time of the attempt;
        - ``module``, int64, and without rounds also its ``epoch`` and the ``number`` of the
          attempt: who claims;
        - ``site``, ``generator``, ``at``, objects: where it stands, and the move that it claims;
        - ``outcome``, object: "granted", "lost", or "" if that is not recorded;
        - ``wall_ns``, int64: the publish time of the claim.

        They are in order of rounds and then of modules, or without rounds of modules, epochs and
        numbers. `InputError` as for `messages`.
        """
        return claims_of(self)

    def frame(self, table: str = "moves") -> pd.DataFrame:
        """Return a table as a data frame of pandas: ``pip install 'cubepath[experiments]'``.

        >>> recording = read_recording("logs/golden/hex-5.mcap")
        >>> recording.frame("moves").groupby("module").size().tolist()
        [7, 7, 7, 7]

        "moves" and "claims" have the columns of `moves` and `claims`. "messages" has a row for each
        message as it was recorded: ``round`` (the log time), ``wall_ns``, ``sequence``, ``kind``,
        ``sender`` and the number of its ``bytes``. InputError if pandas is missing, if there is no
        such table, and as for `messages`.
        """
        return frame_of(self, table)

    def blocks(self) -> Iterator[tuple[Iterable[stored_messages.Record], float]]:
        """Yield the messages some at a time, each time with the least round of those to come.

        That is the round under which they were written; infinity if nothing is to come. So what was
        collected of the rounds before it is complete.
        """
        if isinstance(self.records, stored_messages.StoredRecords):
            return self.records.blocks()
        return iter([(self.records, inf)])

    def chunks(self) -> Sequence[stored_messages.RecordChunk]:
        """Return the chunks of the file in order; the messages of one are read when asked for.

        So a message in the middle of a long recording costs the reading of one chunk.
        """
        records = self.records
        if isinstance(records, stored_messages.StoredRecords):
            return records.chunks()
        some = range(0, len(records), _UNSTORED)
        return [stored_messages.chunk_of(records[begin : begin + _UNSTORED]) for begin in some]

    def topics(self) -> frozenset[str]:
        """Return the recorded topics, at no cost if the file says of all channels what they are.

        >>> sorted(read_recording("logs/golden/hex-5.mcap").topics())[:2]
        ['bundle/process_0', 'bundle/process_1']
        """
        records = self.records
        if isinstance(records, stored_messages.StoredRecords):
            return records.topics
        return frozenset(record.topic for record in records)

    def sha256(self) -> str | None:
        """Return the SHA-256 of the file in hexadecimal, as ``sha256sum`` prints it.

        None for a recording that was not read from a file. The whole file is read.
        """
        records = self.records
        return records.sha256() if isinstance(records, stored_messages.StoredRecords) else None

    def received_ns(self, record: stored_messages.Record) -> int:
        """Return the wall time at which a message was received, in nanoseconds."""
        return record.round if self.of_keys else record.wall_ns

    def counts(self) -> description.Counts:
        """Return how much is in the recording; it is read only if the file does not say so."""
        records = self.records
        if isinstance(records, stored_messages.StoredRecords) and records.counts is not None:
            return records.counts
        found = description.Counts(by_topic=self.of_keys)
        for record in records:
            found.add(record.topic, record.data, self.received_ns(record))
        return found


def read_recording(source: Source) -> Recording:
    """Read a recording with all checks; `problems` lists what is wrong.

    A truncated file yields all its whole chunks, and only a corrupt chunk itself is left out. No
    message is returned without a valid CRC. If the CRCs of the whole file hold, messages are not
    looked at before they are asked for. Raises InputError if the file is no recording, or has lost
    its parameters or its scene.

    >>> recording = read_recording("logs/golden/hex-5.mcap")
    >>> recording.parameters["rule"], len(recording.records), recording.problems
    ('chain', 578, ())
    """
    found = read(source)
    problems = list(found.problems)
    written_as, parameters = description.parameters_in(found.path, found.salvage, problems)
    of_keys = written_as == description.KEYS_FORMAT
    scene = None if of_keys else description.scene_in(found.path, found.salvage)
    return found.recording(written_as, parameters, scene, problems)


@dataclass(frozen=True, slots=True)
class FileContents:
    """What was found in a file, before anyone asks whether that is a recording."""

    path: Path
    size: int
    salvage: Salvage
    records: stored_messages.StoredRecords

    @property
    def problems(self) -> tuple[str, ...]:
        """Return what is wrong with the file."""
        return tuple(self.salvage.problems)

    def _behind(self, problems: Sequence[str]) -> Iterator[str]:
        """Yield what else is wrong, where so much is known to be."""
        if self.records.lost:
            yield f"{self.records.lost} messages belong to channels that are lost"
        elif self.salvage.gap is not None and not problems:
            yield self.salvage.gap

    def recording(
        self,
        written_as: str,
        parameters: Mapping[str, str],
        scene: Scene | None,
        problems: Sequence[str],
    ) -> Recording:
        """Return the recording with what was found in it, and what else is wrong."""
        schedules = (
            each.data for each in self.salvage.attachments if each.name == description.SCHEDULE
        )
        return Recording(
            self.path,
            parameters,
            scene,
            self.records,
            (*problems, *self._behind(problems)),
            next(schedules, None),
            self.size,
            written_as,
        )


def read(source: Source) -> FileContents:
    """Read whatever can be read of a file; InputError if it is empty, or cannot be read."""
    with opened(source) as file:
        stored = StoredBytes(file)
    if not stored.size:
        raise InputError(f"{stored.path}: empty file, expected an MCAP recording")
    whole = outline(stored)
    counts = None if whole is None else description.counts_of(whole)
    found = salvage(stored) if whole is None or counts is None else whole
    records = stored_messages.StoredRecords(
        stored, found, counts, by_wall=description.wall_times_in(found)
    )
    return FileContents(stored.path, stored.size, found, records)


def recording_of(recording: Recording | Source) -> Recording:
    """Return a recording that was read already, or read it."""
    return recording if isinstance(recording, Recording) else read_recording(recording)


def read_undamaged(source: Recording | Source) -> Recording:
    """Read an undamaged recording; InputError names the damage and how to recover the rest."""
    recording = recording_of(source)
    if recording.problems:
        path = recording.path
        raise InputError(
            f"{path}: {'; '.join(recording.problems)}."
            f" 'cubepath log recover {path} -o OUT' writes what can be read"
        )
    return recording


def rounds_in_turn(recording: Recording) -> Iterator[Sequence[stored_messages.Record]]:
    """Yield the messages of some rounds at a time, in the order of rounds, each round whole.

    They come while the file is read, so that memory does not grow with it. Of a run without rounds
    all messages come at once: a commit of any level may be repeated at the very end.
    """
    if recording.clock == "free":
        yield recording.records
        return
    pending: list[stored_messages.Record] = []
    for records, least in recording.blocks():
        pending += records
        ready = [record for record in pending if record.round < least]
        if ready:
            pending = [record for record in pending if record.round >= least]
            yield ready
    yield pending
