"""Two keepers and two modules: each answer that a keeper gives."""

from dataclasses import replace
from typing import Any

import pytest
from msgspec.structs import replace as replaced

from cubepath.agents.keepers.journal import Acknowledged, Compacted, JoinedRecord, MemoryJournal
from cubepath.agents.keepers.keeper import (
    ABORTED,
    FETCH_MAX,
    LEASE_TICKS,
    LEASE_TICKS_MAX,
    REMIND_TICKS,
    SETTLE_TICKS,
    Keeper,
)
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.sites import Site
from cubepath.protocol.scenes.specs import scene_from_spec
from cubepath.protocol.wire.free_messages import (
    Attempt,
    Commit,
    CommitLog,
    Decision,
    Entered,
    EnterRequest,
    Forwarded,
    Forwards,
    Inquiry,
    PlaceState,
    Replies,
    Settled,
    TileQuery,
    TileUpdate,
)
from exploration.keeper_world import Dealt

STAR = replace(scene_from_spec("agv:graph=S3,n=2"), start=(1, 2), goal=None, goals=())
TILES = Dealt(STAR.system, {0: 1, 1: 0, 2: 1, 3: 1})
"""Module 0 at leaf 1 has to ask keeper 0 first, module 1 at leaf 2 only keeper 1."""


class Pair:
    """Two keepers, with their journals."""

    def __init__(self) -> None:
        self.journals = [MemoryJournal(), MemoryJournal()]
        self.keepers = [Keeper(me, STAR, TILES, self.journals[me]) for me in (0, 1)]

    def crash(self, me: int) -> None:
        self.keepers[me] = Keeper(me, STAR, TILES, self.journals[me])

    def parts(self, me: int) -> list[Any]:
        """Return what a keeper has to say, announcements apart."""
        found: list[Any] = []
        for message in self.keepers[me].outgoing():
            if isinstance(message, Forwards | Replies):
                found += message.parts
        return found

    def ask(self, me: int, part: Attempt | EnterRequest | TileQuery, process: int = 0) -> list[Any]:
        self.keepers[me].ask(process, part)
        return self.parts(me)

    def hear(self, me: int, part: Any) -> list[Any]:
        self.keepers[me].hear(1 - me, part)
        return self.parts(me)

    def ticks(self, me: int, count: int) -> list[Any]:
        for _ in range(count):
            self.keepers[me].tick()
        return self.parts(me)


def attempt(module: int, number: int = 1, epoch: int = 0, **other: Any) -> Attempt:
    """Return an attempt to go to the hub."""
    site: Site = module + 1
    (move,) = [each for each in STAR.system.moves(site) if each is not None]
    sensed: list[tuple[Site, Site | None]] = [(0, None), (site, site)]
    made = Attempt(module, epoch, number, 0, site, move.generator, move.at, sensed)
    return replaced(made, **other)


def test_an_attempt_passes_and_is_committed() -> None:
    """The last keeper logs it, tells the module and the keeper before, which follows."""
    pair = Pair()
    (passed,) = pair.ask(0, attempt(0))
    assert isinstance(passed, Forwarded)
    told, decision = pair.hear(1, passed)[::-1]
    assert told == decision
    moved, asked = decision.commit, passed.attempt
    assert moved.motion == [(0, 1, 0, 1)]
    assert moved.level == 1
    assert (moved.generator, moved.at, moved.turn) == (asked.generator, asked.at, asked.turn)
    assert pair.keepers[0].units.shows(1) == 1
    assert pair.hear(0, decision) == []
    assert pair.keepers[0].units.shows(1) is None
    assert pair.keepers[1].units.occupant(0).module == 0  # type: ignore[union-attr]
    assert not pair.keepers[0]._exclusive


