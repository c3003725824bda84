"""The chain rule takes every straight chain to its goal, whatever is lost, skipped or turned."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from itertools import combinations
from statistics import mean

import pytest

from cubepath.agents.environments.rollouts import Rollout, play
from cubepath.agents.environments.world import World
from cubepath.agents.local.observation import STAY, observe, view_of
from cubepath.agents.local.random_streams import RandomStream
from cubepath.agents.rules.actor import actors_for
from cubepath.agents.rules.chain import CHAIN
from cubepath.agents.rules.rule import InitialKnowledge, Rule, as_choice
from cubepath.agents.rules.uniform import RANDOM
from cubepath.coordinator.normal_form.heap import normal_cube_path
from cubepath.protocol.core.actions import Action, admissible, commute
from cubepath.protocol.core.catalogue import HEX_DIRECTIONS, HEXAGONS, Catalogue, Cell, Move
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.sites import Site
from cubepath.protocol.core.system import Scene
from cubepath.protocol.scenes.built_in_pages import page_catalogue
from cubepath.protocol.scenes.specs import scene_from_spec
from cubepath.protocol.systems.lattice import LatticeSystem

BENDS = ["bend=60", "bend=-60", "bend=120", "bend=-120"]
FAMILIES = ["hex", "hex-open"]
Turn = Callable[[Cell], Cell]


def tasks(count: int) -> list[str]:
    return BENDS + [f"bend=0,shift={shift}" for shift in range(count + 1)]


def scene_of(start: list[Cell], goals: list[Cell], system: LatticeSystem | None = None) -> Scene:
    return Scene(
        spec="by hand",
        family="hex",
        system=system or LatticeSystem(page_catalogue("hexagons-1")),
        start=tuple(start),
        goal=frozenset(goals),
        goals=(tuple(goals),) * len(start),
    )


def row(first: Cell, direction: int, count: int) -> list[Cell]:
    q, r = HEX_DIRECTIONS[direction % 6]
    return [(first[0] + step * q, first[1] + step * r) for step in range(count)]


def changed(scene: Scene, turn: Turn) -> Scene:
    """Return the scene with all cells taken elsewhere, in the open plane."""

    def put(cells: tuple[Site, ...]) -> list[Cell]:
        return [turn(HEXAGONS.check(cell)) for cell in cells]

    return scene_of(put(scene.start), put(scene.goals[0]))


def paths(played: Rollout) -> list[dict[int, tuple[Site, Site]]]:
    return [{m: (move.source, move.target) for m, move in r.moves.items()} for r in played.rounds]


def actions_of(played: Rollout) -> list[list[Action]]:
    return [[move.action for move in each.moves.values()] for each in played.rounds]


def births(scene: Scene) -> list[InitialKnowledge]:
    return [
        InitialKnowledge(
            system=scene.system,
            module=module,
            modules=len(scene.start),
            start=start,
            goals=scene.goals[module],
            stream=RandomStream(module),
        )
        for module, start in enumerate(scene.start)
    ]


# --- It gets there ---------------------------------------------------------------------------


@pytest.mark.few(5)
@pytest.mark.slow
@pytest.mark.parametrize(
    ("family", "count"),
    [("hex", count) for count in (2, 3, 4, 5, 6, 9)]
    + [("hex-open", count) for count in (2, 3, 5, 8)]
    + [
        pytest.param(family, count, marks=pytest.mark.thorough)
        for family, count in (("hex", 7), ("hex", 8), ("hex", 12), ("hex-open", 12))
    ],
)
def test_every_task_is_reached(family: str, count: int) -> None:
    """All bends and all shifts, in both catalogues, within 5n rounds and without a lost claim."""
    for task in tasks(count):
        played = play(scene_from_spec(f"{family}:n={count},{task}"), CHAIN, max_rounds=5 * count)
        assert played.reached, task
        assert played.failed is None
        assert not any(each.lost for each in played.rounds)


@pytest.mark.slow
@pytest.mark.parametrize("family", FAMILIES)
@pytest.mark.parametrize("task", ["bend=60", "bend=-120", "bend=0,shift=9", "bend=0,shift=5"])
@pytest.mark.parametrize(
    ("hesitate", "seeds"),
    [(0.3, [0]), (0.9, [0]), pytest.param(0.9, [1, 2], marks=pytest.mark.thorough)],
)
def test_hesitation_hinders_nobody(
    family: str, task: str, hesitate: float, seeds: list[int]
) -> None:
    """Modules that skip rounds at random still reach the goal."""
    for seed in seeds:
        scene = scene_from_spec(f"{family}:n=9,{task}")
        assert play(scene, CHAIN, seed=seed, hesitate=hesitate, max_rounds=3000).reached


@pytest.mark.slow
@pytest.mark.parametrize(
    "task",
    [
        "bend=60",
        "bend=0,shift=24",
        *(
            pytest.param(task, marks=pytest.mark.thorough)
            for task in ("bend=-60", "bend=120", "bend=-120", "bend=0,shift=50")
        ),
    ],
)
def test_fifty_modules(task: str) -> None:
    """Fifty modules reach every kind of goal, a dozen and more of them moving at once."""
    played = play(scene_from_spec(f"hex:n=50,{task}"), CHAIN, max_rounds=250)
    assert played.reached
    assert max(len(each.moves) for each in played.rounds) >= 13


@pytest.mark.parametrize(
    ("spec", "figures"),
    [
        ("hex:n=12,bend=120", (54, 154, 54, 4)),
        ("hex:n=12,bend=-120", (54, 154, 54, 4)),
        ("hex:n=12,bend=60", (55, 165, 55, 4)),
        ("hex:n=12,bend=0,shift=12", (40, 156, 40, 6)),
        ("hex:n=12,bend=0,shift=1", (13, 13, 13, 1)),
        ("hex:n=12,bend=0,shift=0", (0, 0, 0, 0)),
        # With the second catalogue walkers need not keep a distance.
        ("hex-open:n=12,bend=120", (44, 154, 44, 5)),
        ("hex-open:n=12,bend=0,shift=12", (35, 156, 35, 7)),
    ],
)
def test_figures_of_twelve(spec: str, figures: tuple[int, int, int, int]) -> None:
    """Rounds, moves, length of the normal cube path and most modules at once, for n = 12."""
    rounds = actions_of(play(scene_from_spec(spec), CHAIN))
    moves = [action for each in rounds for action in each]
    most = max(map(len, rounds), default=0)
    assert (len(rounds), len(moves), len(normal_cube_path(moves)), most) == figures


def test_one_hexagon_is_there_or_cannot_go() -> None:
    """One module alone has reached its own cell, and refuses any other."""
    assert play(scene_from_spec("hex:n=1,bend=120"), CHAIN).reached
    with pytest.raises(InputError, match="nothing to pivot about"):
        play(scene_from_spec("hex:n=1,bend=0,shift=1"), CHAIN)


def reachable(scene: Scene) -> Iterator[tuple[tuple[Site, ...], int]]:
    """Yield every state that the rule can come to, with the number of claims that it makes there.

    A round may execute any claims that commute pairwise: the others hesitate, or lose. What a
    module claims depends on its view alone, once the first view has told it its line.
    """
    actors = actors_for(scene, CHAIN, seed=0, hesitate=0.0)
    for module, actor in actors.items():
        actor.act(World(scene, seed=0).observe(module))
    seen, left = {scene.start}, [scene.start]
    while left:
        sites = left.pop()
        occupants = {site: site for site in sites}
        claims: list[tuple[int, Move]] = []
        for module, actor in actors.items():
            sensed = observe(scene.system, sites[module], occupants, goals=frozenset())
            action = actor.act(sensed).action
            move = scene.system.moves(sites[module])[action - 1] if action else None
            if move is not None:
                claims.append((module, move))
        yield sites, len(claims)
        for size in range(1, len(claims) + 1):
            for chosen in combinations(claims, size):
                if all(commute(a.action, b.action) for (_, a), (_, b) in combinations(chosen, 2)):
                    targets = {module: move.target for module, move in chosen}
                    after = tuple(targets.get(m, site) for m, site in enumerate(sites))
                    if after not in seen:
                        seen.add(after)
                        left.append(after)


@pytest.mark.few(3)
@pytest.mark.slow
@pytest.mark.parametrize("family", FAMILIES)
@pytest.mark.parametrize("count", [2, 3, 4, 5])
def test_no_state_but_the_goal_is_stuck(family: str, count: int) -> None:
    """Exhaustively, whatever is held back in whatever round: some module can go, until the goal."""
    for task in tasks(count):
        scene = scene_from_spec(f"{family}:n={count},{task}")
        for sites, claims in reachable(scene):
            assert (claims == 0) == scene.reached(sites), (task, sites)


# --- Rounds are cubes, and grow -------------------------------------------------------------


@pytest.mark.parametrize("spec", ["hex:n=8,bend=60", "hex:n=8,bend=0,shift=8", "hex-open:n=8"])
@pytest.mark.parametrize("hesitate", [0.0, 0.5])
def test_rounds_commute_and_every_choice_is_legal(spec: str, hesitate: float) -> None:
    """What is chosen is admissible in the whole state, what is executed commutes pairwise."""
    scene = scene_from_spec(spec)
    world = World(scene, seed=3)
    actors = actors_for(scene, CHAIN, seed=3, hesitate=hesitate)
    while not scene.reached(world.sites):
        actions = {m: actor.act(world.observe(m)).action for m, actor in actors.items()}
        for module, action in actions.items():
            move = scene.system.moves(world.sites[module])[action - 1] if action else None
            assert (move is None) == (action == STAY)
            assert move is None or admissible(move.action, frozenset(world.sites))
        done = [move.action for move in world.step(actions).moves.values()]
        assert all(commute(one, other) for one, other in combinations(done, 2))


@pytest.mark.few(1)
@pytest.mark.slow
@pytest.mark.parametrize("task", ["bend=120", "bend=60", "bend=0,shift={n}"])
def test_cubes_grow_with_the_chain(task: str) -> None:
    """The mean number of moves in a round, and in a normal cube, grows with n."""
    in_rounds, in_cubes = [], []
    for count in (6, 12, 24):
        scene = scene_from_spec(f"hex:n={count},{task.format(n=count)}")
        rounds = actions_of(play(scene, CHAIN))
        in_rounds.append(mean(map(len, rounds)))
        in_cubes.append(
            mean(map(len, normal_cube_path(action for each in rounds for action in each)))
        )
    assert in_rounds[2] > 1.5 * in_rounds[1] > 2 * in_rounds[0]
    assert in_cubes[2] > 1.5 * in_cubes[1] > 2 * in_cubes[0]


def test_one_sided_runs_are_of_one_homotopy_class() -> None:
    """With hesitation a bend takes other rounds, and has the same normal cube path."""
    scene = scene_from_spec("hex:n=6,bend=120")
    paths_found = {
        normal_cube_path(action for each in actions_of(played) for action in each)
        for played in (play(scene, CHAIN, seed=seed, hesitate=0.5) for seed in range(3))
    }
    assert len(paths_found) == 1


# --- Nothing but what is sensed, and no favourite direction ---------------------------------

TURNS: dict[str, Turn] = {
    "turned by 60": lambda cell: (-cell[1], cell[0] + cell[1]),
    "turned by 180": lambda cell: (-cell[0], -cell[1]),
    "moved": lambda cell: (cell[0] - 17, cell[1] + 9),
}
MIRRORS: dict[str, Turn] = {
    "mirrored across": lambda cell: (cell[1], cell[0]),
    "mirrored along": lambda cell: (cell[0] + cell[1], -cell[1]),
}


@pytest.mark.parametrize("turn", TURNS.values(), ids=TURNS)
@pytest.mark.parametrize("task", ["bend=120", "bend=-60", "bend=0,shift=6", "bend=0,shift=3"])
def test_a_turned_task_gives_the_turned_run(task: str, turn: Turn) -> None:
    """Rotations and translations take the run along, move by move."""
    _compare(scene_from_spec(f"hex:n=6,{task}"), turn)


@pytest.mark.parametrize("turn", MIRRORS.values(), ids=MIRRORS)
@pytest.mark.parametrize("task", ["bend=120", "bend=60"])
def test_a_mirrored_bend_gives_the_mirrored_run(task: str, turn: Turn) -> None:
    """Mirrors do too, for bends. A slide is its own mirror image, so odd and even must decide."""
    _compare(scene_from_spec(f"hex:n=6,{task}"), turn)


def _compare(scene: Scene, turn: Turn) -> None:
    expected = [
        {m: (turn(HEXAGONS.check(a)), turn(HEXAGONS.check(b))) for m, (a, b) in each.items()}
        for each in paths(play(scene, CHAIN))
    ]
    assert expected
    assert paths(play(changed(scene, turn), CHAIN)) == expected


@pytest.mark.parametrize("task", ["bend=60", "bend=120", "bend=-60", "bend=0,shift=4"])
@pytest.mark.parametrize("count", [2, 5, 6])
def test_the_goal_may_be_listed_from_either_end(task: str, count: int) -> None:
    """The list in reverse order gives the same run, also where a cell is in line with both ends."""
    if task == "bend=0,shift=4":
        task = f"bend=0,shift={min(4, count)}"
    scene = scene_from_spec(f"hex:n={count},{task}")
    turned = replace(scene, goals=tuple(known[::-1] for known in scene.goals))
    assert paths(play(turned, CHAIN)) == paths(play(scene, CHAIN))


@pytest.mark.parametrize("direction", range(6))
@pytest.mark.parametrize("numbers", ["as they stand", "in reverse"])
def test_the_goal_may_begin_one_cell_further(direction: int, numbers: str) -> None:
    """From the cell after the chain's end the goal may go any way; so may a slide to the left."""
    count = 7
    start = row((0, 0), 0, count)
    for head in ((count, 0), (-1, 0)):
        goals = row(head, direction, count)
        chain = start if numbers == "as they stand" else start[::-1]
        assert play(scene_of(chain, goals), CHAIN, max_rounds=6 * count).reached


