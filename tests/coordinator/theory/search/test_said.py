"""What a system says of its paths: its errors are told by class and method, in one line."""

from collections.abc import Callable, Iterable

import pytest

from cubepath.coordinator.theory.search.lower_bounds import bounds_of, potential_of, ways_of
from cubepath.protocol.core.actions import State
from cubepath.protocol.core.errors import CheckError, InputError
from cubepath.protocol.core.sites import Site
from cubepath.protocol.core.system import Bound, Ways
from cubepath.protocol.systems.graph import GraphSystem

_NOTHING: dict[Site, tuple[int, ...]] = {}


class Late(GraphSystem):
    """Raises when its answers are used, not when it is asked."""

    def ways(self) -> Ways:
        return Ways(lambda site: _NOTHING[site], one_to_one=True)

    def bounds(self, start: State, goal: State) -> Iterable[Bound]:
        yield Bound(len(start) // (len(goal) - len(start)), "none")

    def potential(self, goal: State) -> Callable[[Site], int]:
        return lambda site: _NOTHING[site][0] if goal else 0


class Early(GraphSystem):
    """Raises when it is asked."""

    def ways(self) -> Ways:
        raise ValueError("two\nlines")

    def bounds(self, start: State, goal: State) -> Iterable[Bound]:
        raise CheckError(f"of the project: {start}, {goal}")

    def potential(self, goal: State) -> Callable[[Site], int]:
        raise KeyError(len(goal))


def near(system: GraphSystem) -> object:
    found = ways_of(system)
    assert found is not None
    return found.near(1)


def measured(system: GraphSystem) -> object:
    found = potential_of(system, frozenset({1}))
    assert found is not None
    return found(5)


def bounds(system: GraphSystem) -> object:
    return bounds_of(system, frozenset({0}), frozenset({1}), within=9)


@pytest.mark.parametrize(
    ("kind", "ask", "told"),
    [
        (Late, near, f"Late.ways of {__name__}: KeyError: 1"),
        (Late, bounds, f"Late.bounds of {__name__}: ZeroDivisionError: integer division"),
        (Late, measured, f"Late.potential of {__name__}: KeyError: 5"),
        (Early, near, f"Early.ways of {__name__}: ValueError: two lines"),
        (Early, measured, f"Early.potential of {__name__}: KeyError: 1"),
    ],
)
def test_errors_name_class_and_method(
    kind: type[GraphSystem], ask: Callable[[GraphSystem], object], told: str
) -> None:
    """Whether it raises at once or later."""
    with pytest.raises(InputError) as error:
        ask(kind([0, 1], [(0, 1)]))
    assert str(error.value).startswith(told)


def test_errors_of_the_project_go_through() -> None:
    """What a class says on purpose is told as it is."""
    with pytest.raises(CheckError, match="of the project"):
        bounds(Early([0, 1], [(0, 1)]))


def test_what_is_said_is_handed_on() -> None:
    """A system without errors is asked as if there were nothing between."""
    system = GraphSystem([0, 1, 2], [(0, 1), (1, 2)])
    assert near(system) == (0, 2)
    assert bounds(system) == []
    assert potential_of(system, frozenset({1})) is None
