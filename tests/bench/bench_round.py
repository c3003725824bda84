"""What a lockstep round costs in processor time, against its bytes and work without a protocol.

    python tests/bench/bench_round.py [--quick]

All processes count: modules, router and coordinator. A *round* is the real thing, with the
recording. Its *floor* is made from that run, in the same run: as many processes put the same bytes
on the same keys, a batch for each phase and region, observe and choose for the same modules from
where these really stood, and the coordinator records; nobody decodes, dispatches, arbitrates or
checks anything. The *wire* is the floor without observing, choosing and recording.
*MB* is the memory of all processes of the real run, with what they share counted once.

Below, what the coordinator spends to find the action of a move that is reported, in processor time:
the first time that this run is gathered, when some of its actions are new, and again. The floor is
a look-up in a plain dictionary by generator and place.
"""

import argparse
import contextlib
import multiprocessing as mp
import os
import resource
import statistics
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from queue import SimpleQueue
from tempfile import TemporaryDirectory

import msgspec
import zenoh
from tqdm import tqdm

from cubepath.agents.environments.rollouts import play
from cubepath.agents.local.observation import goal_sets, observe
from cubepath.agents.processes.dealing import dealt
from cubepath.agents.processes.fleet import LockstepFleet
from cubepath.agents.rules.actor import actors_for
from cubepath.agents.rules.registry import rule_named
from cubepath.agents.rules.uniform import RANDOM
from cubepath.coordinator.runs.conductor import Conductor
from cubepath.protocol.core.catalogue import GeneratorPlacement
from cubepath.protocol.core.sites import Site, site_hook
from cubepath.protocol.core.system import Scene
from cubepath.protocol.recordings.writing import RecordingWriter
from cubepath.protocol.scenes.specs import scene_from_spec
from cubepath.protocol.wire.credentials import COORDINATOR, Credentials
from cubepath.protocol.wire.keys import key_of, to_region, topic_of
from cubepath.protocol.wire.messages import Bundle, Go, Message, Ready, Report, Reports, parts_of
from cubepath.protocol.wire.nodes import Keep
from cubepath.protocol.wire.router import Router
from cubepath.protocol.wire.sessions import open_client, publisher, put, subscribe

PHASES = ("sense", "claim", "settle")
RUN = "bench"
Puts = list[tuple[str, bytes]]


def cpu_s(pid: int) -> float:
    """Return the processor time of a process so far, of all its threads (Linux)."""
    return time.clock_gettime((~pid << 3) | 2)


def memory_mb(pids: list[int]) -> float:
    """Return the memory that processes share out among themselves, in megabytes (Linux)."""
    rolled = (Path(f"/proc/{pid}/smaps_rollup").read_text() for pid in pids)
    lines = (line.split() for text in rolled for line in text.splitlines()[1:])
    return sum(int(line[1]) for line in lines if line[0] == "Pss:") / 1e3


@dataclass
class Recorded:
    """A real run: what each process put in each phase, and where modules stood in each round."""

    scene: Scene
    rounds: int
    processes: int
    puts: dict[tuple[int, int, str], Puts] = field(default_factory=dict)
    """By process, round and phase."""
    gos: dict[tuple[int, str], bytes] = field(default_factory=dict)
    sites: dict[int, dict[int, Site]] = field(default_factory=dict)
    """By round, then by module."""
    messages: int = 0
    parts: int = 0
    cpu_ms: float = 0.0
    wall_ms: float = 0.0
    memory_mb: float = 0.0

    def take(self, message: Message, data: bytes) -> None:
        """Note a message."""
        if isinstance(message, Go):
            self.gos[message.round, message.phase] = data
        elif isinstance(message, Bundle | Ready | Reports):
            phase = "settle" if isinstance(message, Reports) else message.phase
            at = (message.process, message.round, phase)
            self.puts.setdefault(at, []).append((key_of(RUN, message), data))
        for part in parts_of(message):
            if isinstance(part, Report):
                self.sites.setdefault(part.round, {})[part.module] = part.before
            self.parts += isinstance(message, Bundle | Reports)
        self.messages += 1


