"""States of a pure node: copied, told apart, and each step from one of them made once.

A copy shares what never changes (scene, system, moves, messages) and holds anew what does: the
attributes of nodes, modules and rules, what rules keep in closures, random streams. What is neither
known to be constant nor known to be mutable is refused, so that nothing is forgotten.
"""

from collections import deque
from collections.abc import Callable, Hashable
from dataclasses import dataclass
from functools import cache
from types import BuiltinFunctionType, CellType, FunctionType
from typing import Any, TypeAlias

import msgspec
import numpy as np

from cubepath.agents.processes.judge import Judge, Refusals
from cubepath.agents.rules.graph_distances import Roads
from cubepath.agents.rules.rule import InitialKnowledge
from cubepath.protocol.core.system import System, VehicleGraph
from cubepath.protocol.wire.messages import encode
from cubepath.protocol.wire.nodes import End, Ignore, Keep, Listen, Node, Put, Timer

_CONSTANT = (
    *(type(None), bool, int, float, str, bytes, frozenset, type),
    *(System, VehicleGraph, Roads, Judge, Refusals, msgspec.Struct, BuiltinFunctionType),
    type(cache(len)),
)
"""What never changes, or keeps only what it could compute again."""
_OWN = ("cubepath", "exploration", "samples", "agents", "tests")
"""Where classes are whose objects are copied attribute by attribute."""
_ALIKE = (System, VehicleGraph, Roads, Judge, Refusals, BuiltinFunctionType, type(cache(len)))
"""What is one and the same for all states of a node, or only tells of what had no effect."""


_Known: TypeAlias = dict[int, Any]
"""By the identity of what was met: its copy, or what was told of it."""


def _attributes(value: Any) -> dict[str, Any]:
    """Return the attributes of an object of the project."""
    own = {name: getattr(value, name) for name in _slots(value.__class__) if hasattr(value, name)}
    return own | getattr(value, "__dict__", {})


@cache
def _slots(kind: type) -> tuple[str, ...]:
    if kind.__module__.split(".")[0] not in _OWN:
        raise TypeError(f"{kind.__module__}.{kind.__name__}: neither constant nor known to change")
    return tuple(name for each in kind.__mro__ for name in getattr(each, "__slots__", ()))


# Hundreds of thousands of states are copied and told, so what to do is asked once for each type.


def copied(value: Any, known: _Known) -> Any:
    """Return a copy that shares nothing that changes; `known` has the copies so far by identity."""
    copy = _copier(value.__class__)
    return value if copy is None else copy(value, known)


@cache
def _copier(kind: type) -> Callable[[Any, _Known], Any] | None:
    """Return what copies values of a type; None: they never change, so that copies share them."""
    if _is_constant(kind):
        return None
    return next((copy for base, copy in _COPIERS.items() if issubclass(kind, base)), _copy_object)


@cache
def _is_constant(kind: type) -> bool:
    """Return whether values of a type never change."""
    parameters = getattr(kind, "__dataclass_params__", None)
    return issubclass(kind, _CONSTANT) or (
        parameters is not None and parameters.frozen and kind is not InitialKnowledge
    )


def _copy_tuple(value: Any, known: _Known) -> Any:
    found = known.get(id(value))
    if found is None:
        make = getattr(type(value), "_make", tuple)  # of a named tuple
        found = known[id(value)] = make([copied(each, known) for each in value])
    return found


def _copy_dict(value: dict[Any, Any], known: _Known) -> Any:
    found = known.get(id(value))
    if found is None:
        found = known[id(value)] = {}
        for key, each in value.items():
            found[copied(key, known)] = copied(each, known)
    return found


def _copy_sequence(value: Any, known: _Known) -> Any:
    found = known.get(id(value))
    if found is None:
        found = known[id(value)] = type(value)()
        found.extend([copied(each, known) for each in value])
    return found


def _copy_set(value: set[Any], known: _Known) -> Any:
    found = known.get(id(value))
    if found is None:
        constant = all(_is_constant(each.__class__) or type(each) is tuple for each in value)
        assert constant, f"{value}: a set of what may change"
        found = known[id(value)] = set(value)
    return found


def _copy_stream(value: np.random.Generator, known: _Known) -> Any:
    found = known.get(id(value))
    if found is None:
        bits: Any = type(value.bit_generator)(0)
        bits.state = value.bit_generator.state
        found = known[id(value)] = np.random.Generator(bits)
    return found


def _copy_function(value: FunctionType, known: _Known) -> Any:
    before = value.__closure__
    if before is None:
        return value
    found = known.get(id(value))
    if found is None:
        cells = tuple(CellType() for _ in before)
        found = known[id(value)] = FunctionType(
            value.__code__, value.__globals__, value.__name__, value.__defaults__, cells
        )
        for cell, other in zip(cells, before, strict=True):
            cell.cell_contents = copied(other.cell_contents, known)
    return found


def _copy_object(value: Any, known: _Known) -> Any:
    found = known.get(id(value))
    if found is None:
        # It is known before its parts are copied: they may refer to it.
        found = known[id(value)] = object.__new__(type(value))
        for name, each in _attributes(value).items():
            object.__setattr__(found, name, copied(each, known))
    return found


_COPIERS: dict[type, Callable[[Any, _Known], Any]] = {
    tuple: _copy_tuple,
    dict: _copy_dict,
    list: _copy_sequence,
    deque: _copy_sequence,
    set: _copy_set,
    np.random.Generator: _copy_stream,
    FunctionType: _copy_function,
}


def told(value: Any, known: _Known) -> Hashable:
    """Return what a value holds, so that equal values are told alike; dictionaries are unordered.

    That the order in which entries came into a dictionary makes no difference is not shown by the
    explorer, except for what is said and kept: of states that differ in it alone it follows one.
    """
    tell = _teller(value.__class__)
    return value if tell is None else tell(value, known)


@cache
def _teller(kind: type) -> Callable[[Any, _Known], Hashable] | None:
    """Return what tells values of a type; None: they are told by themselves."""
    for base, tell in _TELLERS.items():
        if issubclass(kind, base):
            return tell
    if _is_constant(kind):
        return None
    return _tell_object


def _tell_kind(value: Any, known: _Known) -> Hashable:
    del known
    return type(value).__name__


def _tell_sequence(value: Any, known: _Known) -> Hashable:
    return tuple([told(each, known) for each in value])


def _tell_dict(value: dict[Any, Any], known: _Known) -> Hashable:
    return frozenset([(told(key, known), told(each, known)) for key, each in value.items()])


def _tell_function(value: FunctionType, known: _Known) -> Hashable:
    cells = [told(cell.cell_contents, known) for cell in value.__closure__ or ()]
    return (value.__qualname__, *cells)


def _tell_object(value: Any, known: _Known) -> Hashable:
    found = known.get(id(value))
    if found is None:
        known[id(value)] = "itself"
        parts = [(name, told(each, known)) for name, each in _attributes(value).items()]
        found = known[id(value)] = (type(value).__name__, *parts)
    return found


_TELLERS: dict[type, Callable[[Any, _Known], Hashable]] = {
    **dict.fromkeys(_ALIKE, _tell_kind),
    msgspec.Struct: lambda value, _: encode(value),
    Keep: lambda value, _: value.data,
    FunctionType: _tell_function,
    np.random.Generator: lambda value, known: told(value.bit_generator.state, known),
    tuple: _tell_sequence,
    list: _tell_sequence,
    deque: _tell_sequence,
    dict: _tell_dict,
    set: lambda value, _: frozenset(value),
}


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
