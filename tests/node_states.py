"""States of a pure node: copied, told apart, and each step from one of them made once.

A copy shares what never changes (scene, system, moves, messages) and holds anew what does: the
attributes of nodes, modules and rules, what rules keep in closures, random streams. What is neither
known to be constant nor known to be mutable is refused, so that nothing is forgotten.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Hashable
from copy import deepcopy
from dataclasses import dataclass
from types import BuiltinFunctionType, CellType, FunctionType
from typing import Any

import msgspec
import numpy as np

from cubepath.agents.processes.judge import Judge
from cubepath.agents.processes.refusals import Refusals
from cubepath.agents.rules.graph_distances import Roads
from cubepath.agents.rules.rule import InitialKnowledge
from cubepath.protocol.core.system import System
from cubepath.protocol.core.vehicle_graph import VehicleGraph
from cubepath.protocol.wire.messages import encode
from cubepath.protocol.wire.nodes import End, Ignore, Keep, Listen, Node, Put, Timer

_CONSTANT = (
    *(type(None), bool, int, float, str, bytes, frozenset, type),
    *(System, VehicleGraph, Roads, Judge, Refusals, msgspec.Struct, BuiltinFunctionType),
)
"""What never changes, or keeps only what it could compute again."""
_OWN = ("cubepath", "node_states", "short_runs", "agents", "tests")
"""Where classes are whose objects are copied attribute by attribute."""
_ALIKE = (System, VehicleGraph, Roads, Judge, Refusals, BuiltinFunctionType)
"""What is one and the same for all states of a node, or only tells of what had no effect."""


def _is_cache(value: object) -> bool:
    return callable(value) and hasattr(value, "cache_parameters")


def _is_constant(value: object) -> bool:
    """Return whether a value never changes, so that copies of a node may share it."""
    if isinstance(value, _CONSTANT) or _is_cache(value):
        return True
    if isinstance(value, FunctionType):
        return value.__closure__ is None
    parameters = getattr(value, "__dataclass_params__", None)
    return parameters is not None and parameters.frozen and type(value) is not InitialKnowledge


def _attributes(value: object) -> dict[str, Any]:
    """Return the attributes of an object of the project."""
    kind = type(value)
    if kind.__module__.split(".")[0] not in _OWN:
        raise TypeError(f"{kind.__module__}.{kind.__name__}: neither constant nor known to change")
    slots = [name for each in kind.__mro__ for name in getattr(each, "__slots__", ())]
    own = {name: getattr(value, name) for name in slots if hasattr(value, name)}
    return own | getattr(value, "__dict__", {})


def copied(value: Any, known: dict[int, Any]) -> Any:
    """Return a copy that shares nothing that changes; `known` has the copies so far by identity."""
    if _is_constant(value):
        return value
    if id(value) not in known:
        _copy(value, known)
    return known[id(value)]


def _copy(value: Any, known: dict[int, Any]) -> None:
    """Enter a copy into `known`, before its parts are copied: they may refer to it."""
    match value:
        case tuple():
            parts = [copied(each, known) for each in value]
            make = getattr(type(value), "_make", tuple)  # of a named tuple
            known[id(value)] = make(parts)
        case np.random.Generator() | set():
            known[id(value)] = deepcopy(value)
        case dict():
            table = known[id(value)] = {}
            table.update((copied(key, known), copied(each, known)) for key, each in value.items())
        case list() | deque():
            sequence = known[id(value)] = type(value)()
            sequence.extend(copied(each, known) for each in value)
        case FunctionType():
            _copy_closure(value, known)
        case _:
            found = known[id(value)] = object.__new__(type(value))
            for name, each in _attributes(value).items():
                object.__setattr__(found, name, copied(each, known))


def _copy_closure(value: FunctionType, known: dict[int, Any]) -> None:
    before = value.__closure__ or ()
    cells = tuple(CellType() for _ in before)
    known[id(value)] = FunctionType(
        value.__code__, value.__globals__, value.__name__, value.__defaults__, cells
    )
    for cell, other in zip(cells, before, strict=True):
        cell.cell_contents = copied(other.cell_contents, known)


def told(value: Any, known: dict[int, Hashable]) -> Hashable:
    """Return what a value holds, so that equal values are told alike; dictionaries are unordered.

    That the order in which entries came into a dictionary makes no difference is not shown by the
    explorer, except for what is said and kept: of states that differ in it alone it follows one.
    """
    if isinstance(value, _ALIKE) or _is_cache(value):
        return type(value).__name__
    if isinstance(value, msgspec.Struct):
        return encode(value)
    if isinstance(value, Keep):
        return value.data
    if _is_constant(value) and not isinstance(value, FunctionType):
        return value  # type: ignore[no-any-return]
    if isinstance(value, np.random.Generator):
        return told(value.bit_generator.state, known)
    return _told_parts(value, known)


def _told_parts(value: Any, known: dict[int, Hashable]) -> Hashable:
    match value:
        case tuple() | list() | deque():
            return tuple([told(each, known) for each in value])
        case dict():
            return frozenset([(told(key, known), told(each, known)) for key, each in value.items()])
        case set():
            return frozenset(value)
        case FunctionType():
            cells = [told(cell.cell_contents, known) for cell in value.__closure__ or ()]
            return (value.__qualname__, *cells)
        case _ if id(value) not in known:
            known[id(value)] = "itself"
            parts = [(name, told(each, known)) for name, each in _attributes(value).items()]
            known[id(value)] = (type(value).__name__, *parts)
        case _:
            pass
    return known[id(value)]


@dataclass(frozen=True, slots=True)
class Reaction:
    """What a node in one state does when something happens to it."""

    state: int
    """The number of the state that it is in afterwards."""
    puts: tuple[Put, ...]
    timer: Timer | None
    """The last that it set; None: it left its timer as it was."""


class Seat:
    """A node with what its shell knows of it: the keys that it listens to, and whether it ended."""

    def __init__(self, node: Node) -> None:
        self.node = node
        self.keys: set[str] = set()
        self.keys_so_far: set[str] = set()
        self.ended = False

    def carry_out(self, do: Callable[[], list[Any]]) -> tuple[tuple[Put, ...], Timer | None]:
        """Let the node do something; return what it puts and the timer it sets."""
        puts: list[Put] = []
        timer: Timer | None = None
        for effect in do():
            match effect:
                case Put():
                    puts.append(effect)
                case Timer():
                    timer = effect
                case Listen(keys=keys):
                    assert not self.keys & set(keys), "it listens to a key twice"
                    self.keys.update(keys)
                    self.keys_so_far.update(keys)
                case Ignore(keys=keys):
                    assert self.keys >= set(keys), "it ignores a key that it does not listen to"
                    self.keys.difference_update(keys)
                case End():
                    self.ended = True
                case Keep():
                    raise AssertionError("what is kept is the coordinator's own affair")
                case _:
                    raise AssertionError(f"no effect: {effect!r}")
        return tuple(puts), timer


class States:
    """The states of one node as numbers, and its reactions."""

    def __init__(self, node: Node) -> None:
        self.seats: list[Seat] = []
        self.computed = 0
        """How many reactions were computed; the others were known."""
        self._numbers: dict[Hashable, int] = {}
        self._reactions: dict[tuple[int, tuple[str, bytes] | None], Reaction] = {}
        seat = Seat(node)
        self.first = self._reaction(seat, node.start)

    def after(self, state: int, put: tuple[str, bytes] | None) -> Reaction:
        """Return what it does when it receives this in a state; None: when its timer runs out."""
        found = self._reactions.get((state, put))
        if found is None:
            self.computed += 1
            seat = copied(self.seats[state], {})
            node = seat.node
            found = self._reaction(seat, node.tick if put is None else lambda: node.receive(*put))
            self._reactions[state, put] = found
        return found

    def _reaction(self, seat: Seat, do: Callable[[], list[Any]]) -> Reaction:
        puts, timer = seat.carry_out(do)
        key = told(seat, {})
        number = self._numbers.setdefault(key, len(self.seats))
        if number == len(self.seats):
            self.seats.append(seat)
        return Reaction(number, puts, timer)

    def steps(self) -> dict[int, set[int]]:
        """Return by state the other states that it was seen to come to in one step."""
        found: dict[int, set[int]] = {}
        for (state, _), reaction in self._reactions.items():
            if reaction.state != state:
                found.setdefault(state, set()).add(reaction.state)
        return found
