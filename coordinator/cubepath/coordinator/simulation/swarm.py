"""Many seeds, each a run with faults of its own: what came of them, and the failing ones kept.

Room: coordinator. A failing seed is shrunk; what is left of it is written as a recording, with a
picture of its messages.
"""

from __future__ import annotations

import shlex
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from random import Random
from typing import Any

from cubepath.coordinator.simulation.faults import KINDS, Drawn, Listed
from cubepath.coordinator.simulation.scenarios import ANYTHING, Asked, scenario_of
from cubepath.coordinator.simulation.sequence import sequence_picture
from cubepath.coordinator.simulation.shrinking import shrunk
from cubepath.coordinator.simulation.simulated import (
    COORDINATOR,
    LIE,
    PATIENCE_US,
    MakeNode,
    Simulated,
    host_node,
    process_names,
    simulate,
)
from cubepath.coordinator.simulation.trace import Trace
from cubepath.protocol.core.errors import CheckError, CubepathError
from cubepath.protocol.recordings.recording import RecordingWriter
from cubepath.protocol.wire.messages import Again, Go, Ready, Said, Waiting, decode, kind_of

OUTCOMES = ("goal", "max-rounds", "gave-up", "crash", "return", "stall", LIE, "failure")
"""How a run can come out: it ends as without faults in the first three, or by one, or it fails."""
_SAME_NAMES_MAX = 1000


@dataclass(frozen=True, slots=True)
class Kept:
    """A failing seed: what failed, the command that replays it, and the files of its remainder."""

    seed: int
    kind: str
    detail: str
    command: str
    log: str
    pictures: tuple[str, ...]
    system: str
    rule: str
    modules: int
    rounds: int
    faults: tuple[str, ...]

    def document(self) -> dict[str, Any]:
        """Return the keys of an entry of ``failed`` of ``cubepath simulate --json``."""
        found = {key: getattr(self, key) for key in self.__slots__}
        return found | {"pictures": list(self.pictures), "faults": list(self.faults)}


@dataclass(slots=True)
class Tally:
    """What came of the seeds so far."""

    seeds: int = 0
    steps: int = 0
    rounds: int = 0
    virtual_seconds: float = 0.0
    faults: Counter[str] = field(default_factory=lambda: Counter(dict.fromkeys(KINDS, 0)))
    outcomes: Counter[str] = field(default_factory=lambda: Counter(dict.fromkeys(OUTCOMES, 0)))
    failed: list[Kept] = field(default_factory=list)

    def add(self, run: Simulated) -> None:
        """Count a run."""
        self.seeds += 1
        self.steps += run.steps
        self.rounds += run.rounds
        self.virtual_seconds += run.seconds
        self.faults.update(fault.kind for fault in run.fired)
        self.outcomes[run.outcome] += 1

    def document(self, seconds: float) -> dict[str, Any]:
        """Return the keys of ``cubepath simulate --json``."""
        return {
            "seeds": self.seeds,
            "failures": self.outcomes["failure"],
            "steps": self.steps,
            "rounds": self.rounds,
            "faults": dict(self.faults),
            "outcomes": dict(self.outcomes),
            "failed": [kept.document() for kept in self.failed],
            "virtual_seconds": round(self.virtual_seconds, 3),
            "seconds": round(seconds, 3),
            "seeds_per_second": round(self.seeds / seconds, 2) if seconds else 0.0,
        }


def run_of(seed: int, asked: Asked = ANYTHING, *, make: MakeNode = host_node) -> Simulated:
    """Simulate the run that a seed stands for, with the faults that are drawn from it."""
    scenario = scenario_of(seed, asked)
    random = Random(f"{seed}/faults")  # noqa: S311 - not for secrets
    lies = Random(f"{seed}/lies") if asked.liars else None  # noqa: S311 - not for secrets
    faults = Drawn(random, COORDINATOR, process_names(scenario), PATIENCE_US, lies)
    return simulate(scenario, faults, fault_seed=seed, make=make)


