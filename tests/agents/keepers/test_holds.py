"""Places that a keeper holds for a module: who waits, who gets them, and what ends it."""

from dataclasses import replace
from typing import Any

from msgspec.structs import replace as replaced

from cubepath.agents.keepers.journal import MemoryJournal
from cubepath.agents.keepers.keeper import ABORTED, LEASE_TICKS, Keeper
from cubepath.protocol.core.sites import Site
from cubepath.protocol.scenes.specs import scene_from_spec
from cubepath.protocol.wire.free_messages import (
    Attempt,
    Decision,
    Entered,
    EnterRequest,
    Forwarded,
    Held,
    Hold,
    Inquiry,
)
from exploration.keeper_seats import check_keeper
from exploration.keeper_world import Dealt, Part, letters_of

ROW = replace(scene_from_spec("agv:graph=P6,n=3"), start=(0, 2, 4), goal=None, goals=())
TILES = Dealt(ROW.system, {0: 0, 1: 0, 2: 0, 3: 0, 4: 0, 5: 1})
"""Module 2 at place 4 passes keeper 0 and is committed by keeper 1 if it goes to place 5."""


class Row:
    """Keeper 0, which has all places but the last one."""

    def __init__(self) -> None:
        self.journal = MemoryJournal()
        self.keeper = Keeper(0, ROW, TILES, self.journal)

    def said(self) -> list[Part]:
        check_keeper(self.keeper)
        return [letter.part for letter in letters_of(self.keeper)]

    def ask(self, part: Attempt | EnterRequest | Hold) -> list[Part]:
        self.keeper.ask(0, part)
        return self.said()

    def hear(self, part: Decision | Inquiry) -> list[Part]:
        self.keeper.hear(1, part)
        return self.said()

    def hold(self, module: int, number: int, *places: int, epoch: int = 0) -> list[Part]:
        return self.ask(Hold(module, epoch, number, [*places], 3 if places else 0))

    def ticks(self, count: int) -> list[Part]:
        for _ in range(count):
            self.keeper.tick()
        return self.said()

    def crash(self) -> None:
        self.keeper = Keeper(0, ROW, TILES, self.journal)

    def prepare(self) -> None:
        """Let the move of module 2 from place 4 to place 5 be under way."""
        (passed,) = self.ask(go(2, 4, 5))
        assert isinstance(passed, Forwarded)


def go(module: int, source: Site, target: Site, number: int = 1) -> Attempt:
    """Return an attempt to go."""
    (move,) = [e for e in ROW.system.moves(source) if e is not None and e.target == target]
    sensed = sorted([(source, source), (target, None)], key=str)
    return Attempt(module, 0, number, 0, source, move.generator, move.at, sensed)


def changed(attempt: Attempt, **fields: Any) -> Attempt:
    """Return an attempt that differs."""
    return replaced(attempt, **fields)


def told(parts: list[Part]) -> list[tuple[str, int, int]]:
    """Return of what is told the kind, the module and the number."""
    return [
        (type(part).__name__, part.module, part.number)
        for part in parts
        if isinstance(part, Held | Decision)
    ]


REFUSED = Decision(2, 0, 1, reason="no")


def test_what_is_held_is_told_as_it_is() -> None:
    """Also when it is asked for again."""
    row = Row()
    (held,) = row.hold(0, 1, 0, 1)
    assert isinstance(held, Held)
    assert [(each.place, each.module) for each in held.parts] == [(0, 0), (1, None)]
    assert row.hold(0, 1, 0, 1) == [held]


def test_places_are_held_for_who_came_first() -> None:
    """Who comes later waits, in the order in which they came; what is apart is held at once."""
    row = Row()
    assert told(row.hold(0, 1, 0, 1)) == [("Held", 0, 1)]
    assert row.hold(1, 1, 1, 2) == []
    assert row.hold(2, 1, 2, 3) == [], "nobody overtakes who waits"
    assert told(row.hold(0, 2)) == [("Held", 1, 1)]
    assert told(row.hold(1, 2)) == [("Held", 2, 1)]


