"""Trials: a run under listed faults in virtual time, in this process, and what must hold of it.

The nodes are those of real processes, on the wire of `simulation`. Strategies of hypothesis draw
trials, and you can also write a trial by hand.

It needs hypothesis: ``pip install 'cubepath[testing]'``. No other module of the room imports it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal, TypeAlias, get_args

from cubepath.coordinator.runs.plan import Plan, task_of
from cubepath.coordinator.simulation.faults import (
    ENDING,
    FREE_KINDS,
    KINDS,
    ON_HOPS,
    ROUTER,
    SECOND_US,
    STARTS,
    Fault,
    ListedFaults,
)
from cubepath.coordinator.simulation.free_simulated import FreeSimulatedRun, free_simulate
from cubepath.coordinator.simulation.scenarios import FreeScenario, Scenario, built
from cubepath.coordinator.simulation.simulated import MakeNode, SimulatedRun, host_node, simulate
from cubepath.coordinator.testing.log import RunLog
from cubepath.coordinator.testing.network import NETWORK_FAULTS, NetworkFault, NetworkFaultKind
from cubepath.coordinator.testing.rules import SECONDS_MAX, Direction
from cubepath.coordinator.testing.wire_messages import RESULTS, short, table
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.options import known_name, seconds as checked_seconds, whole_number
from cubepath.protocol.wire.credentials import COORDINATOR

__tracebackhide__ = True  # pytest shows no frames of this module
Clock: TypeAlias = Literal["lockstep", "free"]
_ON_ROUTER = ("router", "partition", "one-way", "host")
_LASTING = ("delay", "reorder", "drag", "pause", "slow", "stall", "late", *_ON_ROUTER[1:])
"""The kinds that are nothing if they take no time."""
_LONG_US = 20_000_000
_FAULTS_SHOWN = 12


@dataclass(frozen=True, slots=True)
class Trial:
    """One run and its faults: the same trial is the same run, bit for bit.

    >>> trial = trial_of("hex:n=4", faults=[fault("loss", "process_0 up", 3)], processes=2)
    >>> trial.check().goal_reached
    True
    """

    scenario: Scenario | FreeScenario
    faults: tuple[Fault, ...] = ()

    def play(self, make: MakeNode = host_node) -> TrialResult:
        """Simulate the run, and return the outcome; nothing is raised that fails in it.

        `make` makes the nodes of module processes of a run with rounds: your own code, from its
        orders and the scene.
        """
        if isinstance(self.scenario, FreeScenario):
            if make is not host_node:
                raise InputError("make: only for runs with rounds (clock=lockstep)")
            return TrialResult(self, free_simulate(self.scenario, ListedFaults(self.faults)))
        return TrialResult(self, simulate(self.scenario, ListedFaults(self.faults), make=make))

    def check(self, make: MakeNode = host_node) -> TrialResult:
        """Simulate the run, and check that everything holds; AssertionError tells what does not.

        With rounds: the path is the one without faults, the run ends as it does there unless a
        fault ended it, and its log is legal. Without rounds: every invariant of keepers, and that
        the run continues after its faults.
        """
        tried = self.play(make)
        tried.assert_holds()
        return tried


@dataclass(frozen=True, slots=True)
class TrialResult:
    """The outcome of a trial."""

    trial: Trial
    run: SimulatedRun | FreeSimulatedRun

    @property
    def fired(self) -> tuple[Fault, ...]:
        """Return the faults that came to pass, in order."""
        return self.run.fired

    @property
    def goal_reached(self) -> bool:
        """Return whether the modules came to their goal."""
        return self.run.outcome == "goal"

    @property
    def log(self) -> RunLog:
        """Return the log of a run with rounds; InputError for one without, which keeps none."""
        if isinstance(self.run, FreeSimulatedRun):
            raise InputError("log: a simulated run without rounds keeps none, expected lockstep")
        return RunLog(self.run.recording)

    def assert_holds(self) -> None:
        """Check that everything held; AssertionError tells what did not, and under which faults."""
        failure, scenario = self.run.failure, self.trial.scenario
        if failure is None:
            return
        of = f"{scenario.processes} processes, hesitate {scenario.hesitate:g}"
        lines = [
            short(failure.detail),
            f"system {scenario.system}, rule {scenario.rule}, seed {scenario.seed}, {of}",
            *(f"fault: {_fault_text(fault)}" for fault in self.fired[:_FAULTS_SHOWN]),
        ]
        if len(self.fired) > _FAULTS_SHOWN:
            lines.append(f"and {len(self.fired) - _FAULTS_SHOWN} more faults")
        if isinstance(self.run, SimulatedRun):
            said = [seen for seen in self.log.all_deliveries if seen.kind not in RESULTS]
            lines.append(table(said, title="the last messages"))
        raise AssertionError("\n".join(lines))


def fault(kind: str, where: str, nth: int = 0, seconds: float = 0.0) -> Fault:
    """Return a fault: its kind, where, at which count there (from 0), and how long it takes.

    On a link it is a message of ``process_0 up`` or ``process_0 down`` that is struck; otherwise a
    process by its name, ``coordinator`` and ``keeper_0`` included, or ``router``, before it takes
    that message. InputError for what is no fault of either clock.
    """
    known_name("fault ", kind, FREE_KINDS)
    whole_number("nth", nth, 0)
    checked_seconds("seconds", seconds, SECONDS_MAX)
    if not isinstance(where, str):  # pyright: ignore[reportUnnecessaryIsInstance]
        raise InputError(f"fault {kind} at {where}: expected a name, as process_0")
    return Fault(where, nth, kind, round(seconds * SECOND_US))


def places(kind: str, clock: Clock, processes: int, keepers: int) -> list[str]:
    """Return where a fault of a kind can strike a run of this many processes and keepers."""
    hosts = [f"process_{number}" for number in range(processes)]
    kept = [f"keeper_{number}" for number in range(keepers)] if clock == "free" else []
    # The coordinator of a run without rounds only listens.
    found = [*hosts, *kept] if clock == "free" else [*hosts, COORDINATOR]
    if kind in ON_HOPS or kind == "drag":
        found = [f"{name} {way}" for name in (*hosts, *kept, COORDINATOR) for way in ("up", "down")]
    elif kind in _ON_ROUTER:
        found = [ROUTER]
    elif kind == "late":
        found = [name + STARTS for name in hosts]
    elif kind == "torn":
        found = kept
    elif kind in ("leave", "crash", "twin"):
        found = hosts
    elif kind in ("return", "cut"):
        found = [*hosts, *kept]
    return found


def _check(fault: Fault, clock: Clock, processes: int, keepers: int) -> None:
    """Check that a fault can come to pass; InputError tells what was expected."""
    if not isinstance(fault, Fault):  # pyright: ignore[reportUnnecessaryIsInstance]
        raise InputError(f"fault {fault}: expected one as fault('loss', 'process_0 up', 3)")
    kind, where = fault.kind, fault.where
    known_name("fault ", kind, FREE_KINDS if clock == "free" else KINDS)
    there = places(kind, clock, processes, keepers)
    known_name(f"fault {kind} at ", where, there)
    if kind in _LASTING and fault.amount_us <= 0:
        raise InputError(f"fault {kind} at {where}: seconds=0, expected more")


def trial_of(
    system: str,
    rule: str | None = None,
    *,
    faults: Sequence[Fault] = (),
    clock: Clock = "lockstep",
    seed: int = 0,
    processes: int = 2,
    hesitate: float = 0.0,
    max_rounds: int = 200,
    keepers: int = 2,
    moves: int = 20,
) -> Trial:
    """Return a trial of a system and a rule, by name or as ``FILE.py:NAME``; None is its own rule.

    Without rounds there are faults until this many `moves` were made, in `keepers`. InputError
    names what cannot be run, and faults that there are not under the clock.
    """
    if not isinstance(system, str):  # pyright: ignore[reportUnnecessaryIsInstance]
        raise InputError(f"system={system!r}: expected a name or a file")
    if not isinstance(faults, Sequence):  # pyright: ignore[reportUnnecessaryIsInstance]
        raise InputError(f"faults={faults!r}: expected a list of faults")
    whole_number("max_rounds", max_rounds, 0)
    whole_number("keepers", keepers, 1)
    whole_number("moves", moves, 0)
    plan = Plan(system, rule, seed=seed, hesitate=hesitate, processes=processes, clock=clock)
    task = task_of(plan)
    most = min(max(processes, 1), len(task.scene.start))
    for fault in faults:
        _check(fault, clock, most, keepers)
    if clock == "free":
        free = FreeScenario(
            system=system,
            rule=task.rule,
            processes=most,
            keepers=keepers,
            hesitate=hesitate,
            factors=(0.0,),
            moves=moves,
            long_us=_LONG_US,
            seed=seed,
        )
        return Trial(free, tuple(faults))
    scenario = Scenario(system, task.rule, most, hesitate, max_rounds, seed)
    return Trial(scenario, tuple(faults))


def _fault_text(fault: Fault) -> str:
    long = f" for {fault.amount_us / 1e6:g} s" if fault.amount_us else ""
    return f"{fault.kind} at {fault.where}, number {fault.nth}{long}"


try:
    from hypothesis import strategies as st
    from hypothesis.strategies import SearchStrategy
except ImportError as error:
    raise InputError("strategies take hypothesis: pip install 'cubepath[testing]'") from error

_NTH_MAX = 150
_LONGEST_US = {
    "delay": 200_000,
    "reorder": 200_000,
    "duplicate": 200_000,
    "drag": 500_000,
    "pause": 2_000_000,
    "slow": 50_000,
    "router": 2_000_000,
    "return": 3_000_000,
    "cut": 3_000_000,
    "torn": 3_000_000,
    "late": 10_000_000,
    "leave": 15_000_000,
    "partition": 10_000_000,
    "one-way": 10_000_000,
    "host": 3_000_000,
    "twin": 15_000_000,
    "stall": 30_000_000,
}
"""How long a fault takes at most; of those that runs with rounds tolerate, a dozen together take
less than half of their patience."""
_LOCKSTEP_STALL_US = (72_000_000, 300_000_000)
"""What is no stall is a pause: it takes longer than the patience."""
FAULTS_MAX = 12


def faults(
    *,
    clock: Clock = "lockstep",
    processes: int = 2,
    keepers: int = 2,
    kinds: Sequence[str] | None = None,
    most: int = 8,
    endings: bool = False,
) -> SearchStrategy[list[Fault]]:
    """Return a strategy of lists of faults, `most` of them at most, 12 or fewer.

    They shrink towards none, then to the first of `kinds`, early messages and short times. `kinds`
    None are all that the clock has; with rounds those that end a run (crash, return, stall) are
    left out unless `endings`. InputError for a kind that the clock does not have.

    >>> from hypothesis import find
    >>> find(faults(kinds=["loss"]), lambda each: len(each) > 0)
    [Fault(where='process_0 up', nth=0, kind='loss', amount_us=0)]
    """
    known = FREE_KINDS if clock == "free" else KINDS
    usual = [kind for kind in known if clock == "free" or endings or kind not in ENDING]
    if kinds is not None and (isinstance(kinds, str) or not isinstance(kinds, Sequence)):  # pyright: ignore[reportUnnecessaryIsInstance]
        raise InputError(f"kinds={kinds!r}: expected kinds of faults, as ['loss']")
    chosen = usual if kinds is None else list(kinds)
    for kind in chosen:
        known_name("fault ", kind, known)
    if not 0 <= most <= FAULTS_MAX:
        raise InputError(f"most={most}: expected 0 to {FAULTS_MAX}")
    one = st.sampled_from(chosen).flatmap(lambda kind: _fault(kind, clock, processes, keepers))
    return st.lists(one, max_size=most, unique_by=lambda fault: (fault.where, fault.nth))


def _fault(kind: str, clock: Clock, processes: int, keepers: int) -> SearchStrategy[Fault]:
    where = places(kind, clock, processes, keepers)
    nth = st.just(0) if kind == "late" else st.integers(0, _NTH_MAX)
    bounds = (0, _LONGEST_US.get(kind, 0))
    if kind == "stall" and clock == "lockstep":
        bounds = _LOCKSTEP_STALL_US
    elif kind not in ("leave", *_TIMELESS):
        bounds = (1, bounds[1])
    amounts = st.just(0) if kind in _TIMELESS else st.integers(*bounds)
    return st.builds(Fault, st.sampled_from(where), nth, st.just(kind), amounts)


_TIMELESS = ("loss", "crash", "jump")


@st.composite
def scenarios(
    draw: st.DrawFn,
    system: str | Sequence[str] = "hex:n=4",
    rule: str | Sequence[str] | None = None,
    *,
    clock: Clock = "lockstep",
    kinds: Sequence[str] | None = None,
    most: int = 8,
    endings: bool = False,
    max_rounds: int = 200,
) -> Trial:
    """Return a strategy of runs with faults; each is a `Trial`, to be played or checked.

    Of several systems and rules, by name or as ``FILE.py:NAME``, one is drawn; None is the rule of
    the system. Seeds, processes, keepers and hesitation are drawn as well. A trial shrinks towards
    no faults, the first system, one process, seed 0. The rest is as for `faults`.

    >>> from hypothesis import given
    >>> @given(scenarios("agv:graph=C6,n=2"))
    ... def test_vehicles_reach_their_targets_whatever_the_wire_does(trial):
    ...     assert trial.check().goal_reached
    """
    systems = [system] if isinstance(system, str) else list(system)
    rules: list[str | None] = [rule] if rule is None or isinstance(rule, str) else list(rule)
    named = draw(st.sampled_from(systems))
    modules = len(built(named).start)
    processes = draw(st.integers(1, min(modules, 4)))
    free: dict[str, Any] = {}
    if clock == "free":
        free = {"keepers": draw(st.integers(1, 4)), "moves": draw(st.integers(1, 40))}
    struck = draw(
        faults(
            clock=clock,
            processes=processes,
            keepers=free.get("keepers", 0),
            kinds=kinds,
            most=most,
            endings=endings,
        )
    )
    return trial_of(
        named,
        draw(st.sampled_from(rules)),
        faults=struck,
        clock=clock,
        seed=draw(st.integers(0, 1 << 16)),
        processes=processes,
        hesitate=draw(st.sampled_from((0.0, 0.25, 0.5))),
        max_rounds=max_rounds,
        **free,
    )


_NTH_OWN_MAX = 20
_UNUSED = {
    "count": ("pause", "restart"),
    "way": ("cut",),
    "seconds": ("drop", "reorder", "cut", "restart"),
}
"""The kinds for which a field of `NetworkFault` means nothing."""


def network_faults(
    processes: Sequence[str],
    *,
    kinds: Sequence[NetworkFaultKind] = NETWORK_FAULTS,
    keys: Sequence[str] | None = None,
    most: int = 3,
) -> SearchStrategy[list[NetworkFault]]:
    """Return a strategy of lists of faults of your own processes, for `NetworkUnderTest.inject`.

    With `keys`, key expressions, each fault counts the messages on one of them. All strike within
    the first 20 messages that they count. They shrink towards none, then to the first of `kinds`,
    early and few messages.

    >>> from hypothesis import find
    >>> find(network_faults(["arm"], kinds=["cut"]), lambda each: len(each) > 0)
    [NetworkFault('cut', 'arm')]
    """
    if isinstance(keys, str):
        raise InputError(f"keys={keys!r}: expected key expressions, as ['robot/arm']")
    drawn: dict[str, SearchStrategy[Any]] = {
        # Of what comes rarely, only the first messages can be struck.
        "nth": st.just(0) | st.integers(0, 3) | st.integers(0, _NTH_OWN_MAX),
        "count": st.integers(1, 3) | st.integers(1, _NTH_OWN_MAX),
        "way": st.sampled_from(get_args(Direction)),
        "seconds": st.sampled_from((0.01, 0.1, 0.5)),
        **({} if keys is None else {"key": st.sampled_from(list(keys))}),
    }

    def of_kind(kind: NetworkFaultKind) -> SearchStrategy[NetworkFault]:
        used = {name: each for name, each in drawn.items() if kind not in _UNUSED.get(name, ())}
        return st.builds(NetworkFault, st.just(kind), st.sampled_from(list(processes)), **used)

    return st.lists(st.sampled_from(list(kinds)).flatmap(of_kind), max_size=most)
