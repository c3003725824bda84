"""Assembly: the states are the order ideals of the steps, and the complex is contractible."""

from itertools import chain, combinations
from math import comb

import pytest

from cubepath.protocol.core.actions import Action, State, admissible, apply, commute
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.system import System
from cubepath.protocol.scenes.families.assembly import PLANS, AssemblyPlan, pyramid, tree, wall
from cubepath.protocol.scenes.specs import scene_from_spec
from oracles.complexes import f_vector, states_of

Step = tuple[object, str]


def orders(plan: AssemblyPlan, *, weld: bool) -> dict[Step, set[Step]]:
    """Return what must be done before each step."""
    found: dict[Step, set[Step]] = {
        (part, "place"): {(other, "place") for other in plan.below[part]} for part in plan.middles
    }
    if weld:
        found |= {
            (part, "weld"): {(other, "place") for other in (part, *plan.beside[part])}
            for part in plan.middles
        }
    return found


def ideals(plan: AssemblyPlan, *, weld: bool) -> int:
    """Count the sets of steps that hold all that must be done before, by trying all sets."""
    before = orders(plan, weld=weld)
    sets = chain.from_iterable(combinations(before, size) for size in range(len(before) + 1))
    return sum(all(before[step] <= {*done} for step in done) for done in sets)


def steps_done(state: State) -> set[Step]:
    letters: dict[object, str] = dict(state)  # type: ignore[arg-type]
    assert len(letters) == len(state)
    done = {(part, "place") for part, letter in letters.items() if letter != "open"}
    return done | {(part, "weld") for part, letter in letters.items() if letter == "welded"}


@pytest.mark.few(4)
@pytest.mark.parametrize(
    ("kind", "size", "until"),
    [
        ("pyramid", 1, "welded"),
        ("pyramid", 2, "welded"),
        ("pyramid", 3, "welded"),
        ("pyramid", 4, "placed"),
        ("wall", 2, "welded"),
        ("wall", 3, "placed"),
        ("tree", 2, "welded"),
        ("tree", 3, "placed"),
        pytest.param("tree", 3, "welded", marks=pytest.mark.slow),
    ],
)
def test_states_are_the_order_ideals(kind: str, size: int, until: str) -> None:
    """Every state has done what its steps need, all such states are reached; chi is 1."""
    scene = scene_from_spec(f"assembly:kind={kind},n={size},until={until}")
    plan = PLANS[kind][0](size)
    before = orders(plan, weld=until == "welded")
    states = states_of(scene)
    for state in states:
        done = steps_done(state)
        assert all(before[step] <= done for step in done)
    assert len(states) == ideals(plan, weld=until == "welded")
    assert scene.goal in states
    counts = f_vector(scene)
    assert sum((-1) ** k * count for k, count in enumerate(counts)) == 1


@pytest.mark.parametrize("size", [1, 2, 3, 4, 5])
def test_pyramids_have_catalan_many_states(size: int) -> None:
    """A pyramid on n parts has Catalan(n + 1) states when it is not welded."""
    scene = scene_from_spec(f"assembly:n={size},until=placed")
    assert len(states_of(scene)) == comb(2 * size + 2, size + 1) // (size + 2)


def test_what_rests_on_what() -> None:
    """Parts of a pyramid and a tree rest on two, bricks of a wall on those that they overlap."""
    assert pyramid(3).below[0, 1] == ((0, 0), (1, 0))
    assert pyramid(3).beside[1, 0] == ((0, 0), (2, 0))
    assert tree(3).below[1, 1] == ((2, 0), (3, 0))
    assert tree(3).beside[1, 1] == ((0, 1),)
    assert tree(3).beside[0, 2] == ()
    for size in (2, 5):
        plan = wall(size)
        for (x, y), (middle, _) in plan.middles.items():
            under = {
                part
                for part, (at, row) in plan.middles.items()
                if row == y - 1 and abs(at - middle) < 1
            }
            assert set(plan.below[x, y]) == under


def after(system: System, state: State, *steps: Step) -> State:
    for part, name in steps:
        state = apply(system.action(name, part), state)
    return state


def test_steps_wait_for_one_another() -> None:
    """A part needs those below it, a weld those beside it, and nothing in use comes out again."""
    scene = scene_from_spec("assembly:n=2")
    system, start = scene.system, scene.start_state

    def can(state: State, name: str, part: object) -> bool:
        return admissible(system.action(name, part), state)

    assert not can(start, "place", (0, 1))
    assert not can(start, "weld", (0, 0))
    one = after(system, start, ((0, 0), "place"))
    assert not can(one, "place", (0, 1))
    assert not can(one, "weld", (0, 0))
    both = after(system, one, ((1, 0), "place"))
    assert can(both, "weld", (0, 0))
    assert can(both, "place", (1, 0))
    welded = after(system, both, ((0, 0), "weld"))
    assert not can(welded, "place", (1, 0))
    assert not can(welded, "place", (0, 0))
    top = after(system, both, ((0, 1), "place"))
    assert not can(top, "place", (0, 0))
    assert can(top, "weld", (0, 0))


def test_what_can_be_done_at_one_time() -> None:
    """Welding a part commutes with putting one on top, and with welding the next; not its own."""

    def step(name: str, *part: int) -> Action:
        return scene_from_spec("assembly").system.action(name, part)

    assert commute(step("weld", 0, 0), step("place", 0, 1))
    assert commute(step("weld", 0, 0), step("weld", 1, 0))
    assert commute(step("place", 0, 0), step("place", 1, 0))
    assert not commute(step("place", 0, 0), step("weld", 0, 0))
    assert not commute(step("place", 0, 0), step("place", 0, 1))
    assert not commute(step("place", 1, 0), step("weld", 0, 0))


@pytest.mark.parametrize(
    ("spec", "message"),
    [
        ("assembly:kind=arch", "kind=arch: expected one of pyramid, wall, tree"),
        ("assembly:until=open", "until=open: expected one of placed, welded"),
        ("assembly:n=0", "n=0: expected a whole number of at least 1, at most 40"),
        ("assembly:kind=tree,n=11", "n=11: expected a whole number of at least 1, at most 10"),
    ],
)
def test_specs_that_are_refused(spec: str, message: str) -> None:
    """Each mistake in a key is named."""
    with pytest.raises(InputError, match=message):
        scene_from_spec(spec)
