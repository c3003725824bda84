"""The positive articulated arm on lattice edges.

Source: Abrams and Ghrist, example 2-d articulated planar arm.
"""

from __future__ import annotations

from cubepath.protocol.core.actions import State
from cubepath.protocol.core.catalogue import EDGES, Catalogue, Generator
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.sites import Site
from cubepath.protocol.core.system import Scene, System
from cubepath.protocol.scenes.family import Family, Values, whole
from cubepath.protocol.systems.lattice import LatticeSystem


def arm_catalogue() -> Catalogue:
    """Return the generators of the positive articulated arm on lattice edges.

    The edge ``(x, y, 0)`` runs right from the vertex (x, y), ``(x, y, 1)`` runs up. `flip` turns a
    corner (as words: xy <-> yx), `rotate` turns the last segment; its support holds, off, the
    edges that would continue the arm from either tip (paper, example articulated planar arm).
    """
    right, up = (0, 0, 0), (0, 0, 1)
    right_then_up, up_then_right = (1, 0, 1), (0, 1, 0)
    flip = Generator(
        name="flip",
        support=(right, right_then_up, up, up_then_right),
        trace=(right, right_then_up, up, up_then_right),
        before=(right, right_then_up),
        after=(up, up_then_right),
        # Segments keep their order along the arm: each turns in place.
        motion=((right, up), (right_then_up, up_then_right)),
    )
    rotate = Generator(
        name="rotate",
        support=(right, up, (1, 0, 0), right_then_up, up_then_right, (0, 1, 1)),
        trace=(right, up),
        before=(right,),
        after=(up,),
        motion=((right, up),),
    )
    return Catalogue(EDGES, (flip, rotate))


def _arm(name: str, values: Values) -> Scene:
    """Build a positive arm of n segments that begins straight up and ends as the word `goal`."""
    count = whole(values, "n", least=1)
    word = values["goal"] or "x" * count
    if len(word) != count or set(word) - {"x", "y"}:
        raise InputError(f"goal={word}: expected {count} letters x and y")
    goal = arm_sites(word)
    return Scene(
        spec=name,
        family=name,
        system=LatticeSystem(arm_catalogue()),
        start=arm_sites("y" * count),
        goal=frozenset(goal),
        goals=tuple((site,) for site in goal),
    )


def arm_sites(word: str) -> tuple[Site, ...]:
    """Return the lattice edges of the positive arm that spells `word` from the origin."""
    x = y = 0
    found: list[Site] = []
    for letter in word:
        found.append((x, y, 0 if letter == "x" else 1))
        x, y = (x + 1, y) if letter == "x" else (x, y + 1)
    return tuple(found)


def _is_positive_arm(system: System, start: State) -> bool:
    """Return whether the state is an arm that goes right and up, under the arm's own catalogue.

    Its complex is contractible for every length (paper, proposition on the positive arm).
    """
    if system.catalogue != arm_catalogue() or not system.open:
        return False
    edges = sorted(map(EDGES.check, start), key=lambda edge: edge[0] + edge[1])
    tips = [(x + 1 - axis, y + axis) for x, y, axis in edges]
    return all((edge[0], edge[1]) == tip for edge, tip in zip(edges[1:], tips, strict=False))


FAMILIES = (
    Family(
        "arm",
        "positive articulated arm on lattice edges",
        {
            "n": ("5", "number of segments"),
            "goal": ("", "word of the goal, from the base; all x when left out"),
        },
        _arm,
        LatticeSystem,
        "word",
        _is_positive_arm,
    ),
)
