"""What `cubepath log record` keeps up with, against a subscriber that only counts, in the same run.

    python tests/bench/bench_record.py [--quick]

A process publishes messages of 200 bytes that block, through a router in a process of its own, to
one other process: *counted* is a subscriber that adds one to a number, *recorded* is `cubepath log
record`, and *any keys* the same with `--keys`. First at 20,000 a second, of which all have to
arrive; processor time is that of the whole receiving process, without its start. Then as fast as it
goes, over numbers of messages. Medians of several, by turns; ratios are over counted. Nothing is
asserted but that nothing is lost.
"""

import argparse
import json
import os
import signal
import statistics
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

from cubepath.protocol.wire.router import Router

TESTS = Path(__file__).parents[1]
RATE, SIZE = 20_000, 200
COUNTS, QUICK_COUNTS = (20_000, 60_000, 180_000), (5_000, 10_000)
HOW = ("counted", "recorded", "any keys")
STEADY, QUICK_STEADY = 100_000, 10_000
COUNTER = """
import sys, time
from cubepath.protocol.wire.sessions import open_client, subscribe
count = 0
def take(sample):
    global count
    count += 1
with open_client(sys.argv[1]) as session:
    subscriber = subscribe(session, "cubepath/**", take)
    print("recording run", file=sys.stderr, flush=True)
    known, since = 0, time.monotonic()
    while count < int(sys.argv[2]) and time.monotonic() - since < 30:
        if count != known:
            known, since = count, time.monotonic()
        time.sleep(0.01)
print('{"messages": %d, "lost": {}}' % count)
"""


def processor_s(pid: int) -> float:
    """Return the processor time that a process has taken, in seconds."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def received(count: int, rate: float, how: str) -> tuple[float, float]:
    """Return the seconds, and the processor time, in which a process receives all messages."""
    with TemporaryDirectory() as folder, Router("tcp/127.0.0.1:0") as router:
        at = router.endpoint
        publish = [
            sys.executable,
            "processes/publisher.py",
            at,
            *map(str, (count, rate, "block", SIZE)),
        ]
        record = [
            "-m",
            "cubepath.coordinator",
            "log",
            "record",
            "--connect",
            at,
            "-o",
            f"{folder}/a.mcap",
            "--json",
            *(["--keys", "cubepath/**"] if how == "any keys" else []),
        ]
        counter = ["-c", COUNTER, at, str(count)]
        receive = [sys.executable, *(counter if how == "counted" else record)]
        pipe = subprocess.PIPE
        with (
            subprocess.Popen(publish, cwd=TESTS, stdin=pipe, stdout=pipe, text=True) as mouth,
            subprocess.Popen(receive, stdout=pipe, stderr=pipe, text=True) as ear,
        ):
            try:
                seconds, spent = _carried(mouth, ear)
                if how == "any keys":  # which have no end
                    ear.send_signal(signal.SIGINT)
                told = json.loads(ear.communicate(timeout=60)[0])
            finally:
                mouth.kill()
                ear.kill()
        if how != "counted":
            assert (told["messages"], told["lost"]) == (count, {}), told
        elif told["messages"] < count:  # it was too slow for the router, which cut it off
            print(f"  counted: {told['messages']:,} of {count:,} came")
        return seconds, spent


def _carried(mouth: subprocess.Popen[str], ear: subprocess.Popen[str]) -> tuple[float, float]:
    """Have all published; return the seconds that took, and the receiver's processor time."""
    if mouth.stdin is None or mouth.stdout is None or ear.stderr is None:
        raise AssertionError("no pipes")  # they were asked for
    mouth.stdout.readline()
    ear.stderr.readline()
    before = processor_s(ear.pid)
    mouth.stdin.write("\n")
    mouth.stdin.flush()
    seconds = float(mouth.stdout.readline().split()[1])
    time.sleep(0.2)  # what is on its way comes, too
    spent = processor_s(ear.pid)
    mouth.stdin.close()
    return seconds, spent - before


def row(name: str, found: Sequence[tuple[float, float]], count: int) -> tuple[float, float]:
    """Print a row; return the medians of messages a second, and of microseconds a message."""
    rate = statistics.median(count / seconds for seconds, _ in found)
    cost = statistics.median(spent / count * 1e6 for _, spent in found)
    print(f"{name:<28}{rate:>12,.0f} a second{cost:>9.1f} us of processor time each")
    return rate, cost


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--quick", action="store_true")
    quick = parser.parse_args(arguments).quick
    repeats = 1 if quick else 5
    cases = [(QUICK_STEADY if quick else STEADY, float(RATE))]
    cases += [(count, 0.0) for count in (QUICK_COUNTS if quick else COUNTS)]
    for count, rate in cases:
        speed = f"at {RATE:,} a second" if rate else "as fast as it goes"
        print(f"{count:,} messages of {SIZE} bytes, {speed}")
        found: dict[str, list[tuple[float, float]]] = {name: [] for name in HOW}
        for _ in range(repeats):
            for name, into in found.items():
                into.append(received(count, rate, name))
        counted, cost = row("  counted", found["counted"], count)
        for name in HOW[1:]:
            written, more = row(f"  {name}", found[name], count)
            print(f"  ratio{'':<23}{written / counted:>10.2f}{more / cost:>19.2f}")


if __name__ == "__main__":
    main()