def test_the_same_again_is_answered_the_same() -> None:
    """Passed on while it is under way, told afterwards; also after a crash of each."""
    pair = Pair()
    (passed,) = pair.ask(0, attempt(0))
    assert pair.ask(0, attempt(0)) == [passed]
    pair.crash(0)
    assert pair.ask(0, attempt(0)) == [passed]
    decision = pair.hear(1, passed)[0]
    pair.crash(1)
    assert pair.hear(1, passed) == [decision]
    assert pair.keepers[1].commits == 1
    pair.hear(0, decision)
    assert pair.ask(0, attempt(0)) == [decision]
    pair.crash(0)
    assert pair.ask(0, attempt(0)) == [decision]


def test_a_refusal_is_remembered() -> None:
    """Also when what was sensed holds later, and after a crash."""
    pair = Pair()
    (committed,) = pair.ask(1, attempt(1), 1)
    assert committed.commit is not None
    (passed,) = pair.ask(0, attempt(0))
    refusals = pair.hear(1, passed)
    assert [each.commit for each in refusals] == [None, None]
    assert refusals[0].reason == "0 shows 0, None was sensed"
    pair.crash(1)
    assert pair.hear(1, passed) == refusals[:1]
    assert pair.hear(0, refusals[0]) == refusals[:1], "the first keeper tells the module as well"
    assert not pair.keepers[0]._prepared


def test_who_came_first_is_served_first() -> None:
    """Who waits is taken up when what it waits for is decided; refused if that was in its way."""
    pair = Pair()
    other = Dealt(STAR.system, {0: 0, 1: 1, 2: 1, 3: 1})
    keeper = Keeper(0, STAR, other, MemoryJournal())
    keeper.ask(0, attempt(0))
    (passes,) = keeper.outgoing()
    assert isinstance(passes, Forwards)
    keeper.ask(1, attempt(1))
    assert keeper.outgoing() == []
    keeper.ask(1, attempt(1))
    assert keeper.outgoing() == [], "nor when it asks again"
    assert list(keeper._waiting) == [1]
    keeper.hear(1, Decision(0, 0, 1, reason="no"))
    parts = [
        part for each in keeper.outgoing() if isinstance(each, Forwards) for part in each.parts
    ]
    assert [part.attempt.module for part in parts if isinstance(part, Forwarded)] == [1]
    assert not keeper._waiting
    assert not pair.keepers[0]._waiting


def _crowded() -> Keeper:
    """Return the first keeper of three modules that all want the hub; the first is prepared."""
    scene = replace(scene_from_spec("agv:graph=S3,n=3"), start=(1, 2, 3), goal=None, goals=())
    keeper = Keeper(0, scene, Dealt(scene.system, {0: 0, 1: 1, 2: 1, 3: 1}), MemoryJournal())
    keeper.ask(0, attempt(0))
    return keeper


def test_who_asks_again_keeps_its_place_in_the_line() -> None:
    """It does not begin to wait anew."""
    keeper = _crowded()
    for module in (1, 2, 1, 2, 1):
        keeper.ask(module, attempt(module))
    assert list(keeper._waiting) == [1, 2]
    keeper.hear(1, Decision(0, 0, 1, reason="no"))
    assert (list(keeper._prepared), list(keeper._waiting)) == ([1], [2])


def test_no_more_than_so_many_wait(monkeypatch: pytest.MonkeyPatch) -> None:
    """Who finds no room is not answered, and asks again."""
    monkeypatch.setattr("cubepath.agents.keepers.keeper.WAITING_MAX", 1)
    keeper = _crowded()
    for module in (1, 2):
        keeper.ask(module, attempt(module))
    assert list(keeper._waiting) == [1]
    keeper.hear(1, Decision(0, 0, 1, reason="no"))
    keeper.ask(2, attempt(2))
    assert list(keeper._waiting) == [2]


def test_who_waits_with_an_attempt_that_is_outdated_is_not_taken_up() -> None:
    """A later one was forbidden meanwhile, so the module has long gone on."""
    keeper = _crowded()
    keeper.ask(1, attempt(1))
    keeper.hear(1, Inquiry(1, 0, 2))
    keeper.hear(1, Decision(0, 0, 1, reason="no"))
    assert not keeper._waiting
    assert not keeper._prepared


