"""Faults of a simulated wire: what can happen, and where it is decided that it does.

A fault has a place and a count: the 12th message on the way up from process_1, the 40th message
that the coordinator takes. So a list of faults means the same when you remove some of them, and a
failing run can be shrunk.

In runs without rounds a fault happens at any time and place, up to a last one. Nothing ends such a
run, so faults may last as long as they like. Afterwards every process is back, or gone permanently.
"""

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from random import Random
from typing import Protocol, TypeAlias

SECOND_US = 1_000_000

ON_HOPS = ("delay", "reorder", "duplicate", "loss")
"""A message comes later and holds back those behind it, or is overtaken; comes twice, or not."""
ON_PROCESSES = ("pause", "slow", "crash", "return", "stall")
"""A process does nothing for a while, or is slow with some messages; dies, dies and comes back
without memory, or does nothing for longer than the patience."""
ON_ROUTER = ("router",)
"""The router dies, and comes back without what was under way."""
LIES = (
    "lie-site",
    "lie-claim",
    "lie-verdict",
    "lie-note",
    "lie-report",
    "lie-heard",
    "lie-count",
    "lie-other",
    "lie-part",
    "lie-double",
    "lie-old",
    "lie-withhold",
    "lie-silence",
    "lie-flood",
)
"""What a liar says is false, of another module or in part missing; it says it twice, or says what
was said before; says nothing, and counts that or not; or says far too much."""
SAYS = " says"
"""What a process puts is counted at its name with this."""
KINDS = (*ON_HOPS, *ON_PROCESSES, *ON_ROUTER)
ENDING = frozenset(("crash", "return", "stall"))
"""The kinds that may end a run; all others must be tolerated."""
ROUTER = "router"
SLOW_MESSAGES = 20
"""How many messages a slow receiver is slow with."""

_RATES: Mapping[str, tuple[float, float]] = {
    "delay": (0.003, 0.2),
    "reorder": (0.003, 0.2),
    "duplicate": (0.003, 0.2),
    "loss": (0.001, 0.08),
    "pause": (0.0005, 0.01),
    "slow": (0.0005, 0.01),
    "router": (0.0002, 0.004),
}
"""The least and the greatest rate of a kind: per hop, per message taken, per message routed."""
_AMOUNTS_US: Mapping[str, tuple[float, float]] = {
    "delay": (10, 0.2 * SECOND_US),
    "reorder": (10, 0.2 * SECOND_US),
    "duplicate": (0.5, 0.2 * SECOND_US),
    "pause": (100, 20 * SECOND_US),
    "slow": (100, 0.05 * SECOND_US),
    "router": (1000, 5 * SECOND_US),
    "return": (1000, 5 * SECOND_US),
}
SWITCHED_OFF = 0.4
"""How probable it is that a run has none of a kind."""
_ONCE: Mapping[str, float] = {"crash": 0.08, "return": 0.05, "stall": 0.03}
"""How probable it is that a run has one of an ending kind."""
_STALL = (1.2, 5.0)
"""How long a stall takes, in units of the patience."""
_LYING, _SECOND_LIAR = 0.8, 0.2
"""How probable it is that a run that may have liars has one, and that there is a second."""
_LIE_RATES = (0.01, 0.3)
"""The least and the greatest rate of lies: per message that a liar says."""
_OUTAGE = 0.5
"""The tolerated share of the patience for all outages of a run together."""
_BRIEF_US = 0.01 * SECOND_US
"""What takes no longer is no outage."""


@dataclass(frozen=True, slots=True, order=True)
class Fault:
    """One fault: its kind, where, at which count there (from 0), and how long, if it takes time."""

    where: str
    nth: int
    kind: str
    amount_us: int = 0


class Faults(Protocol):
    """Says which faults happen at each place and count; each is asked for once."""

    @property
    def liars(self) -> frozenset[str]:
        """Return the names of the processes that may tell lies."""
        ...

    def at(self, where: str, nth: int, kinds: Sequence[str] = ()) -> Fault | None:
        """Return the fault at a place, if there is one.

        A place is a link such as ``process_0 up``, for its next message; a process, before it takes
        a message; `ROUTER`, before it routes one; or a process with `STARTS` or `SAYS` behind its
        name. There, `kinds` are the lies that there are about the message.
        """