def real(spec: str, processes: int, rounds: int) -> Recorded:
    """Run modules over zenoh, recorded and gathered, and return what was said and what it cost."""
    scene = scene_from_spec(spec)
    found = Recorded(scene, rounds, processes)
    conductor = Conductor(scene, max_rounds=rounds + 1, record=lambda _: None)
    kept: list[tuple[Message, bytes]] = []
    with (
        TemporaryDirectory() as folder,
        RecordingWriter(Path(folder) / "run.mcap", scene, {}) as writer,
    ):

        def sink(found: Keep[Message], wall_ns: int) -> None:
            message, data = found.message, found.data
            writer.write(topic_of(message), data, round_number=message.round, wall_ns=wall_ns)
            conductor.hear(message)
            kept.append((message, data))

        with LockstepFleet(
            scene,
            "random",
            processes=processes,
            sink=sink,
            plausible=conductor.gatherer.plausibility.check,
        ) as fleet:
            conductor.gatherer.plausibility.know(fleet.modules_of, 0)
            pids = [os.getpid(), *fleet.pids.values()]
            times, walls = [], []
            fleet.play_round()  # whatever is done once is done
            for _ in range(rounds):
                before, began = sum(map(cpu_s, pids)), time.perf_counter()
                fleet.play_round()
                times.append(sum(map(cpu_s, pids)) - before)
                walls.append(time.perf_counter() - began)
            found.memory_mb = memory_mb(pids)
    for message, data in kept:
        found.take(message, data)
    found.cpu_ms = statistics.median(times) * 1e3
    found.wall_ms = statistics.median(walls) * 1e3
    return found


# The floor.


@dataclass(frozen=True)
class Part:
    """What one process of the floor is given."""

    endpoint: str
    credentials: Credentials
    number: int
    spec: str
    modules: list[int]
    rounds: int
    puts: dict[tuple[int, str], Puts]
    sites: dict[int, dict[int, Site]]
    listen: list[str]
    work: bool


def floor_process(part: Part) -> None:
    """Put what was put at every go; observe and choose before claims, if there is work to do."""
    heard: SimpleQueue[bytes] = SimpleQueue()

    def enqueue(sample: zenoh.Sample) -> None:
        heard.put(sample.payload.to_bytes())

    def drop(sample: zenoh.Sample) -> None:
        sample.payload.to_bytes()

    scene = scene_from_spec(part.spec)
    rule = rule_named("random", scene.system)
    actors = actors_for(scene, rule, seed=0, hesitate=0.0, modules=part.modules)
    goals = goal_sets(scene)
    with (
        open_client(part.endpoint, credentials=part.credentials) as session,
        contextlib.ExitStack() as stack,
    ):
        control = subscribe(session, f"cubepath/{RUN}-go", enqueue)
        ears = [subscribe(session, key, drop) for key in part.listen]
        mouths: dict[str, zenoh.Publisher] = {}
        put(session, f"cubepath/{RUN}/ready/process_{part.number}", b"join")
        while (said := heard.get()) != b"stop":
            number, phase = msgspec.json.decode(said)
            if part.work and phase == "claim":
                there = {scene.system.place_of(at): at for at in part.sites[number].values()}
                for module in part.modules:
                    site = part.sites[number][module]
                    actors[module].act(observe(scene.system, site, there, goals=goals[module]))
            for key, data in part.puts.get((number, phase), ()):
                mouth = mouths.get(key)
                if mouth is None:
                    mouth = mouths[key] = publisher(session, key)
                    stack.callback(mouth.undeclare)
                mouth.put(data)
        for ear in (control, *ears):
            ear.undeclare()


def floor(
    recorded: Recorded,
    puts: dict[tuple[int, int, str], Puts],
    listen: list[list[str]],
    modules_of: list[list[int]],
    *,
    work: bool,
) -> tuple[float, float]:
    """Return the processor time and the wall time of a round of the floor, medians in ms."""
    arrived: SimpleQueue[tuple[str, bytes]] = SimpleQueue()

    def enqueue(sample: zenoh.Sample) -> None:
        arrived.put((str(sample.key_expr), sample.payload.to_bytes()))

    spec, rounds = recorded.scene.spec, recorded.rounds
    context = mp.get_context("spawn")
    with contextlib.ExitStack() as stack:
        router = stack.enter_context(Router())
        # What a process may say is looked up for all alike: the floor has that too.
        credentials = router.credentials(COORDINATOR)
        session = stack.enter_context(open_client(router.endpoint, credentials=credentials))
        ear = subscribe(session, f"cubepath/{RUN}/**", enqueue)
        children = []
        for process, modules in enumerate(modules_of):
            mine = {key[1:]: found for key, found in puts.items() if key[0] == process}
            part = Part(
                router.endpoint,
                credentials,
                process,
                spec,
                modules,
                rounds,
                mine,
                recorded.sites,
                listen[process],
                work,
            )
            children.append(context.Process(target=floor_process, args=(part,)))
            children[-1].start()
        for _ in children:
            arrived.get()
        folder = stack.enter_context(TemporaryDirectory())
        writer = stack.enter_context(RecordingWriter(Path(folder) / "run.mcap", recorded.scene, {}))
        mouth = publisher(session, f"cubepath/{RUN}-go")
        pids = [os.getpid(), router.pid, *(int(child.pid or 0) for child in children)]
        times, walls = [], []
        for number in range(1, rounds + 2):
            before, began = sum(map(cpu_s, pids)), time.perf_counter()
            for phase in PHASES:
                mouth.put(msgspec.json.encode([number, phase]))
                due = sum(len(puts.get((p, number, phase), ())) for p in range(len(children)))
                for _ in range(due):
                    key, data = arrived.get()
                    if work:
                        topic = key.split("/", 2)[2]
                        kind = topic.partition("/")[0].replace("to", "bundle")
                        writer.write(
                            f"{kind}/process_0", data, round_number=number, wall_ns=time.time_ns()
                        )
            times.append(sum(map(cpu_s, pids)) - before)
            walls.append(time.perf_counter() - began)
        put(session, f"cubepath/{RUN}-go", b"stop")
        for child in children:
            child.join()
        mouth.undeclare()
        ear.undeclare()
    return statistics.median(times[1:]) * 1e3, statistics.median(walls[1:]) * 1e3