def test_a_keeper_says_what_it_has_to_do() -> None:
    """The attempts that wait first, then those that are prepared, then what is not settled."""
    pair = Pair()
    states = [[keeper.state for keeper in pair.keepers]]

    def told(me: int, part: Any) -> list[Any]:
        found = pair.ask(me, part) if isinstance(part, Attempt) else pair.hear(me, part)
        states.append([keeper.state for keeper in pair.keepers])
        return found

    (passed,) = told(0, attempt(0))
    told(0, attempt(0, 2))
    decision = told(1, passed)[0]
    told(0, decision)
    (settled,) = pair.ticks(0, SETTLE_TICKS)
    told(1, settled)
    assert states == [
        ["idle", "idle"],
        ["prepared", "idle"],
        ["waiting", "idle"],
        ["waiting", "settling"],
        ["settling", "settling"],
        ["idle", "idle"],
    ]


def test_what_is_acknowledged_goes_with_what_is_sent_anyway() -> None:
    """And what is owed after that waits as long as ever."""
    pair = Pair()
    (passed,) = pair.ask(0, attempt(0))
    decision, settled = pair.hear(1, passed)[0], Settled(0, 0, 1)
    pair.hear(0, decision)
    assert pair.ticks(0, SETTLE_TICKS - 1) == []
    assert pair.hear(0, Inquiry(1, 0, 9)) == [Decision(1, 0, 9, reason=ABORTED), settled]
    for _ in range(2):
        pair.hear(0, decision)
        assert pair.ticks(0, SETTLE_TICKS - 1) == []
        assert pair.ticks(0, 1) == [settled]


def test_an_attempt_that_comes_late_is_not_waited_with() -> None:
    """A later one of its module waits, so this one was decided elsewhere."""
    keeper = Keeper(0, STAR, Dealt(STAR.system, {0: 0, 1: 1, 2: 1, 3: 1}), MemoryJournal())
    keeper.ask(1, attempt(1))
    for number in (2, 1):
        keeper.ask(0, attempt(0, number))
    keeper.hear(1, Decision(1, 0, 1, reason="no"))
    assert keeper._prepared[0].passed.attempt.number == 2


def test_a_later_epoch_waits_in_place_of_an_earlier_one() -> None:
    """Of each module one attempt waits at most, and the earlier one is never taken up."""
    tiles = Dealt(STAR.system, {0: 0, 1: 1, 2: 1, 3: 1})
    keeper = Keeper(0, STAR, tiles, MemoryJournal())
    keeper.ask(0, attempt(0))
    keeper.ask(1, attempt(1))
    keeper.ask(1, attempt(1, epoch=1))
    keeper.outgoing()
    keeper.ask(1, attempt(1))
    keeper.hear(1, Decision(0, 0, 1, reason="no"))
    keeper.outgoing()
    assert keeper._prepared[1].passed.attempt.epoch == 1
    keeper.ask(1, attempt(1))
    (tells,) = keeper.outgoing()
    assert isinstance(tells, Replies)
    (told,) = tells.parts
    assert isinstance(told, Decision)
    assert told.reason == "fenced off: a later epoch has begun"


def test_an_expired_lease_forbids_an_attempt_that_has_not_arrived() -> None:
    """Asked, the last keeper logs that; the attempt is refused when it comes, after a crash too."""
    pair = Pair()
    (passed,) = pair.ask(0, attempt(0))
    assert pair.ticks(0, LEASE_TICKS - 1) == []
    inquiry = Inquiry(0, 0, 1)
    assert pair.ticks(0, 1) == [inquiry]
    assert pair.ticks(0, 2 * LEASE_TICKS - 1) == [], "ever more rarely"
    assert pair.ticks(0, 1) == [inquiry]
    (aborted,) = pair.hear(1, inquiry)
    assert aborted == Decision(0, 0, 1, reason=ABORTED)
    pair.crash(1)
    assert pair.hear(1, passed) == [aborted]
    assert pair.hear(0, aborted) == [aborted]
    assert not pair.keepers[0]._exclusive
    (again,) = pair.ask(0, attempt(0, 2))
    assert pair.ticks(0, 2 * LEASE_TICKS) == [], "it waits longer for who was late"
    assert pair.hear(1, again)[0].commit is not None


