"""Sliding squares: the generators are the paper's, and the pair round a rectangle counts up."""

from collections.abc import Collection

import pytest

from cubepath.agents.environments.world import World
from cubepath.protocol.core.actions import admissible, apply, commute
from cubepath.protocol.core.catalogue import SQUARES, Generator
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.sites import Site
from cubepath.protocol.core.system import Scene
from cubepath.protocol.scenes.families.shapes import sliding_catalogue
from cubepath.protocol.scenes.specs import scene_from_spec
from cubepath.protocol.systems.lattice import LatticeSystem
from oracles.cells import cells_of
from oracles.complexes import actions_at, f_vector, states_of


def squares(*cells: tuple[int, int], filled: Collection[Site] = (), longest: int = 3) -> Scene:
    """Return free squares on these cells."""
    return Scene("own", "", LatticeSystem(sliding_catalogue(longest), filled=filled), cells)


def joined(sites: Collection[Site]) -> bool:
    """Tell whether the cells hang together by their sides."""
    cells = set(cells_of(sites))
    todo = [min(cells)]
    seen = set(todo)
    while todo:
        x, y = todo.pop()
        near = {(x + 1, y), (x - 1, y), (x, y + 1), (x, y - 1)} & cells - seen
        seen |= near
        todo += near
    return seen == cells


@pytest.mark.parametrize("p", range(1, 5))
@pytest.mark.parametrize("q", range(1, 5))
def test_the_pair_round_a_rectangle(p: int, q: int) -> None:
    """4(pq+1)+2(p+q) states, 8(pq+1)-2(p+q) edges, 4(p-1)(q-1) squares, Euler characteristic 0."""
    scene = scene_from_spec(f"sliding:p={p},q={q}")
    states, edges, *rest = f_vector(scene)
    assert (states, edges) == (4 * (p * q + 1) + 2 * (p + q), 8 * (p * q + 1) - 2 * (p + q))
    assert rest == ([4 * (p - 1) * (q - 1)] if min(p, q) > 1 else [])
    assert states - edges + sum(rest) == 0
    assert (scene.goal or frozenset()) | scene.system.filled in states_of(scene)


def test_the_generators_are_those_of_the_figure() -> None:
    """k + 4 cells in the middle row, the trace without its ends, the dots with their arrows."""
    named = sliding_catalogue(4).by_name
    assert list(named) == [f"{way}-{k}" for k in range(5) for way in ("row", "column")]
    for k in range(5):
        row = named[f"row-{k}"]
        middle = {cell for cell in row.support if cell[1] == 0}
        assert middle == {(x, 0) for x in range(-1, k + 3)}
        assert set(row.trace) == middle - {(-1, 0), (k + 2, 0)}
        assert set(row.before) == {(x, 0) for x in range(k + 1)}
        assert set(row.after) == {(x, 0) for x in range(1, k + 2)}
        arrows = {((0, y), (1, y)) for y in (1, -1)} | {((k + 1, y), (k, y)) for y in (1, -1)}
        assert set(row.guards) == arrows
        assert set(row.support) - middle == {cell for arrow in arrows for cell in arrow}
        assert set(row.free) == set(row.support) - middle


def test_columns_are_rows_with_x_and_y_exchanged() -> None:
    """Nothing tells the two directions apart."""
    catalogue = sliding_catalogue(3)
    for k in range(4):
        row, column = (
            catalogue.by_name[f"{way}-{k}"].place(SQUARES, (0, 0)) for way in ("row", "column")
        )
        turned = {(y, x) for x, y in cells_of(row.support)}
        assert turned == column.support
        arrows = [cells_of(arrow) for arrow in row.guards]
        assert {((b, a), (d, c)) for (a, b), (c, d) in arrows} == column.guards


@pytest.mark.parametrize(
    ("above", "slides"),
    [
        ([], True),
        ([(0, 1)], False),
        ([(0, 1), (1, 1)], True),
        ([(3, 1)], False),
        ([(3, 1), (2, 1)], True),
        ([(1, 1)], True),
    ],
)
def test_a_run_leaves_nothing_behind(above: list[tuple[int, int]], slides: bool) -> None:
    """A cell over the run's end may be on only if the one that its arrow points to is."""
    action = sliding_catalogue(2).by_name["row-2"].place(SQUARES, (0, 0))
    run: list[Site] = [(0, 0), (1, 0), (2, 0)]
    assert admissible(action, {*run, *above}) == slides
    assert admissible(action, {*run, *[(x, -y) for x, y in above]}) == slides


@pytest.mark.parametrize("spec", ["sliding:n=3", "sliding:p=2,q=2,n=4", "sliding:p=1,q=1,n=4"])
def test_the_aggregate_hangs_together(spec: str) -> None:
    """In every state the squares and the obstacle are one aggregate, though no rule says so."""
    scene = scene_from_spec(spec)
    states = states_of(scene)
    assert len(states) == {"sliding:n=3": 258}.get(spec, len(states))
    assert all(joined(state) for state in states)
    assert (scene.goal or frozenset()) | scene.system.filled in states


