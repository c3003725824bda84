"""Cube paths by their definitions, written to be read and to check the results of other code.

Source: Abrams and Ghrist, definitions of cube path and normal cube path. This module shares nothing
with `cubepath.coordinator.normal_form.heap`: `cubepath verify` compares the two, so each must be
able to prove the other wrong.
"""

from collections import Counter
from collections.abc import Collection, Iterable, Sequence
from itertools import pairwise

from cubepath.protocol.core.actions import Action, State, apply_in_place
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.sites import Site


def is_cube(actions: Iterable[Action]) -> bool:
    """Return whether the actions commute pairwise, as the edges of a cube at one vertex do.

    Source: the paper's definition of the state complex. No action may occur twice, since none
    commutes with itself. A vertex is a cube, with no action.

    All pairs are checked at once: no trace meets another's support iff each site of a trace is in
    the support of only its own action. Time is linear in the supports.

    >>> left, right = Action([1, 2], [1, 2], [1], [2]), Action([2, 3], [2, 3], [2], [3])
    >>> is_cube([left]), is_cube([left, right]), is_cube([left, left])
    (True, False, False)
    """
    cube = list(actions)
    supports = Counter(site for action in cube for site in action.support)
    return all(supports[site] == 1 for action in cube for site in action.trace)


def is_normal(cubes: Sequence[Collection[Action]]) -> bool:
    """Return whether the cubes form a normal cube path.

    Definition: all are cubes, none is a mere vertex, and no action of a cube is in the previous
    cube or commutes with all of it. This is the paper's condition (3), that the star of a cube
    meets the next cube in one vertex only, read at the vertex between them, that is, in the
    universal cover. In the complex itself two cubes may meet in more vertices and the path still be
    normal: two vehicles at 0 and 2 of the 4-cycle 0123 that take the edges {01, 23} and then
    {12, 30} are back at the start, and this is the shortest path of its homotopy class. Time is
    linear in the supports.

    >>> def edge(a, b):
    ...     return Action([a, b], [a, b], [a], [b])
    >>> is_normal([[edge(0, 1), edge(2, 3)], [edge(1, 2), edge(3, 0)]])
    True
    >>> is_normal([[edge(0, 1)], [edge(2, 3)]]), is_normal([[edge(0, 1)], [edge(0, 1)]])
    (False, False)
    """
    return all(len(cube) > 0 and is_cube(cube) for cube in cubes) and not any(
        too_late(cube, following) for cube, following in pairwise(cubes)
    )


def too_late(cube: Collection[Action], following: Collection[Action]) -> list[Action]:
    """Return the actions of a cube that are in the cube before, or commute with all of it.

    Costs the supports.

    >>> one, other = Action([1, 2], [1, 2], [1], [2]), Action([2, 3], [2, 3], [2], [3])
    >>> too_late([one], [other]), too_late([one], [one]) == [one]
    ([], True)
    """
    held = frozenset(cube)
    traces = {site for action in cube for site in action.trace}
    supports = {site for action in cube for site in action.support}
    return [
        action
        for action in following
        if action in held
        or (action.trace.isdisjoint(supports) and action.support.isdisjoint(traces))
    ]


def end_state(path: Iterable[Action | Iterable[Action]], start: State) -> frozenset[Site]:
    """Return the state at the end of an edge path or a cube path; each item is a move or a cube.

    Definition: an action is admissible if the state shows one of its local states, which is then
    replaced by the other. The actions of a cube are applied one after another; since they commute,
    any order will do. InputError names the first move that is not admissible, by its cube and its
    place, both counted from 1. Costs the supports and one copy of the state.

    >>> step, on = Action([1, 2], [1, 2], [1], [2]), Action([2, 3], [2, 3], [2], [3])
    >>> sorted(end_state([step, on], {1, 7}))
    [3, 7]
    >>> end_state([[step], [step, on]], {1})  # doctest: +ELLIPSIS
    Traceback (most recent call last):
    ...
    cubepath.protocol.core.errors.InputError: cube 2, move 2: ...: site 2 is off, expected on
    """
    state = set(start)
    for number, item in enumerate(path, start=1):
        if isinstance(item, Action):
            _step(item, state, f"move {number}")
            continue
        for place, action in enumerate(item, start=1):
            _step(action, state, f"cube {number}, move {place}")
    return frozenset(state)


def _step(action: Action, state: set[Site], where: str) -> None:
    try:
        apply_in_place(action, state)
    except InputError as error:
        raise InputError(f"{where}: {error}") from None