class ListedFaults:
    """The faults of a list, and no others."""

    def __init__(self, faults: Iterable[Fault]) -> None:
        """Sort the faults by place."""
        self._faults = {(fault.where, fault.nth): fault for fault in faults}
        self.asked = Counter[str]()
        """How often it was asked, by kind of place."""

    def at(self, where: str, nth: int, kinds: Sequence[str] = ()) -> Fault | None:
        """Return the listed fault, if there is one, and if it fits here."""
        self.asked[_kind_of_place(where)] += 1
        found = self._faults.get((where, nth))
        return None if found is None or (kinds and found.kind not in kinds) else found

    @property
    def liars(self) -> frozenset[str]:
        """Return the names of the processes with a lie on the list."""
        return frozenset(
            where.removesuffix(SAYS) for where, _ in self._faults if where.endswith(SAYS)
        )


@dataclass(slots=True)
class BranchedFaults:
    """The faults of a list up to a step, and the rest of them at other places from there on.

    Each of the rest comes at most once, and as rarely as in a run with the list alone.
    """

    listed: ListedFaults
    step: int
    rest: list[Fault]
    random: Random
    asked: Mapping[str, int]
    """How often a run with the list asks, by kind of place."""
    _begun: bool = False

    @property
    def liars(self) -> frozenset[str]:
        """Return the names of the processes with a lie on the list."""
        return self.listed.liars

    def begin(self) -> int:
        """Go over to other places; return a seed for other delays."""
        self._begun = True
        return self.random.getrandbits(32)

    def at(self, where: str, nth: int, kinds: Sequence[str] = ()) -> Fault | None:
        """Return the listed fault, or draw which of the rest happens here."""
        if not self._begun:
            return self.listed.at(where, nth, kinds)
        place = _kind_of_place(where)
        for fault in self.rest:
            fits = _kind_of_place(fault.where) == place and (not kinds or fault.kind in kinds)
            if fits and self.random.random() * self.asked[place] < 1:
                self.rest.remove(fault)
                return replace(fault, where=where, nth=nth)
        return None


def _kind_of_place(where: str) -> str:
    """Return what kind of place a place is: a link, the router, or processes of a kind."""
    name, _, what = where.partition(" ")
    return "link" if what in ("up", "down") else f"{name.rstrip('0123456789')} {what}"


_Table: TypeAlias = list[tuple[float, str]]
"""Kinds of faults, each with the sum of the rates so far, the largest first."""


def _table(rates: Mapping[str, float]) -> _Table:
    found, total = [], 0.0
    for kind, rate in sorted(rates.items(), key=lambda each: -each[1]):
        total += rate
        found.append((total, kind))
    return found


class _Drawn:
    """Faults at random, by tables of what can happen at each place.

    What takes time is drawn only as long as all of it together fits into the outages of a run.
    """

    def __init__(
        self, random: Random, outages_us: float, amounts_us: Mapping[str, tuple[float, float]]
    ) -> None:
        self._random = random
        self._left_us = outages_us
        self._amounts_us = amounts_us
        self._draw = random.random
        self._tables: dict[str, _Table] = {}
        self._ends: dict[tuple[str, int], Fault] = {}

    def at(self, where: str, nth: int, kinds: Sequence[str] = ()) -> Fault | None:
        """Draw whether something happens, or whether a liar lies now, and how."""
        if kinds:
            return self._lie(where, nth, kinds)
        if self._ends and (where, nth) in self._ends:
            return self._ends[where, nth]
        table = self._tables.get(where)
        if not table:
            return None
        one = self._draw()
        if one >= table[-1][0]:
            return None
        kind = next(kind for total, kind in table if one < total)
        amount = self._amount_us(kind)
        outage = self._outage_us(kind, amount)
        if outage > _BRIEF_US:
            if outage > self._left_us:
                return None
            self._left_us -= outage
        return Fault(where, nth, kind, amount)

    def _lie(self, _where: str, _nth: int, _kinds: Sequence[str]) -> Fault | None:
        return None

    def _amount_us(self, kind: str) -> int:
        bounds = self._amounts_us.get(kind)
        return 0 if bounds is None else int(between(self._random, *bounds))

    def _outage_us(self, _kind: str, amount_us: int) -> int:
        return amount_us


