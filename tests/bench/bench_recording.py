"""How long recordings are written, described and verified, against reading their bytes alone.

    python tests/bench/bench_recording.py [--quick] [--free MOVES]

A recording is made of 60 vehicles that move at random, in one process, with each part as a message
of its own and in batches. So is one without rounds, of which the parts are its messages, with a
line for the time that a move takes; ``--free`` gives its length, and it is made 8 times as long
too. Times are processor times of one thread, in parts a second; ``write``
appends the same messages to a new file; ``verify`` derives everything, ``audit`` asks the rules as
well, which are random here. The floor is bare reading in the same run: each chunk
unpacked by the mcap package with its CRC, each message decoded by msgspec. ``info`` is in
milliseconds. Memory is the greatest that Python has allocated meanwhile, measured in a run of its
own, in bytes a part. The last columns are of the audit: the growth exponent is the slope of log
time over log parts against the row before; linear is 1. Nothing is asserted.
"""

import argparse
import sys
import time
import tracemalloc
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from math import log
from pathlib import Path
from tempfile import TemporaryDirectory

from mcap.records import Chunk, Message
from mcap.stream_reader import StreamReader, breakup_chunk

from cubepath.coordinator.auditing.rule_audit import audit
from cubepath.coordinator.runs.contents import info
from cubepath.coordinator.verification.findings import Verification
from cubepath.coordinator.verification.recording import verify
from cubepath.protocol.recordings.recording import Recording, read_recording
from cubepath.protocol.recordings.writing import copy_recording
from cubepath.protocol.scenes.specs import scene_from_spec
from cubepath.protocol.wire.free_messages import decode_free
from cubepath.protocol.wire.messages import decode

sys.path.append(str(Path(__file__).parents[1]))
from samples.free_runs import write_long
from samples.long_runs import write

SPEC = "agv:graph=grid10x10,n=60"
SIZES = (20_000, 60_000, 180_000)
QUICK_SIZES = (5_000, 10_000)
_WIDTHS = (10, 10, 9, 10, 10, 10, 9, 9, 8)


def seconds(work: Callable[[], object]) -> float:
    """Return the processor time of some work."""
    began = time.process_time()
    work()
    return time.process_time() - began


def floor(path: Path, decode: Callable[[bytes], object]) -> None:
    """Read a recording and decode its messages, and nothing else."""
    with path.open("rb") as stream:
        for record in StreamReader(stream, emit_chunks=True).records:
            if isinstance(record, Chunk):
                for each in breakup_chunk(record, validate_crc=True):
                    if isinstance(each, Message):
                        decode(each.data)


def check(path: Path, how: Callable[[Recording], Verification] = audit) -> None:
    """Check a recording, which is right."""
    found = how(read_recording(path))
    if not found.ok:
        raise AssertionError([each for each in found.checks if not each.ok])


def peak(work: Callable[[], object]) -> int:
    """Return the greatest number of bytes allocated during some work."""
    tracemalloc.start()
    work()
    found = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return found


def row(path: Path, copy: Path, parts: int, before: tuple[int, float] | None) -> float:
    """Print a line for a recording; return how long verifying took."""
    recording = read_recording(path)
    messages = len(recording.records)
    in_memory = replace(recording, records=tuple(recording.records))
    writing = seconds(partial(copy_recording, in_memory, copy))
    del in_memory
    telling = seconds(lambda: info(read_recording(path)))
    free = recording.clock == "free"
    least = seconds(partial(floor, path, decode_free if free else decode))
    deriving = seconds(partial(check, path, verify))
    checking = seconds(partial(check, path))
    growth = ""
    if before is not None:
        growth = f"{log(checking / before[1]) / log(parts / before[0]):.2f}"
    memory = peak(partial(check, path)) / parts
    print(
        f"{parts:>9}{messages:>10}{parts / writing:>10.0f}{telling * 1e3:>9.1f}"
        f"{parts / least:>10.0f}{parts / deriving:>10.0f}{parts / checking:>10.0f}"
        f"{checking / least:>9.1f}"
        f"{memory:>9.0f}{growth:>8}",
        flush=True,
    )
    if free:
        moves = verify(path).moves
        print(
            f"{moves:>9} moves: {deriving / moves * 1e3:.3f} ms a move to verify,"
            f" {checking / moves * 1e3:.3f} to audit"
        )
    return checking


def main() -> None:
    """Print the tables."""
    options = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    options.add_argument("--quick", action="store_true", help="small sizes")
    options.add_argument("--free", type=int, metavar="MOVES", help="without rounds alone")
    given = options.parse_args()
    sizes = QUICK_SIZES if given.quick else SIZES
    heads = (
        "messages",
        "write",
        "info ms",
        "floor",
        "verify",
        "audit",
        "x floor",
        "B/part",
        "growth",
    )
    columns = [f"{head:>{wide}}" for head, wide in zip(heads, _WIDTHS, strict=True)]
    scene = scene_from_spec(SPEC)
    with TemporaryDirectory() as folder:
        moves = given.free or (250 if given.quick else 1_000)
        for clock in ("free",) if given.free else ("lockstep", "free"):
            print(f"{clock}\n{'parts':>9}" + "".join(columns))
            before: tuple[int, float] | None = None
            for size in sizes if clock == "lockstep" else (moves, 8 * moves):
                path = Path(folder) / f"{clock}-{size}.mcap"
                if clock == "lockstep":
                    parts = write(path, scene, size)
                else:
                    parts = write_long(path, SPEC, size)
                took = row(path, path.with_suffix(".copy"), parts, before)
                before = parts, took


if __name__ == "__main__":
    main()