def batches(recorded: Recorded) -> tuple[list[list[str]], list[list[int]]]:
    """Return the keys that each process listens to, and its modules."""
    system = recorded.scene.system
    modules_of = dealt(recorded.scene, recorded.processes)
    listen = [
        sorted(
            {
                to_region(RUN, system.region(system.place_of(recorded.scene.start[module])))
                for module in modules
            }
        )
        for modules in modules_of
    ]
    return listen, modules_of


# Gathering.


def moves_of(spec: str, rounds: int) -> list[GeneratorPlacement]:
    """Return the moves that modules report in a run of random moves, as they are on the wire."""
    played = play(scene_from_spec(spec), RANDOM, max_rounds=rounds)
    return [
        msgspec.json.decode(
            msgspec.json.encode(GeneratorPlacement(move.generator, move.at)),
            type=GeneratorPlacement,
            dec_hook=site_hook,
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
            find(placed.generator, placed.at)
    return (time.process_time() - began) / times / len(moves) * 1e6


def gathering(spec: str, rounds: int) -> None:
    """Print what finding the actions of a run costs."""
    moves = moves_of(spec, rounds)
    system = scene_from_spec(spec).system
    first = found_us(system.action, moves, 1)
    again = found_us(system.action, moves, 5)
    table = {(placed.generator, placed.at): placed for placed in moves}
    dictionary = found_us(lambda generator, at: table[generator, at], moves, 5)
    print(
        f"{spec:<26}{first:>10.2f}{again:>10.2f}{dictionary:>10.2f}{again / dictionary:>10.1f}"
        f"{len(moves):>10}{len(table):>10}",
        flush=True,
    )


def rows(quick: bool) -> Iterator[tuple[str, int, int]]:
    """Yield system, processes and rounds."""
    for count in (16,) if quick else (64, 256, 1024):
        for processes in (4,) if quick else (4, 8):
            yield f"hex:n={count}", processes, 10 if quick else 30
    if not quick:
        yield "agv:graph=grid32x32,n=256", 4, 30
        yield "hex:n=128", 128, 10


def main() -> None:
    """Print the tables."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--quick", action="store_true", help="fewer and smaller rows")
    options.add_argument("--only", help="one system")
    chosen = options.parse_args()
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (min(hard, max(soft, 4096)), hard))
    columns: tuple[str, ...] = (
        "processes",
        "round ms",
        "floor ms",
        "ratio",
        "wire ms",
        "wall ms",
        "messages",
        "parts",
        "MB",
    )
    print(f"{'processor time a round':<26}" + "".join(f"{column:>10}" for column in columns))
    todo = [row for row in rows(chosen.quick) if chosen.only in (None, row[0])]
    for spec, processes, rounds in tqdm(todo, disable=None, leave=False, file=sys.stderr):
        found = real(spec, processes, rounds)
        listen, modules_of = batches(found)
        whole, _ = floor(found, found.puts, listen, modules_of, work=True)
        wire, _ = floor(found, found.puts, listen, modules_of, work=False)
        print(
            f"{spec:<26}{processes:>10}{found.cpu_ms:>10.1f}{whole:>10.1f}"
            f"{found.cpu_ms / whole:>10.2f}{wire:>10.1f}{found.wall_ms:>10.1f}"
            f"{found.messages / (rounds + 1):>10.0f}{found.parts / (rounds + 1):>10.0f}"
            f"{found.memory_mb:>10.0f}",
            flush=True,
        )
    costs = ("first us", "again us", "floor us", "ratio", "moves", "distinct")
    print(f"\n{'a gathered move':<26}" + "".join(f"{column:>10}" for column in costs))
    for family in ("hex:n=", "agv:graph=grid32x32,n="):
        for count in (16,) if chosen.quick else (16, 64, 256):
            gathering(f"{family}{count}", 10 if chosen.quick else 40)


if __name__ == "__main__":
    main()
