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
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import partial
from itertools import combinations
from typing import Any

from cubepath.agents.keepers.journal import Record
from cubepath.agents.keepers.keeper import Keeper, Name, name_of
from cubepath.protocol.wire.free_messages import Decision
from exploration.keeper_history import History
from exploration.keeper_modules import Modules, is_heard
from exploration.keeper_seats import Seats, check_no_circle
from exploration.keeper_world import Dealt, Log, Scenario, World, unchanged, words_of
from oracles.components import bottoms


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
        self._seats = Seats(scenario, self._tiles, kind)
        self._modules = Modules(scenario, self._tiles, self._seats.letter)
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
        found.states, found.keeper_states = len(worlds), len(self._seats.all)
        return found

    def _start(self) -> World:
        scenario = self._scenario
        system, start = scenario.scene.system, scenario.scene.start
        keepers = tuple(
            self._seats.of(self._kind(number, scenario.scene, self._tiles, Log()))
            for number in range(self._tiles.keepers)
        )
        modules = tuple(map(self._modules.first, range(len(start))))
        world = World(
            keepers, modules, frozenset(), self._history(History.at(system, start)), scenario.faults
        )
        if scenario.enters:
            for module in range(len(start)):
                world = self._modules.born(world, module)
        return world

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
            told = f"{words_of(self._seats.letters[number])}"
            rest = world._replace(under_way=world.under_way - {number})
            yield told, partial(self._delivered, rest, number)
            if faults.double:
                kept = world._replace(faults=faults._replace(double=faults.double - 1))
                yield f"double of {told}", partial(self._delivered, kept, number)
            if faults.loss:
                lost = rest._replace(faults=faults._replace(loss=faults.loss - 1))
                yield f"lost: {told}", partial(unchanged, lost)
        for number in self._available(world):
            told = f"said again, {words_of(self._seats.letters[number])}"
            if self._changes(world, number) and number not in world.under_way:
                yield told, partial(self._delivered, world, number)
            if faults.double and number not in world.under_way:
                late = world._replace(
                    under_way=world.under_way | {number},
                    faults=faults._replace(double=faults.double - 1),
                )
                yield f"will come late: {told}", partial(unchanged, late)
        for keeper, state in enumerate(world.keepers):
            for other in self._seats.all[state].settles:
                yield (
                    f"keeper {keeper} acknowledges to {other}",
                    partial(self._kept, world, keeper, ("settle", other)),
                )
            if faults.keeper:
                yield from self._keeper_crashes(world, keeper)
        for module in range(len(world.modules)):
            yield from self._modules.may(world, module)

    def _available(self, world: World) -> tuple[int, ...]:
        """Return what may be said again in a state, and arrive."""
        key = world.keepers, tuple(module.says for module in world.modules)
        found = self._said_again_in.get(key)
        if found is None:
            says = [
                *(self._seats.all[state].says for state in world.keepers),
                *(module.says for module in world.modules),
            ]
            reached = dict.fromkeys(number for numbers in says for number in numbers)
            left = list(reached)
            while left:
                number = left.pop()
                to = self._seats.letters[number].to
                if to >= 0:
                    step = self._seats.step(world.keepers[to], ("letter", number))
                    if step.state == world.keepers[to] and not step.records:
                        new = [each for each in step.letters if each not in reached]
                        reached.update(dict.fromkeys(new))
                        left += new
            found = self._said_again_in[key] = tuple(sorted(reached))
        return found

    def _changes(self, world: World, number: int) -> bool:
        """Return whether anyone's state changes when a letter arrives."""
        letter = self._seats.letters[number]
        if letter.to < 0:
            if isinstance(letter.part, Decision):
                self._histories[world.history].check_told(letter.part)
            return is_heard(world.modules[-letter.to - 1], letter.part)
        step = self._seats.step(world.keepers[letter.to], ("letter", number))
        return step.state != world.keepers[letter.to] or bool(step.records)

    def _keeper_crashes(
        self, world: World, keeper: int
    ) -> Iterator[tuple[str, Callable[[], World]]]:
        """Yield crashes, each with other messages of the keeper lost that were under way."""
        faults = world.faults._replace(keeper=world.faults.keeper - 1)
        said = [each for each in world.under_way if self._seats.letters[each].sender == keeper]
        for count in range(len(said) + 1):
            for lost in combinations(sorted(said), count):
                rest = world._replace(faults=faults, under_way=world.under_way - {*lost})
                yield (
                    f"keeper {keeper} crashes, {count} messages of it are lost",
                    partial(self._kept, rest, keeper, ("crash", 0)),
                )

    def _delivered(self, world: World, number: int) -> World:
        letter = self._seats.letters[number]
        if letter.to >= 0:
            return self._kept(world, letter.to, ("letter", number))
        history = self._histories[world.history]
        return self._modules.heard(world, history, -letter.to - 1, letter.part)

    def _kept(self, world: World, keeper: int, what: tuple[str, Any]) -> World:
        """Return the state in which a keeper has done something."""
        step = self._seats.step(world.keepers[keeper], what)
        history = world.history
        if step.records:
            history = self._logged(history, step.records)
        for number in step.letters:
            part = self._seats.letters[number].part
            if self._seats.letters[number].to < 0 and isinstance(part, Decision):
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
        letter = self._seats.letters[number]
        if letter.to < 0:
            return not is_heard(world.modules[-letter.to - 1], letter.part)
        state = world.keepers[letter.to]
        if (number, state) in self._not_ignored:
            return False
        if not self._has_effect(state, number):
            self._guessed.setdefault(number, set()).add(state)
            return True
        return False

    def _has_effect(self, state: int, number: int) -> bool:
        step = self._seats.step(state, ("letter", number))
        return bool(step.state != state or step.letters or step.records)

    def _wrong_guesses(self) -> set[tuple[int, int]]:
        """Return the letters that were ignored in a state, but not in one that came after it."""
        later: dict[int, set[int]] = {}
        for (state, _), step in self._seats.steps.items():
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

    # What must hold.

    def _check(self, world: World) -> None:
        """Check what is to hold in every state."""
        for state in world.keepers:
            if (state, world.history) not in self._checked_keepers:
                self._checked_keepers.add((state, world.history))
                self._histories[world.history].check_keeper(self._seats.all[state].keeper)
        if world.keepers in self._checked:
            return
        self._checked.add(world.keepers)
        seats = [self._seats.all[state] for state in world.keepers]
        edges = {edge for seat in seats for edge in seat.waits}
        if edges:
            check_no_circle(edges)
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
            keeper = self._seats.all[state].keeper
            assert self._seats.all[state].idle, f"something stays due at keeper {at}"
            assert not keeper._waiting, f"something waits for good at keeper {at}"
            assert not keeper._exclusive, f"something stays locked at keeper {at}"
            assert not keeper._shared, f"something stays locked at keeper {at}"
        history.check_all([self._seats.all[state].keeper for state in world.keepers])


def _way(came_from: Sequence[tuple[int, str]], at: int) -> str:
    names = []
    while at >= 0:
        at, name = came_from[at]
        names.append(name)
    return "\n".join(reversed(names))