def test_what_waits_at_the_last_keeper_is_not_forbidden() -> None:
    """And what was committed is told, also when more has been since."""
    pair = Pair()
    tiles = Dealt(STAR.system, {0: 1, 1: 0, 2: 2, 3: 1})
    keeper = Keeper(1, STAR, tiles, MemoryJournal())
    first = Keeper(0, STAR, tiles, MemoryJournal())
    keeper.ask(1, attempt(1))
    first.ask(0, attempt(0))
    (passes,) = first.outgoing()
    assert isinstance(passes, Forwards)
    keeper.hear(0, passes.parts[0])
    keeper.outgoing()
    keeper.hear(0, Inquiry(0, 0, 1))
    assert keeper.outgoing() == []
    keeper.hear(2, Decision(1, 0, 1, reason="no"))
    assert keeper.commits == 1
    keeper.outgoing()
    keeper.hear(0, Inquiry(0, 0, 1))
    (said,) = keeper.outgoing()
    assert isinstance(said, Forwards)
    (decision,) = said.parts
    assert isinstance(decision, Decision)
    assert decision.commit is not None
    assert not pair.keepers[1].busy


def test_a_commit_is_told_until_it_is_acknowledged() -> None:
    """After a crash as well; once acknowledged it is not, and who acknowledges is on record."""
    pair = Pair()
    (passed,) = pair.ask(0, attempt(0))
    decision = pair.hear(1, passed)[0]
    assert pair.ticks(1, REMIND_TICKS - 1) == []
    assert pair.ticks(1, 1) == [decision]
    pair.crash(1)
    assert pair.ticks(1, REMIND_TICKS) == [decision]
    pair.keepers[0].hear(2, decision)
    assert not pair.keepers[0].busy, "it is acknowledged to who has committed it"
    assert pair.hear(0, decision) == []
    assert pair.keepers[0].busy
    assert pair.ticks(0, SETTLE_TICKS - 1) == []
    settled = Settled(0, 0, 1)
    assert pair.ticks(0, 1) == [settled]
    assert not pair.keepers[0].busy
    assert pair.hear(0, decision) == []
    assert pair.ticks(0, SETTLE_TICKS) == [settled], "it may have been lost"
    assert pair.keepers[1].busy
    pair.keepers[1].hear(2, settled)
    assert pair.keepers[1].busy, "another keeper cannot acknowledge it"
    pair.hear(1, settled)
    pair.hear(1, settled)
    assert not pair.keepers[1].busy
    assert [each for each in pair.journals[1].records() if isinstance(each, Acknowledged)] == [
        Acknowledged(0, 0, 0, 1)
    ]
    pair.crash(1)
    assert not pair.keepers[1].busy


def test_a_module_enters_when_nothing_of_it_is_under_way() -> None:
    """Its keeper asks what became of that first; a later incarnation fences off an earlier one."""
    pair = Pair()
    (passed,) = pair.ask(0, attempt(0))
    assert pair.ask(0, EnterRequest(0, 1)) == [Inquiry(0, 0, 1)]
    pair.hear(0, Decision(0, 0, 1, reason="no"))
    (entered,) = pair.ask(0, EnterRequest(0, 1))
    assert isinstance(entered, Entered)
    assert (entered.incarnation, entered.site, entered.occupant.epoch) == (1, 1, 1)
    assert entered.occupant.number == 0
    assert pair.ask(0, EnterRequest(0, 1)) == [entered]
    pair.crash(0)
    assert pair.ask(0, EnterRequest(0, 1)) == [entered]
    (second,) = pair.ask(0, EnterRequest(0, 2))
    assert second.occupant.epoch == 2
    assert pair.keepers[0]._entered == {0: 2}, "as a compacted log says"
    assert pair.ask(0, EnterRequest(0, 1)) == []
    assert pair.ask(1, EnterRequest(0, 3)) == []
    (refused,) = pair.ask(0, attempt(0, 1, epoch=1))
    assert refused.reason == "fenced off: module_0 is in epoch 2"
    assert passed.attempt.epoch == 0