def test_who_waits_keeps_the_place_in_the_line_under_a_new_number() -> None:
    """It asks so when it was not answered for long."""
    row = Row()
    row.hold(0, 1, 1)
    row.hold(1, 1, 1)
    row.hold(2, 1, 1)
    assert row.hold(1, 2, 1) == []
    assert told(row.hold(0, 2)) == [("Held", 1, 2)]


def test_another_attempt_waits_and_the_own_one_passes() -> None:
    """What is held ends with the commit, and then the other one is taken up."""
    row = Row()
    row.hold(0, 1, 0, 1)
    assert row.ask(go(1, 2, 1)) == []
    assert told(row.ask(go(0, 0, 1))) == [("Decision", 0, 1), ("Decision", 1, 1)]
    assert row.keeper.units.shows(1) == 1
    assert not row.keeper._exclusive


def test_a_refusal_ends_what_is_held() -> None:
    """At the keeper that refuses."""
    row = Row()
    row.hold(0, 1, 0, 1)
    assert told(row.ask(changed(go(0, 0, 1), notes=[(1, [5], None)]))) == [("Decision", 0, 1)]
    assert not row.keeper._holds


def test_the_decision_of_another_keeper_ends_what_is_held() -> None:
    """The attempt was prepared here, over what is held."""
    row = Row()
    row.hold(2, 1, 3, 4)
    row.prepare()
    assert row.keeper._exclusive == {(False, 3): ~2, (True, 3): ~2, (False, 4): 2, (True, 4): 2}
    row.hear(REFUSED)
    assert not row.keeper._exclusive


def test_what_is_held_ends_after_its_ticks() -> None:
    """And is not held again when the same is asked again; under a new number it is."""
    row = Row()
    row.hold(0, 1, 1)
    row.hold(1, 1, 1)
    assert row.ticks(2) == []
    assert told(row.ticks(1)) == [("Held", 1, 1)]
    assert row.hold(0, 1, 1) == []
    assert row.hold(0, 2, 1) == []
    assert told(row.ticks(3)) == [("Held", 0, 2)]
    row.ticks(3)
    assert not row.keeper.busy


def test_a_crash_forgets_what_is_held() -> None:
    """Nothing of it is logged; who asks again is held for again."""
    row = Row()
    row.hold(0, 1, 1)
    row.hold(1, 1, 1)
    assert [*row.journal.records()] == []
    row.crash()
    assert not row.keeper.busy
    assert told(row.hold(1, 1, 1)) == [("Held", 1, 1)]


def test_late_and_doubled_requests_have_no_effect() -> None:
    """Of an earlier number, or of an epoch that is over."""
    row = Row()
    row.hold(0, 2)
    assert row.hold(0, 1, 1) == []
    assert told(row.hold(0, 1, 1, epoch=1)) == [("Held", 0, 1)]
    assert row.hold(0, 3, 2) == [], "of the epoch before"
    assert row.keeper._holds[0].asked.epoch == 1
    row.hold(0, 2, epoch=1)
    row.ask(EnterRequest(1, 1))
    assert row.keeper.refused == 0
    row.ask(changed(go(1, 2, 3), epoch=1))
    assert row.hold(1, 1, 1) == [], "its attempt of a later epoch was seen"
    assert not row.keeper._holds


def test_a_module_enters_where_it_is_held() -> None:
    """By itself or by another: nothing of it is under way."""
    row = Row()
    row.hold(1, 1, 0)
    (entered,) = row.ask(EnterRequest(0, 1))
    assert isinstance(entered, Entered)


def test_what_is_under_way_is_waited_for() -> None:
    """Also by the module whose own attempt that is."""
    for module in (1, 2):
        row = Row()
        row.prepare()
        assert row.hold(module, 1, 4) == []
        assert told(row.hear(REFUSED)) == [("Decision", 2, 1), ("Held", module, 1)]


