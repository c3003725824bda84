"""Traces of simulated runs under either clock: messages and their fate, faults, and the outcome.

A result is one seed of ``cubepath simulate``: its scenario, the faults that fired, the whole trace
of the simulated wire with each message decoded, the recording or the commits, and the outcome. ::

    python tests/nets/traces.py take free.gz --clock free --count 1000 -n 2
    python tests/nets/traces.py compare old.gz new.gz --words words.json

Some minutes and 15 MB for 1,000 seeds under one clock. What a seed stands for hangs on the random
numbers of rules: once these are drawn otherwise, traces have to be taken anew. Beyond the four
imports, fields of runs and traces are read in `taken` alone.
"""

from __future__ import annotations

import sys
import time
from functools import cache
from multiprocessing import get_context
from typing import Any

from words import compared, parser, plain, text_of, write

from cubepath.coordinator.simulation.network import Trace
from cubepath.coordinator.simulation.scenarios import ScenarioOptions
from cubepath.coordinator.simulation.swarm import FreeSwarm, LockstepSwarm


class _Lockstep(LockstepSwarm):
    """Keeps the trace of its last run."""

    trace: Trace

    def play(self, seed: Any, scenario: Any, faults: Any, trace: Any = None) -> Any:
        self.trace = trace or Trace()
        return super().play(seed, scenario, faults, self.trace)


class _Free(FreeSwarm):
    """Keeps the trace of its last run."""

    trace: Trace

    def play(self, seed: Any, scenario: Any, faults: Any, trace: Any = None) -> Any:
        self.trace = trace or Trace()
        return super().play(seed, scenario, faults, self.trace)


@cache
def _simulator(clock: str, liars: bool) -> _Lockstep | _Free:
    return (
        _Free(ScenarioOptions(clock="free"))
        if clock == "free"
        else _Lockstep(ScenarioOptions(liars=liars))
    )


def taken(job: tuple[str, bool, int]) -> tuple[str, bytes]:
    """Return the name of a seed, and the canonical text of all that happened."""
    clock, liars, seed = job
    simulator = _simulator(clock, liars)
    run: Any = simulator.run_of(seed)
    trace = simulator.trace
    found = {
        "scenario": plain(run.scenario),
        "fired": plain(run.fired),
        "outcome": run.outcome,
        "failure": plain(run.failure),
        "long": run.long,
        "steps": run.steps,
        "seconds": run.seconds,
        "arrows": [
            [
                each.begin_us,
                each.end_us,
                each.sender,
                each.receiver,
                each.key,
                plain(each.data),
                each.fate,
            ]
            for each in trace.arrows
        ],
        "spans": [[each.begin_us, each.end_us, each.who, each.kind] for each in trace.spans],
        "remarks": [[each.at_us, each.who, each.text] for each in trace.remarks],
    }
    if clock == "free":
        found |= {
            "commits": plain(run.commits),
            "messages": run.messages,
            "moved": run.moved_seconds,
        }
    else:
        found |= {
            "ending": plain(run.ending),
            "parameters": plain(run.recording.parameters),
            "records": [
                [each.topic, plain(each.data), each.round, each.wall_ns, each.sequence]
                for each in run.recording.records
            ],
        }
    return f"seed {seed}", text_of(found)


def main() -> int:
    """Take traces, or compare them."""
    found, take = parser(__doc__)
    take.add_argument("--count", type=int, default=1000, help="the seeds from 0 on")
    take.add_argument("--clock", choices=("lockstep", "free"), default="lockstep")
    take.add_argument("--liars", action="store_true", help="let processes lie; lockstep alone")
    take.add_argument("-n", type=int, default=1, metavar="N", help="processes")
    options = found.parse_args()
    if options.command == "compare":
        return compared(options)
    began = time.monotonic()
    jobs = [(options.clock, options.liars, seed) for seed in range(options.count)]
    with get_context("spawn").Pool(options.n) as pool:
        count = write(options.file, pool.imap(taken, jobs, 8))
    megabytes = options.file.stat().st_size / 1e6
    print(f"{count} seeds, {megabytes:.1f} MB, {time.monotonic() - began:.0f} s")
    return 0


if __name__ == "__main__":
    sys.exit(main())
