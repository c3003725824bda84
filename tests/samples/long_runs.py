"""Long runs without zenoh: modules in one process, and what a coordinator would put on record."""

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

from cubepath.agents.local.module import ModuleCore
from cubepath.agents.local.observation import goal_sets
from cubepath.agents.rules.actor import actors_for
from cubepath.agents.rules.rule import RuleType
from cubepath.agents.rules.uniform import RANDOM
from cubepath.coordinator.normal_form.certificate import certificate_of
from cubepath.coordinator.runs.gatherer import Gatherer
from cubepath.protocol.core.sites import Site
from cubepath.protocol.core.system import Scene
from cubepath.protocol.recordings.writing import RecordingWriter
from cubepath.protocol.wire.keys import addressees, topic_of
from cubepath.protocol.wire.messages import (
    Bundle,
    Certified,
    Claim,
    Cube,
    Edges,
    Go,
    Message,
    Note,
    Part,
    Presence,
    Ready,
    Report,
    Reports,
    Summary,
    Verdict,
    encode,
)
from samples.batched import PROCESSES, batches


def said(
    scene: Scene, rule: RuleType = RANDOM, seed: int = 0, hesitate: float = 0.0
) -> Iterator[list[Part | Report]]:
    """Yield what modules say, round by round without end, as they say it."""
    goals, system = goal_sets(scene), scene.system
    note_length = rule.note_length(len(scene.start))
    actors = actors_for(scene, rule, seed=seed, hesitate=hesitate)
    cores = [
        ModuleCore(system, module=n, site=site, goals=goals[n], seed=seed, note_length=note_length)
        for n, site in enumerate(scene.start)
    ]
    number = 0
    while True:
        number += 1
        found: list[Part | Report] = []
        at = {core.place: core for core in cores}

        def deliver(
            post: Iterable[Message],
            at: dict[Site, ModuleCore] = at,
            found: list[Part | Report] = found,
        ) -> None:
            waiting = [*post]
            for message in waiting:
                assert isinstance(message, Presence | Note | Claim | Verdict)
                found.append(message)
                for place in addressees(system, message) or ():
                    if place in at:
                        waiting += at[place].hear(message)

        deliver([message for core in cores for message in core.sense(number)])
        claims: list[Message] = []
        for core in cores:
            choice = actors[core.module].act(core.observation())
            claims += core.claim(choice.action, choice.note)
        deliver(claims)
        deliver([message for core in cores for message in core.arbitrate()])
        found += [core.report() for core in cores]
        yield found


def write(path: Path, scene: Scene, most_parts: int, *, seed: int = 0) -> int:
    """Write the recording of a run of random moves; return the number of parts in it."""
    written = 0
    gatherer = Gatherer(scene)
    parameters = {"system": scene.spec, "rule": "random", "seed": str(seed), "hesitate": "0.0"}
    with RecordingWriter(path, scene, parameters) as writer:

        def say(message: Message) -> None:
            writer.write(
                topic_of(message),
                encode(message),
                round_number=message.round,
                wall_ns=writer.messages,
            )

        for process in range(PROCESSES):
            say(Ready(0, process, "join"))
        for parts in said(scene, seed=seed):
            number = parts[0].round
            written += len(parts)
            for message in paced(number, [*batches(scene.system, parts)]):
                say(message)
            for part in parts:
                if isinstance(part, Report):
                    gatherer.receive(part)
            step = gatherer.steps[-1]
            say(Edges(number, list(step.executed)))
            if written >= most_parts:
                break
        for result in results(gatherer):
            say(result)
    return written


def paced(number: int, told: Sequence[Bundle | Reports]) -> Iterator[Message]:
    """Yield what is said in a round, with what begins and ends its phases."""
    before: Counter[str] = Counter()
    for phase in ("sense", "claim", "settle"):
        yield Go(number, phase, dict(sorted(before.items())))
        before.clear()
        own: dict[int, Counter[str]] = {process: Counter() for process in range(PROCESSES)}
        for message in told:
            if (message.phase if isinstance(message, Bundle) else "settle") != phase:
                continue
            if isinstance(message, Bundle):
                own[message.process][message.region] += 1
                before[message.region] += 1
            yield message
        for process, counts in own.items():
            yield Ready(number, process, phase, dict(counts))


def results(gatherer: Gatherer) -> Iterator[Cube | Certified | Summary]:
    """Yield what the coordinator says at the end of a run."""
    for index, cube in enumerate(gatherer.schedule(), 1):
        yield Cube(gatherer.rounds, index, list(cube))
    heap = gatherer.heap
    path = [action for step in gatherer.steps for action in step.actions]
    proof = certificate_of(path, start=gatherer.scene.start_state, found=heap.normal_form())
    yield Certified(gatherer.rounds, proof)
    yield Summary(
        round=gatherer.rounds,
        ended="max-rounds",
        error=None,
        rounds=gatherer.rounds,
        moves=heap.moves,
        reduced_moves=heap.reduced_moves,
        cubes=heap.cubes,
        max_cube_dimension=heap.max_cube_dimension,
        goal_reached=gatherer.reached,
        path_digest=gatherer.digest,
    )
