"""Rules: plain functions from a view to a choice, each made for one module when it starts.

Other distributions add rules under the entry point group ``cubepath.rules``: each entry names a
`RuleType`.
"""

from __future__ import annotations

import operator
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from typing import NamedTuple, TypeAlias

import numpy as np

from cubepath.agents.local.observation import STAY, Note, View, is_legal
from cubepath.agents.local.random_streams import RandomStream
from cubepath.agents.local.relative import RelativeObserver, relative_observer
from cubepath.agents.rules.limits import RuleLimits, WrongSensing
from cubepath.agents.rules.vector_rule import VectorKnowledge, VectorRule
from cubepath.protocol.core.errors import InputError, RuleError
from cubepath.protocol.core.options import keys_of, options_from_values
from cubepath.protocol.core.parsing import Keys, all_values, given_values
from cubepath.protocol.core.sites import Site
from cubepath.protocol.core.system import System

LIMITS = keys_of(RuleLimits)
"""The keys that may follow the name of any rule."""


@dataclass(frozen=True, slots=True)
class InitialKnowledge:
    """What a module knows from the start: the static map, its own number, place and goals.

    `modules` is the number of modules; where the others are is unknown. `stream` has the module's
    own random numbers, derived from the seed of the run and its number; it does not tell that seed.
    """

    system: System
    module: int
    modules: int
    start: Site
    goals: tuple[Site, ...]
    stream: RandomStream

    @property
    def random(self) -> np.random.Generator:
        """Return the module's own numpy generator; what it draws does not depend on `stream`."""
        return self.stream.generator

    def shared_stream(self) -> RandomStream:
        """Return a new stream from which all modules of the run draw the same numbers.

        Modules that draw in every round agree without a message. It follows from the seed alone.
        """
        return RandomStream(self.stream.shared)

    @property
    def label(self) -> int | None:
        """Return the module's label in a labelled system."""
        return self.system.label_of(self.start)

    def relative(self) -> RelativeObserver:
        """Return what makes the relative observations of this module from its views' `numbers`.

        They are equal to those of an environment with ``observation="relative"``.
        """
        return relative_observer(self.system, self.goals)


@dataclass(frozen=True, slots=True)
class Choice:
    """An `action`, a `note` for the modules within reach, and whether the rule has given up.

    Action 0 stays; without a note the last one stands. Modules hear the note when they sense the
    next round, whether or not the move was granted. A rule that finds that it cannot reach its goal
    says so in `failed`, in one line.

    The rest is for the free clock, under which a note is a register at the module's place, and all
    of a choice happens at one instant or not at all: only if the support of the move, the `guards`
    (sensed places), the registers of the places that it `heeds` and `exchanges`, and the module's
    own if it writes that, are still as they were sensed. `exchanges` has new contents for the
    registers of modules at places within reach.

    >>> Choice(3, note=(1, 2)).note
    (1, 2)
    """

    action: int = STAY
    note: Note | None = None
    failed: str | None = None
    guards: tuple[Site, ...] = ()
    heeds: tuple[Site, ...] = ()
    exchanges: Mapping[Site, Note] = field(default_factory=dict)


def _silent(_modules: int) -> int:
    return 0


Rule: TypeAlias = Callable[[View], "int | Choice"]
"""A module calls it once per round: from what it sees to an action, or to a full `Choice`."""


@dataclass(frozen=True, slots=True)
class FreeRule:
    """How a rule holds without rounds: `why` it does, and what it is made by there.

    Without its own `make` it is made as under the lockstep clock.

    >>> from dataclasses import replace
    >>> rule = policy_rule("last", lambda observation, action_mask: action_mask.nonzero()[0][-1])
    >>> free = replace(rule, free=FreeRule(why="nothing beyond the support of a move matters"))
    >>> play_free("hex:n=3", free, max_cycles=5).turns
    15
    """

    why: str
    make: Callable[[InitialKnowledge], Rule] | None = None
    note_length: Callable[[int], int] = _silent


