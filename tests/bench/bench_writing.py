"""How fast a run is put on record, against the bare writer of the mcap package in the same run.

    python tests/bench/bench_writing.py [--quick]

The messages are those of real runs in one process, first with rounds and then without, written one
by one with their publish times and numbers. *bare* is mcap's own writer, with chunks of the same
size and the same compression: it counts nothing, flushes nothing and checks nothing, and a kill
would cost it a chunk. *written* is the `RecordingWriter` as a run uses it, written out after every
round, and after half a second at the latest; *flushed* is mcap's own writer, flushed after every
round. Times are processor times of one thread, medians of several, by turns; sizes are bytes a
message of the finished file. The growth exponent is the slope of log time over log messages against
the row before; linear is 1.

Below, what a round costs where rounds are small: microseconds and bytes a round, and for how many
bytes more than bare a file has its rounds safe. Nothing is asserted.
"""

import argparse
import statistics
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import islice
from math import log
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from mcap.writer import CompressionType, Writer

from cubepath.protocol.core.system import Scene
from cubepath.protocol.recordings.recording import read_recording
from cubepath.protocol.recordings.stored_messages import Record
from cubepath.protocol.recordings.writing import CHUNK_BYTES, RecordingWriter
from cubepath.protocol.scenes.specs import scene_from_spec

sys.path.append(str(Path(__file__).parents[1]))
from samples import free_runs, long_runs

SPEC = "agv:graph=grid10x10,n=60"
SIZES, QUICK_SIZES = (8_000, 32_000, 128_000), (1_000, 4_000)
SMALL, QUICK_SMALL = ("hex:n=2", "hex:n=8", "hex:n=32", "hex:n=128"), ("hex:n=2", "hex:n=8")
REPEATS, QUICK_REPEATS = 7, 1
Sized = tuple[float, int]
"""Seconds, and bytes of the file."""


@dataclass(frozen=True, slots=True)
class Run:
    """The messages of a run, and how many of them are a round; None without rounds."""

    scene: Scene
    records: Sequence[Record]
    has_rounds: bool

    @property
    def rounds(self) -> int:
        """Return the number of rounds."""
        return len({record.round for record in self.records})


def repeated(records: Sequence[Record], most: int) -> Iterator[Record]:
    """Yield so many messages, those of a run again and again with later rounds."""
    last = max(record.round for record in records) + 1
    for number in range(most):
        record = records[number % len(records)]
        later = number // len(records) * last
        yield replace(record, round=record.round + later, sequence=number)


def with_rounds(spec: str, most: int, folder: Path) -> Run:
    """Return messages of a run with rounds."""
    scene = scene_from_spec(spec)
    path = folder / f"{spec}-{most}.mcap"
    long_runs.write(path, scene, min(most, 20_000))
    records = [
        *islice(read_recording(path).of_kind("go", "bundle", "ready", "reports", "edges"), most)
    ]
    records = [record for record in records if record.round]
    return Run(scene, [*repeated(records, most)], has_rounds=True)


def without(spec: str, most: int) -> Run:
    """Return messages of a run without rounds."""
    recording = free_runs.free_recorded(spec, moves=200)
    kinds = {"commit", "turns", "replies", "forwards", "requests", "tile", "commits"}
    records = [record for record in recording.records if record.kind in kinds]
    return Run(recording.scene, [*repeated(records, most)], has_rounds=False)


def bare(run: Run, path: Path, *, flushed: bool = False) -> None:
    """Write a run with mcap's own writer."""
    channels: dict[str, int] = {}
    number = 0
    with path.open("wb") as stream:
        writer: Any = Writer(stream, chunk_size=CHUNK_BYTES, compression=CompressionType.ZSTD)
        writer.start()
        for record in run.records:
            if flushed and record.round != number:
                writer.flush()
                number = record.round
            channel = channels.get(record.topic)
            if channel is None:
                schema = writer.register_schema(record.kind, "jsonschema", b"{}")
                channel = channels[record.topic] = writer.register_channel(
                    record.topic, "json", schema
                )
            writer.add_message(channel, record.round, record.data, record.wall_ns, record.sequence)
        writer.finish()


