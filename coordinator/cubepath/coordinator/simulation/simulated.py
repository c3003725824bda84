"""One simulated run: the nodes of a run on a simulated wire, and what must hold of the result.

A run without faults is also played in the environment, in one process and by other code: the edge
path must be the same. If a fault ended the run, its path must be the beginning of that one. The
recording of every run must pass `verify`. The coordinator is one node, which does what pacing node
and conductor do in a run over zenoh.
"""

import re
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TypeAlias

import msgspec

from cubepath.agents.environments.rollouts import Rollout, play_in_python
from cubepath.agents.processes.config import ProcessConfig
from cubepath.agents.processes.dealing import dealt
from cubepath.agents.processes.judge import Judge
from cubepath.agents.processes.node import HostNode
from cubepath.agents.processes.pacer import PATIENCE_S, Pacer
from cubepath.agents.rules.registry import rule_named
from cubepath.coordinator.runs.conductor import Conductor, RunEnd
from cubepath.coordinator.simulation.faults import (
    ENDING,
    LIES,
    SAYS,
    SECOND_US,
    BranchedFaults,
    Fault,
    Faults,
)
from cubepath.coordinator.simulation.liars import Liar
from cubepath.coordinator.simulation.network import EndlessRun, NodeError, SimulatedNetwork, Trace
from cubepath.coordinator.simulation.scenarios import FreeScenario, Scenario
from cubepath.coordinator.verification.recording import verify
from cubepath.protocol.core.errors import CubepathError
from cubepath.protocol.core.sites import Site
from cubepath.protocol.core.system import Scene
from cubepath.protocol.recordings.recording import Recording
from cubepath.protocol.recordings.stored_messages import Record
from cubepath.protocol.wire.credentials import process_name
from cubepath.protocol.wire.keys import topic_of
from cubepath.protocol.wire.messages import Edges, Message, Refused, decode, encode
from cubepath.protocol.wire.nodes import Effect, End, Keep, Node

Keeps: TypeAlias = Callable[[bytes, Message], None]


class Coordinator:
    """Paces the processes round by round until the run has come to its end."""

    def __init__(self, pacer: Pacer, conductor: Conductor, record: Keeps) -> None:
        """Begin; `record` is given what belongs in the recording."""
        self.ending: RunEnd | None = None
        """How the run has ended; None while it continues."""
        self._pacer = pacer
        self._conductor = conductor
        self._record = record

    def start(self) -> list[Effect]:
        """Wait for the processes."""
        return self._guarded(self._pacer.start)

    def receive(self, key: str, data: bytes) -> list[Effect]:
        """Take a message."""
        return self._guarded(lambda: self._pacer.receive(key, data))

    def tick(self) -> list[Effect]:
        """Note that the timer has run out."""
        return self._guarded(self._pacer.tick)

    def died(self, process: int, error: CubepathError | None) -> list[Effect]:
        """End the run since a process has died, of an error or of a signal."""
        if error is None:
            error = self._pacer.died(process, "killed by signal 9")
        return self._ended(self._conductor.failed(str(error)))

    def _guarded(self, do: Callable[[], list[Effect]]) -> list[Effect]:
        try:
            return self._go_on(do())
        except CubepathError as error:
            return self._ended(self._conductor.failed(str(error)))

    def _go_on(self, effects: list[Effect]) -> list[Effect]:
        """Keep what belongs on record; begin the next round when one is over, or end the run."""
        done: list[Effect] = []
        while True:
            self._keep(effects)
            done += effects
            if not self._pacer.idle:
                return done
            ending = self._conductor.between(self._pacer.round, lambda: None)
            if ending is not None:
                return [*done, *self._ended(ending)]
            effects = self._pacer.begin_round()

    def _ended(self, ending: RunEnd) -> list[Effect]:
        self.ending = ending
        effects = self._pacer.stop()
        self._keep(effects)
        return [*effects, End()]

    def _keep(self, effects: list[Effect]) -> None:
        for effect in effects:
            if isinstance(effect, Keep):
                self._record(effect.data, effect.message)
                self._conductor.hear(effect.message)


RUN = "simulated"
COORDINATOR = "coordinator"
PATIENCE_US = int(PATIENCE_S * SECOND_US)
_START_US, _NEXT_START_US = 500, 50
"""When the first module process is there, and how much later each other: the coordinator listens
before it starts them."""
LIE = "lie"
"""How a run came out that liars have ended."""
MakeNode = Callable[[ProcessConfig, Scene], Node]
"""Makes the node of a module process; tests give nodes with a bug in them."""