class Sensed(Mapping[Site, Site]):
    """Occupants that may be asked for about the sensed places only."""

    def __init__(self, occupants: Mapping[Site, Site], allowed: set[Site | None]) -> None:
        self._occupants = occupants
        self._allowed = allowed

    def __getitem__(self, place: Site) -> Site:
        if place not in self._allowed:
            raise AssertionError(f"asked for {place}, which is not sensed")
        return self._occupants[place]

    def __iter__(self) -> Iterator[Site]:
        raise AssertionError("asked for all occupants")

    def __len__(self) -> int:
        raise AssertionError("asked for the number of occupants")


@pytest.mark.parametrize("spec", ["hex:n=6,bend=60", "hex-open:n=6,bend=0,shift=6"])
def test_a_choice_depends_on_what_is_sensed_alone(spec: str) -> None:
    """Nothing is asked for beyond the radius of two cells, and filling it changes no choice."""
    scene = scene_from_spec(spec)
    system = scene.system
    rules = [CHAIN.make(knowledge) for knowledge in births(scene)]
    world = World(scene, seed=0)
    while not scene.reached(world.sites):
        occupants = {site: site for site in world.sites}
        everywhere = {(q, r): (q, r) for q in range(-9, 19) for r in range(-14, 14)}
        actions = {}
        for module, (site, rule) in enumerate(zip(world.sites, rules, strict=True)):
            near = set(system.sensed(site))
            assert max(_distance(site, cell) for cell in near if cell is not None) == 2
            full = {c: c for c in everywhere if c not in near and c != site} | {
                c: c for c in occupants if c in near or c == site
            }
            choices = [_ask(rule, scene, site, Sensed(shown, near)) for shown in (occupants, full)]
            assert choices[0] == choices[1]
            actions[module] = choices[0]
        assert any(actions.values())
        world.step(actions)


