"""Many seeds, each a run with its own faults: the results, with failing runs shrunk and kept.

A failing run is shrunk: fewer modules, fewer rounds and fewer faults, as long as it fails in the
same way. The faults of a run are a list, so removing one leaves the others where they are: first
halves of the list are removed, then smaller parts (delta debugging, Zeller, 1999). The shrunk run
is written as a recording, with a picture of its messages. Runs with rounds and without have
separate seeds.
"""

import shlex
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from random import Random
from typing import Any, Generic, Protocol, Self, TypeAlias, TypeVar

from cubepath.agents.keepers.keeper import Keeper
from cubepath.coordinator.simulation.faults import (
    FREE_KINDS,
    KINDS,
    DrawnFaults,
    Fault,
    Faults,
    FreeDrawnFaults,
    ListedFaults,
)
from cubepath.coordinator.simulation.free_simulated import (
    FreeSimulatedRun,
    MakeKeeper,
    free_simulate,
    host_names,
    keeper_names,
)
from cubepath.coordinator.simulation.network import Trace
from cubepath.coordinator.simulation.scenarios import (
    ANYTHING,
    FreeScenario,
    Scenario,
    ScenarioOptions,
    free_scenario_of,
    scenario_of,
)
from cubepath.coordinator.simulation.sequence import sequence_picture
from cubepath.coordinator.simulation.simulated import (
    COORDINATOR,
    LIE,
    PATIENCE_US,
    MakeNode,
    SimulatedRun,
    host_node,
    process_names,
    simulate,
)
from cubepath.protocol.core.errors import CheckError, CubepathError
from cubepath.protocol.recordings.writing import RecordingWriter
from cubepath.protocol.wire.free_messages import Forwards, Replies, Requests, decode_free, free_kind
from cubepath.protocol.wire.messages import Bundle, Go, Ready, Retransmit, Waiting, decode, kind_of

_RUNS_MAX = 250
"""How many runs are tried in all."""
_DRAWS = 12
"""How often faults are drawn anew for a scenario with fewer modules."""


class Failed(Protocol):
    """What did not hold of a run."""

    @property
    def kind(self) -> str:
        """Return the kind by which failures are the same."""
        ...


class Shrinkable(Protocol):
    """What a seed stands for."""

    def smaller(self) -> Sequence[Self]:
        """Return the same with fewer modules and processes, the smallest first."""
        ...

    def shorter(self, long: int) -> Sequence[Self]:
        """Return the same with less to do than a run of this length did."""
        ...

    def plainer(self) -> Sequence[Self]:
        """Return the same with fewer peculiarities."""
        ...


class ShrinkableRun(Protocol):
    """A run that may have failed."""

    @property
    def scenario(self) -> Any:
        """Return what it was of."""
        ...

    @property
    def fired(self) -> tuple[Fault, ...]:
        """Return the faults that came to pass."""
        ...

    @property
    def failure(self) -> Failed | None:
        """Return what did not hold, if anything."""
        ...

    @property
    def long(self) -> int:
        """Return how much it did, in rounds or moves."""
        ...


_Run = TypeVar("_Run", bound=ShrinkableRun)
Play = Callable[[Any, Faults], _Run]
"""Simulates a scenario under faults."""
Draw = Callable[[Any, str], Faults]
"""Draws faults for a scenario, from a text."""


