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
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from random import Random
from typing import Any, TypeAlias, get_args

from cubepath.agents.free.mover import State
from cubepath.agents.keepers.keeper import Keeper
from cubepath.coordinator.simulation.causes import Cause, cause_of
from cubepath.coordinator.simulation.failure_curve import failure_curve
from cubepath.coordinator.simulation.faults import (
    FREE_KINDS,
    KINDS,
    LIES,
    DrawnFaults,
    Fault,
    Faults,
    FreeDrawnFaults,
    ListedFaults,
)
from cubepath.coordinator.simulation.free_simulated import (
    KEEPER_STATES,
    FreeSimulatedRun,
    MakeKeeper,
    free_simulate,
    keeper_names,
)
from cubepath.coordinator.simulation.network import Remark, Trace
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
from cubepath.protocol.core.garbage import collector_paused
from cubepath.protocol.recordings.writing import copy_recording
from cubepath.protocol.wire.free_messages import Forwards, Replies, Requests, decode_free, free_kind
from cubepath.protocol.wire.messages import Bundle, Go, Ready, Retransmit, Waiting, decode, kind_of

_RUNS_MAX = 250
"""How many runs are tried in all."""
_DRAWS = 12
"""How often faults are drawn anew for a scenario with fewer modules."""


class _Shrinking:
    """The smallest failing run so far, and how many more may be tried."""

    def __init__(self, found: Any, seed: int, simulator: Any) -> None:
        self.best = found  # it and its scenario are of the simulator's own kind
        self.left = _RUNS_MAX
        self._seed = seed
        self._simulator = simulator

    def fails(self, scenario: Any, faults: Faults) -> bool:
        """Try a run; return whether it fails in the same way, and take it if it does."""
        if self.left == 0:
            return False
        self.left -= 1
        tried = self._simulator.play(self._seed, scenario, faults)
        if tried.failure is None or tried.failure.kind != self.best.failure.kind:
            return False
        self.best = tried
        return True

    def shorter(self) -> None:
        shorter = self.best.scenario.shorter(max(1, self.best.long))
        any(self.fails(scenario, ListedFaults(self.best.fired)) for scenario in shorter)

    def plainer(self) -> None:
        plainer = self.best.scenario.plainer()
        any(self.fails(scenario, ListedFaults(self.best.fired)) for scenario in plainer)

    def fewer_modules(self) -> None:
        for scenario in self.best.scenario.smaller():
            if any(self.fails(scenario, faults) for faults in self._faults_for(scenario)):
                return

    def _faults_for(self, scenario: Any) -> Iterable[Faults]:
        fired = self.best.fired
        yield ListedFaults(fired)
        for number in range(_DRAWS if fired else 0):
            yield self._simulator.draw(self._seed, scenario, f"{number}/smaller")

    def fewer_faults(self) -> None:
        if self.best.fired and self.fails(self.best.scenario, ListedFaults(())):
            return
        for kind in sorted({fault.kind for fault in self.best.fired}):
            self._keep([fault for fault in self.best.fired if fault.kind != kind])
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


def shrunk(found: Any, seed: int, simulator: Any) -> Any:
    """Return the smallest run found that fails in the same way as a failing run of a seed."""
    if found.failure is None:
        raise ValueError("a run that holds has nothing to shrink")
    shrinking = _Shrinking(found, seed, simulator)
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

    states = ("join", "sense", "claim", "settle", "waiting")
    outcomes = OUTCOMES
    unit = "rounds"

    def __init__(self, asked: ScenarioOptions = ANYTHING, make: MakeNode = host_node) -> None:
        """Draw what is not asked for; `make` makes the nodes of module processes."""
        self.asked = asked
        self.kinds = (*KINDS, *(LIES if asked.liars else ()))
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

    @staticmethod
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
                return f"{_kinds_text(message.parts)} to {message.region}"
            case _:
                return f"{kind_of(message)} {message.round}"


def _kinds_text(parts: Iterable[Any]) -> str:
    kinds = Counter(part.__struct_config__.tag for part in parts)
    return ", ".join(kind if n == 1 else f"{n} {kind}" for kind, n in kinds.items())


WITHOUT_ROUNDS = ScenarioOptions(clock="free")
"""Nothing else is asked for: everything is drawn."""
FREE_OUTCOMES = ("goal", "moves", "blocked", "gave-up", "failure")
"""How a run can come out: at its goal, or with moves enough; nothing could move but for the dead,
or these were in the way of the goal; its rule gave up; or it fails."""