@dataclass(frozen=True, slots=True)
class RuleType:
    """A rule by name: its source, the systems that it fits, and how to make one for a module.

    Without `free`, the rule is for the lockstep clock alone.
    """

    name: str
    summary: str
    source: str
    fits: Callable[[System], bool]
    make: Callable[[InitialKnowledge], Rule]
    note_length: Callable[[int], int] = _silent
    """Length of the notes, from the number of modules; 0 for a rule that is silent."""
    free: FreeRule | None = None
    vectorised: Callable[[VectorKnowledge], VectorRule | None] | None = None
    """Makes the form that chooses for all modules of many environments, under the lockstep clock.

    Its choices and notes are those of the rules that `make` makes, so replacing one replaces the
    other. None if it does not know a system or scene: then each module is asked by itself.
    """
    keys: Keys = field(default_factory=dict, compare=False, repr=False)
    """The keys that may follow its name, as in ``metropolis:temperature=2``; those of `RuleLimits`
    follow any name."""
    configure: Callable[[Mapping[str, str]], RuleType] | None = None
    """Make the rule for the values of all its keys; InputError for a wrong value."""
    to_goal: bool = True
    """Whether it leads towards the goal; False if modules wander, and may reach it by chance."""
    content: str = field(default="", compare=False, repr=False)
    """What the rule follows from beside code, as a hash of it: learned weights, a table.

    Sweeps take a rule with another content for another rule.
    """

    def with_values(self, text: str) -> RuleType:
        """Return the rule with the values of keys, as text: KEY=VALUE,...

        InputError names a key that it does not have, or a wrong value.

        >>> rule_named("metropolis", scene_from_spec("hex").system).with_values("cooling=1").name
        'metropolis:cooling=1'
        """
        keys = {**self.keys, **LIMITS}
        given = given_values(text, keys, f"rule {self.name!r}")
        shown = ",".join(f"{key}={given[key]}" for key in keys if key in given)
        values = all_values(given, keys)
        rule = self if self.configure is None else self.configure(values)
        limited = rule if given.keys() <= self.keys.keys() else _limited(rule, values)
        return replace(limited, name=f"{self.name}:{shown}", keys=self.keys)

    @property
    def clocks(self) -> tuple[str, ...]:
        """Return the clocks under which the rule holds."""
        return ("lockstep",) if self.free is None else ("lockstep", "free")

    def is_for(self, system: System) -> bool:
        """Return whether the rule fits the system; InputError names a rule that cannot tell."""
        try:
            return bool(self.fits(system))
        except Exception as error:
            why = " ".join(f"{type(error).__name__}: {error}".split())
            code = getattr(self.fits, "__code__", None)
            file = "" if code is None else f" ({code.co_filename})"
            raise InputError(f"rule {self.name!r}{file}: its fits: {why}") from error

    def made(self, knowledge: InitialKnowledge, clock: str = "lockstep") -> Rule:
        """Return the rule of one module under a clock that it holds for; InputError if none."""
        own = None if clock == "lockstep" or self.free is None else self.free.make
        rule = (own or self.make)(knowledge)
        if not callable(rule):
            raise InputError(
                f"rule {self.name!r}: make returned {rule!r}, expected a function of a View"
            )
        return rule

    def length(self, modules: int, clock: str = "lockstep") -> int:
        """Return the length of the notes under a clock, from the number of modules.

        RuleError if the rule cannot tell.
        """
        own = (
            self.note_length if clock == "lockstep" or self.free is None else self.free.note_length
        )
        try:
            return operator.index(own(modules))
        except Exception as error:
            why = " ".join(f"{type(error).__name__}: {error}".split())
            raise RuleError(
                f"rule {self.name!r}: its note_length: {why}, expected a function of the number of"
                " modules that returns a whole number"
            ) from error


def _limited(rule: RuleType, values: Mapping[str, str]) -> RuleType:
    """Return the rule under the limits that these values set."""
    limits = options_from_values(RuleLimits, values)
    free = None
    if rule.free is not None:
        free = replace(rule.free, make=partial(_under, rule, limits, "free"))
    make = partial(_under, rule, limits, "lockstep")
    return replace(rule, make=make, free=free, vectorised=None, to_goal=False)


def _under(rule: RuleType, limits: RuleLimits, clock: str, knowledge: InitialKnowledge) -> Rule:
    inner = rule.made(knowledge, clock)
    if limits.misread:
        inner = _misled(inner, WrongSensing(limits.misread, knowledge.stream.key))
    left = limits.notes
    last: Note | None = None

    def choose(view: View) -> Choice:
        nonlocal left, last
        choice = as_choice(inner(view))
        if choice.note is None or tuple(choice.note) == last:
            return choice
        if not left:
            return replace(choice, note=None, exchanges={})
        left, last = left - 1, tuple(choice.note)
        return choice

    return choose


def _misled(inner: Rule, sensing: WrongSensing) -> Rule:
    def choose(view: View) -> Choice:
        try:
            choice = as_choice(inner(sensing.of(view)))
        except Exception:  # noqa: BLE001 - what it sees may be impossible, so anything may fail
            return Choice()
        return choice if is_legal(view.mask, choice.action) else replace(choice, action=STAY)

    return choose


class RuleName(NamedTuple):
    """The parts of a rule's name: FILE.py:NAME:KEY=VALUE,... of which only NAME must be there."""

    file: str
    name: str
    values: str

    @classmethod
    def of(cls, text: str) -> RuleName:
        """Return the parts of a name.

        >>> RuleName.of("mine.py:MINE:speed=2")
        RuleName(file='mine.py', name='MINE', values='speed=2')
        """
        begin, _, last = text.rpartition(":")
        named, values = (begin, last) if begin and "=" in last else (text, "")
        file, _, own = named.rpartition(":")
        return cls(file, own, values) if file.endswith(".py") else cls("", named, values)

    @property
    def without_values(self) -> str:
        """Return the name without its values."""
        return f"{self.file}:{self.name}" if self.file else self.name


def _action(found: object, whose: str, other: str = "") -> int:
    try:
        return operator.index(found)  # type: ignore[arg-type] # pyright: ignore[reportArgumentType]
    except TypeError:
        kind = "None" if found is None else type(found).__name__
        raise InputError(f"returned {whose}{kind}, expected one integer{other}") from None


def as_choice(found: int | Choice) -> Choice:
    """Return a rule's result as a choice, with its reason for giving up as one line."""
    if not isinstance(found, Choice):
        return Choice(_action(found, "", ", or a Choice"))
    _action(found.action, "a Choice of the action ")
    if found.failed is None:
        return found
    if not isinstance(found.failed, str):  # pyright: ignore[reportUnnecessaryIsInstance]
        raise InputError(
            f"returned a Choice with failed={found.failed!r}, expected why in one line"
        )
    return replace(found, failed=" ".join(found.failed.split()))
