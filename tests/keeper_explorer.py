"""Every way in which a few keepers and modules can go on, with messages in any order and faults.

The keepers are the real machines; each step of one from a state of its own is made once and
remembered. A module is abstract: it attempts any of the moves that it is given, says the same again
at any time, and enters again after a crash without memory. Messages under way are a set, each part
of one by itself, delivered in any order. A keeper may take note at any moment that the time of any
one thing has come: a lease, a reminder, an acknowledgement.

What makes it smaller:

- What is said again until it is answered (an attempt, an entry, an inquiry, an unsettled commit)
  arrives when it is said, at any moment while its sender has a reason to say it, and so does what a
  keeper says again because of it, without a change. That one of these arrives when there is no
  reason any more is a fault: the same as a double.
- A message that its receiver ignores, and would ignore in every state that it can come to, is taken
  out at once. That it would is assumed at first, and tried afterwards in all states of the keeper
  that were reached from there. Where it does not hold, all is explored again without it.

Two states of a keeper are the same if what is in its memory is, and what a keeper would have that
came back from its journal. Since a keeper comes back record by record, what either does from then
on is the same.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from copy import deepcopy
from dataclasses import dataclass, field
from functools import lru_cache, partial
from itertools import combinations
from typing import Any, NamedTuple, TypeAlias

from components import bottoms
from cubepath.agents.keepers.journal import Committed, Record
from cubepath.agents.keepers.keeper import (
    LEASE_TICKS,
    REMIND_TICKS,
    SETTLE_TICKS,
    Keeper,
    Name,
    name_of,
)
from cubepath.protocol.core.sites import Site, site_from_json
from cubepath.protocol.core.system import Scene, System
from cubepath.protocol.wire.free_messages import (
    Attempt,
    Decision,
    Enter,
    Entered,
    Inquiry,
    Moved,
    Passed,
    Passes,
    Settled,
    Tells,
)
from cubepath.protocol.wire.messages import encode
from cubepath.protocol.wire.tiles import Tiles
from keeper_history import History

Part: TypeAlias = Attempt | Enter | Passed | Decision | Inquiry | Settled | Entered


class Letter(NamedTuple):
    """A part of a message under way; modules are numbered from -1 down."""

    sender: int
    to: int
    part: Part


class Dealt(Tiles):
    """Every place is a tile of its own, and these keepers have them."""

    def __init__(self, system: System, keeper_of: dict[Site, int]) -> None:
        """Deal the places so."""
        super().__init__(system, max(keeper_of.values()) + 1)
        self.tile_of = lru_cache(str)
        self._dealt = {str(place): keeper for place, keeper in keeper_of.items()}

    def keeper_of_tile(self, tile: str) -> int:
        """Return the number of the keeper that has a tile."""
        return self._dealt[tile]


class Log:
    """A journal whose records are never changed, so that copies of a keeper share them."""

    def __init__(self, records: tuple[Record, ...] = ()) -> None:
        """Begin with these."""
        self.all = records

    def __deepcopy__(self, memo: dict[int, Any]) -> Log:
        """Return another log with the same records."""
        return Log(self.all)

    def append(self, record: Record) -> None:
        """Add a record."""
        self.all = (*self.all, record)

    def records(self) -> Iterator[Record]:
        """Yield all records, in their order."""
        return iter(self.all)

    def commit(self, serial: int) -> Moved:
        """Return the commit of this serial number, from 1."""
        found = [each.decision.moved for each in self.all if isinstance(each, Committed)]
        moved = found[serial - 1]
        assert moved is not None
        return moved


class Module(NamedTuple):
    """What a module knows; in no phase but its own does it say anything."""

    phase: str
    """entering, idle, pending, or dead."""
    birth: int
    epoch: int
    number: int
    site: Site
    left: int
    """How many attempts it may still begin."""
    says: tuple[int, ...] = ()
    """The numbers of the letters that it says until it is answered."""


class Faults(NamedTuple):
    """How many of each may still happen."""

    double: int = 0
    loss: int = 0
    module: int = 0
    """Crashes of modules, which come back without memory, or do not."""
    keeper: int = 0
    """Crashes of keepers, which come back from their journals."""


class World(NamedTuple):
    """A global state; keepers, histories and letters by number."""

    keepers: tuple[int, ...]
    modules: tuple[Module, ...]
    under_way: frozenset[int]
    history: int
    faults: Faults


@dataclass(frozen=True, slots=True)
class Scenario:
    """Who is where, who may attempt what, and what may go wrong."""

    scene: Scene
    keeper_of: dict[Site, int]
    targets: Callable[[int, Site], Iterable[tuple[Site, tuple[tuple[Site, Site | None], ...]]]]
    """By module and site, where it may attempt to go, with its guards."""
    attempts: int = 1
    faults: Faults = Faults()  # noqa: RUF009 - a tuple
    enters: bool = False
    """Whether modules begin outside."""


@dataclass(slots=True)
class _Seat:
    """A state of a keeper, with what is asked of it in every global state."""

    keeper: Keeper
    waits: tuple[tuple[Name, Name], ...]
    idle: bool
    settles: tuple[int, ...]
    """Keepers to which something is to be acknowledged."""
    says: tuple[int, ...] = ()
    """The numbers of the letters that it says until it is answered."""


@dataclass(frozen=True, slots=True)
class _Step:
    state: int
    letters: tuple[int, ...]
    records: tuple[Record, ...]


@dataclass(slots=True)
class Explored:
    """How much was explored."""

    states: int = 0
    transitions: int = 0
    keeper_states: int = 0
    committed: set[frozenset[Name]] = field(default_factory=set)
    """What was committed in the ends."""
    ends: int = 0
    """States from which one never comes away."""


class Broken(AssertionError):  # noqa: N818 - what is broken is told by the message
    """Something does not hold; the message tells how it came to that."""


class Explorer:
    """Explores a scenario; keepers of another class are tried to see that faults are found."""

    def __init__(self, scenario: Scenario, kind: type[Keeper] = Keeper) -> None:
        """Begin with the keepers' first states."""
        self._scenario = scenario
        self._kind = kind
        self._tiles = Dealt(scenario.scene.system, scenario.keeper_of)
        self._seats: list[_Seat] = []
        self._numbers: dict[object, int] = {}
        self._steps: dict[tuple[int, object], _Step] = {}
        self._letters: list[Letter] = []
        self._letter_numbers: dict[tuple[int, int, bytes], int] = {}
        self._histories: list[History] = []
        self._history_numbers: dict[History, int] = {}
        self._said_again_in: dict[object, tuple[int, ...]] = {}
        self._checked: set[tuple[int, ...]] = set()
        self._checked_keepers: set[tuple[int, int]] = set()
        self._guessed: dict[int, set[int]] = {}
        """By letter the states of its receiver in which it was ignored."""
        self._not_ignored: set[tuple[int, int]] = set()
        """Letters with states in which they make no difference, and may later."""

    # The graph.

    def explore(self, most: int = 10_000_000) -> Explored:
        """Go through all states; Broken if something does not hold in one."""
        while True:
            self._guessed = {}
            found = self._explored(most)
            wrong = self._wrong_guesses()
            if not wrong:
                return found
            self._not_ignored |= wrong

    def _explored(self, most: int) -> Explored:
        start = self._start()
        numbers: dict[World, int] = {start: 0}
        worlds = [start]
        came_from: list[tuple[int, str]] = [(-1, "start")]
        following: list[list[int]] = []
        found = Explored()
        at, last = 0, "start"
        try:
            while at < len(worlds):
                world, after = worlds[at], []
                self._check(world)
                for name, make in self._moves(world):
                    last = name
                    other = self._without_ignored(make())
                    number = numbers.setdefault(other, len(worlds))
                    if number == len(worlds):
                        worlds.append(other)
                        came_from.append((at, name))
                        assert number < most, f"more than {most} states"
                    after.append(number)
                following.append(after)
                found.transitions += len(after)
                at += 1
            last = "ends so"
            for bottom in bottoms(following):
                at = bottom[0]
                found.ends += len(bottom)
                for number in bottom:
                    at = number
                    self._check_end(worlds[number])
                found.committed.add(self._histories[worlds[bottom[0]].history].committed)
        except AssertionError as error:
            raise Broken(f"{error}\nafter\n{_way(came_from, at)}\n{last}") from error
        found.states, found.keeper_states = len(worlds), len(self._seats)
        return found

    def _start(self) -> World:
        scenario = self._scenario
        system, start = scenario.scene.system, scenario.scene.start
        keepers = tuple(
            self._seat(self._kind(number, scenario.scene, self._tiles, Log()))
            for number in range(self._tiles.keepers)
        )
        modules = tuple(Module("idle", 0, 0, 0, site, scenario.attempts) for site in start)
        world = World(
            keepers,
            modules,
            frozenset(),
            self._history(History.at(system, start)),
            scenario.faults,
        )
        if scenario.enters:
            for module in range(len(start)):
                world = self._born(world, module)
        return world

    # States of keepers.

    def _seat(self, keeper: Keeper) -> int:
        """Return the number of a keeper's state."""
        for pending in (*keeper._prepared.values(), *keeper._waiting.values()):
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
        number = self._numbers.setdefault((keeper.me, key), len(self._seats))
        if number == len(self._seats):
            seat = _Seat(keeper, tuple(_waits(keeper)), not keeper.busy, tuple(keeper._owed))
            self._seats.append(seat)
            _check_keeper(keeper)
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
        return {*map(self._letter, _letters(copy))}

    def _back(self, keeper: Keeper) -> Keeper:
        """Return a keeper that has come back from the journal of another."""
        return self._kind(keeper.me, self._scenario.scene, self._tiles, deepcopy(keeper._journal))

    def _copied(self, keeper: Keeper) -> Keeper:
        fixed = (keeper._system, keeper._tiles, self._scenario.scene)
        memo: dict[int, Any] = {id(each): each for each in fixed}
        for pending in (*keeper._prepared.values(), *keeper._waiting.values()):
            memo[id(pending.plan)] = pending.plan
            memo[id(pending.passed)] = pending.passed
        for unsettled in keeper._unsettled.values():
            memo[id(unsettled.decision)] = unsettled.decision
        return deepcopy(keeper, memo)

    def _step(self, state: int, what: tuple[str, Any]) -> _Step:
        """Return what a keeper does in a state."""
        found = self._steps.get((state, what))
        if found is None:
            found = self._steps[state, what] = self._made(state, *what)
        return found

    def _made(self, state: int, kind: str, about: Any) -> _Step:
        old = self._seats[state].keeper
        before = len(old._journal.all)  # type: ignore[attr-defined]
        keeper = self._back(old) if kind == "crash" else self._copied(old)
        match kind:
            case "letter":
                letter = self._letters[about]
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
        letters = tuple(map(self._letter, _letters(keeper)))
        state = self._seat(keeper)
        again = self._seats[state].says
        letters = tuple(each for each in letters if each not in again)
        return _Step(state, letters, records)

    def _letter(self, letter: Letter) -> int:
        key = (letter.sender, letter.to, type(letter.part).__name__.encode() + encode(letter.part))
        number = self._letter_numbers.setdefault(key, len(self._letters))
        if number == len(self._letters):
            self._letters.append(letter)
        return number

    def _history(self, history: History) -> int:
        number = self._history_numbers.setdefault(history, len(self._histories))
        if number == len(self._histories):
            self._histories.append(history)
        return number

    # What can happen.

    def _moves(  # noqa: C901 - a list of what can happen
        self, world: World
    ) -> Iterator[tuple[str, Callable[[], World]]]:
        """Yield what can happen, each in words and as a function to what comes of it."""
        faults = world.faults
        for number in sorted(world.under_way):
            told = f"{_words(self._letters[number])}"
            rest = world._replace(under_way=world.under_way - {number})
            yield told, partial(self._delivered, rest, number)
            if faults.double:
                kept = world._replace(faults=faults._replace(double=faults.double - 1))
                yield f"double of {told}", partial(self._delivered, kept, number)
            if faults.loss:
                lost = rest._replace(faults=faults._replace(loss=faults.loss - 1))
                yield f"lost: {told}", partial(_unchanged, lost)
        for number in self._available(world):
            told = f"said again, {_words(self._letters[number])}"
            if self._changes(world, number) and number not in world.under_way:
                yield told, partial(self._delivered, world, number)
            if faults.double and number not in world.under_way:
                late = world._replace(
                    under_way=world.under_way | {number},
                    faults=faults._replace(double=faults.double - 1),
                )
                yield f"will come late: {told}", partial(_unchanged, late)
        for keeper, state in enumerate(world.keepers):
            for other in self._seats[state].settles:
                yield (
                    f"keeper {keeper} acknowledges to {other}",
                    partial(self._kept, world, keeper, ("settle", other)),
                )
            if faults.keeper:
                yield from self._keeper_crashes(world, keeper)
        for module in range(len(world.modules)):
            yield from self._of_module(world, module)

    def _available(self, world: World) -> tuple[int, ...]:
        """Return what may be said again in a state, and arrive."""
        key = world.keepers, tuple(module.says for module in world.modules)
        found = self._said_again_in.get(key)
        if found is None:
            says = [
                *(self._seats[state].says for state in world.keepers),
                *(module.says for module in world.modules),
            ]
            reached = dict.fromkeys(number for numbers in says for number in numbers)
            left = list(reached)
            while left:
                number = left.pop()
                to = self._letters[number].to
                if to >= 0:
                    step = self._step(world.keepers[to], ("letter", number))
                    if step.state == world.keepers[to] and not step.records:
                        new = [each for each in step.letters if each not in reached]
                        reached.update(dict.fromkeys(new))
                        left += new
            found = self._said_again_in[key] = tuple(sorted(reached))
        return found

    def _changes(self, world: World, number: int) -> bool:
        """Return whether anyone's state changes when a letter arrives."""
        letter = self._letters[number]
        if letter.to < 0:
            if isinstance(letter.part, Decision):
                self._histories[world.history].check_told(letter.part)
            return _is_heard(world.modules[-letter.to - 1], letter.part)
        step = self._step(world.keepers[letter.to], ("letter", number))
        return step.state != world.keepers[letter.to] or bool(step.records)

    def _keeper_crashes(
        self, world: World, keeper: int
    ) -> Iterator[tuple[str, Callable[[], World]]]:
        """Yield crashes, each with other messages of the keeper lost that were under way."""
        faults = world.faults._replace(keeper=world.faults.keeper - 1)
        said = [each for each in world.under_way if self._letters[each].sender == keeper]
        for count in range(len(said) + 1):
            for lost in combinations(sorted(said), count):
                rest = world._replace(faults=faults, under_way=world.under_way - {*lost})
                yield (
                    f"keeper {keeper} crashes, {count} messages of it are lost",
                    partial(self._kept, rest, keeper, ("crash", 0)),
                )

    def _of_module(self, world: World, number: int) -> Iterator[tuple[str, Callable[[], World]]]:
        module = world.modules[number]
        faults = world.faults
        if module.phase == "idle" and module.left:
            for attempt in self._attempts(number, module):
                yield (
                    f"module {number} begins {attempt.sensed}",
                    partial(self._begun, world, number, attempt),
                )
        if faults.module and module.phase != "dead":
            rest = world._replace(faults=faults._replace(module=faults.module - 1))
            yield f"module {number} crashes", partial(self._born, rest, number)
            dead = module._replace(phase="dead", says=())
            yield f"module {number} dies", partial(_with, rest, number, dead)

    def _attempts(self, number: int, module: Module) -> Iterator[Attempt]:
        system = self._scenario.scene.system
        for target, guards in self._scenario.targets(number, module.site):
            (move,) = [
                each
                for each in system.moves(module.site)
                if each is not None and each.target == target
            ]
            sensed = {module.site: module.site, target: None, **dict(guards)}
            yield Attempt(
                number,
                module.epoch,
                module.number + 1,
                0,
                module.site,
                move.generator,
                move.at,
                sorted(sensed.items()),
            )

    def _begun(self, world: World, number: int, attempt: Attempt) -> World:
        module = world.modules[number]
        places = [site_from_json(unit) for unit, _ in attempt.sensed]
        first = min(self._tiles.keeper_of(place) for place in places)
        letter = self._letter(Letter(-number - 1, first, attempt))
        return _with(
            world,
            number,
            module._replace(
                phase="pending", says=(letter,), left=module.left - 1, number=attempt.number
            ),
        )

    def _born(self, world: World, number: int) -> World:
        """Let a module enter; of before it remembers nothing but that this is a later birth."""
        module = world.modules[number]
        birth = module.birth + 1
        letters = tuple(
            self._letter(Letter(-number - 1, keeper, Enter(number, birth)))
            for keeper in range(self._tiles.keepers)
        )
        start = self._scenario.scene.start[number]
        return _with(world, number, Module("entering", birth, 0, 0, start, module.left, letters))

    def _delivered(self, world: World, number: int) -> World:
        letter = self._letters[number]
        if letter.to >= 0:
            return self._kept(world, letter.to, ("letter", number))
        return self._heard(world, -letter.to - 1, letter.part)

    def _kept(self, world: World, keeper: int, what: tuple[str, Any]) -> World:
        """Return the state in which a keeper has done something."""
        step = self._step(world.keepers[keeper], what)
        history = world.history
        if step.records:
            history = self._logged(history, step.records)
        for number in step.letters:
            part = self._letters[number].part
            if self._letters[number].to < 0 and isinstance(part, Decision):
                self._histories[history].check_told(part)
        after = world._replace(
            keepers=(*world.keepers[:keeper], step.state, *world.keepers[keeper + 1 :]),
            history=history,
        )
        letters = step.letters
        if step.state == world.keepers[keeper] and not step.records:
            available = self._available(after)
            letters = tuple(number for number in letters if number not in available)
        return after._replace(under_way=world.under_way.union(letters)) if letters else after

    def _logged(self, history: int, records: tuple[Record, ...]) -> int:
        found = self._histories[history]
        for record in records:
            found = found.after(record)
        return self._history(found)

    def _without_ignored(self, world: World) -> World:
        """Return a state without the messages under way that their receivers ignore."""
        ignored = {number for number in world.under_way if self._is_ignored(world, number)}
        return world._replace(under_way=world.under_way - ignored) if ignored else world

    def _is_ignored(self, world: World, number: int) -> bool:
        letter = self._letters[number]
        if letter.to < 0:
            return not _is_heard(world.modules[-letter.to - 1], letter.part)
        state = world.keepers[letter.to]
        if (number, state) in self._not_ignored:
            return False
        if not self._has_effect(state, number):
            self._guessed.setdefault(number, set()).add(state)
            return True
        return False

    def _has_effect(self, state: int, number: int) -> bool:
        step = self._step(state, ("letter", number))
        return bool(step.state != state or step.letters or step.records)

    def _wrong_guesses(self) -> set[tuple[int, int]]:
        """Return the letters that were ignored in a state, but not in one that came after it."""
        later: dict[int, set[int]] = {}
        for (state, _), step in self._steps.items():
            later.setdefault(state, set()).add(step.state)
        return {
            (number, state)
            for number, states in self._guessed.items()
            for state in states
            if self._may_have_effect(state, number, later)
        }

    def _may_have_effect(self, state: int, number: int, later: dict[int, set[int]]) -> bool:
        seen, left = {state}, [state]
        while left:
            state = left.pop()
            if self._has_effect(state, number):
                return True
            new = later.get(state, set()) - seen
            seen |= new
            left += new
        return False

    def _heard(self, world: World, number: int, part: Part) -> World:
        """Let a module take what it is told; that is to be what was logged."""
        module = world.modules[number]
        history = self._histories[world.history]
        if isinstance(part, Decision):
            history.check_told(part)
            if not _is_heard(module, part):
                return world
            site = module.site
            if part.moved is not None:
                (site,) = [
                    site_from_json(to) for who, _, to, _ in part.moved.motion if who == number
                ]
            return _with(world, number, module._replace(phase="idle", site=site, says=()))
        assert isinstance(part, Entered)
        if not _is_heard(module, part):
            return world
        assert part.occupant.epoch == history.epochs[number], "entered in an epoch that is over"
        new = Module(
            "idle",
            module.birth,
            part.occupant.epoch,
            part.occupant.number,
            site_from_json(part.site),
            module.left,
        )
        assert new.site == history.sites[number], "entered where the module is not"
        return _with(world, number, new)

    # What must hold.

    def _check(self, world: World) -> None:
        """Check what is to hold in every state."""
        for state in world.keepers:
            if (state, world.history) not in self._checked_keepers:
                self._checked_keepers.add((state, world.history))
                self._histories[world.history].check_keeper(self._seats[state].keeper)
        if world.keepers in self._checked:
            return
        self._checked.add(world.keepers)
        seats = [self._seats[state] for state in world.keepers]
        edges = {edge for seat in seats for edge in seat.waits}
        if edges:
            _check_no_circle(edges)
            for at, seat in enumerate(seats):
                waiting = {name_of(each.passed.attempt) for each in seat.keeper._waiting.values()}
                for other in seats[at:]:
                    held = {
                        name_of(each.passed.attempt) for each in other.keeper._prepared.values()
                    }
                    assert not waiting & held, "waits where it holds something as high, or higher"

    def _check_end(self, world: World) -> None:
        """Check what is to hold where one never comes away from."""
        for number, module in enumerate(world.modules):
            assert module.phase in ("idle", "dead"), f"module {number} stays {module.phase}"
            able = module.left and [*self._scenario.targets(number, module.site)]
            assert module.phase == "dead" or not able, f"module {number} cannot go on"
        history = self._histories[world.history]
        for at, state in enumerate(world.keepers):
            keeper = self._seats[state].keeper
            assert self._seats[state].idle, f"something stays due at keeper {at}"
            assert not keeper._waiting, f"something waits for good at keeper {at}"
            assert not keeper._exclusive, f"something stays locked at keeper {at}"
            assert not keeper._shared, f"something stays locked at keeper {at}"
        history.check_all([self._seats[state].keeper for state in world.keepers])