def test_what_is_none_of_its_business_is_counted() -> None:
    """No attempt of anyone, of other keepers, not from the keeper before; another's tile."""
    pair = Pair()
    wrong = [
        attempt(0, at=["nowhere"]),
        attempt(0, generator="fly"),
        attempt(0, sensed=[]),
        attempt(0, sensed=[(0, 0), (1, 1)]),
        attempt(0, sensed=[(0, None), (1, 1), (2, 2)]),
        attempt(0, after=[(2, 0, 0)]),
        Attempt(0, 0, 1, 0, 1, sensed=[(1, 1)]),
        Attempt(0, 0, 1, 0, 1),
        attempt(1),
    ]
    for part in wrong:
        assert pair.ask(0, part) == []
    pair.keepers[0].ask(0, TileQuery("0", -1))
    assert pair.keepers[0].refused == len(wrong) + 1
    (passed,) = pair.ask(0, attempt(0))
    pair.keepers[1].hear(2, passed)
    pair.keepers[1].ask(0, attempt(0))
    assert pair.keepers[1].refused == 2
    assert not pair.keepers[1].commits
    assert not pair.keepers[1]._prepared


def test_a_tile_is_shown_whole_to_who_looks() -> None:
    """Unless it is known; each change is shown with its number."""
    pair = Pair()
    keeper = pair.keepers[1]
    keeper.ask(0, TileQuery("2", -1))
    (shows,) = keeper.outgoing()
    assert isinstance(shows, TileUpdate)
    assert (shows.whole, shows.serial, shows.parts[0].module) == (True, 0, 1)
    keeper.ask(0, TileQuery("2", 0))
    assert keeper.outgoing() == []
    keeper.ask(1, attempt(1))
    changes = [each for each in keeper.outgoing() if isinstance(each, TileUpdate)]
    assert [(each.tile, each.serial, each.whole) for each in changes] == [
        ("0", 1, False),
        ("2", 1, False),
    ]
    assert [each.parts for each in changes] == [[PlaceState(0, 1, 0, 1, [], 1)], [PlaceState(2, 1)]]


def test_how_often_units_were_read_is_shown_if_it_is_to_be() -> None:
    """As the moves of a schedule wait for."""
    for tell_reads in (False, True):
        keeper = Keeper(1, STAR, TILES, MemoryJournal(), tell_reads=tell_reads)
        keeper.ask(1, attempt(1))
        changes = [each for each in keeper.outgoing() if isinstance(each, TileUpdate)]
        reads = [part.reads for each in changes for part in each.parts]
        assert reads == ([[(0, 1, 0)], [(2, 1, 0)]] if tell_reads else [[], []])


def test_an_attempt_stays_prepared_whatever_is_decided_of_another() -> None:
    """Of a later one of its module, also after a crash."""
    pair = Pair()
    pair.ask(0, attempt(0))
    decision = Decision(0, 0, 2, reason=ABORTED)
    assert pair.hear(0, Inquiry(0, 0, 2)) == [decision]
    for _ in range(2):
        pair.hear(0, decision)
        assert [each.passed.attempt.number for each in pair.keepers[0]._prepared.values()] == [1]
        pair.crash(0)


def test_changes_are_shown_in_the_order_of_tiles() -> None:
    """Of what is written, and of registers that are exchanged."""
    keeper = Keeper(0, STAR, Dealt(STAR.system, dict.fromkeys(range(4), 0)), MemoryJournal())
    keeper.ask(1, attempt(1, notes=[(1, [], [7])]))
    changes = [each for each in keeper.outgoing() if isinstance(each, TileUpdate)]
    assert [each.tile for each in changes] == ["0", "1", "2"]