def simulate_seeds(
    seeds: Iterable[int],
    asked: Asked,
    folder: Path,
    tally: Tally,
    *,
    failing: Callable[[int], object] | None = None,
    make: MakeNode = host_node,
) -> Iterator[Kept | None]:
    """Simulate the seeds one by one and count them; yield for each what was kept, if it failed.

    `failing` is called with a seed that fails before it is shrunk.
    """
    for seed in seeds:
        found = run_of(seed, asked, make=make)
        tally.add(found)
        if found.failure is None:
            yield None
            continue
        if failing is not None:
            failing(seed)
        kept = keep(shrunk(found, seed, make=make), seed, asked, folder, make=make)
        tally.failed.append(kept)
        yield kept


def command_of(seed: int, asked: Asked) -> str:
    """Return the command that simulates this seed alone."""
    return shlex.join(["cubepath", "simulate", "--seeds", f"{seed}..{seed}", *asked.arguments()])


def keep(
    run: Simulated, seed: int, asked: Asked, folder: Path, *, make: MakeNode = host_node
) -> Kept:
    """Write a failing run as a recording, with pictures of its messages beside it.

    InputError or CheckError if they cannot be written.
    """
    if run.failure is None:
        raise ValueError("a run that holds is not kept")
    log = _new_name(folder, f"simulated-{seed}")
    recording = run.recording
    parameters = {**recording.parameters, "simulated": f"seed {seed}: {run.failure.detail}"}
    with RecordingWriter(log, recording.scene, parameters) as writer:
        for record in recording.records:
            writer.write(
                record.topic, record.data, round_number=record.round, wall_ns=record.wall_ns
            )
    trace = Trace()
    faults = Listed(run.fired)
    simulate(run.scenario, faults, fault_seed=seed, trace=trace, make=make)
    # Not the name of the log alone: that is where `cubepath view` draws the states.
    pictures = tuple(log.with_name(f"{log.stem}-messages{kind}") for kind in (".svg", ".png"))
    names = [COORDINATOR, *process_names(run.scenario)]
    title = f"seed {seed}: {run.failure.detail}"
    for picture in pictures:
        sequence_picture(trace, names, picture, title=_short(title), label=label)
    return Kept(
        seed=seed,
        kind=run.failure.kind,
        detail=run.failure.detail,
        command=command_of(seed, asked),
        log=str(log),
        pictures=tuple(map(str, pictures)),
        system=run.scenario.system,
        rule=run.scenario.rule,
        modules=len(run.scenario.scene.start),
        rounds=run.rounds,
        faults=tuple(
            f"{fault.kind} at {fault.where} {fault.nth}"
            + (f" for {fault.amount_us} us" if fault.amount_us else "")
            for fault in run.fired
        ),
    )


def _new_name(folder: Path, stem: str) -> Path:
    """Return the first name that no recording has; earlier ones are never overwritten."""
    names = (f"{stem}{f'-{number}' if number > 1 else ''}.mcap" for number in range(1, 1000))
    for name in names:
        if not (folder / name).exists():
            return folder / name
    raise CheckError(f"{folder}: holds {_SAME_NAMES_MAX} recordings {stem}, expected fewer")


def _short(title: str) -> str:
    return title if len(title) <= 160 else title[:157] + "..."


def label(data: bytes) -> str:
    """Return in a few words what a message is, for a picture."""
    try:
        message = decode(data)
    except CubepathError:
        return "no message"
    match message:
        case Go() | Ready() | Again() | Waiting():
            return f"{kind_of(message)} {message.round} {message.phase}"
        case Said():
            kinds = Counter(kind_of(part) for part in message.parts)
            told = ", ".join(kind if n == 1 else f"{n} {kind}" for kind, n in kinds.items())
            return f"{told} to {message.region}"
        case _:
            return f"{kind_of(message)} {message.round}"