def _is_heard(module: Module, part: Part) -> bool:
    """Return whether a module takes note of what it is told; if not now, then never."""
    if isinstance(part, Decision):
        mine = module.epoch, module.number
        return module.phase == "pending" and (part.epoch, part.number) == mine
    assert isinstance(part, Entered)
    return module.phase == "entering" and part.birth == module.birth


def _letters(keeper: Keeper) -> Iterator[Letter]:
    """Yield what a keeper has to say to others that are explored."""
    for message in keeper.said():
        if isinstance(message, Passes):
            for part in message.parts:
                yield Letter(keeper.me, message.to, part)
        elif isinstance(message, Tells):
            for told in message.parts:
                yield Letter(keeper.me, -message.process - 1, told)


def _unchanged(world: World) -> World:
    return world


def _with(world: World, number: int, module: Module) -> World:
    modules = (*world.modules[:number], module, *world.modules[number + 1 :])
    return world._replace(modules=modules)


def _words(letter: Letter) -> str:
    def who(number: int) -> str:
        return f"keeper {number}" if number >= 0 else f"module {-number - 1}"

    part = letter.part
    about = (
        ()
        if isinstance(part, Entered | Enter)
        else name_of(part.attempt if isinstance(part, Passed) else part)
    )
    if isinstance(part, Decision):
        about = (*about, part.why or "committed")
    return f"{who(letter.sender)} to {who(letter.to)}: {type(part).__name__} {about}"


