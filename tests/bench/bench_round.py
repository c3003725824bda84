"""How long a lockstep round takes, against the bare zenoh round trips that it needs.

    python tests/bench/bench_round.py [--quick]

A round is three phases; each begins when the coordinator says so to every process and ends when
every process has answered. The floor is that alone, measured in the same run: as many processes
that answer at once, three times a round. What lies above it is what the modules say and do.

Below, what the coordinator spends to find the action of a move that is reported, in processor time:
the first time that this run is gathered, when some of its actions are new, and again. The floor is
a look-up in a plain dictionary by generator and place.
"""

from __future__ import annotations

import argparse
import multiprocessing as mp
import statistics
import sys
import time
from collections.abc import Callable
from queue import SimpleQueue

import msgspec
import zenoh
from tqdm import tqdm

from cubepath.agents.environments.rollout import play
from cubepath.agents.processes.fleet import Fleet
from cubepath.agents.rules.uniform import RANDOM
from cubepath.protocol.core.names import GeneratorPlacement
from cubepath.protocol.core.sites import Site, site_from_json
from cubepath.protocol.scenes.specs import scene_from_spec
from cubepath.protocol.wire.sessions import open_client, open_router, put, subscribe

PROCESSES = 4
PHASES = 3


def echo(endpoint: str, number: int) -> None:
    """Answer every `go` at once, until one says stop."""
    heard: SimpleQueue[bytes] = SimpleQueue()

    def enqueue(sample: zenoh.Sample) -> None:
        heard.put(sample.payload.to_bytes())

    with open_client(endpoint) as session:
        subscriber = subscribe(session, "bench/go", enqueue)
        put(session, f"bench/ready/{number}", b"join")
        while heard.get() != b"stop":
            put(session, f"bench/ready/{number}", b"ready")
        subscriber.undeclare()


def floor_ms(rounds: int) -> float:
    """Return the median time of three bare round trips to every process, in milliseconds."""
    router, endpoint = open_router()
    heard: SimpleQueue[bytes] = SimpleQueue()

    def enqueue(sample: zenoh.Sample) -> None:
        heard.put(sample.payload.to_bytes())

    with router, open_client(endpoint) as session:
        subscriber = subscribe(session, "bench/ready/*", enqueue)
        context = mp.get_context("spawn")
        children = [
            context.Process(target=echo, args=(endpoint, number)) for number in range(PROCESSES)
        ]
        for child in children:
            child.start()
        for _ in children:
            heard.get()
        times = []
        for _ in range(rounds):
            began = time.perf_counter()
            for _ in range(PHASES):
                put(session, "bench/go", b"go")
                for _ in children:
                    heard.get()
            times.append(time.perf_counter() - began)
        put(session, "bench/go", b"stop")
        for child in children:
            child.join()
        subscriber.undeclare()
    return statistics.median(times) * 1e3


def round_ms(spec: str, rounds: int) -> tuple[float, float]:
    """Return the median time of a round in milliseconds, and the messages of a round."""
    messages = 0

    def sink(_topic: str, _data: bytes, _wall_ns: int) -> None:
        nonlocal messages
        messages += 1

    with Fleet(scene_from_spec(spec), "random", processes=PROCESSES, sink=sink) as fleet:
        times = []
        began = time.perf_counter()
        for _ in fleet.rounds(rounds):
            now = time.perf_counter()
            times.append(now - began)
            began = now
    return statistics.median(times) * 1e3, messages / rounds


def moves_of(spec: str, rounds: int) -> list[GeneratorPlacement]:
    """Return the moves that modules report in a run of random moves, as they are on the wire."""
    played = play(scene_from_spec(spec), RANDOM, max_rounds=rounds)
    return [
        msgspec.json.decode(
            msgspec.json.encode(GeneratorPlacement(move.generator, move.at)),
            type=GeneratorPlacement,
        )
        for each in played.rounds
        for move in each.moves.values()
    ]


def found_us(
    find: Callable[[str, Site], object], moves: list[GeneratorPlacement], times: int
) -> float:
    """Return the processor time to find the action of a move, in microseconds."""
    began = time.process_time()
    for _ in range(times):
        for placed in moves:
            find(placed.generator, site_from_json(placed.at))
    return (time.process_time() - began) / times / len(moves) * 1e6


def gathering(spec: str, rounds: int) -> None:
    """Print what finding the actions of a run costs."""
    moves = moves_of(spec, rounds)
    system = scene_from_spec(spec).system
    first = found_us(system.action, moves, 1)
    again = found_us(system.action, moves, 5)
    table = {(placed.generator, site_from_json(placed.at)): placed for placed in moves}
    floor = found_us(lambda generator, at: table[generator, at], moves, 5)
    print(
        f"{spec:<26}{first:>10.2f}{again:>10.2f}{floor:>10.2f}{again / floor:>10.1f}"
        f"{len(moves):>10}{len(table):>10}",
        flush=True,
    )


def main() -> None:
    """Print the tables."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--quick", action="store_true", help="fewer rounds")
    rounds = 10 if options.parse_args().quick else 40
    specs = [
        f"{family}{count}"
        for family in ("hex:n=", "agv:graph=grid32x32,n=")
        for count in (16, 64, 256)
    ]
    columns = ("round ms", "floor ms", "ratio", "messages", "us each")
    print(f"{'system':<26}" + "".join(f"{column:>10}" for column in columns))
    for spec in tqdm(specs, disable=None, leave=False, file=sys.stderr):
        floor = floor_ms(rounds)
        took, messages = round_ms(spec, rounds)
        print(
            f"{spec:<26}{took:>10.2f}{floor:>10.2f}{took / floor:>10.1f}{messages:>10.0f}"
            f"{took / messages * 1e3:>10.1f}",
            flush=True,
        )
    costs = ("first us", "again us", "floor us", "ratio", "moves", "distinct")
    print(f"\n{'a gathered move':<26}" + "".join(f"{column:>10}" for column in costs))
    for spec in specs:
        gathering(spec, rounds)


if __name__ == "__main__":
    main()
