"""Strategies of hypothesis: faults, and runs with faults, that shrink to few, early and short ones.

It takes hypothesis: ``pip install 'cubepath[testing]'``. Nothing else of the room imports it.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from cubepath.coordinator.simulation.faults import ENDING, FREE_KINDS, KINDS, Fault
from cubepath.coordinator.simulation.scenarios import built
from cubepath.coordinator.testing.trials import Clock, Trial, places, trial_of
from cubepath.protocol.core.errors import InputError

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
        if kind not in known:
            raise InputError(f"fault {kind}: expected one of {', '.join(known)}")
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


_TIMELESS = ("loss", "crash")


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