def flushed(run: Run, path: Path) -> None:
    """Write a run with mcap's own writer, flushed after each round."""
    bare(run, path, flushed=run.has_rounds)


def written(run: Run, path: Path) -> None:
    """Write a run as it is written when it takes place."""
    number = run.records[0].round
    with RecordingWriter(path, run.scene, {}) as writer:
        for record in run.records:
            if run.has_rounds and record.round != number:
                writer.flush()
                number = record.round
            writer.write(
                record.topic, record.data, round_number=record.round, wall_ns=record.wall_ns
            )


WAYS: tuple[Callable[[Run, Path], None], ...] = (bare, flushed, written)


def measured(run: Run, folder: Path, repeats: int) -> list[Sized]:
    """Return the median processor time of each way, taken by turns, and the size of its file."""
    times: list[list[float]] = [[] for _ in WAYS]
    sizes = [0 for _ in WAYS]
    for _ in range(repeats):
        for place, way in enumerate(WAYS):
            path = folder / "out.mcap"
            began = time.process_time()
            way(run, path)
            times[place].append(time.process_time() - began)
            sizes[place] = path.stat().st_size
            path.unlink()
    return [(statistics.median(each), size) for each, size in zip(times, sizes, strict=True)]


def throughput(
    make: Callable[[int], Run], sizes: Sequence[int], folder: Path, repeats: int
) -> None:
    """Print messages a second by the number of messages."""
    print(
        f"{'messages':>9}{'a round':>9}{'bare/s':>9}{'flushed/s':>11}{'written/s':>11}"
        f"{'x bare':>8}{'bare B':>8}{'flushed B':>11}{'written B':>11}{'growth':>8}"
    )
    before: tuple[int, float] | None = None
    for size in sizes:
        run = make(size)
        (least, small), (often, more), (took, large) = measured(run, folder, repeats)
        growth = "" if before is None else f"{log(took / before[1]) / log(size / before[0]):.2f}"
        each = f"{size / run.rounds:.0f}" if run.has_rounds else "-"
        print(
            f"{size:>9}{each:>9}{size / least:>9.0f}{size / often:>11.0f}{size / took:>11.0f}"
            f"{least / took:>8.2f}{small / size:>8.1f}{more / size:>11.1f}{large / size:>11.1f}"
            f"{growth:>8}",
            flush=True,
        )
        before = size, took


def small_rounds(specs: Sequence[str], most: int, folder: Path, repeats: int) -> None:
    """Print what a round costs by the size of the system."""
    print(
        f"{'system':>12}{'messages':>10}{'bare us':>9}{'flushed us':>12}{'written us':>12}"
        f"{'bare B':>9}{'flushed B':>11}{'written B':>11}{'x bare B':>10}"
    )
    for spec in specs:
        run = with_rounds(spec, most, folder)
        rounds = run.rounds
        (least, small), (often, more), (took, large) = measured(run, folder, repeats)
        us = (f"{each / rounds * 1e6:.0f}" for each in (least, often, took))
        size = (f"{each / rounds:.0f}" for each in (small, more, large))
        told = zip((9, 12, 12, 9, 11, 11), (*us, *size), strict=True)
        print(
            f"{spec:>12}{len(run.records) / rounds:>10.1f}"
            + "".join(f"{each:>{wide}}" for wide, each in told)
            + f"{large / small:>10.2f}",
            flush=True,
        )


def main() -> None:
    """Print the tables."""
    options = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    options.add_argument("--quick", action="store_true", help="small sizes")
    quick = options.parse_args().quick
    sizes = QUICK_SIZES if quick else SIZES
    repeats = QUICK_REPEATS if quick else REPEATS
    with TemporaryDirectory() as name:
        folder = Path(name)
        print(f"with rounds: {SPEC}")
        throughput(lambda most: with_rounds(SPEC, most, folder), sizes, folder, repeats)
        print("without rounds: hex:n=8")
        throughput(lambda most: without("hex:n=8", most), sizes, folder, repeats)
        print("small rounds")
        small_rounds(QUICK_SMALL if quick else SMALL, sizes[0], folder, repeats)


if __name__ == "__main__":
    main()
