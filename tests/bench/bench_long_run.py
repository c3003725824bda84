"""What a long run over zenoh keeps in memory, and what it takes to read its recording.

    python tests/bench/bench_long_run.py [--quick]

Sixty vehicles move at random on a grid until their modules have said about two million messages,
parts of batches counted one by one (some minutes). Memory is what is resident (Linux): of the
module processes and the router after the first fifth of the run and at its end, which should be
the same, and of the coordinator for each move that is left after cancelling, from the first fifth
(the compiled heap is loaded by then) to the end of the rounds and to its peak, which comes when it
writes its results. Then `info` and `verify` of the
recording, each in a process of its own: real time, and the most that was resident.
"""

import argparse
import contextlib
import json
import subprocess
import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory

SPEC = "agv:graph=grid10x10,n=60"
PROCESSES = 3
_CUBEPATH = [sys.executable, "-m", "cubepath.coordinator"]
_MEASURED = """
import json, resource, sys, time
from cubepath.coordinator.commands.main import main
began = time.perf_counter()
code = main(sys.argv[1:])
peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
print(json.dumps([code, time.perf_counter() - began, peak]), file=sys.stderr)
"""


def resident_kb(pid: int, key: str = "VmRSS") -> int:
    """Return what is resident of a process, in kB; 0 if it has ended."""
    try:
        lines = Path(f"/proc/{pid}/status").read_text().splitlines()
    except FileNotFoundError:
        return 0
    return next((int(line.split()[1]) for line in lines if line.startswith(key)), 0)


def processes_of(pid: int) -> dict[str, int]:
    """Return the process ids of a run by what they are."""
    found = {"coordinator": pid}
    with contextlib.suppress(OSError):  # one of them has just ended
        for task in Path(f"/proc/{pid}/task").iterdir():
            for child in (task / "children").read_text().split():
                command = Path(f"/proc/{child}/cmdline").read_bytes().split(b"\0")
                if b"-m" not in command:
                    continue  # it has just been started, or has just ended
                name = command[command.index(b"-m") + 1].decode().rpartition(".")[2]
                found[f"{name} {len(found)}" if name == "host" else name] = int(child)
    return found


def watched(log: Path, rounds: int) -> tuple[list[dict[str, int]], dict[str, object], int]:
    """Run, and return what was resident every second, what was said of the run, and the peak."""
    command = [*_CUBEPATH, "run", SPEC, "--rule=random", f"--max-rounds={rounds}", "--seed=1"]
    child = subprocess.Popen(
        [*command, f"--processes={PROCESSES}", f"--log={log}", "--json"],
        stdout=subprocess.PIPE,
        text=True,
    )
    samples: list[dict[str, int]] = []
    peak = 0
    while child.poll() is None:
        time.sleep(1)
        if child.poll() is None:
            sample = {name: resident_kb(pid) for name, pid in processes_of(child.pid).items()}
            peak = max(peak, resident_kb(child.pid, "VmHWM"))
            if len(sample) == PROCESSES + 2:
                samples.append(sample)
    said, _ = child.communicate()
    return samples, json.loads(said), peak


def measured(*arguments: str) -> tuple[float, int, str]:
    """Run a command in a process of its own; return its time in s, its peak in kB, its output."""
    done = subprocess.run(
        [sys.executable, "-c", _MEASURED, *arguments], capture_output=True, text=True, check=False
    )
    code, took, peak = json.loads(done.stderr.splitlines()[-1])
    if code != 0:
        raise SystemExit(f"{arguments}: exit code {code}: {done.stdout[-500:]}")
    return took, peak, done.stdout


def main() -> None:
    """Print the tables."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--quick", action="store_true", help="a hundredth of the rounds")
    rounds = 95 if options.parse_args().quick else 9500
    with TemporaryDirectory() as folder:
        log = Path(folder) / "run.mcap"
        began = time.perf_counter()
        samples, said, peak = watched(log, rounds)
        took = time.perf_counter() - began
        first, last = samples[len(samples) // 5], samples[-1]
        print(f"{SPEC}, {PROCESSES} processes: {said['rounds']} rounds in {took:.0f} s")
        print(f"{'':<16}{'first MB':>10}{'last MB':>10}{'ratio':>8}")
        for name in first:
            ratio = last.get(name, 0) / first[name]
            print(
                f"{name:<16}{first[name] / 1024:>10.1f}{last.get(name, 0) / 1024:>10.1f}"
                f"{ratio:>8.3f}"
            )
        moves, reduced = int(str(said["moves"])), int(str(said["reduced_moves"]))
        start, further = first["coordinator"], reduced * 4 / 5
        print(
            f"coordinator: {moves} moves, {reduced} reduced; {peak / 1024:.0f} MB at the most:"
            f" {(last['coordinator'] - start) * 1024 / further:.0f} bytes a further reduced move in"
            f" the rounds, {(peak - start) * 1024 / further:.0f} with the results"
        )
        took, most, shown = measured("log", "info", str(log), "--json")
        document = json.loads(shown)
        parts = sum(document["parts"].values())
        print(
            f"recording: {document['bytes'] / 1e6:.0f} MB, {document['messages']} messages on the"
            f" wire with {parts} parts"
        )
        print(f"info: {took:.2f} s, {most / 1024:.0f} MB")
        took, most, _ = measured("verify", str(log))
        print(
            f"verify: {took:.1f} s, {parts / took:.0f} parts and {document['messages'] / took:.0f}"
            f" messages a second, {most / 1024:.0f} MB"
        )


if __name__ == "__main__":
    main()