@pytest.mark.slow
def test_longer_runs_than_there_are_free_squares_never_slide() -> None:
    """With every k up to the aggregate's size the same actions are admissible everywhere."""
    some, all_ = (scene_from_spec(f"sliding:p=2,q=2,n=3{more}") for more in ("", ",k=7"))
    for state in states_of(some):
        assert set(actions_at(some, state)) == set(actions_at(all_, state))


@pytest.mark.parametrize("row", [True, False])
def test_all_modules_of_a_run_go_one_cell_on(row: bool) -> None:
    """There and back each of three squares moves by one, whoever proposes; no other may."""

    def cell(x: int, y: int) -> tuple[int, int]:
        return (x, y) if row else (y, x)

    scene = squares(cell(0, 0), cell(1, 0), cell(2, 0), cell(1, 1))
    world = World(scene, seed=0)
    for shift in (1, 0):
        name = f"{'row' if row else 'column'}-2"
        legal = [
            (module, action)
            for module, site in enumerate(world.sites)
            for action in world.observe(module)["action_mask"].nonzero()[0]
            if action
            and scene.system.moves(site)[action - 1].generator == name  # type: ignore[union-attr]
            and scene.system.moves(site)[action - 1].target == cell(shift, 0)  # type: ignore[union-attr]
        ]
        ((module, action),) = legal
        assert module == 0
        world.step({module: int(action)})
        assert world.sites[:3] == [cell(x + shift, 0) for x in range(3)]
        assert world.sites[3] == cell(1, 1)


def test_a_column_part_way_obstructs_a_row() -> None:
    """The paper's pair: a square of the transition graph, of slides that do not commute."""
    catalogue = sliding_catalogue(1)
    row = catalogue.by_name["row-1"].place(SQUARES, (-1, 0))
    column = catalogue.by_name["column-1"].place(SQUARES, (0, -1))
    state = frozenset([(-1, 0), (0, 0), (0, -1)])
    ends = {apply(column, apply(row, state)), apply(row, apply(column, state))}
    assert ends == {frozenset([(1, 0), (0, 0), (0, 1)])}
    assert not commute(row, column)
    assert row.trace & column.trace == {(0, 0)}


def test_a_longer_run_is_sensed_from_farther() -> None:
    """How far a module senses follows from the longest run: k + 2 cells along its row."""
    for k in range(4):
        system = LatticeSystem(sliding_catalogue(k))
        sensed = cells_of(site for site in system.sensed((0, 0)) if site is not None)
        assert max(x for x, _ in sensed) == k + 2
        assert all(min(abs(x), abs(y)) <= 1 for x, y in sensed)


@pytest.mark.parametrize(
    ("spec", "message"),
    [
        ("sliding:p=0", "p=0: expected a whole number of at least 1"),
        ("sliding:p=1000,q=1000", "p=1000,q=1000: expected at most 10000 cells"),
        ("sliding:n=1", "n=1: expected a whole number of at least 2"),
        ("sliding:k=-1", "k=-1: expected a whole number of at least 0"),
    ],
)
def test_a_spec_that_cannot_be_is_refused(spec: str, message: str) -> None:
    """Each bad value is named."""
    with pytest.raises(InputError, match=message):
        scene_from_spec(spec)


def test_a_square_on_an_obstacle_is_refused() -> None:
    """A module starts beside the obstacle and not on it."""
    with pytest.raises(InputError, match=r"module starts at \(1, 0\): an obstacle or no place"):
        squares((0, 0), (1, 0), filled=[(1, 0)])


ROW: dict[str, tuple[tuple[int, ...], ...]] = {
    "support": ((0, 0), (1, 0), (0, 1)),
    "trace": ((0, 0), (1, 0)),
    "before": ((0, 0),),
    "after": ((1, 0),),
}


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"after": ((1, 0), (0, 1))}, r"the local states differ at \(0, 1\), which is off the tra"),
        ({"trace": ((0, 0), (1, 0), (2, 0))}, r"the trace holds \(2, 0\), which is not in the sup"),
        (
            {"before": ((0, 0), (5, 5))},
            r"a local state holds \(5, 5\), which is not in the support",
        ),
        ({"after": ((0, 0),)}, "the two local states are equal"),
        ({"free": ((0, 0),)}, r"site \(0, 0\) is free and in the trace or a local state"),
        ({"free": ((0, 7),)}, r"the free sites holds \(0, 7\), which is not in the support"),
        ({"guards": (((0, 1), (0, 9)),)}, r"a guard holds \(0, 9\), which is not in the support"),
        ({"guards": (((0, 1), (1, 0)),)}, r"guard site \(1, 0\) is in the trace"),
        ({"motion": ()}, "no module goes anywhere"),
        ({"motion": (((0, 1), (1, 0)),)}, "'goes' must take every site of the trace"),
    ],
)
def test_a_generator_that_is_none_is_refused_by_name(keys: dict[str, object], message: str) -> None:
    """Local states that differ off the trace, a trace outside the support, and their like."""
    given = {**ROW, "motion": (((0, 0), (1, 0)),), **keys}
    with pytest.raises(InputError, match=f"generator 'crawl': {message}") as caught:
        Generator(name="crawl", **given)  # type: ignore[arg-type]
    assert "\n" not in str(caught.value)