def _way(came_from: Sequence[tuple[int, str]], at: int) -> str:
    names = []
    while at >= 0:
        at, name = came_from[at]
        names.append(name)
    return "\n".join(reversed(names))


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


def _waits(keeper: Keeper) -> Iterator[tuple[Name, Name]]:
    """Yield which attempt waits at a keeper for which others, by the definition of a conflict."""
    earlier = [*keeper._prepared.values()]
    for waiting in keeper._waiting.values():
        share = waiting.plan.shares[keeper.me]
        for other in earlier:
            same = other.passed.attempt.module == waiting.passed.attempt.module
            if same or share.conflicts(other.plan.shares[keeper.me]):
                yield name_of(waiting.passed.attempt), name_of(other.passed.attempt)
        earlier.append(waiting)


def _check_keeper(keeper: Keeper) -> None:
    """Check that locks are those of what is prepared, and that nobody waits for nothing."""
    exclusive: dict[object, int] = {}
    shared: dict[object, set[int]] = {}
    for module, pending in keeper._prepared.items():
        share = pending.plan.shares[keeper.me]
        for lock in share.exclusive:
            assert lock not in exclusive, "two hold what only one may hold"
            exclusive[lock] = module
        for lock in share.shared:
            shared.setdefault(lock, set()).add(module)
    assert not exclusive.keys() & shared.keys(), "held exclusively, and shared"
    assert exclusive == keeper._exclusive, "other locks than of what is prepared"
    assert shared == {lock: {*held} for lock, held in keeper._shared.items()}, "other locks"
    assert keeper._prepared or not keeper._waiting, "waits, and nothing is under way"
    assert all(each.owing for each in keeper._unsettled.values()), "nobody owes anything"


def _check_no_circle(edges: set[tuple[Name, Name]]) -> None:
    """Check that who waits for whom has no circle."""
    while edges:
        waited_for = {later for _, later in edges}
        left = {(one, other) for one, other in edges if one in waited_for}
        assert left != edges, f"they wait in a circle: {sorted(edges)}"
        edges = left