def _links(names: Iterable[str]) -> list[str]:
    return [f"{name} {way}" for name in names for way in ("up", "down")]


class DrawnFaults(_Drawn):
    """Faults at random: kinds are switched off and rates drawn for the whole run, then each fault.

    All that is tolerated takes less time together than the patience, so no run may end of it.
    """

    def __init__(
        self,
        random: Random,
        coordinator: str,
        processes: Iterable[str],
        patience_us: int,
        lies: Random | None = None,
    ) -> None:
        """Draw the rates, and where the ending faults are; `processes` are those of modules.

        With `lies` there are liars in most runs, which are drawn from it alone.
        """
        super().__init__(random, _OUTAGE * patience_us, _AMOUNTS_US)
        self._patience_us = patience_us
        names = list(processes)
        rates = {
            kind: 0.0 if random.random() < SWITCHED_OFF else between(random, *bounds)
            for kind, bounds in _RATES.items()
        }
        for places, kinds in (
            (_links([coordinator, *names]), ON_HOPS),
            ([coordinator, *names], ("pause", "slow")),
            ([ROUTER], ON_ROUTER),
        ):
            self._tables |= dict.fromkeys(places, _table({kind: rates[kind] for kind in kinds}))
        for kind, probability in _ONCE.items():
            if random.random() < probability:
                # Few of the later ones come to pass: many runs are over before.
                who = [*names, coordinator] if kind == "stall" else names
                at = (random.choice(who), int(between(random, 1, 300)) - 1)
                self._ends[at] = Fault(*at, kind, self._amount_us(kind))
        self._lies = lies
        self._liars: dict[str, tuple[float, frozenset[str]]] = {}
        if lies is not None and lies.random() < _LYING:
            for name in lies.sample(names, min(len(names), 1 + (lies.random() < _SECOND_LIAR))):
                possible = frozenset(kind for kind in LIES if lies.random() >= SWITCHED_OFF)
                self._liars[name] = between(lies, *_LIE_RATES), possible

    def _lie(self, where: str, nth: int, kinds: Sequence[str]) -> Fault | None:
        rate, own = self._liars.get(where.removesuffix(SAYS), (0.0, frozenset()))
        found = [kind for kind in kinds if kind in own]
        if self._lies is None or not found or self._lies.random() >= rate:
            return None
        return Fault(where, nth, self._lies.choice(found))

    def _amount_us(self, kind: str) -> int:
        if kind == "stall":
            return int(self._patience_us * self._random.uniform(*_STALL))
        return super()._amount_us(kind)

    def _outage_us(self, kind: str, amount_us: int) -> int:
        if kind == "duplicate":
            return 0
        return amount_us * (SLOW_MESSAGES if kind == "slow" else 1)

    @property
    def liars(self) -> frozenset[str]:
        """Return the names of the liars."""
        return frozenset(self._liars)


def between(random: Random, least: float, most: float) -> float:
    """Draw a number whose logarithm is uniform: each order of magnitude is equally probable."""
    return float(least * (most / least) ** random.random())


