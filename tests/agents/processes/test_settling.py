"""Who has not kept to what the claims and the verdicts of a round say."""

from cubepath.agents.processes.settling import Settling
from cubepath.protocol.scenes.specs import scene_from_spec
from cubepath.protocol.wire.messages import Report
from oracles.obvious_rounds import rank

SYSTEM = scene_from_spec("agv:graph=P20,n=2").system
FIRST = next(seed for seed in range(20) if rank(seed, 3, 0) > rank(seed, 3, 1))
OTHER = next(seed for seed in range(20) if rank(seed, 3, 0) < rank(seed, 3, 1))
"""Seeds with which module 0, or module 1, goes before the other in round 3."""


def settling(seed: int) -> Settling:
    """Return two vehicles that want the vertex between them, and a third that is free."""
    claims = {}
    for module, (at, to) in enumerate(((0, 1), (2, 1), (8, 9))):
        moves = [move for move in SYSTEM.moves(at) if move is not None and move.target == to]
        (claims[module],) = moves
    return Settling(claims, seed=seed, round_number=3)


def test_who_goes_before_whom_and_who_waits() -> None:
    """By the ranks of the round; claims that commute have nothing to settle."""
    for seed, first in ((FIRST, 0), (OTHER, 1)):
        found = settling(seed)
        assert found.before == {first: set(), 1 - first: {first}, 2: set()}
        assert found.waiting == {first: {2 - 2 * first}, 1 - first: set(), 2: set()}


def report(module: int, site: int, *, moved: bool) -> Report:
    """Return a report; of a move it matters only that there is one."""
    move = settling(FIRST).claims[module] if moved else None
    return Report(3, module, 0, site, "granted" if moved else "lost", move, {})  # type: ignore[arg-type]


def test_a_round_that_agrees_has_no_fault() -> None:
    """The first is granted, the other lost."""
    reports = {
        0: report(0, 1, moved=True),
        1: report(1, 2, moved=False),
        2: report(2, 9, moved=True),
    }
    sites = {0: 0, 1: 2, 2: 8}
    assert settling(FIRST).fault({0: True}, reports, sites) is None
    assert settling(OTHER).fault({1: False}, reports, sites) == (
        1,
        "verdict of module_1: by those before it it is granted",
    )
    assert settling(OTHER).fault({1: True}, reports, sites) == (
        1,
        "report of module_1: by those before it it is granted",
    )


def test_where_modules_end_is_where_the_moves_take_them() -> None:
    """Also those that claim nothing."""
    nothing = Settling({}, seed=0, round_number=1)
    stays = Report(1, 4, 5, 6, "none", None, {})
    assert nothing.fault({}, {4: stays}, {4: 6}) is None
    found = nothing.fault({}, {4: stays}, {4: 5})
    assert found == (4, "report of module_4: the moves take it to 5")
