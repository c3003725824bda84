"""A structure that is put together part by part, in steps.

Source: Abrams and Ghrist, examples ("certain multi-step assembly processes").

A place is where a part belongs, and is the agent. A site is ``(place, letter)``; one letter is on
at each place: ``open`` while the part is missing, ``placed`` when it is in, ``welded`` when it is
joined.

- `place` takes a part from open to placed, or out again: it writes these two sites, and reads that
  none of those below is open, that all of those above are, and that none of those beside is welded.
- `weld` takes it from placed to welded, or loosens it: it writes these two sites, and reads that
  none of those beside is open.

Each move reads only the sites that must be on or off, so welding a part and putting another on top
of it commute. The states are the order ideals of the steps under precedence, so the state complex
is CAT(0), and contractible.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from cubepath.protocol.core.actions import Action, State
from cubepath.protocol.core.catalogue import Move
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.ideals import step_needs
from cubepath.protocol.core.sites import Site
from cubepath.protocol.core.system import Scene, System
from cubepath.protocol.scenes.registry import Family, Values, scene_of, whole
from cubepath.protocol.systems.listed import TabledSystem

Part = tuple[int, int]
"""The number of a part in its row, and the row, from the ground up."""

OPEN, PLACED, WELDED = STEPS = ("open", "placed", "welded")
_SIZE_MAX = 40


@dataclass(frozen=True)
class AssemblyPlan:
    """The parts: the middle of each, the parts that it rests on, and those beside it."""

    middles: Mapping[Part, tuple[float, float]]
    below: Mapping[Part, tuple[Part, ...]]
    beside: Mapping[Part, tuple[Part, ...]]


def _plan(
    middles: Mapping[Part, tuple[float, float]], rests: Callable[[Part], set[Part]]
) -> AssemblyPlan:
    beside = {
        (x, y): tuple(part for part in ((x - 1, y), (x + 1, y)) if part in middles)
        for x, y in middles
    }
    below = {part: tuple(sorted(rests(part) & middles.keys())) for part in middles}
    return AssemblyPlan(middles, below, beside)


def pyramid(size: int) -> AssemblyPlan:
    """Return a pyramid on `size` parts, in which each part rests on two."""
    middles = {(x, y): (x + y / 2, float(y)) for y in range(size) for x in range(size - y)}
    return _plan(middles, lambda part: {(part[0] + side, part[1] - 1) for side in (0, 1)})


def wall(size: int) -> AssemblyPlan:
    """Return a wall of `size` rows of `size` bricks, every other row shifted by half a brick."""
    middles = {(x, y): (x + y % 2 / 2, float(y)) for y in range(size) for x in range(size)}

    def rests(part: Part) -> set[Part]:
        x, y = part
        return {(x, y - 1), (x + (1 if y % 2 else -1), y - 1)}

    return _plan(middles, rests)


def tree(size: int) -> AssemblyPlan:
    """Return a binary tree of `size` levels: each part joins two that are made before it."""
    middles = {
        (x, y): ((x + 0.5) * 2**y - 0.5, float(y))
        for y in range(size)
        for x in range(2 ** (size - 1 - y))
    }
    found = _plan(middles, lambda part: {(2 * part[0] + side, part[1] - 1) for side in (0, 1)})
    siblings = {
        (x, y): tuple(part for part in ((x ^ 1, y),) if part in middles) for x, y in middles
    }
    return AssemblyPlan(middles, found.below, siblings)


PLANS: Mapping[str, tuple[Callable[[int], AssemblyPlan], int]] = {
    "pyramid": (pyramid, _SIZE_MAX),
    "wall": (wall, _SIZE_MAX),
    "tree": (tree, 10),
}
"""The kinds of structures, each with its greatest size."""


def assembly_moves(plan: AssemblyPlan, *, weld: bool) -> tuple[Move, ...]:
    """Return the moves of all parts: placing, and, if asked for, welding."""
    above: dict[Part, list[Part]] = {part: [] for part in plan.middles}
    for part, rests in plan.below.items():
        for other in rests:
            above[other].append(part)
    found = []
    for part in plan.middles:
        on = [(other, OPEN) for other in above[part]]
        off = [(other, OPEN) for other in plan.below[part]]
        if weld:
            off += [(other, WELDED) for other in plan.beside[part]]
        found.append(_step("place", part, (OPEN, PLACED), on, off))
        if weld:
            off = [(other, OPEN) for other in plan.beside[part]]
            found.append(_step("weld", part, (PLACED, WELDED), [], off))
    return tuple(found)


def _step(
    name: str, part: Part, letters: tuple[str, str], on: Sequence[Site], off: Sequence[Site]
) -> Move:
    before, after = ((part, letter) for letter in letters)
    support = [before, after, *on, *off]
    label = f"{name} at {list(part)}"
    action = Action(support, (before, after), [before, *on], [after, *on], label=label)
    return Move(action, name, part, ((before, after),))


def _assembly(name: str, values: Values) -> Scene:
    """Build a structure that is empty at the start and complete at the goal."""
    kind = values["kind"]
    if kind not in PLANS:
        raise InputError(f"kind={kind}: expected one of {', '.join(PLANS)}")
    last = values["until"]
    if last not in STEPS[1:]:
        raise InputError(f"until={last}: expected one of {', '.join(STEPS[1:])}")
    build, most = PLANS[kind]
    plan = build(whole(values, "n", least=1, most=most))
    positions: dict[Site, tuple[float, float]] = dict(plan.middles.items())
    system = TabledSystem(
        assembly_moves(plan, weld=last == WELDED),
        letters=STEPS[: STEPS.index(last) + 1],
        drawing="letters",
        positions=positions,
    )
    start = tuple((part, OPEN) for part in plan.middles)
    return scene_of(name, system, start, ((part, last) for part in plan.middles), own=True)


def _is_ideal(system: System, start: State) -> bool:
    """Return whether the states that are reached are order ideals, so that all paths are homotopic.

    Their complex is CAT(0), see `cubepath.protocol.core.ideals`.
    """
    needs = step_needs(system)

    def made(place: Site, number: int) -> bool:
        return any((place, letter) in start for letter in system.letters[number:])

    return needs is not None and all(made(*other) for step, other in needs if made(*step))


FAMILIES = (
    Family(
        "assembly",
        "a structure put together part by part: placed when what is below is, then welded",
        {
            "kind": ("pyramid", "pyramid, wall or tree"),
            "n": ("3", "parts in the lowest row; levels of a tree"),
            "until": ("welded", "the last step of every part: placed or welded"),
        },
        _assembly,
        TabledSystem,
        "geodesic",
        one_class=_is_ideal,
    ),
)
