"""Many seeds, each a run with faults of its own: what came of them, and the failing ones kept.

A failing seed is shrunk; what is left of it is written as a recording, with a picture of its
messages.
"""

from __future__ import annotations

import shlex
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeAlias

from cubepath.coordinator.simulation.faults import Listed
from cubepath.coordinator.simulation.free_simulated import FreeSimulated
from cubepath.coordinator.simulation.free_swarm import Free
from cubepath.coordinator.simulation.lockstep import Lockstep
from cubepath.coordinator.simulation.scenarios import Asked
from cubepath.coordinator.simulation.sequence import sequence_picture
from cubepath.coordinator.simulation.shrinking import shrunk
from cubepath.coordinator.simulation.simulated import Simulated
from cubepath.coordinator.simulation.trace import Trace
from cubepath.protocol.core.errors import CheckError

Simulator: TypeAlias = Lockstep | Free
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
    unit: str
    long: int
    """How much the run did, in this unit: rounds, or moves."""
    faults: tuple[str, ...]

    def document(self) -> dict[str, Any]:
        """Return the keys of an entry of ``failed`` of ``cubepath simulate --json``."""
        found = {key: getattr(self, key) for key in self.__slots__ if key not in ("unit", "long")}
        found |= {"pictures": list(self.pictures), "faults": list(self.faults)}
        return found | {self.unit: self.long}


@dataclass(slots=True)
class Tally:
    """What came of the seeds so far."""

    simulator: Simulator = field(default_factory=Lockstep)
    seeds: int = 0
    steps: int = 0
    long: int = 0
    virtual_seconds: float = 0.0
    faults: Counter[str] = field(default_factory=Counter)
    outcomes: Counter[str] = field(default_factory=Counter)
    failed: list[Kept] = field(default_factory=list)

    def add(self, run: Simulated | FreeSimulated) -> None:
        """Count a run."""
        self.seeds += 1
        self.steps += run.steps
        self.long += run.long
        self.virtual_seconds += run.seconds
        self.faults.update(fault.kind for fault in run.fired)
        self.outcomes[run.outcome] += 1

    def document(self, seconds: float) -> dict[str, Any]:
        """Return the keys of ``cubepath simulate --json``."""
        return {
            "seeds": self.seeds,
            "failures": self.outcomes["failure"],
            "steps": self.steps,
            self.simulator.unit: self.long,
            "faults": {kind: self.faults[kind] for kind in self.simulator.kinds},
            "outcomes": {kind: self.outcomes[kind] for kind in self.simulator.outcomes},
            "failed": [kept.document() for kept in self.failed],
            "virtual_seconds": round(self.virtual_seconds, 3),
            "seconds": round(seconds, 3),
            "seeds_per_second": round(self.seeds / seconds, 2) if seconds else 0.0,
        }


def simulator_of(asked: Asked) -> Simulator:
    """Return what simulates the runs that are asked for."""
    return Free(asked) if asked.clock == "free" else Lockstep(asked)


def simulate_seeds(
    seeds: Iterable[int],
    folder: Path,
    tally: Tally,
    *,
    failing: Callable[[int], object] | None = None,
) -> Iterator[Kept | None]:
    """Simulate the seeds one by one and count them; yield for each what was kept, if it failed.

    `failing` is called with a seed that fails before it is shrunk.
    """
    simulator: Any = tally.simulator  # its runs are of its own kind
    for seed in seeds:
        found = simulator.run_of(seed)
        tally.add(found)
        if found.failure is None:
            yield None
            continue
        if failing is not None:
            failing(seed)
        kept = keep(small(found, seed, simulator), seed, folder, simulator)
        tally.failed.append(kept)
        yield kept


def small(found: Any, seed: int, simulator: Any) -> Any:
    """Return the smallest run found that fails in the same way as a failing run of a seed."""

    def play(scenario: Any, faults: Any) -> Any:
        return simulator.play(seed, scenario, faults)

    def draw(scenario: Any, text: str) -> Any:
        return simulator.draw(seed, scenario, text)

    return shrunk(found, play, draw)


def command_of(seed: int, asked: Asked) -> str:
    """Return the command that simulates this seed alone."""
    return shlex.join(["cubepath", "simulate", "--seeds", f"{seed}..{seed}", *asked.arguments()])


def keep(run: Any, seed: int, folder: Path, simulator: Any) -> Kept:
    """Write a failing run as a recording, if it has one, with pictures of its messages beside it.

    InputError or CheckError if they cannot be written.
    """
    if run.failure is None:
        raise ValueError("a run that holds is not kept")
    log = _new_name(folder, f"simulated-{seed}")
    title = f"seed {seed}: {run.failure.detail}"
    recorded = simulator.write(run, log, title)
    trace = Trace()
    simulator.play(seed, run.scenario, Listed(run.fired), trace)
    # Not the name of the log alone: that is where `cubepath view` draws the states.
    pictures = tuple(log.with_name(f"{log.stem}-messages{kind}") for kind in (".svg", ".png"))
    names = simulator.names(run.scenario)
    for picture in pictures:
        sequence_picture(trace, names, picture, title=_short(title), label=simulator.label)
    return Kept(
        seed=seed,
        kind=run.failure.kind,
        detail=run.failure.detail,
        command=command_of(seed, simulator.asked),
        log=str(log if recorded else pictures[0]),
        pictures=tuple(map(str, pictures)),
        system=run.scenario.system,
        rule=run.scenario.rule,
        modules=len(run.scenario.scene.start),
        unit=simulator.unit,
        long=run.long,
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
        log = folder / name
        if not log.exists() and not log.with_name(f"{log.stem}-messages.svg").exists():
            return log
    raise CheckError(f"{folder}: holds {_SAME_NAMES_MAX} recordings {stem}, expected fewer")


def _short(title: str) -> str:
    return title if len(title) <= 160 else title[:157] + "..."