def _ask(rule: Rule, scene: Scene, site: Site, occupants: Mapping[Site, Site]) -> int:
    observation = observe(scene.system, site, occupants, goals=frozenset())
    return as_choice(rule(view_of(scene.system, observation))).action


def _distance(one: Site, other: Site) -> int:
    (a, b), (c, d) = HEXAGONS.check(one), HEXAGONS.check(other)
    return max(abs(a - c), abs(b - d), abs(a - c + b - d))


# --- What it is for, and what it refuses ----------------------------------------------------


def test_fits_both_catalogues_of_hexagons_and_nothing_else() -> None:
    """Known by content: generators in another order are the same catalogue."""
    shuffled = Catalogue(HEXAGONS, page_catalogue("hexagons-1").generators[::-1])
    assert CHAIN.fits(LatticeSystem(shuffled))
    for family in FAMILIES:
        assert CHAIN.fits(scene_from_spec(family).system)
    for other in ("arm", "agv", "agv-labelled"):
        assert not CHAIN.fits(scene_from_spec(other).system)
    fewer = Catalogue(HEXAGONS, page_catalogue("hexagons-1").generators[1:])
    assert not CHAIN.fits(LatticeSystem(fewer))


LINE = row((0, 0), 0, 6)


@pytest.mark.parametrize(
    ("goals", "message"),
    [
        (row((0, 1), 0, 6), "no goal end is in line"),  # parallel, beside the start
        (row((2, 3), 0, 6), "no goal end is in line"),  # parallel, further off
        (row((3, -2), 1, 6), "no goal end is in line"),  # crosses the start
        (row((7, 0), 0, 6), "within 6 cells"),  # a slide that is too far
        (row((7, 0), 1, 6), "within 6 cells"),
        (row((-2, 0), 3, 6), "within 6 cells"),
        ([(5, 0), (5, 1), (5, 2), (6, 2), (7, 2), (8, 2)], "no straight chain"),
        ([(5, 0), (7, 0), (6, 0), (8, 0), (9, 0), (10, 0)], "no straight chain"),
        (row((5, 0), 1, 5), "found 5 goal cells"),
        ([], "found 0 goal cells"),
    ],
)
def test_goals_that_it_cannot_reach_are_refused_at_birth(goals: list[Cell], message: str) -> None:
    """One clear line, from a module that can tell by its own start cell."""
    scene = scene_of(LINE, LINE)
    scene = replace(scene, goal=None, goals=(tuple(goals),) * 6)
    with pytest.raises(InputError, match=message) as refused:
        actors_for(scene, CHAIN, seed=0, hesitate=0.0)
    assert "\n" not in str(refused.value)