def test_who_waits_for_a_hold_is_forbidden_when_its_lease_has_expired() -> None:
    """Who holds may come to wait for what that one has locked at a lower keeper."""
    tiles = Dealt(ROW.system, {0: 0, 1: 1, 2: 1, 3: 1, 4: 1, 5: 1})
    keeper = Keeper(1, ROW, tiles, MemoryJournal())
    first = Keeper(0, ROW, tiles, MemoryJournal())
    first.ask(0, go(0, 0, 1))
    (letter,) = letters_of(first)
    assert isinstance(letter.part, Forwarded)
    keeper.ask(1, Hold(1, 0, 1, [1, 2], 100))
    keeper.hear(0, letter.part)
    keeper.ask(2, go(2, 4, 3))
    for _ in range(LEASE_TICKS):
        first.tick()
    (inquiry,) = [each.part for each in letters_of(first)]
    assert isinstance(inquiry, Inquiry)
    keeper.said()
    keeper.hear(0, inquiry)
    assert [each.part for each in letters_of(keeper)] == [Decision(0, 0, 1, reason=ABORTED)]
    check_keeper(keeper)


def test_who_waited_behind_what_is_given_up_waits_no_more() -> None:
    """Given up while it waited itself, or asked for elsewhere."""
    for places in ((), (0,)):
        row = Row()
        row.prepare()
        assert row.hold(0, 1, 2, 3, 4) == []
        assert row.ask(go(1, 2, 1)) == []
        assert ("Decision", 1, 1) in told(row.hold(0, 2, *places))


def test_who_waited_behind_an_attempt_that_is_replaced_waits_no_more() -> None:
    """A module that has entered again attempts something else."""
    row = Row()
    row.prepare()
    row.hold(0, 1, 1)
    assert row.ask(go(1, 2, 1)) == []
    assert row.hold(2, 1, 2) == []
    assert told(row.ask(Attempt(1, 1, 1, 0, 2, notes=[(2, [], [7])]))) == [("Held", 2, 1)]


def test_who_waited_behind_an_attempt_that_is_forbidden_waits_no_more() -> None:
    """It waited for a hold, and its lease has expired."""
    tiles = Dealt(ROW.system, {0: 1, 1: 0, 2: 1, 3: 1, 4: 1, 5: 1})
    keeper = Keeper(1, ROW, tiles, MemoryJournal())
    first = Keeper(0, ROW, tiles, MemoryJournal())
    first.ask(1, changed(go(1, 2, 1), sensed=[(1, None), (2, 2), (3, None)]))
    (letter,) = letters_of(first)
    assert isinstance(letter.part, Forwarded)
    keeper.ask(0, Hold(0, 0, 1, [3], 100))
    keeper.hear(0, letter.part)
    keeper.ask(2, Hold(2, 0, 1, [2], 100))
    assert told([each.part for each in letters_of(keeper)]) == [("Held", 0, 1)]
    keeper.hear(0, Inquiry(1, 0, 1))
    found = [each.part for each in letters_of(keeper)]
    assert sorted(told(found)) == [("Decision", 1, 1), ("Held", 2, 1)]


def test_what_is_no_place_of_the_keeper_is_counted() -> None:
    """Another keeper's, or nobody's; nothing is held."""
    row = Row()
    row.hold(0, 1, 5)
    row.ask(Hold(0, 0, 2, ["nowhere"], 3))
    row.ask(Hold(0, 0, 3, [99], 3))
    assert row.keeper.refused == 3
    assert not row.keeper._holds


def test_more_places_than_anyone_senses_are_not_held() -> None:
    """Whoever could hold them all would stop everybody."""
    row = Row()
    assert row.hold(0, 1, 0, 1, 2, 3) == []
    assert row.keeper.refused == 1
    assert told(row.hold(0, 2, 0, 1, 2)) == [("Held", 0, 2)]
