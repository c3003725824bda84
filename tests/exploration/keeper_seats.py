"""The states that keepers come to: each found once, with each step from it made once.

Two states of a keeper are the same if what is in its memory is, and what a keeper would have that
came back from its journal. Since a keeper comes back record by record, what either does from then
on is the same.
"""

from collections.abc import Iterator
from copy import deepcopy
from dataclasses import dataclass
from typing import Any

from cubepath.agents.keepers.attempts import Share
from cubepath.agents.keepers.journal import Record
from cubepath.agents.keepers.keeper import (
    LEASE_TICKS,
    REMIND_TICKS,
    SETTLE_TICKS,
    Keeper,
    Name,
    _Pending,
    name_of,
)
from cubepath.protocol.core.sites import Site
from cubepath.protocol.wire.free_messages import Settled
from cubepath.protocol.wire.messages import encode
from exploration.keeper_world import Dealt, Letter, Scenario, letters_of


@dataclass(slots=True)
class Seat:
    """A state of a keeper, with what is asked of it in every global state."""

    keeper: Keeper
    waits: tuple[tuple[Name, Name], ...]
    idle: bool
    settles: tuple[int, ...]
    """Keepers to which something is to be acknowledged."""
    says: tuple[int, ...] = ()
    """The numbers of the letters that it says until it is answered."""


@dataclass(frozen=True, slots=True)
class Step:
    state: int
    letters: tuple[int, ...]
    records: tuple[Record, ...]


class Seats:
    """The states of the keepers of a scenario, and what they say."""

    def __init__(self, scenario: Scenario, tiles: Dealt, kind: type[Keeper]) -> None:
        """Begin with none."""
        self.all: list[Seat] = []
        self.steps: dict[tuple[int, object], Step] = {}
        self.letters: list[Letter] = []
        self._scenario = scenario
        self._tiles = tiles
        self._kind = kind
        self._numbers: dict[object, int] = {}
        self._letter_numbers: dict[tuple[int, int, bytes], int] = {}

    def of(self, keeper: Keeper) -> int:
        """Return the number of a keeper's state."""
        for pending in _attempts(keeper):
            pending.age, pending.due = 0, LEASE_TICKS
        for unsettled in keeper._unsettled.values():
            unsettled.age = 0
        keeper._owed_age, keeper.refused = 0, 0
        keeper._leases = {}
        keeper._owed = {
            other: [Settled(*each) for each in sorted({*map(name_of, owed)})]
            for other, owed in sorted(keeper._owed.items())
        }
        key: object = _memory(keeper)
        if self._scenario.faults.keeper:
            key = key, _memory(self._back(keeper))  # a crash may come
        number = self._numbers.setdefault((keeper.me, key), len(self.all))
        if number == len(self.all):
            seat = Seat(keeper, tuple(_waits(keeper)), not keeper.busy, tuple(keeper._owed))
            self.all.append(seat)
            check_keeper(keeper)
            if self._scenario.faults.keeper:
                self._check_compacted(keeper)
            seat.says = tuple(sorted(self._said_again(keeper)))
        return number

    def _said_again(self, keeper: Keeper) -> set[int]:
        """Return what a keeper says when its time has come, as it says it."""
        copy = self._copied(keeper)
        copy._owed = {}
        for pending in copy._prepared.values():
            pending.age = LEASE_TICKS
        for unsettled in copy._unsettled.values():
            unsettled.age = REMIND_TICKS - 1
        copy.tick()
        return {*map(self.letter, letters_of(copy))}

    def _back(self, keeper: Keeper) -> Keeper:
        """Return a keeper that has come back from the journal of another."""
        return self._kind(keeper.me, self._scenario.scene, self._tiles, deepcopy(keeper._journal))

    def _check_compacted(self, keeper: Keeper) -> None:
        """Check that a keeper comes back from a compacted journal as from the whole."""
        back, copy = self._back(keeper), self._back(keeper)
        copy._journal.compact(copy._compacted(copy.commits))
        assert _memory(self._back(copy)) == _memory(back), "compacted, it says something else"

    def _copied(self, keeper: Keeper) -> Keeper:
        fixed = (keeper._system, keeper._tiles, self._scenario.scene)
        memo: dict[int, Any] = {id(each): each for each in fixed}
        for pending in _attempts(keeper):
            memo[id(pending.plan)] = pending.plan
            memo[id(pending.passed)] = pending.passed
        for unsettled in keeper._unsettled.values():
            memo[id(unsettled.decision)] = unsettled.decision
        return deepcopy(keeper, memo)

    def step(self, state: int, what: tuple[str, Any]) -> Step:
        """Return what a keeper does in a state."""
        found = self.steps.get((state, what))
        if found is None:
            found = self.steps[state, what] = self._made(state, *what)
        return found

    def _made(self, state: int, kind: str, about: Any) -> Step:
        old = self.all[state].keeper
        before = len(old._journal.all)  # type: ignore[attr-defined]
        keeper = self._back(old) if kind == "crash" else self._copied(old)
        match kind:
            case "letter":
                letter = self.letters[about]
                if letter.sender < 0:
                    keeper.ask(-letter.sender - 1, letter.part)
                else:
                    keeper.hear(letter.sender, letter.part)
            case "settle":
                keeper._owed_age = SETTLE_TICKS
                rest = {other: owed for other, owed in keeper._owed.items() if other != about}
                keeper._owed = {about: keeper._owed[about]}
                keeper.tick()
                keeper._owed = rest
            case _:
                assert kind == "crash"
        records = keeper._journal.all[before:]  # type: ignore[attr-defined]
        letters = tuple(map(self.letter, letters_of(keeper)))
        state = self.of(keeper)
        again = self.all[state].says
        letters = tuple(each for each in letters if each not in again)
        return Step(state, letters, records)

    def letter(self, letter: Letter) -> int:
        key = (letter.sender, letter.to, type(letter.part).__name__.encode() + encode(letter.part))
        number = self._letter_numbers.setdefault(key, len(self.letters))
        if number == len(self.letters):
            self.letters.append(letter)
        return number