def test_commits_are_fetched_some_at_a_time() -> None:
    """The units come with the last of them."""
    keeper = Keeper(0, STAR, Dealt(STAR.system, dict.fromkeys(range(4), 0)), MemoryJournal())
    site: Site = 2
    for number in range(1, FETCH_MAX + 3):
        target = 0 if site else 2
        (move,) = [e for e in STAR.system.moves(site) if e is not None and e.target == target]
        sensed: list[tuple[Site, Site | None]] = [(site, site), (target, None)]
        sensed.sort(key=repr)
        keeper.ask(1, Attempt(1, 0, number, 0, site, move.generator, move.at, sensed))
        site = target
    assert not keeper.busy, "nobody else has to learn of them"
    keeper.outgoing()
    keeper.fetch(0, 0)
    keeper.fetch(FETCH_MAX, 0)
    first, rest = keeper.outgoing()
    assert isinstance(first, CommitLog)
    assert isinstance(rest, CommitLog)
    assert [each.serial for each in first.parts] == [*range(1, FETCH_MAX + 1)]
    assert [each.serial for each in rest.parts] == [FETCH_MAX + 1, FETCH_MAX + 2]
    assert [each.level for each in rest.parts] == [FETCH_MAX + 1, FETCH_MAX + 2]
    assert first.units == []
    last = FETCH_MAX + 2
    assert rest.units == [(0, last, last, 0, None), (2, last, last, 0, 2)]
    assert isinstance(rest.parts[0], Commit)


def test_registers_are_exchanged_at_once() -> None:
    """The own one is written with that of another module, whose own is only held to another."""
    pair = Pair()
    own = Attempt(0, 0, 1, 0, 1, notes=[(1, [], [5])])
    (told,) = pair.ask(0, own)
    assert told.commit.notes == [(1, 0, 1, [5])]
    assert told.commit.level == 0
    exchange = Attempt(0, 0, 2, 0, 1, notes=[(1, [5], None), (2, [], [7])])
    (passed,) = pair.ask(0, exchange)
    assert pair.ask(0, EnterRequest(0, 1)) == [Inquiry(0, 0, 2)], "what has to hold is locked"
    decision = pair.hear(1, passed)[0]
    assert decision.commit.notes == [(1, 0, 1, None), (2, 1, 1, [7])]
    pair.hear(0, decision)
    notes = [pair.keepers[0].units.occupant(1), pair.keepers[1].units.occupant(2)]
    assert [each.note for each in notes if each is not None] == [[5], [7]]
    assert [(each.version, each.number) for each in notes if each is not None] == [(1, 1), (1, 0)]
    (refused,) = pair.ask(0, Attempt(0, 0, 3, 0, 1, notes=[(1, [6], [7])]))
    assert refused.reason == "the register at 1 is [5], [6] was sensed"
    assert not pair.keepers[0]._shared


def test_a_refusal_is_told_when_asked_and_stays_the_last_word() -> None:
    """With its own reason; an inquiry about an earlier attempt does not come in its place."""
    pair = Pair()
    pair.ask(1, attempt(1), 1)
    (passed,) = pair.ask(0, attempt(0, 2))
    refusal = pair.hear(1, passed)[0]
    assert pair.hear(1, Inquiry(0, 0, 2)) == [refusal]
    records = len([*pair.journals[1].records()])
    assert pair.hear(1, Inquiry(0, 0, 1)) == [Decision(0, 0, 1, reason=ABORTED)]
    assert len([*pair.journals[1].records()]) == records
    assert pair.hear(1, passed) == [refusal]


def test_a_lease_is_short_again_after_another_outcome() -> None:
    """It is longer only after an attempt that was given up."""
    pair = Pair()
    pair.ask(0, attempt(0))
    pair.hear(0, Decision(0, 0, 1, reason=ABORTED))
    pair.ask(0, attempt(0, 2))
    assert pair.ticks(0, LEASE_TICKS) == []
    pair.hear(0, Decision(0, 0, 2, reason="no"))
    pair.ask(0, attempt(0, 3))
    assert pair.ticks(0, LEASE_TICKS) == [Inquiry(0, 0, 3)]