_STEPS_MAX, _STEPS_A_ROUND = 50_000, 3_000
_TIME_US_MAX, _TIME_US_A_ROUND = 20 * PATIENCE_US, PATIENCE_US // 10
"""A run may take so much, and so much for each round that it has without faults."""

_OF_THE_WIRE = frozenset(("doubled", "stale", "out of place"))
"""Why a message is refused that was doubled or late on the wire."""
_OF_MODULES = frozenset(("deliveries", "hearing"))
"""The checks that may fail of what a liar says that it has heard; all else it is refused for."""
_MODULE = re.compile(r"module_(\d+)")

_Moves: TypeAlias = "list[tuple[int, str, Site]]"
"""The moves of a round, in increasing order of modules."""


@dataclass(frozen=True, slots=True)
class Failure:
    """What did not hold of a run: its kind, by which failures are the same, and one line."""

    kind: str
    detail: str


@dataclass(frozen=True, slots=True)
class SimulatedRun:
    """A simulated run; `failure` is None if everything held that must hold."""

    scenario: Scenario
    fired: tuple[Fault, ...]
    met: Mapping[tuple[str, str], int]
    """By kind, and phase of the process struck (the coordinator's, for the router), how many."""
    ending: RunEnd | None
    rounds: int
    failure: Failure | None
    recording: Recording
    steps: int
    seconds: float
    """The virtual time that it took."""

    @property
    def long(self) -> int:
        """Return its rounds."""
        return self.rounds

    @property
    def outcome(self) -> str:
        """Return how the run came out, in a word or two."""
        if self.failure is not None:
            return "failure"
        if self.ending is None:  # only a failure has none
            raise AssertionError("no end")
        if self.ending.ended != "failed":
            return self.ending.ended
        kinds = [fault.kind for fault in self.fired]
        lie = LIE if any(kind in LIES for kind in kinds) else "gave-up"
        return next((kind for kind in kinds if kind in ENDING), lie)


def host_node(config: ProcessConfig, scene: Scene) -> Node:
    """Return the node of a module process, as a real one has it."""
    return HostNode(config, scene)


def process_names(scenario: Scenario | FreeScenario) -> list[str]:
    """Return the names of the module processes."""
    return [process_name(number) for number in range(scenario.processes)]


def simulate(
    scenario: Scenario,
    faults: Faults,
    *,
    fault_seed: int = 0,
    trace: Trace | None = None,
    make: MakeNode = host_node,
) -> SimulatedRun:
    """Simulate a run to its end and check it; nothing is raised that the nodes do wrong.

    `fault_seed` is that of the small differences between delays.
    """
    run = _Run(scenario, faults, fault_seed, trace, make)
    failure = run.play()
    network = run.network
    return SimulatedRun(
        scenario=scenario,
        fired=tuple(network.fired),
        met=network.met,
        ending=run.ending,
        rounds=run.conductor.gatherer.rounds,
        failure=failure,
        recording=run.recording(),
        steps=network.steps,
        seconds=network.now_us / SECOND_US,
    )