def _memory(keeper: Keeper) -> object:
    """Return all of a keeper's memory on which anything depends that it will do."""
    units = keeper.units
    return (
        encode(
            (
                [(str(unit), known) for unit, known in sorted(vars_of(units.units))],
                [(str(place), held) for place, held in sorted(units._occupants.items())],
                sorted(units._places.items()),
                sorted(units.serials.items()),
                keeper.commits,
                [
                    (module, last.epoch, last.number, last.decision)
                    for module, last in sorted(keeper._last.items())
                ],
                [keeper._prepared[module].passed for module in sorted(keeper._prepared)],
                [each.passed for each in keeper._waiting.values()],
                [
                    (name, each.decision, sorted(each.owing))
                    for name, each in sorted(keeper._unsettled.items())
                ],
                sorted((key, *each) for key, each in keeper._owed.items()),
            )
        ),
    )


def vars_of(units: dict[Site, Any]) -> Iterator[tuple[Site, tuple[int, ...]]]:
    """Yield units with what is known of them, but for those that are as at the start."""
    for unit, known in units.items():
        values = known.version, known.level, known.reads, known.read_level
        if any(values):
            yield unit, values


def _attempts(keeper: Keeper) -> Iterator[_Pending]:
    """Yield the attempts that are prepared or wait."""
    yield from keeper._prepared.values()
    yield from keeper._waiting.values()


def _share(keeper: Keeper, each: _Pending) -> Share:
    return each.plan.shares[keeper.me]


def _name(each: _Pending) -> Name:
    return name_of(each.passed.attempt)


def _waits(keeper: Keeper) -> Iterator[tuple[Name, Name]]:
    """Yield who waits at a keeper for whom, by the definition of a conflict."""
    before = [*keeper._prepared.values()]
    for waiting in keeper._waiting.values():
        mine, share = _name(waiting)[0], _share(keeper, waiting)
        for other in before:
            if _name(other)[0] == mine or share.conflicts(_share(keeper, other)):
                yield _name(waiting), _name(other)
        before.append(waiting)


def check_keeper(keeper: Keeper) -> None:
    """Check that locks are those of what is prepared, and that nobody waits for nothing."""
    exclusive: dict[object, int] = {}
    shared: dict[object, set[int]] = {}
    for module, pending in keeper._prepared.items():
        share = _share(keeper, pending)
        for lock in share.exclusive:
            assert lock not in exclusive, "two hold what only one may hold"
            exclusive[lock] = module
        for lock in share.shared:
            shared.setdefault(lock, set()).add(module)
    assert not exclusive.keys() & shared.keys(), "held exclusively, and shared"
    assert exclusive == keeper._exclusive, "other locks than of what is prepared"
    assert shared == {lock: {*held} for lock, held in keeper._shared.items()}, "other locks"
    for_something = {one for one, _ in _waits(keeper)}
    assert for_something == {*map(_name, keeper._waiting.values())}, "somebody waits for nothing"
    assert keeper.busy or not keeper._waiting, "waits, and nothing is under way"
    assert all(each.owing for each in keeper._unsettled.values()), "nobody owes anything"


def check_no_circle(edges: set[tuple[Name, Name]]) -> None:
    """Check that who waits for whom has no circle."""
    while edges:
        waited_for = {later for _, later in edges}
        left = {(one, other) for one, other in edges if one in waited_for}
        assert left != edges, f"they wait in a circle: {sorted(edges)}"
        edges = left
