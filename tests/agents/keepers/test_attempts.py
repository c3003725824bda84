"""What an attempt takes of each keeper, and attempts that no module could make."""

from typing import Any

import pytest
from msgspec.structs import replace

from cubepath.agents.keepers import attempts
from cubepath.agents.keepers.attempts import NotAnAttempt, chain_of, planned
from cubepath.protocol.core.catalogue import HEXAGONS
from cubepath.protocol.core.sites import Site, in_order
from cubepath.protocol.scenes.specs import scene_from_spec
from cubepath.protocol.wire.free_messages import Attempt
from cubepath.protocol.wire.keys import Tiles
from exploration.keeper_world import Dealt

HEX = scene_from_spec("hex:n=3")
(MOVE, *_) = [
    move
    for move in HEX.system.moves(HEX.start[0])
    if move is not None and move.possible({*HEX.start})
]
GUARD = next(cell for cell in HEX.system.sensed(HEX.start[0]) if cell not in MOVE.action.support)
"""A cell that the first module senses, and that its move does not touch."""
SENSED = in_order(MOVE.action.support | {GUARD})


class Scattered(Tiles):
    """The keeper of a cell is 8 or 1, so that a set of them is not in order by itself."""

    def __init__(self) -> None:
        super().__init__(HEX.system, 9)

    def keeper_of(self, place: Site) -> int:
        return 8 if sum(HEXAGONS.check(place)) % 2 else 1


TILES = Scattered()


def attempt(**other: Any) -> Attempt:
    """Return the attempt of the first module to make its move, with a guard and two registers."""
    made = Attempt(
        module=0,
        epoch=1,
        number=1,
        turn=1,
        site=HEX.start[0],
        generator=MOVE.generator,
        at=MOVE.at,
        sensed=[(cell, cell if cell in HEX.start else None) for cell in SENSED],
        notes=[((1, 0), [5], None), ((2, 0), [6], [7])],
        after=[((0, 0), 1, None), ((1, 0), 3, 2)],
    )
    return replace(made, **other)


def test_each_keeper_has_its_share() -> None:
    """Units are read, written or guarded; what is written or exchanged is for this one alone."""
    plan = planned(HEX.system, TILES, attempt())
    assert plan.chain == (1, 8) == chain_of(HEX.system, TILES, attempt())
    assert plan.motion == MOVE.motion
    writes, reads = MOVE.action.trace, MOVE.action.support - MOVE.action.trace
    for keeper, share in plan.shares.items():
        mine = [cell for cell in SENSED if TILES.keeper_of(cell) == keeper]
        assert share.sensed == tuple((cell, cell if cell in HEX.start else None) for cell in mine)
        assert share.writes == tuple(cell for cell in mine if cell in writes)
        assert share.reads == tuple(cell for cell in mine if cell in reads)
        assert share.guards == tuple(cell for cell in mine if cell == GUARD)
        alone = {(register, cell) for cell in share.writes for register in (False, True)}
        alone |= {(True, (2, 0))} if keeper == 1 else set()
        together = {(False, cell) for cell in (*share.reads, *share.guards)}
        together |= {(True, (1, 0))} if keeper == 8 else set()
        assert share.exclusive == alone
        assert share.shared == together
    assert plan.shares[8].notes == (((1, 0), (5,), None),)
    assert plan.shares[1].notes == (((2, 0), (6,), (7,)),)
    assert plan.shares[8].after == (((1, 0), 3, 2),)
    assert plan.shares[1].after == (((0, 0), 1, None),)


def test_the_keepers_of_registers_are_in_the_chain() -> None:
    """Also where nothing else is theirs."""
    note = attempt(generator=None, at=None, sensed=[], after=[])
    note = replace(note, notes=[((0, 0), [], [1]), ((1, 0), [5], None)])
    plan = planned(HEX.system, TILES, note)
    assert plan.chain == (1, 8) == chain_of(HEX.system, TILES, note)
    assert plan.move is None
    assert plan.motion == ()


SQUARES = scene_from_spec("sliding:n=2")