def test_goals_listed_twice_are_no_chain() -> None:
    """A goal that stays on one cell is not straight, whoever tells a module of it."""
    knowledge = replace(births(scene_of(LINE[:2], LINE[:2]))[0], goals=((1, 0), (1, 0)))
    with pytest.raises(InputError, match="no straight chain"):
        CHAIN.make(knowledge)


@pytest.mark.parametrize(
    ("start", "goals"),
    [
        (row((0, 0), 0, 6), row((2, 0), 1, 6)),  # the goal begins inside the start
        ([(2, 0), (1, 0), (1, 1)], row((1, 1), 1, 3)),  # the start is bent
        (row((0, 0), 0, 3), row((1, -1), 1, 3)),  # crosses, too short to be seen from birth
        (row((0, 0), 0, 2), row((0, 1), 0, 2)),  # parallel, likewise
        ([(0, 0), (1, 0), (3, 0)], row((3, 0), 1, 3)),  # the start has a gap
    ],
)
def test_what_no_module_knows_from_birth_fails_at_the_first_view(
    start: list[Cell], goals: list[Cell]
) -> None:
    """A start that is no straight chain to the goal is given up in the first round."""
    played = play(scene_of(start, goals), CHAIN)
    assert played.failed is not None
    assert "no straight chain leads from" in played.failed
    assert len(played.rounds) <= 1