class FreeSwarm:
    """Simulates runs without rounds."""

    kinds = FREE_KINDS
    states = (*get_args(State)[:-1], *KEEPER_STATES, "gathering")
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
        return FreeDrawnFaults(random, COORDINATOR, process_names(scenario), keeper_names(scenario))

    def names(self, scenario: FreeScenario) -> list[str]:
        """Return the names of the processes."""
        return [*process_names(scenario), *keeper_names(scenario), COORDINATOR]

    @staticmethod
    def label(data: bytes) -> str:
        """Return in a few words what a message is, for a picture."""
        message = decode_free(data)
        if isinstance(message, Requests | Forwards | Replies):
            return _kinds_text(message.parts)
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
    cause: Cause | None = None
    """Why it fails, if that was asked."""

    def document(self) -> dict[str, Any]:
        """Return the keys of an entry of ``failed`` of ``cubepath simulate --json``."""
        found = asdict(self)
        found["cause"] = None if self.cause is None else self.cause.document()
        return found | {found.pop("unit"): found.pop("long")}


@dataclass(slots=True)
class SeedTally:
    """The results of the seeds so far."""

    simulator: Simulator = field(default_factory=LockstepSwarm)
    seeds: int = 0
    steps: int = 0
    long: int = 0
    virtual_seconds: float = 0.0
    met: Counter[tuple[str, str]] = field(default_factory=Counter)
    """By kind of fault and state of what it struck, how many there were."""
    outcomes: Counter[str] = field(default_factory=Counter)
    failed: list[KeptRun] = field(default_factory=list)
    shrunk: Any = None
    """The run that is left of the last seed that failed."""

    def add(self, run: SimulatedRun | FreeSimulatedRun) -> None:
        """Count a run."""
        self.seeds += 1
        self.steps += run.steps
        self.long += run.long
        self.virtual_seconds += run.seconds
        self.met.update(run.met)
        self.outcomes[run.outcome] += 1

    def document(self, seconds: float) -> dict[str, Any]:
        """Return the keys of ``cubepath simulate --json``."""
        kinds, states = self.simulator.kinds, self.simulator.states
        return {
            "seeds": self.seeds,
            "failures": self.outcomes["failure"],
            "steps": self.steps,
            self.simulator.unit: self.long,
            "faults": {kind: sum(self.met[kind, each] for each in states) for kind in kinds},
            "states": {kind: {each: self.met[kind, each] for each in states} for kind in kinds},
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
        with collector_paused():
            found = simulator.run_of(seed)
        tally.add(found)
        if found.failure is None:
            yield None
            continue
        if failing is not None:
            failing(seed)
        tally.shrunk = shrunk(found, seed, simulator)
        kept = keep(tally.shrunk, seed, folder, simulator)
        tally.failed.append(kept)
        yield kept


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
    folder.mkdir(parents=True, exist_ok=True)
    recorded = isinstance(run, SimulatedRun)
    if recorded:
        copy_recording(run.recording, log, {"simulated": title})
    trace = Trace()
    simulator.play(seed, run.scenario, ListedFaults(run.fired), trace)
    # Not the name of the log alone: that is where `cubepath view` draws the states.
    pictures = tuple(log.with_name(f"{log.stem}-messages{kind}") for kind in (".svg", ".png"))
    _draw(trace, run, simulator, pictures, title)
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


def _draw(trace: Trace, run: Any, simulator: Any, pictures: Iterable[Path], title: str) -> None:
    names = simulator.names(run.scenario)
    for picture in pictures:
        sequence_picture(trace, names, picture, title=_short(title), label=simulator.label)


def explain(tally: SeedTally, played: Callable[[int], object]) -> KeptRun:
    """Find out why the last failing seed fails; draw it, and mark it among the messages.

    `played` is called with the number of runs so far. CheckError if it does not fail again.
    InputError or CheckError if the pictures cannot be written.
    """
    kept, simulator = tally.failed[-1], tally.simulator
    with collector_paused():
        cause, trace = cause_of(tally.shrunk, kept.seed, simulator, played)
    title = f"seed {kept.seed}: {kept.detail}"
    messages = [Path(picture) for picture in kept.pictures]
    if cause.place is not None:
        trace.remarks.append(Remark(*cause.place, "decided here"))
        _draw(trace, tally.shrunk, simulator, messages, title)
    curves = [path.with_name(path.name.replace("-messages", "-why")) for path in messages]
    for picture in curves:
        failure_curve(cause, picture, title=_short(title))
    pictures = (*kept.pictures, *map(str, curves))
    tally.failed[-1] = replace(kept, cause=cause, pictures=pictures)
    return tally.failed[-1]


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