class _Run:
    """A run in progress."""

    def __init__(
        self,
        scenario: Scenario,
        faults: Faults,
        fault_seed: int,
        trace: Trace | None,
        make: MakeNode,
    ) -> None:
        self.scenario = scenario
        self.scene = scenario.scene
        self.rule = rule_named(scenario.rule, self.scene.system)
        self.ending: RunEnd | None = None
        self.network = SimulatedNetwork(faults.at, fault_seed, trace)
        self.network.state_of = self._state_of
        self._nodes: dict[str, Node] = {}
        if isinstance(faults, BranchedFaults):
            self.network.branch(faults.step, faults.begin)
        modules_of = dealt(self.scene, scenario.processes)
        self.conductor = Conductor(self.scene, max_rounds=scenario.max_rounds, record=self._result)
        self.conductor.gatherer.plausibility.know(modules_of, scenario.seed)
        self._records: list[Record] = []
        self._expected: list[_Moves] = []
        self._differs: Failure | None = None
        judge = Judge(RUN, modules_of, self.scene.system)
        judge.note_length = self.rule.note_length(len(self.scene.start))
        self._pacer = Pacer(
            RUN,
            modules_of,
            judge=judge,
            check=self.conductor.gatherer.plausibility.check,
            patience_s=PATIENCE_S,
        )
        self._coordinator = Coordinator(self._pacer, self.conductor, self._record)
        self._modules_of = modules_of
        self._make = make
        self._faults = faults
        self._sent: Counter[str] = Counter()

    def _record(self, data: bytes, message: Message) -> None:
        self._records.append(
            Record(
                topic_of(message),
                data,
                message.round,
                self.network.now_us * 1000,
                len(self._records),
            )
        )

    def _result(self, message: Message) -> None:
        """Record a result of the coordinator; stop at the first round with other moves."""
        self._record(encode(message), message)
        if isinstance(message, Edges) and self._differs is None and not self._lied:
            self._differs = self._compared(message)
            if self._differs is not None:
                self.network.stop()

    def play(self) -> Failure | None:
        """Play to the end; return the first thing that does not hold."""
        try:
            reference = self._reference()
        except CubepathError as error:
            return Failure("rule", f"without faults: {error}")
        self._expected = [
            [(module, move.generator, move.at) for module, move in each.moves.items()]
            for each in reference.rounds
        ]
        failure = self._simulate(len(reference.rounds)) or self._differs
        if self.ending is None:
            why = None if failure is None else failure.detail
            self.ending = self.conductor.failed(why or "no end")
        try:
            for message in self.conductor.results(self.ending):
                self._record(encode(message), message)
        except CubepathError as error:
            return failure or Failure("results", str(error))
        if failure is None and not self._lied:
            failure = self._ended(reference)
        return failure or self._blamed(reference) or self._accused() or self._verified()

    def _reference(self) -> Rollout:
        scenario = self.scenario
        return play_in_python(  # so small a run is over before the tables of compiled code are made
            self.scene,
            self.rule,
            seed=scenario.seed,
            hesitate=scenario.hesitate,
            max_rounds=scenario.max_rounds,
            world="plain",
        )

    def _simulate(self, rounds: int) -> Failure | None:
        network = self.network
        if self.conductor.before() is not None:
            self.ending = self.conductor.before()
            return None
        try:
            network.add(COORDINATOR, lambda: self._coordinator)
            for process, modules in enumerate(self._modules_of):
                config = self._config(process, modules)
                make = partial(self._node, config)
                network.add(f"process_{process}", make, _START_US + process * _NEXT_START_US)
            network.on_death(self._coordinator.died)
            network.run(
                _STEPS_MAX + rounds * _STEPS_A_ROUND, _TIME_US_MAX + rounds * _TIME_US_A_ROUND
            )
        except NodeError as error:
            return Failure("raised", str(error))
        except EndlessRun as error:
            return Failure("ran away", str(error))
        finally:
            self.ending = self._coordinator.ending
        return None

    def _node(self, config: ProcessConfig) -> Node:
        """Return the node of a process, which may be a liar."""
        node, name = self._make(config, self.scene), f"process_{config.process}"
        self._nodes[name] = node
        if name not in self._faults.liars:
            return node
        return Liar(
            node,
            name,
            run=RUN,
            scene=self.scene,
            faults=self._faults,
            counts=self._sent,
            tell=self.network.lied,
        )

    def _state_of(self, fault: Fault) -> str:
        node = self._nodes.get(fault.where.partition(" ")[0])
        return node.state if isinstance(node, HostNode) else self._pacer.phase

    @property
    def _lied(self) -> frozenset[str]:
        """Return the names of the processes that have lied so far."""
        if not self._faults.liars:
            return frozenset()
        return frozenset(
            fault.where.removesuffix(SAYS) for fault in self.network.fired if fault.kind in LIES
        )

    def _config(self, process: int, modules: list[int]) -> ProcessConfig:
        return ProcessConfig(
            endpoint="",
            run=RUN,
            process=process,
            modules=modules,
            processes=self._modules_of,
            scene="",
            rule=self.scenario.rule,
            seed=self.scenario.seed,
            hesitate=self.scenario.hesitate,
            note_length=0,
        )

    def _compared(self, edges: Edges) -> Failure | None:
        """Compare a round of the edge path with that of a run without faults."""
        if edges.round > len(self._expected):
            return Failure("path", f"round {edges.round} is one more than without faults")
        found = [(move.module, move.generator, move.at) for move in edges.moves]
        expected = self._expected[edges.round - 1]
        if found == expected:
            return None
        moves = f"round {edges.round} has the moves {_named(found)}"
        return Failure("path", f"{moves}, without faults {_named(expected)}")

    def _ended(self, reference: Rollout) -> Failure | None:
        """Compare how the run ended; a fault may have ended it before."""
        ending, expected = self.ending, _end_of(reference)
        if ending is not None and ending.ended == "failed" and ending != expected:
            return None  # whether it may is asked next
        rounds = self.conductor.gatherer.rounds
        if (ending, rounds) == (expected, len(reference.rounds)):
            return None
        after = f"{_ending_text(ending)} after {rounds} rounds"
        without = f"{_ending_text(expected)} after {len(reference.rounds)}"
        return Failure("outcome", f"{after}, without faults {without}")

    def _blamed(self, reference: Rollout) -> Failure | None:
        """Check that a run that failed was ended by a fault that may end it, and says so."""
        ending = self.ending
        if ending is None or ending.ended != "failed" or ending == _end_of(reference):
            return None
        line = ending.error or ""
        ends = [fault for fault in self.network.fired if fault.kind in {*ENDING, *LIES}]
        if not ends:
            return Failure("ended", f"tolerable faults ended it: {line or 'without a line'}")
        if not line or "\n" in line:
            return Failure("line", f"ended without one clear line: {line!r}")
        blamed = sorted({fault.where.removesuffix(SAYS) for fault in ends})
        # A process is named by itself, or with its modules by the coordinator.
        names = any(f"{name}:" in line or f"({name.replace('_', ' ')})" in line for name in blamed)
        waits = "waiting for others" in line  # those who said nothing are not known
        if not names and not waits and blamed != [COORDINATOR]:
            return Failure("blame", f"the fault was of {', '.join(blamed)}, and it says: {line}")
        return None

    def _accused(self) -> Failure | None:
        """Check that no honest process is named as a liar."""
        for record in self._records:
            message = decode(record.data) if record.kind == "refused" else None
            if not isinstance(message, Refused) or message.reason in _OF_THE_WIRE:
                continue
            if message.sender not in self._lied:
                return Failure("accused", f"{message.sender}, which was honest: {message.detail}")
        return None

    def _verified(self) -> Failure | None:
        wrong = [check for check in verify(self.recording()).checks if not check.ok]
        wrong = [check for check in wrong if not self._tells_a_lie(check.name, check.detail)]
        if not wrong:
            return None
        names = ", ".join(check.name for check in wrong)
        return Failure(f"verify {wrong[0].name}", f"verify fails {names}: {wrong[0].detail}")

    def _tells_a_lie(self, check: str, detail: str) -> bool:
        """Return whether what fails is of a module of a liar: the first that it names."""
        found = _MODULE.search(detail)
        if found is None or check not in _OF_MODULES:
            return False
        module = int(found[1])
        process = next(n for n, modules in enumerate(self._modules_of) if module in modules)
        return f"process_{process}" in self._lied

    def recording(self) -> Recording:
        """Return what was kept, and the results, as a recording."""
        scenario = self.scenario
        parameters = {
            "system": self.scene.spec,
            "family": self.scene.family,
            "rule": scenario.rule,
            "seed": str(scenario.seed),
            "hesitate": str(scenario.hesitate),
            "processes": str(min(scenario.processes, len(self.scene.start))),
            "modules": str(len(self.scene.start)),
            "max_rounds": str(scenario.max_rounds),
            "faults": msgspec.json.encode(self.network.fired).decode(),
        }
        path = Path(f"{RUN}.mcap")
        return Recording(path, parameters, self.scene, tuple(self._records), ())


def _named(moves: _Moves) -> str:
    return ", ".join(f"module_{module} {name} {at!r}" for module, name, at in moves) or "none"


def _end_of(reference: Rollout) -> RunEnd:
    if reference.failed is not None:
        return RunEnd("failed", reference.failed.replace("module ", "module_"))
    return RunEnd("goal" if reference.reached else "max-rounds")


def _ending_text(ending: RunEnd | None) -> str:
    if ending is None:
        return "no end"
    return ending.ended + (f" ({ending.error})" if ending.error else "")