def test_what_never_changes_is_in_no_share_but_counts() -> None:
    """A square slides on a floor of obstacles, which nobody says anything of."""
    system, tiles = SQUARES.system, Tiles(SQUARES.system, 2)
    on = {*SQUARES.start, *system.filled}
    moves = [
        move
        for site in SQUARES.start
        for move in system.moves(site)
        if move is not None and move.possible(on) and move.action.support & system.filled
    ]
    for move in moves:
        units = [unit for unit in move.action.support if system.has_place(unit)]
        sensed: list[tuple[Site, Site | None]] = [(at, at if at in on else None) for at in units]
        made = Attempt(0, 1, 1, 1, move.source, move.generator, move.at, sensed)
        shares = planned(system, tiles, made).shares.values()
        assert {*units} == {unit for share in shares for unit, _ in share.sensed}
    assert moves


def test_no_module_stands_in_an_obstacle() -> None:
    """So none writes into a register there."""
    (wall, *_) = SQUARES.system.filled
    written = Attempt(0, 1, 1, 1, wall, notes=[(wall, [], [1])])
    with pytest.raises(NotAnAttempt, match="attempt of module_0: "):
        planned(SQUARES.system, Tiles(SQUARES.system, 2), written)


FAR: Site = (9, 9)
CHANGED: dict[str, tuple[dict[str, Any], str]] = {
    "another move": ({"generator": "jump"}, "'jump' is no move from there"),
    "part of the support": (
        {"sensed": [(cell, cell if cell in HEX.start else None) for cell in SENSED[2:]]},
        "nothing is said of ",
    ),
    "the target": (
        {"sensed": [pair for pair in attempt().sensed if pair[0] != MOVE.target]},
        "nothing is said of ",
    ),
    "all is empty": (
        {"sensed": [(cell, None) for cell in SENSED]},
        "the move is not admissible where that was sensed",
    ),
    "guards alone": ({"generator": None, "at": None, "after": []}, "guards without a move"),
    "a far guard": (
        {"sensed": [*attempt().sensed, (FAR, None)]},
        r"\(9, 9\) is out of sensing range",
    ),
    "a far register": ({"notes": [(FAR, [], None)]}, r"register at \(9, 9\) is out of reach"),
    "nothing of its own": (
        {"generator": None, "at": None, "sensed": [], "after": []},
        "neither a move, nor anything about the module's own register",
    ),
    "after a guard": ({"after": [(GUARD, 0, None)]}, "what must be done before is not in the"),
    "a site that is none": ({"site": "x" * 300}, "^attempt of module_0: InputError: a site of"),
    "a place that is none": ({"sensed": [*attempt().sensed, ("y", None)]}, "out of sensing range"),
}


@pytest.mark.parametrize(("changed", "why"), CHANGED.values(), ids=CHANGED)
def test_what_no_module_can_attempt_is_refused(changed: dict[str, Any], why: str) -> None:
    """In one line, which is never long."""
    with pytest.raises(NotAnAttempt, match=why) as found:
        planned(HEX.system, TILES, attempt(**changed))
    assert len(str(found.value)) <= 200


def test_a_long_reason_is_cut() -> None:
    """To what a decision may hold."""
    with pytest.raises(NotAnAttempt) as found:
        planned(HEX.system, TILES, attempt(site="x" * 300))
    assert len(str(found.value)) == 200


def test_a_chain_of_what_is_no_place_is_refused() -> None:
    """As it is in a log that was changed."""
    graph = scene_from_spec("agv:graph=P3,n=1").system
    with pytest.raises(NotAnAttempt, match="attempt of module_0: "):
        chain_of(graph, Dealt(graph, {0: 0, 1: 0, 2: 0}), attempt(sensed=[([], None)]))


def test_no_more_than_so_many_plans_are_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    """And a plan that is kept is the one that would be made."""
    monkeypatch.setattr(attempts, "_PLANS_MAX", 3)
    tiles, kept = Scattered(), []
    for times in (0, 1, 2, 1, 3, 4, 5, 6):
        made = attempt(after=[((0, 0), times, None)])
        plan = planned(HEX.system, tiles, made)
        assert plan.attempt is made
        assert plan.shares[1].after == (((0, 0), times, None),)
        kept.append(len(attempts._known_plans(HEX.system, tiles)))
    assert kept == [1, 2, 3, 3, 1, 2, 3, 1]