def test_leases_double_up_to_a_limit() -> None:
    """With each attempt of a module that is given up, and with each inquiry."""
    pair = Pair()
    due = LEASE_TICKS
    for number in range(1, 8):
        pair.ask(0, attempt(0, number))
        assert pair.ticks(0, due - 1) == []
        pair.hear(0, Decision(0, 0, number, reason=ABORTED))
        due = min(2 * due, LEASE_TICKS_MAX)
    pair.ask(0, attempt(0, 8))
    for _ in range(2):
        assert pair.ticks(0, LEASE_TICKS_MAX - 1) == []
        assert pair.ticks(0, 1) == [Inquiry(0, 0, 8)]


def test_the_next_attempt_waits_until_the_last_one_is_decided_here_too() -> None:
    """The module knows what became of it, and this keeper asks."""
    pair = Pair()
    (passed,) = pair.ask(0, attempt(0))
    pair.ask(1, attempt(1), 1)
    refusal = pair.hear(1, passed)[0]
    assert pair.ask(0, attempt(0, 2)) == [Inquiry(0, 0, 1)]
    told = pair.hear(0, refusal)
    assert told[0].attempt.number == 2
    assert told[1] == refusal


class Row:
    """The first keeper of vehicles on a path, of which the second has the first place."""

    def __init__(self, length: int = 5, start: tuple[int, ...] = (0, 2, 3)) -> None:
        spec = f"agv:graph=P{length},n={len(start)}"
        self.scene = replace(scene_from_spec(spec), start=start, goal=None, goals=())
        keepers: dict[Site, int] = {vertex: int(vertex in {0, 6}) for vertex in range(length)}
        self.keeper = Keeper(0, self.scene, Dealt(self.scene.system, keepers), MemoryJournal())

    def go(
        self, module: int, source: int, target: int, guard: Any = None, number: int = 1
    ) -> list[Decision]:
        """Let a vehicle ask to go to a vertex next to it; return what modules are told."""
        moves = self.scene.system.moves(source)
        (move,) = [each for each in moves if each is not None and each.target == target]
        guards = [] if guard is None else [guard]
        sensed = sorted([(source, source), (target, None), *guards], key=lambda pair: pair[0])
        made = Attempt(module, 0, number, 0, source, move.generator, move.at, [*sensed])
        self.keeper.ask(module, made)
        return self.told()

    def told(self) -> list[Decision]:
        """Return what modules are told."""
        replies = [each for each in self.keeper.outgoing() if isinstance(each, Replies)]
        return [part for each in replies for part in each.parts if isinstance(part, Decision)]


def test_who_waits_is_not_overtaken_by_who_conflicts_with_it_alone() -> None:
    """A guard of what it will write waits behind it."""
    row = Row()
    row.go(0, 0, 1)
    row.go(1, 2, 1)
    row.go(2, 3, 4, (2, 2))
    assert list(row.keeper._waiting) == [1, 2]
    assert row.keeper.commits == 0
    row.keeper.hear(1, Decision(0, 0, 1, reason="no"))
    assert [(each.module, each.reason) for each in row.told()] == [
        (0, "no"),
        (1, ""),
        (2, "2 shows None, 2 was sensed"),
    ]


def test_who_waits_for_another_is_taken_up_before_those_that_came_first() -> None:
    """Only what conflicts waits: at the other end of the path nothing is in the way any more."""
    row = Row(7, (0, 2, 6, 4))
    for module, source, target in ((0, 0, 1), (2, 6, 5), (1, 2, 1), (3, 4, 5)):
        assert row.go(module, source, target) == []
    assert (list(row.keeper._prepared), list(row.keeper._waiting)) == ([0, 2], [1, 3])
    row.keeper.hear(1, Decision(2, 0, 1, reason="no"))
    assert [(each.module, each.reason) for each in row.told()] == [(2, "no"), (3, "")]
    assert list(row.keeper._waiting) == [1]


