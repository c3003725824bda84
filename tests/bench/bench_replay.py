"""How fast a recording is replayed and sought in, against bare puts and the reading of a chunk.

    python tests/bench/bench_replay.py [--quick]

The recordings are of long runs, every part a message of its own. *puts* is the floor: the same
bytes on the same keys from one session through a router to another, which counts them, and nothing
is decoded. *replay* reads, puts, gathers and compares. Both are wall-clock messages a second with
the router in a process of its own, medians of several by turns; *x puts* is their ratio. *peak kB*
is the most that Python allocates while it is replayed, the recording included.

*seek ms* is a seek to a round, with the state there: the median of 25 seeks to rounds all over the
file, each by a player that has looked at nothing before (*first*), and by one and the same player
(*next*). *chunk ms* is the floor, the reading of one chunk. *seek kB* is the most that a player
allocates for 25 seeks. The longest recording, in which only is sought, is the shortest again and
again, in later rounds. The growth exponent is the slope of log time over log messages against the
row before: of a seek it should be near 0. Nothing is asserted.
"""

import argparse
import statistics
import sys
import time
import tracemalloc
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import replace
from math import log
from pathlib import Path
from queue import SimpleQueue
from tempfile import TemporaryDirectory
from typing import Any

from cubepath.coordinator.playback.machine import Machine, read_order
from cubepath.coordinator.playback.player import replay
from cubepath.coordinator.playback.selection import SAID, KeyMapping, PlayedMessages, RecordedStates
from cubepath.coordinator.playback.timeline import Timeline
from cubepath.protocol.recordings.recording import Recording, read_recording
from cubepath.protocol.recordings.stored_messages import Record
from cubepath.protocol.recordings.writing import copy_recording
from cubepath.protocol.scenes.specs import scene_from_spec
from cubepath.protocol.wire.credentials import COORDINATOR
from cubepath.protocol.wire.router import Router
from cubepath.protocol.wire.sessions import open_client, put, subscribe

sys.path.append(str(Path(__file__).parents[1]))
from processes.ears import wait_for_subscriber
from samples import long_runs

SPEC = "agv:graph=grid10x10,n=60"
SIZES, QUICK_SIZES = (10_000, 100_000), (1_000, 4_000)
LAPS, QUICK_LAPS = 100, 10
REPEATS, QUICK_REPEATS = 5, 1
SEEKS = 25


class Repeated(Sequence[Record]):
    """The messages of a recording so many times, each time in later rounds."""

    def __init__(self, recording: Recording, laps: int) -> None:
        self._records = recording.records
        self._laps = laps
        self._rounds = max(record.round for record in recording.records)

    def __len__(self) -> int:
        return len(self._records) * self._laps

    def __iter__(self) -> Iterator[Record]:
        number = 0
        for lap in range(self._laps):
            later = lap * self._rounds
            for record in self._records:
                at = record.round + later
                data = record.data.replace(b'"round":%d,' % record.round, b'"round":%d,' % at, 1)
                yield replace(record, data=data, round=at, sequence=number)
                number += 1

    def __getitem__(self, index: Any) -> Any:
        return tuple(self)[index]


def puts(messages: Sequence[tuple[str, bytes]]) -> float:
    """Return how long bare puts take until all have arrived."""
    with ExitStack() as opened:
        router = opened.enter_context(Router())
        mouth = open_client(router.endpoint, credentials=router.credentials(COORDINATOR))
        opened.callback(mouth.close)
        ear = open_client(router.endpoint)
        opened.callback(ear.close)
        came: SimpleQueue[tuple[str, bytes]] = SimpleQueue()
        heard = subscribe(
            ear, "cubepath/**", lambda each: came.put((str(each.key_expr), each.payload.to_bytes()))
        )
        opened.callback(heard.undeclare)
        wait_for_subscriber(mouth, "cubepath/r/probe")
        began = time.perf_counter()
        for key, data in messages:
            put(mouth, key, data)
        for _ in messages:
            came.get(timeout=60)
        return time.perf_counter() - began


