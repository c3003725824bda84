"""What recordings take to be exported, cut and joined, against decoding them in the same run.

    python tests/bench/bench_exporting.py [--quick]

The recordings are long runs with rounds (`tests/samples/long_runs.py`). *read* is a pass over the
messages as bytes; *decoded* is a pass over `Recording.messages`, with which an exporter of your own
would begin, and every other column is a multiple of its time: the `moves` as CSV, the `messages` as
CSV, Parquet and JSON Lines, the file for viewers without and with the robot, a filter that takes
half of the topics, a split into four parts, and the merge of these. Times are processor times of
one thread, medians of several, by turns. *growth* is the slope of log time over log messages of all
of it together against the row before; linear is 1.

Below, the greatest memory that Python took, in MB, measured by itself: what grows with the
recording would show. Nothing is asserted.
"""

import argparse
import statistics
import sys
import time
import tracemalloc
from collections.abc import Callable, Sequence
from functools import partial
from math import log
from pathlib import Path
from shutil import rmtree
from tempfile import TemporaryDirectory

from cubepath.coordinator.tools.exports.exporting import export
from cubepath.protocol.recordings.cutting import filter_recording, merge_recordings, split_recording
from cubepath.protocol.recordings.recording import read_recording
from cubepath.protocol.scenes.specs import scene_from_spec

sys.path.append(str(Path(__file__).parents[1]))
from samples import long_runs

SPEC = "agv:graph=grid10x10,n=60"
SIZES, QUICK_SIZES = (2_500, 10_000, 40_000), (1_000, 4_000)
"""What modules say, in batches."""
REPEATS, QUICK_REPEATS = 3, 1


def read(log_path: Path, _out: Path) -> None:
    """Read all messages as bytes."""
    for _ in read_recording(log_path).records:
        pass


def decoded(log_path: Path, _out: Path) -> None:
    """Read and decode all messages."""
    for _ in read_recording(log_path).messages():
        pass


def table(log_path: Path, out: Path, *, name: str, form: str) -> None:
    """Export a table."""
    export(log_path, out / f"table.{form}", table=name)


def viewed(log_path: Path, out: Path, *, foxglove: bool) -> None:
    """Export a file for viewers."""
    export(log_path, out / "viewed.mcap", foxglove=foxglove)


def filtered(log_path: Path, out: Path) -> None:
    """Take some of the topics."""
    filter_recording(log_path, out / "filtered.mcap", topics=["re*"])


def split(log_path: Path, out: Path) -> None:
    """Split into four parts."""
    split_recording(log_path, out / "parts", parts=4)


def merged(_log_path: Path, out: Path) -> None:
    """Merge the four parts."""
    merge_recordings(sorted((out / "parts").iterdir()), out / "merged.mcap")


WAYS: dict[str, Callable[[Path, Path], None]] = {
    "read": read,
    "decoded": decoded,
    "moves.csv": partial(table, name="moves", form="csv"),
    "msgs.csv": partial(table, name="messages", form="csv"),
    "msgs.parquet": partial(table, name="messages", form="parquet"),
    "msgs.jsonl": partial(table, name="messages", form="jsonl"),
    "mcap": partial(viewed, foxglove=False),
    "foxglove": partial(viewed, foxglove=True),
    "filter": filtered,
    "split": split,
    "merge": merged,
}


def once(
    log_path: Path, folder: Path, measure: Callable[[Callable[[], None]], float]
) -> list[float]:
    """Return what a measure says of each way, on new files."""
    out = folder / "out"
    out.mkdir()
    found = [measure(partial(way, log_path, out)) for way in WAYS.values()]
    rmtree(out)
    return found


def seconds(work: Callable[[], None]) -> float:
    """Return the processor time of some work."""
    began = time.process_time()
    work()
    return time.process_time() - began


def megabytes(work: Callable[[], None]) -> float:
    """Return the greatest memory that Python took during some work."""
    tracemalloc.start()
    work()
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return peak / 1e6


def head(*first: str) -> str:
    """Return the names of the columns."""
    return "".join(f"{each:>13}" for each in (*first, *WAYS))


def times(logs: Sequence[Path], folder: Path, repeats: int) -> None:
    """Print the times by the number of messages."""
    print(head("messages") + f"{'growth':>13}")
    before: tuple[int, float] | None = None
    for log_path in logs:
        count = len(read_recording(log_path).records)
        rows = [once(log_path, folder, seconds) for _ in range(repeats)]
        took = [statistics.median(each) for each in zip(*rows, strict=True)]
        floor = took[1]
        growth = (
            "" if before is None else f"{log(sum(took) / before[1]) / log(count / before[0]):.2f}"
        )
        shown = [
            f"{took[0] / floor:.2f}",
            f"{floor:.2f} s",
            *(f"{t / floor:.2f}" for t in took[2:]),
        ]
        print("".join(f"{each:>13}" for each in (count, *shown, growth)), flush=True)
        before = count, sum(took)


def memory(logs: Sequence[Path], folder: Path) -> None:
    """Print the memory by the number of messages."""
    print(head("messages"))
    for log_path in logs:
        count = len(read_recording(log_path).records)
        found = (f"{each:.1f}" for each in once(log_path, folder, megabytes))
        print("".join(f"{each:>13}" for each in (count, *found)), flush=True)


def main() -> None:
    """Print the tables."""
    options = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    options.add_argument("--quick", action="store_true", help="small sizes")
    quick = options.parse_args().quick
    with TemporaryDirectory() as name:
        folder = Path(name)
        logs = []
        for parts in QUICK_SIZES if quick else SIZES:
            logs.append(folder / f"{parts}.mcap")
            long_runs.write(logs[-1], scene_from_spec(SPEC), parts)
        print(f"times the time of decoding: {SPEC}")
        times(logs, folder, QUICK_REPEATS if quick else REPEATS)
        print("memory in MB")
        memory(logs, folder)


if __name__ == "__main__":
    main()