def test_attempts_are_numbered_anew_in_each_epoch() -> None:
    """Whatever the last one was."""
    row = Row()
    (moved,) = row.go(1, 2, 1)
    assert moved.commit is not None
    row.keeper.ask(1, EnterRequest(1, 1))
    (replies,) = row.keeper.outgoing()
    assert isinstance(replies, Replies)
    (entered,) = replies.parts
    assert isinstance(entered, Entered)
    assert (entered.occupant.epoch, entered.occupant.number) == (1, 0)


def test_how_often_each_module_has_entered_is_in_a_compacted_log() -> None:
    """A run that is taken up again is checked by it."""
    row = Row()
    for module, incarnation in ((1, 1), (1, 2), (2, 1)):
        row.keeper.ask(1, EnterRequest(module, incarnation))
    compacted, *_ = row.keeper._compacted(0)
    assert isinstance(compacted, Compacted)
    assert compacted.entered == {1: 2, 2: 1}


def test_who_waited_for_what_is_replaced_is_taken_up() -> None:
    """A later epoch of that module wants something else."""
    row = Row()
    row.go(0, 0, 1)
    row.go(1, 2, 1)
    row.go(2, 3, 4, (2, 2))
    row.keeper.ask(1, EnterRequest(1, 1))
    row.keeper.ask(1, Attempt(1, 1, 1, 0, 2, notes=[(2, [], [5])]))
    assert [(each.module, each.epoch, each.reason) for each in row.told()] == [
        (1, 1, ""),
        (2, 0, ""),
    ]
    assert not row.keeper._waiting


def test_a_commit_says_what_it_relied_on() -> None:
    """The version of each unit that is written or guarded, how often it was read, and its level."""
    row = Row()
    row.go(2, 3, 4)
    ((first,), (second,)) = (
        row.go(1, 2, 3, (1, None), number=1),
        row.go(1, 3, 2, (4, 4), number=2),
    )
    assert first.commit is not None
    assert second.commit is not None
    assert (first.commit.written, first.commit.guarded) == ([(2, 0, 0), (3, 1, 0)], [(1, 0)])
    assert (second.commit.written, second.commit.guarded) == ([(2, 1, 0), (3, 2, 0)], [(4, 1)])
    assert (first.commit.level, second.commit.level) == (2, 3)
    occupant = row.keeper.units.occupant(2)
    assert occupant is not None
    assert (occupant.module, occupant.number, occupant.version) == (1, 2, 2)


def test_every_keeper_of_a_chain_is_told_until_it_acknowledges() -> None:
    """Each by itself."""
    scene = Row().scene
    tiles = Dealt(scene.system, {0: 0, 1: 0, 2: 1, 3: 2, 4: 2})
    keepers = [Keeper(me, scene, tiles, MemoryJournal()) for me in range(3)]
    (move,) = [each for each in scene.system.moves(2) if each is not None and each.target == 1]
    sensed: list[tuple[Site, Site | None]] = [(1, None), (2, 2), (3, 3)]
    keepers[0].ask(0, Attempt(1, 0, 1, 0, 2, move.generator, move.at, sensed))
    for me in (0, 1):
        (passes,) = keepers[me].outgoing()
        assert isinstance(passes, Forwards)
        keepers[me + 1].hear(me, passes.parts[0])

    def told() -> list[int]:
        return [each.to for each in keepers[2].outgoing() if isinstance(each, Forwards)]

    assert told() == [0, 1]
    for me in (0, 1):
        for _ in range(REMIND_TICKS):
            keepers[2].tick()
        assert told() == [0, 1][me:]
        keepers[2].hear(me, Settled(1, 0, 1))
    assert not keepers[2].busy


def test_records_that_cannot_follow_those_before_are_refused() -> None:
    """As those of another run, whose module was never here."""
    journal = MemoryJournal()
    journal.append(JoinedRecord(EnterRequest(0, 1)))
    with pytest.raises(InputError, match=r"log of keeper_1 cannot follow the .* \(KeyError\)"):
        Keeper(1, STAR, TILES, journal)