def whole(recording: Recording) -> float:
    """Return how long a replay takes; it must come to the same."""
    found = replay(recording)
    if not found.same:
        raise AssertionError(found.result)
    return found.seconds


def seek(reel: Timeline, states: RecordedStates, number: int) -> float:
    """Return how long it takes to a round, and to the state there."""
    machine = Machine(reel, PlayedMessages(reel.recording), paused=True)
    began = time.perf_counter()
    machine.order(read_order("seek", {"to": str(number)}), 0.0)
    states.at(machine.mark)
    return time.perf_counter() - began


def peak(work: Callable[[], object]) -> int:
    """Return the greatest number of bytes allocated during some work."""
    tracemalloc.start()
    work()
    found = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return found


def row(path: Path, repeats: int, before: tuple[int, float] | None) -> tuple[int, float]:
    """Print a line for a recording; return its messages and the time of a seek."""
    recording = read_recording(path)
    messages = len(recording.records)
    reel = Timeline(recording)
    last = reel.step_at(reel.end)
    rounds = [1 + (last - 1) * each // (SEEKS - 1) for each in range(SEEKS)]
    order = [rounds[each * 7 % SEEKS] for each in range(SEEKS)]

    def fresh(number: int) -> float:
        own = Timeline(recording)
        return seek(own, RecordedStates(own), number)

    first = statistics.median(map(fresh, order))
    states = RecordedStates(reel)
    following = statistics.median(seek(reel, states, number) for number in order)
    chunks = recording.chunks()
    began = time.perf_counter()
    for each in chunks[:SEEKS]:
        each.read()
    chunk = (time.perf_counter() - began) / min(SEEKS, len(chunks))
    seeking = peak(lambda: [fresh(number) for number in order])
    told = f"{messages:>9}"
    if repeats:
        keys = KeyMapping(recording, "r")
        bare = [(keys.key(each), each.data) for each in recording.of_kind(*SAID)]
        times = [(puts(bare), whole(recording)) for _ in range(repeats)]
        floor, replayed = (statistics.median(each) for each in zip(*times, strict=True))
        memory = peak(lambda: whole(read_recording(path)))
        told += f"{len(bare) / floor:>10.0f}{len(bare) / replayed:>10.0f}{replayed / floor:>8.1f}"
        told += f"{memory / 1e3:>9.0f}"
    else:
        told += f"{'-':>10}{'-':>10}{'-':>8}{'-':>9}"
    growth = ""
    if before is not None:
        growth = f"{log(first / before[1]) / log(messages / before[0]):.2f}"
    told += f"{chunk * 1e3:>9.2f}{first * 1e3:>9.2f}{following * 1e3:>9.2f}{seeking / 1e3:>9.0f}"
    print(f"{told}{growth:>8}", flush=True)
    return messages, first


def main() -> None:
    """Print the table."""
    options = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    options.add_argument("--quick", action="store_true", help="small sizes")
    quick = options.parse_args().quick
    heads = ("messages", "puts", "replay", "x puts", "peak kB", "chunk ms", "first", "next")
    widths = (9, 10, 10, 8, 9, 9, 9, 9)
    named = "".join(f"{head:>{wide}}" for head, wide in zip(heads, widths, strict=True))
    print(f"{named}{'seek kB':>9}{'growth':>8}")
    before: tuple[int, float] | None = None
    with TemporaryDirectory() as folder:
        for size in QUICK_SIZES if quick else SIZES:
            path = Path(folder) / f"{size}.mcap"
            long_runs.write(path, scene_from_spec(SPEC), size)
            before = row(path, QUICK_REPEATS if quick else REPEATS, before)
        base = read_recording(Path(folder) / f"{(QUICK_SIZES if quick else SIZES)[0]}.mcap")
        laps = Repeated(base, QUICK_LAPS if quick else LAPS)
        path = Path(folder) / "repeated.mcap"
        copy_recording(replace(base, records=laps), path)
        row(path, 0, before)


if __name__ == "__main__":
    main()
