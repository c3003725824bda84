"""The normal cube path of an edge path in the obvious way, which heaps are compared with."""

from collections.abc import Iterable

from cubepath.protocol.core.actions import Action, commute


def obvious_normal_form(actions: Iterable[Action]) -> tuple[frozenset[Action], ...]:
    """Return the normal cube path of an edge path in the obvious way, with each cube as a set.

    Each move walks down from the last cube as long as it commutes with the whole cube. If it meets
    a cube that contains its equal, both are removed; otherwise it joins the last cube that it
    passed, or becomes a new one. All higher cubes commute with it, so nothing else changes. Source:
    Foata normal form, in a right-angled Coxeter group. A move costs up to the whole path: this
    checks `cubepath.coordinator.normal_form.heap`, with which it shares only `commute`.

    >>> out, other = Action([1, 2], [1, 2], [1], [2]), Action([5, 6], [5, 6], [5], [6])
    >>> obvious_normal_form([out, other]) == (frozenset({out, other}),)
    True
    >>> obvious_normal_form([out, other, out]) == (frozenset({other}),)
    True
    """
    cubes: list[set[Action]] = []
    for action in actions:
        level = len(cubes)
        while level > 0 and all(commute(action, other) for other in cubes[level - 1]):
            level -= 1
        if level > 0 and action in cubes[level - 1]:
            cubes[level - 1].remove(action)
            # Only the last cube can become empty: every other cube blocks a move of the next one.
            if not cubes[level - 1]:
                cubes.pop()
        elif level == len(cubes):
            cubes.append({action})
        else:
            cubes[level].add(action)
    return tuple(frozenset(cube) for cube in cubes)