class _Shrinking(Generic[_Run]):
    """The smallest failing run so far, and how many more may be tried."""

    def __init__(self, found: _Run, play: Play[_Run], draw: Draw) -> None:
        self.best = found
        self.left = _RUNS_MAX
        self._play = play
        self._draw = draw

    def fails(self, scenario: Shrinkable, faults: Faults) -> bool:
        """Try a run; return whether it fails in the same way, and take it if it does."""
        if self.left == 0:
            return False
        self.left -= 1
        tried = self._play(scenario, faults)
        if (tried.failure and tried.failure.kind) != (self.best.failure and self.best.failure.kind):
            return False
        self.best = tried
        return True

    def shorter(self) -> None:
        for scenario in self.best.scenario.shorter(max(1, self.best.long)):
            if self.fails(scenario, ListedFaults(self.best.fired)):
                return

    def plainer(self) -> None:
        for scenario in self.best.scenario.plainer():
            if self.fails(scenario, ListedFaults(self.best.fired)):
                return

    def fewer_modules(self) -> None:
        for scenario in self.best.scenario.smaller():
            if any(self.fails(scenario, faults) for faults in self._faults_for(scenario)):
                return

    def _faults_for(self, scenario: Shrinkable) -> Iterable[Faults]:
        fired = self.best.fired
        yield ListedFaults(fired)
        for number in range(_DRAWS if fired else 0):
            yield self._draw(scenario, f"{number}/smaller")

    def fewer_faults(self) -> None:
        if self.best.fired and self.fails(self.best.scenario, ListedFaults(())):
            return
        for kind in sorted({fault.kind for fault in self.best.fired}):
            self._without(kind)
        parts = 2
        while len(self.best.fired) > 1 and self.left:
            size = -(-len(self.best.fired) // parts)
            if any(self._drop(start, size) for start in range(0, len(self.best.fired), size)):
                parts = max(2, parts - 1)
            elif size == 1:
                break
            else:
                parts = min(2 * parts, len(self.best.fired))
        fired = self.best.fired
        if len(fired) > 1:
            any(self._keep([fault]) for fault in fired)

    def _without(self, kind: str) -> bool:
        return self._keep([fault for fault in self.best.fired if fault.kind != kind])

    def _drop(self, start: int, size: int) -> bool:
        return self._keep([*self.best.fired[:start], *self.best.fired[start + size :]])

    def _keep(self, kept: Sequence[Fault]) -> bool:
        """Try with these faults only; what then happens may be fewer, but not more."""
        before = self.best
        if self.fails(before.scenario, ListedFaults(kept)) and len(self.best.fired) < len(
            before.fired
        ):
            return True
        self.best = before
        return False


def shrunk(found: _Run, play: Play[_Run], draw: Draw) -> _Run:
    """Return the smallest run found that fails in the same way as a failing run."""
    if found.failure is None:
        raise ValueError("a run that holds has nothing to shrink")
    shrinking = _Shrinking(found, play, draw)
    while shrinking.left:
        before = shrinking.best
        shrinking.shorter()
        shrinking.fewer_modules()
        shrinking.fewer_faults()
        shrinking.plainer()
        if shrinking.best is before:
            break
    return shrinking.best


OUTCOMES = ("goal", "max-rounds", "gave-up", "crash", "return", "stall", LIE, "failure")
"""How a run can come out: it ends as without faults in the first three, or by one, or it fails."""


class LockstepSwarm:
    """Simulates runs with rounds."""

    kinds = KINDS
    outcomes = OUTCOMES
    unit = "rounds"

    def __init__(self, asked: ScenarioOptions = ANYTHING, make: MakeNode = host_node) -> None:
        """Draw what is not asked for; `make` makes the nodes of module processes."""
        self.asked = asked
        self._make = make

    def run_of(self, seed: int) -> SimulatedRun:
        """Simulate the run that a seed stands for, with the faults that are drawn from it."""
        scenario = scenario_of(seed, self.asked)
        return self.play(seed, scenario, self._drawn(scenario, f"{seed}/faults", f"{seed}/lies"))

    def play(
        self, seed: int, scenario: Scenario, faults: Faults, trace: Trace | None = None
    ) -> SimulatedRun:
        """Simulate a scenario with these faults."""
        return simulate(scenario, faults, fault_seed=seed, trace=trace, make=self._make)

    def draw(self, seed: int, scenario: Scenario, text: str) -> Faults:
        """Draw other faults for a seed."""
        return self._drawn(scenario, f"{seed}/{text}", f"{seed}/{text}/lies")

    def _drawn(self, scenario: Scenario, faults: str, lies: str) -> Faults:
        random = Random(faults)  # noqa: S311 - not for secrets
        liars = Random(lies) if self.asked.liars else None  # noqa: S311 - not for secrets
        return DrawnFaults(random, COORDINATOR, process_names(scenario), PATIENCE_US, liars)

    def names(self, scenario: Scenario) -> list[str]:
        """Return the names of the processes."""
        return [COORDINATOR, *process_names(scenario)]

    def write(self, run: SimulatedRun, log: Path, why: str) -> bool:
        """Write the recording of a run; return whether there is one."""
        recording = run.recording
        parameters = {**recording.parameters, "simulated": why}
        with RecordingWriter(log, recording.scene, parameters) as writer:
            for record in recording.records:
                writer.write(
                    record.topic, record.data, round_number=record.round, wall_ns=record.wall_ns
                )
        return True

    def label(self, data: bytes) -> str:
        """Return in a few words what a message is, for a picture."""
        return label(data)


def label(data: bytes) -> str:
    """Return in a few words what a message is, for a picture."""
    try:
        message = decode(data)
    except CubepathError:
        return "no message"
    match message:
        case Go() | Ready() | Retransmit() | Waiting():
            return f"{kind_of(message)} {message.round} {message.phase}"
        case Bundle():
            kinds = Counter(kind_of(part) for part in message.parts)
            told = ", ".join(kind if n == 1 else f"{n} {kind}" for kind, n in kinds.items())
            return f"{told} to {message.region}"
        case _:
            return f"{kind_of(message)} {message.round}"


WITHOUT_ROUNDS = ScenarioOptions(clock="free")
"""Nothing else is asked for: everything is drawn."""
FREE_OUTCOMES = ("goal", "moves", "blocked", "failure")
"""How a run can come out: at its goal, or with moves enough; nothing could move but for the dead,
or these were in the way of the goal; or it fails."""


class FreeSwarm:
    """Simulates runs without rounds."""

    kinds = FREE_KINDS
    outcomes = FREE_OUTCOMES
    unit = "moves"

    def __init__(self, asked: ScenarioOptions = WITHOUT_ROUNDS, make: MakeKeeper = Keeper) -> None:
        """Draw what is not asked for; `make` makes keepers."""
        self.asked = asked
        self._make = make

    def run_of(self, seed: int) -> FreeSimulatedRun:
        """Simulate the run that a seed stands for, with the faults that are drawn from it."""
        scenario = free_scenario_of(seed, self.asked)
        return self.play(seed, scenario, self.draw(seed, scenario, "free faults"))

    def play(
        self, seed: int, scenario: FreeScenario, faults: Faults, trace: Trace | None = None
    ) -> FreeSimulatedRun:
        """Simulate a scenario with these faults."""
        return free_simulate(scenario, faults, fault_seed=seed, trace=trace, make=self._make)

    def draw(self, seed: int, scenario: FreeScenario, text: str) -> Faults:
        """Draw faults for a seed."""
        random = Random(f"{seed}/{text}")  # noqa: S311 - not for secrets
        return FreeDrawnFaults(random, host_names(scenario), keeper_names(scenario))

    def names(self, scenario: FreeScenario) -> list[str]:
        """Return the names of the processes."""
        return [*host_names(scenario), *keeper_names(scenario), COORDINATOR]

    def write(self, _run: FreeSimulatedRun, log: Path, _why: str) -> bool:
        """Write no recording, only make the folder: the messages are in the picture."""
        log.parent.mkdir(parents=True, exist_ok=True)
        return False

    def label(self, data: bytes) -> str:
        """Return in a few words what a message is, for a picture."""
        message = decode_free(data)
        if isinstance(message, Requests | Forwards | Replies):
            kinds = Counter(part.__struct_config__.tag for part in message.parts)
            return ", ".join(f"{kind}" if n == 1 else f"{n} {kind}" for kind, n in kinds.items())
        return free_kind(message)


Simulator: TypeAlias = LockstepSwarm | FreeSwarm
_SAME_NAMES_MAX = 1000


@dataclass(frozen=True, slots=True)
class KeptRun:
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
class SeedTally:
    """The results of the seeds so far."""

    simulator: Simulator = field(default_factory=LockstepSwarm)
    seeds: int = 0
    steps: int = 0
    long: int = 0
    virtual_seconds: float = 0.0
    faults: Counter[str] = field(default_factory=Counter)
    outcomes: Counter[str] = field(default_factory=Counter)
    failed: list[KeptRun] = field(default_factory=list)

    def add(self, run: SimulatedRun | FreeSimulatedRun) -> None:
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


def simulator_of(asked: ScenarioOptions) -> Simulator:
    """Return what simulates the runs that are asked for."""
    return FreeSwarm(asked) if asked.clock == "free" else LockstepSwarm(asked)


def simulate_seeds(
    seeds: Iterable[int],
    folder: Path,
    tally: SeedTally,
    *,
    failing: Callable[[int], object] | None = None,
) -> Iterator[KeptRun | None]:
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


def command_of(seed: int, asked: ScenarioOptions) -> str:
    """Return the command that simulates this seed alone."""
    return shlex.join(["cubepath", "simulate", "--seeds", f"{seed}..{seed}", *asked.arguments()])


def keep(run: Any, seed: int, folder: Path, simulator: Any) -> KeptRun:
    """Write a failing run as a recording, if it has one, with pictures of its messages beside it.

    InputError or CheckError if they cannot be written.
    """
    if run.failure is None:
        raise ValueError("a run that holds is not kept")
    log = _new_name(folder, f"simulated-{seed}")
    title = f"seed {seed}: {run.failure.detail}"
    recorded = simulator.write(run, log, title)
    trace = Trace()
    simulator.play(seed, run.scenario, ListedFaults(run.fired), trace)
    # Not the name of the log alone: that is where `cubepath view` draws the states.
    pictures = tuple(log.with_name(f"{log.stem}-messages{kind}") for kind in (".svg", ".png"))
    names = simulator.names(run.scenario)
    for picture in pictures:
        sequence_picture(trace, names, picture, title=_short(title), label=simulator.label)
    return KeptRun(
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