FREE_KINDS = (
    *ON_HOPS,
    "drag",
    "pause",
    "slow",
    "stall",
    "return",
    "cut",
    "torn",
    "leave",
    "crash",
    "late",
    "router",
    "partition",
    "one-way",
    "host",
    "twin",
    "jump",
)
"""Beside those of a run with rounds: a link is slow for a while; a process is killed after it has
written, and before it has sent, what follows from a message, or while it writes that; a module
process leaves, and perhaps comes back, or comes late; some hosts and the others do not hear each
other, or one side alone does not; a host dies with its processes, and comes back; a module process
stops, another takes its place, and it wakes up; a timer runs out early, as after a clock jump."""
_HOPS: Mapping[str, tuple[float, float]] = {
    "delay": (0.003, 0.3),
    "reorder": (0.003, 0.4),
    "duplicate": (0.003, 0.5),
    "loss": (0.003, 0.2),
    "drag": (0.0003, 0.01),
}
_HOST: Mapping[str, tuple[float, float]] = {
    "pause": (0.0005, 0.02),
    "slow": (0.0005, 0.01),
    "stall": (0.0002, 0.003),
    "return": (0.0005, 0.06),
    "cut": (0.0005, 0.06),
    "leave": (0.0002, 0.005),
    "crash": (0.0002, 0.004),
    "twin": (0.0002, 0.006),
    "jump": (0.0005, 0.02),
}
_KEEPER: Mapping[str, tuple[float, float]] = {
    "pause": (0.0005, 0.02),
    "slow": (0.0005, 0.01),
    "stall": (0.0002, 0.003),
    "return": (0.0005, 0.02),
    "cut": (0.001, 0.04),
    "torn": (0.001, 0.04),
    "jump": (0.0005, 0.02),
}
_ROUTER: Mapping[str, tuple[float, float]] = {
    "router": (0.0002, 0.004),
    "partition": (0.0002, 0.006),
    "one-way": (0.0002, 0.006),
    "host": (0.0001, 0.003),
}
_START: Mapping[str, tuple[float, float]] = {"late": (0.05, 0.5)}
"""The least and the greatest rate of a kind: per hop, per message taken, per message routed,
and per module process at its start."""
_FREE_AMOUNTS_US: Mapping[str, tuple[float, float]] = {
    "delay": (300, 2 * SECOND_US),
    "reorder": (300, 5 * SECOND_US),
    "duplicate": (300, 10 * SECOND_US),
    "drag": (1000, 0.5 * SECOND_US),
    "pause": (100, 2 * SECOND_US),
    "slow": (100, 0.1 * SECOND_US),
    "stall": (11 * SECOND_US, 30 * SECOND_US),
    "return": (1000, 3 * SECOND_US),
    "cut": (1000, 3 * SECOND_US),
    "torn": (1000, 3 * SECOND_US),
    "late": (0.1 * SECOND_US, 10 * SECOND_US),
    "leave": (2 * SECOND_US, 15 * SECOND_US),
    "router": (1000, 5 * SECOND_US),
    "partition": (1000, 12 * SECOND_US),
    "one-way": (1000, 12 * SECOND_US),
    "host": (1000, 5 * SECOND_US),
    "twin": (1000, 15 * SECOND_US),
}
STARTS = " starts"
"""Where a process starts is its name with this."""
_FOR_GOOD = 0.3
"""How probable it is that a process that leaves does not come back."""
_OUTAGES_US = 40 * SECOND_US
"""How long processes are away in a run, all together: faults are many rather than long."""


class FreeDrawnFaults(_Drawn):
    """Faults at random, in a run without rounds; a seed in eight has no fault at all."""

    liars: frozenset[str] = frozenset()

    def __init__(
        self, random: Random, coordinator: str, hosts: Iterable[str], keepers: Iterable[str]
    ) -> None:
        """Draw the rates, of module processes and keepers each; others have faults on links."""
        super().__init__(random, _OUTAGES_US, _FREE_AMOUNTS_US)
        names, kept = list(hosts), list(keepers)
        quiet = random.random() < 1 / 8
        off = {kind for kind in FREE_KINDS if quiet or random.random() < SWITCHED_OFF}
        for places, bounds in (
            (_links([coordinator, *names, *kept]), _HOPS),
            ([ROUTER], _ROUTER),
            (names, _HOST),
            (kept, _KEEPER),
            ([name + STARTS for name in names], _START),
        ):
            rates = {kind: between(random, *bounds[kind]) for kind in bounds if kind not in off}
            self._tables |= dict.fromkeys(places, _table(rates))

    def _amount_us(self, kind: str) -> int:
        if kind == "leave" and self._random.random() < _FOR_GOOD:
            return 0
        return super()._amount_us(kind)

    def _outage_us(self, kind: str, amount_us: int) -> int:
        return 0 if kind in _HOPS else amount_us