NARROW = [(q, r) for q in range(-3, 9) for r in range(-1, 10)]


@pytest.mark.parametrize(
    ("filled", "empty", "workspace"),
    [([(3, 2)], [], None), ([], [(-2, 0)], None), ([], [], NARROW)],
)
def test_obstacles_and_walls_in_the_way_are_refused(
    filled: list[Cell], empty: list[Cell], workspace: list[Cell] | None
) -> None:
    """The static map is known from birth, so is that there is no room."""
    system = LatticeSystem(
        page_catalogue("hexagons-1"), filled=filled, empty=empty, workspace=workspace
    )
    scene = scene_of(LINE, row((5, 0), 1, 6), system)
    with pytest.raises(InputError, match="needs room"):
        actors_for(scene, CHAIN, seed=0, hesitate=0.0)


def test_an_obstacle_far_away_is_no_hindrance() -> None:
    """Three cells off is far enough."""
    system = LatticeSystem(page_catalogue("hexagons-1"), filled=[(0, 3), (2, -3)])
    assert play(scene_of(LINE, row((5, 0), 1, 6), system), CHAIN).reached


def test_random_is_not_chain() -> None:
    """The figures above are the rule's own: random modules do not get there in as many rounds."""
    assert not play(scene_from_spec("hex:n=6"), RANDOM, max_rounds=30).reached
