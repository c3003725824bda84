"""One simulated run without rounds: its nodes on a simulated wire, and what must hold throughout.

A run has faults first. When they are over it must make progress: to its goal, or for some more
moves. Then no more attempts are let through, and everything must come to rest, with everything that
modules sense up to date.

Its coordinator is a node that gathers and decides nothing; like that of a run over zenoh, it keeps
asking keepers for what they have committed. Journals survive their keeper, except for a record that
was being written. The oracle receives every record once it is sure to stay.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Literal

from cubepath.agents.environments.rollouts import play
from cubepath.agents.free.config import FreeProcessConfig
from cubepath.agents.free.host_node import FreeHostNode
from cubepath.agents.keepers.journal import Journal, Record, commit_in
from cubepath.agents.keepers.keeper import Keeper
from cubepath.agents.keepers.node import KeeperNode
from cubepath.agents.processes.dealing import dealt
from cubepath.agents.rules.registry import rule_named
from cubepath.coordinator.simulation.faults import (
    ROUTER,
    SECOND_US,
    STARTS,
    BranchedFaults,
    Fault,
    Faults,
)
from cubepath.coordinator.simulation.free_oracle import Oracle, OracleError
from cubepath.coordinator.simulation.network import EndlessRun, NodeError, SimulatedNetwork, Trace
from cubepath.coordinator.simulation.scenarios import FreeScenario
from cubepath.coordinator.simulation.simulated import COORDINATOR, RUN, Failure, process_names
from cubepath.protocol.core.errors import CubepathError
from cubepath.protocol.core.sites import Site
from cubepath.protocol.core.system import Scene
from cubepath.protocol.wire.credentials import keeper_name
from cubepath.protocol.wire.free_messages import (
    Attempt,
    Commit,
    CommitLog,
    CommitQuery,
    EnterRequest,
    Requests,
    TileQuery,
    Turns,
    decode_free,
    free_key,
)
from cubepath.protocol.wire.keys import Tiles
from cubepath.protocol.wire.messages import encode
from cubepath.protocol.wire.nodes import Effect, Listen, Node, Put, Timer


class SimulatedJournal:
    """A journal in memory that can lose what was written since the last look at it.

    It is compacted often.
    """

    def __init__(self, wrote: Callable[[], None]) -> None:
        """Begin empty; `wrote` is called for each record."""
        self._wrote = wrote
        self._records: list[Record] = []
        self._commits: dict[int, Commit] = {}
        self._looked = self._compacted = 0

    def append(self, record: Record) -> None:
        """Add a record."""
        self._records.append(record)
        self._wrote()
        moved = commit_in(record)
        if moved is not None:
            self._commits[moved.serial] = moved

    def records(self) -> Iterator[Record]:
        """Yield all records, in their order."""
        return iter(tuple(self._records))

    def commit(self, serial: int) -> Commit:
        """Return the commit of this serial number, from 1."""
        return self._commits[serial]

    @property
    def grown(self) -> bool:
        """Return whether it has twice the records that it was compacted to."""
        return len(self._records) > 2 * self._compacted

    def compact(self, records: Iterable[Record]) -> None:
        """Replace all records by these."""
        self._records = list(records)
        self._looked = self._compacted = len(self._records)
        moved = filter(None, map(commit_in, self._records))
        self._commits = {each.serial: each for each in moved}

    def fresh(self) -> list[Record]:
        """Return the records since this was last called."""
        if self._looked == len(self._records):
            return []
        found = self._records[self._looked :]
        self._looked = len(self._records)
        return found

    def tear(self, number: int) -> bool:
        """Lose a fresh record, which the number decides, and all after it.

        Return whether there was one.
        """
        fresh = len(self._records) - self._looked
        if not fresh:
            return False
        left = self._looked + number % fresh
        for moved in filter(None, map(commit_in, self._records[left:])):
            del self._commits[moved.serial]
        del self._records[left:]
        return True


FETCH_S = 0.5


class Watch:
    """Fetches the commits of all keepers."""

    def __init__(self, run: str, keepers: int) -> None:
        """Begin without any."""
        self.tails: dict[int, CommitLog] = {}
        """By keeper its last answer that has all of its commits."""
        self._run = run
        self._known = dict.fromkeys(range(keepers), 0)
        self.ticks = 0

    def start(self) -> list[Effect]:
        """Listen to the keepers."""
        return [Listen((f"cubepath/{self._run}/commits/**",)), Timer(FETCH_S)]

    def receive(self, key: str, data: bytes) -> list[Effect]:
        """Take what keepers have committed."""
        tail = decode_free(data)
        if isinstance(tail, CommitLog) and key == free_key(self._run, tail):
            known = self._known[tail.keeper]
            if tail.parts and tail.parts[0].serial <= known + 1:
                known = self._known[tail.keeper] = max(known, tail.parts[-1].serial)
            if tail.serial == known:
                self.tails[tail.keeper] = tail
        return []

    def tick(self) -> list[Effect]:
        """Fetch what is new."""
        self.ticks += 1
        # It never loses anything.
        fetches = [CommitQuery(keeper, serial, serial) for keeper, serial in self._known.items()]
        puts = [Put(free_key(self._run, fetch), encode(fetch)) for fetch in fetches]
        return [*puts, Timer(FETCH_S)]


MakeKeeper = Callable[[int, Scene, Tiles, Journal], Keeper]
"""Makes a keeper; tests give some with a bug in them."""

KEEPER_STATES = ("idle", "settling", "prepared", "waiting")
MORE_MOVES = 20
"""This many moves a run without a goal must have after its faults."""
_STEPS_MAX = 400_000
_ON_US, _REST_US = 240 * SECOND_US, 120 * SECOND_US
"""How long a run may take after its faults, and until it is at rest."""
_STUCK_US = 20 * SECOND_US
"""Where the goal may be out of reach, a run that stands still for this long is blocked."""
_ROUNDS_MAX = 3000
_JITTER = 0.5

Phase = Literal["faults", "on", "rest"]
FreeOutcome = Literal["goal", "moves", "blocked", "gave-up"]


@dataclass(frozen=True, slots=True)
class FreeSimulatedRun:
    """A simulated run; `failure` is None if everything held that must hold."""

    scenario: FreeScenario
    fired: tuple[Fault, ...]
    met: Mapping[tuple[str, str], int]
    """By kind, and state of the process struck (the busiest keeper's, for the router), how many."""
    moves: int
    failure: Failure | None
    steps: int
    seconds: float
    """The virtual time that it took."""
    came_to: FreeOutcome
    commits: tuple[Commit, ...]
    """What was committed, keeper by keeper."""
    messages: int
    """How many messages were put on the wire."""
    moved_seconds: float
    """The virtual time of the last move."""

    @property
    def long(self) -> int:
        """Return its moves."""
        return self.moves

    @property
    def outcome(self) -> str:
        """Return how the run came out, in a word."""
        return "failure" if self.failure is not None else self.came_to


def keeper_names(scenario: FreeScenario) -> list[str]:
    """Return the names of the keepers."""
    return [keeper_name(number) for number in range(scenario.keepers)]


def free_simulate(
    scenario: FreeScenario,
    faults: Faults,
    *,
    fault_seed: int = 0,
    trace: Trace | None = None,
    make: MakeKeeper = Keeper,
) -> FreeSimulatedRun:
    """Simulate a run to its end and check it; nothing is raised that the nodes do wrong.

    `fault_seed` is that of the small differences between delays.
    """
    run = _Run(scenario, faults, fault_seed, trace, make)
    failure = run.play()
    network = run.network
    return FreeSimulatedRun(
        scenario=scenario,
        fired=tuple(network.fired),
        met=network.met,
        moves=run.oracle.state.moves,
        failure=failure,
        steps=network.steps,
        seconds=network.now_us / SECOND_US,
        came_to=run.came_to,
        commits=tuple(commit for commits in run.oracle.commits.values() for commit in commits),
        messages=run.messages,
        moved_seconds=run.moved_us / SECOND_US,
    )


class _Run:
    """A run in progress."""

    def __init__(
        self,
        scenario: FreeScenario,
        faults: Faults,
        fault_seed: int,
        trace: Trace | None,
        make: MakeKeeper,
    ) -> None:
        self.scenario = scenario
        self.scene = scenario.scene
        self._to_goal = scenario.to_goal
        self.came_to: FreeOutcome = "moves"
        self.oracle = Oracle(self.scene, scenario.keepers)
        self.messages = 0
        self.phase: Phase = "faults"
        self.moved_us = 0
        self._since_us = self._asked_us = 0
        self._moves = self._moves_then = self._ticks = 0
        self._make = make
        self._tiles = Tiles(self.scene.system, scenario.keepers)
        self.network = SimulatedNetwork(
            lambda where, nth: faults.at(where, nth) if self.phase == "faults" else None,
            fault_seed,
            trace,
            scenario.hosts,
        )
        self.network.state_of = self._state_of
        if isinstance(faults, BranchedFaults):
            self.network.branch(faults.step, faults.begin)
        self._modules_of = dealt(self.scene, scenario.processes)
        self._incarnations = [0] * scenario.processes
        self._keepers: dict[str, KeeperNode] = {}
        self._hosts: dict[str, FreeHostNode] = {}
        self._stay: set[int] = set()
        """The modules whose rule attempted nothing when it was last asked."""
        self._written: list[int] = []
        """Keepers that have written to their journals in this step."""
        self._journals = [
            SimulatedJournal(partial(self._written.append, keeper))
            for keeper in range(scenario.keepers)
        ]
        self._watch = Watch(RUN, scenario.keepers)
        self._add(faults)

    def _add(self, faults: Faults) -> None:
        network = self.network
        network.add(COORDINATOR, lambda: self._watch)
        network.on_death(self._died)
        network.watch(self._through, self._after)
        for keeper, name in enumerate(keeper_names(self.scenario)):
            network.add(name, partial(self._keeper, keeper, name), tear=self._journals[keeper].tear)
        for process, name in enumerate(process_names(self.scenario)):
            late = faults.at(name + STARTS, 0)
            start_us = 0 if late is None else late.amount_us
            network.add(name, partial(self._host, process, name), start_us)
            if late is not None:
                network.fire(late)

    def _keeper(self, keeper: int, name: str) -> Node:
        journal = self._journals[keeper]
        node = KeeperNode(
            self._make(keeper, self.scene, self._tiles, journal), RUN, self._modules_of
        )
        self._keepers[name] = node
        return node

    def _host(self, process: int, name: str) -> Node:
        scenario = self.scenario
        self._incarnations[process] += 1
        factors = scenario.factors
        config = FreeProcessConfig(
            endpoint="",
            run=RUN,
            process=process,
            modules=self._modules_of[process],
            keepers=scenario.keepers,
            incarnation=self._incarnations[process],
            scene="",
            rule=scenario.rule,
            seed=scenario.seed,
            hesitate=scenario.hesitate,
            speeds={module: factors[module % len(factors)] for module in self._modules_of[process]},
            jitter=_JITTER,
        )
        node = FreeHostNode(config, self.scene)
        self._hosts[name] = node
        return node

    def play(self) -> Failure | None:
        """Play to the end; return the first thing that does not hold."""
        try:
            self.network.run(_STEPS_MAX, 10**15)
        except OracleError as broken:
            if broken.kind == "rule":  # as on the wire, the run ends
                self.came_to = "gave-up"
                return None
            return Failure(broken.kind, str(broken))
        except EndlessRun as error:
            return Failure("liveness", f"{error}, {self._where()}")
        except NodeError as error:
            return Failure("raised", str(error))
        return None

    def _where(self) -> str:
        return f"in phase {self.phase}, after {self._moves} moves"

    def _died(self, process: int, error: CubepathError | None) -> list[Effect]:
        if error is not None:
            raise OracleError("ended", f"process {process} ended: {error}")
        return []

    def _state_of(self, fault: Fault) -> str:
        name = fault.where.partition(" ")[0]
        if name in self._hosts:
            return self._hosts[name].state
        found = [node.keeper.state for own, node in self._keepers.items() if name in (own, ROUTER)]
        return max(found, key=KEEPER_STATES.index, default="gathering")

    # What is watched.

    def _through(self, _: str, put: Put) -> Put | None:
        """Show what is put to the oracle; at rest no attempt goes onto the wire."""
        self.messages += 1
        self._log()
        message = decode_free(put.data)
        if self.phase == "rest" and isinstance(message, Requests):
            parts: list[Attempt | EnterRequest | TileQuery] = [
                part for part in message.parts if not isinstance(part, Attempt)
            ]
            if len(parts) < len(message.parts):
                return Put(put.key, encode(Requests(message.process, message.keeper, parts)))
        elif isinstance(message, Turns):
            for turn in message.parts:
                (self._stay.discard if turn.number else self._stay.add)(turn.module)
        self.oracle.take(message)
        return put

    def _log(self) -> None:
        if self._written:
            written, self._written[:] = self._written[0], []
            self.oracle.logged(written, self._journals[written].fresh())

    def _after(self) -> None:
        self._log()
        moves, now_us = self.oracle.state.moves, self.network.now_us
        if moves != self._moves:
            self._moves, self.moved_us, self._asked_us = moves, now_us, now_us
            if self._to_goal and self.phase in ("faults", "on"):
                self._look_for_goal()
        if self.phase == "faults":
            if moves >= self.scenario.moves or now_us >= self.scenario.long_us:
                self._begin("on" if self.scenario.ends_at_goal is None else "rest")
        elif self.phase == "on":
            self._on()
        elif self._watch.ticks > self._ticks:
            self._ticks = self._watch.ticks
            self._rest()

    def _begin(self, phase: Phase) -> None:
        self.phase, self._since_us, self._moves_then = phase, self.network.now_us, self._moves

    def _look_for_goal(self) -> None:
        if self.scene.reached(self.oracle.state.site.values()):
            self.came_to = "goal"
            self._begin("rest")

    def _on(self) -> None:
        network = self.network
        if not self._to_goal and self._moves - self._moves_then >= MORE_MOVES:
            self._begin("rest")
        elif network.now_us - max(self._asked_us, self._since_us) > _STUCK_US:
            self._asked_us = network.now_us  # it is not asked again at once
            if not network.away and self._blocked():
                self.came_to = "blocked"
                self._begin("rest")
        if self.phase == "on" and network.now_us - self._since_us > _ON_US:
            if self._to_goal and network.gone:  # others go round the dead for ever
                self.came_to = "blocked"
                self._begin("rest")
                return
            raise OracleError(
                "liveness", f"no end {_ON_US // SECOND_US} s after the faults, {self._where()}"
            )

    def _blocked(self) -> bool:
        """Return whether nothing can move but for the dead, or all others chose to stay.

        To a goal: whether the dead keep from it, or the rule does not reach it in rounds either.
        """
        gone = self.network.gone
        if self._to_goal:
            return bool(gone) or not self._reaches
        system, on = self.scene.system, self.oracle.state.on
        return not any(
            move.possible(on)
            for name, modules in zip(process_names(self.scenario), self._modules_of, strict=True)
            if name not in gone
            for module in modules
            if module not in self._stay
            for move in system.moves_at(self.oracle.state.site[module])
        )

    @cached_property
    def _reaches(self) -> bool:
        """Whether the rule reaches the goal in rounds; a leader may give up."""
        rule = rule_named(self.scenario.rule, self.scene.system)
        return play(self.scene, rule, seed=self.scenario.seed, max_rounds=_ROUNDS_MAX).reached

    # At rest.

    def _rest(self) -> None:
        """End the run if everything has come to rest, and is as it should be."""
        why = self._restless() or self._untold()
        if why is None:
            self.network.stop()
        elif self.network.now_us - self._since_us > _REST_US:
            raise OracleError("rest", f"{_REST_US // SECOND_US} s after the last attempt: {why}")

    def _untold(self) -> str | None:
        for keeper, name in enumerate(keeper_names(self.scenario)):
            tail = self._watch.tails.get(keeper)
            if tail is None:
                return f"{name} has told nothing"
            if tail.prepared or tail.refused:
                return f"{name} has {tail.prepared} prepared, and refused {tail.refused} messages"
            why = self.oracle.unlike(tail)
            if why is not None:
                return why
        return None

    def _restless(self) -> str | None:
        network = self.network
        if network.away:
            return f"{network.away[0]} is not back"
        for name, keeper in self._keepers.items():
            if keeper.keeper.busy:
                return f"{name} has something under way"
        gone = network.gone
        for name, node in self._hosts.items():
            if name not in gone:
                for module in node.movers:
                    place = self._unlike(node, module)
                    if place is not None:
                        return f"module_{module} does not sense what is at {place!r}"
        return None

    def _unlike(self, node: FreeHostNode, module: int) -> Site | None:
        """Return a place that is not as a module of a process senses it, if there is one."""
        system, state = self.scene.system, self.oracle.state
        mover, own = node.movers[module], system.place_of(state.site[module])
        if mover.state == "entering" or mover.site != state.site[module]:
            return own
        for place in {own: None, **dict.fromkeys(system.sensed(own))}:
            if place is None or not system.has_place(place):
                continue
            known, here = node.sensing.place(place), state.at.get(place)
            found = known.version, known.module, known.site, known.note, known.module_version
            expected: tuple[object, ...] = state.places.get(place, 0), None, None, (), 0
            if here is not None:
                content = here, state.site[here], state.note[here], state.version[here]
                expected = state.places.get(place, 0), *content
            if not node.sensing.sees([place]) or found != expected:
                return place
        return None
