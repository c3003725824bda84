"""What the plays of a rule show: where it chose otherwise, and why that is so.

A rule is local if its choices follow from what its module knows from birth, what it has seen, and
its own stream. So each play in which something else was different must have the same choices as the
run; each that does not is a finding, and so is each use of what is outside.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Literal, TypeAlias

from cubepath.agents.locality.plays import Access, Life

Kind: TypeAlias = Literal[
    "reach",
    "state",
    "clock",
    "random",
    "process",
    "environment",
    "files",
    "network",
    "frames",
    "memory",
    "seed",
    "hashing",
    "fails",
    "repeat",
    "unexplained",
]

USES: Mapping[Kind, str] = {
    "clock": "uses the clock",
    "random": "uses random numbers that are not the module's own",
    "process": "uses the process, its threads or others",
    "environment": "uses the machine or the environment of the process",
    "files": "uses files",
    "network": "uses the network",
    "frames": "looks at stack frames",
    "memory": "looks at what else is in memory",
    "seed": "asks for the seed of the run",
}
"""By kind of access what the rule does."""
DEPENDS: Mapping[Kind, str] = {
    "reach": "sees beyond its reach",
    "state": "keeps state outside the module",
    "clock": "depends on the clock",
    "random": "depends on random numbers that are not the module's own",
    "process": "depends on the process it is in",
    "environment": "depends on the folder or the environment of the process",
    "hashing": "depends on hashes or addresses, as by the order of a set",
    "repeat": "does not choose the same twice",
    "unexplained": "depends on something outside the module that was not seen",
    "fails": "fails",
}
"""By kind of difference what the rule does."""


PERIOD: Mapping[str, str] = {"lockstep": "round", "free": "turn"}
"""By clock what the choices of a module are counted by."""


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing that is wrong with a rule: its kind, and a line for people."""

    kind: Kind
    text: str


@dataclass(frozen=True, slots=True)
class Difference:
    """The first choice that was another one: where, and both choices in words."""

    module: int
    round: int
    was: str
    now: str


@dataclass(slots=True)
class Evidence:
    """What was found in all scenes, in the order in which it was."""

    accesses: set[Access] = field(default_factory=set)
    depends: dict[Kind, str] = field(default_factory=dict)
    """By kind the first difference, in words."""
    changed: set[str] = field(default_factory=set)
    """Global names of the rule's file that were changed."""

    def add(self, kind: Kind, text: str) -> None:
        """Keep the first difference of a kind."""
        self.depends.setdefault(kind, text)

    def findings(self) -> Iterator[Finding]:
        """Yield a finding a kind: what was used, where, and what came of it."""
        for kind, depends in DEPENDS.items():
            if kind in self.depends and kind not in USES:
                names = f" ({', '.join(sorted(self.changed))} changed)" if kind == "state" else ""
                shown = names if self.changed else ""
                yield Finding(kind, f"{depends}{shown}: {self.depends[kind]}")
        for kind, uses in USES.items():
            used = sorted(f"{each.what} in {each.where}" for each in self.accesses_of(kind))
            if used:
                came = self.depends.get(kind)
                if came is None and (kind in DEPENDS or not self.depends):
                    came = "no choice was seen to change with it"
                shown = "" if came is None else f": {came}"
                yield Finding(kind, f"{uses} ({', '.join(used)}){shown}")
            elif kind in self.depends:
                yield Finding(kind, f"{DEPENDS[kind]}: {self.depends[kind]}")

    def accesses_of(self, kind: Kind) -> list[Access]:
        """Return the accesses of a kind."""
        return [each for each in self.accesses if each.kind == kind]


def difference(run: Mapping[int, Life], other: Mapping[int, Life]) -> Difference | None:
    """Return the first choice that differs, by round and module; None if there is none.

    A play may have fewer modules than the run; its rounds count as far as both go, and up to the
    first difference both have seen the same.
    """
    rounds = max((len(life.choices) for life in run.values()), default=0)
    for index in range(rounds):
        for module in sorted(run.keys() & other.keys()):
            was, now = run[module].choices, other[module].choices
            if index < len(was) and index < len(now) and was[index] != now[index]:
                number = index + 1 if run[module].observations else 0
                return Difference(module, number, *was[index].beside(now[index]))
    return None


def told(spec: str, found: Difference, how: str, clock: str) -> str:
    """Return a difference in words; `how` says what was different about the play."""
    when = f"in {PERIOD[clock]} {found.round}" if found.round else "when it was made"
    return f"module_{found.module} of {spec} has {found.was} {when}, {how} {found.now}"
