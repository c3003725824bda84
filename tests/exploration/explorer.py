"""Every order in which the messages of a short run can arrive, also with one fault.

A global state is the state of each node, the messages under way to each, and the time left of each
timer. Messages take no time and arrive in any order, whoever sent them; a timer runs out only when
nothing is under way, and then the one that is due first (of several due at once: each). Global
states that are equal are explored once, and so are the states of a single node. Deliveries to
different nodes commute, so their orders meet in equal states.

Three things make it smaller without leaving anything out:

- A message that a node ignores now, and would ignore in every state that it can come to, is taken
  out at once instead of being delivered at every later time. That it would is assumed at first, and
  tried afterwards in all states of the node that were reached from there. Where it does not hold,
  all is explored again without the assumption.
- One fault is tried at a time. A message that is lost, or so late that timers run out before it
  comes, makes a difference only once all others have arrived, so it is chosen then. A double is
  tried at every moment, of everything that was put so far on a key that the node has listened to.
- A state after a fault is not explored if it was explored with all faults still to come.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal, NamedTuple, TypeAlias

from cubepath.protocol.wire.nodes import Node
from exploration.node_states import Reaction, Seat, States

Fault: TypeAlias = Literal["loss", "late", "double", "tick"]
"""What may happen once: a message is lost, late or doubled, or a timer runs out at any time."""
FAULTS: tuple[Fault, ...] = ("loss", "late", "double", "tick")
COORDINATOR = 0
_EVERYTHING = "**"


class Letter(NamedTuple):
    """A message under way to a node, both by number."""

    node: int
    message: int


class Global(NamedTuple):
    """A global state; the coordinator is the first node."""

    nodes: tuple[int, ...]
    under_way: tuple[int, ...]
    """To each node the number of the pile of messages; 0 is the empty one."""
    timers: tuple[float | None, ...]
    """The time left of each; None: it does not run."""
    put: int = 0
    """The number of the set of messages put so far; kept only while a fault can happen."""
    late: Letter | None = None
    fault: bool = False
    """Whether a fault can still happen."""


Core: TypeAlias = tuple[tuple[int, ...], tuple[int, ...], tuple[float | None, ...]]
"""A global state without what is known of faults."""


Step: TypeAlias = tuple[str, Letter | None, Global]
"""What happens, of which message, and the state after it."""


class Letters(NamedTuple):
    """What was put: by whom, on which key, which bytes."""

    sender: int
    key: str
    data: bytes

    @property
    def put(self) -> tuple[str, bytes]:
        return self.key, self.data


@dataclass(slots=True)
class Explored:
    """How much was explored, and all that the coordinator came to in the end."""

    states: int = 0
    transitions: int = 0
    longest: int = 0
    node_states: int = 0
    ends: list[Node] = field(default_factory=list)


class BrokenError(AssertionError):
    """Something does not hold; the message tells how it came to that."""


class _WrongGuessError(Exception):
    """A message that was ignored in one state of a node is not in a later one."""


class Explorer:
    """Explores every order in which the messages of some nodes can arrive, up to their end."""

    def __init__(self, nodes: Sequence[Node], faults: Sequence[Fault] = ()) -> None:
        self._faults = frozenset(faults)
        self._nodes = [States(node) for node in nodes]
        self._messages: list[Letters] = []
        self._numbers: dict[Letters, int] = {}
        self._piles: list[tuple[int, ...]] = [()]
        """Messages by number, in increasing order."""
        self._pile_numbers: dict[tuple[int, ...], int] = {(): 0}
        self._smaller: dict[tuple[int, int], int] = {}
        self._letters: dict[tuple[int, ...], list[Letter]] = {}
        self._histories: list[frozenset[int]] = [frozenset()]
        self._history_numbers: dict[frozenset[int], int] = {frozenset(): 0}
        self._longer: dict[tuple[int, tuple[int, ...]], int] = {}
        self._doubles: dict[tuple[int, int, int], list[int]] = {}
        self._reactions: dict[tuple[int, int, int], tuple[Reaction, tuple[int, ...]]] = {}
        self._new: dict[tuple[int, int, int, tuple[int, ...]], tuple[int, ...]] = {}
        self._arrived: dict[tuple[int, int, int, int, tuple[int, ...]], int] = {}
        self._guessed: dict[Letter, set[int]] = {}
        self._not_guessed: set[Letter] = set()

    def explore(self) -> Explored:
        """Explore all; BrokenError with the way there if something does not hold."""
        while True:
            self._guessed, self._arrived = {}, {}
            found = Explored()
            self._walk(self._start(), found)
            try:
                self._check_guesses()
            except _WrongGuessError:
                continue
            found.node_states = sum(len(node.seats) for node in self._nodes)
            return found

    def _start(self) -> Global:
        count = len(self._nodes)
        world = Global((), (0,) * count, (None,) * count, fault=bool(self._faults))
        world = world._replace(nodes=tuple(node.first.state for node in self._nodes))
        for node, states in enumerate(self._nodes):
            said = self._said(node, states.first)
            world = self._carried_out(world, world.under_way, node, states.first, said)
        return world

    def _walk(self, start: Global, found: Explored) -> None:
        """Go through the states in depth; no way may come round to itself."""
        over: dict[Global, bool] = {start: False}  # whether all that follows was explored
        covered: dict[Core, set[int]] = {}
        ends: set[int] = set()
        way: list[tuple[str, Letter | None, Global, Iterator[Step]]] = []
        way.append(("start", None, start, self._steps(start, ends)))
        name: str = "start"
        letter: Letter | None = None
        try:
            while way:
                step = next(way[-1][3], None)
                if step is None:
                    over[way.pop()[2]] = True
                    found.states += 1
                    continue
                name, letter, world = step
                found.transitions += 1
                explored = over.get(world)
                if explored is None:
                    if self._is_covered(world, covered):
                        over[world] = True
                        continue
                    over[world] = False
                    way.append((name, letter, world, self._steps(world, ends)))
                    found.longest = max(found.longest, len(way))
                assert explored is not False, "it comes round to itself"
        except Exception as error:
            told = "\n".join(self._told(*each[:2]) for each in way)
            last = self._told(name, letter)
            raise BrokenError(f"{type(error).__name__}: {error}\nafter\n{told}\n{last}") from error
        found.ends = [self._nodes[COORDINATOR].seats[state].node for state in sorted(ends)]

    def _is_covered(self, world: Global, covered: dict[Core, set[int]]) -> bool:
        """Return whether what can follow after a fault can follow without it, or by a double."""
        core: Core = world[:3]
        if world.fault:
            covered.setdefault(core, set()).add(world.put)
            return False
        late = world.late
        if core not in covered or late is None:
            return core in covered
        return "double" in self._faults and any(
            late.message in self._histories[put] for put in covered[core]
        )

    # What can happen.

    def _steps(self, world: Global, ends: set[int]) -> Iterator[Step]:
        """Yield what can happen in a state; faults come last, when the rest is explored."""
        letters = self._letters_of(world.under_way)
        for letter in letters:
            rest = self._without(world.under_way, letter)
            yield "takes", letter, self._delivered(world, rest, letter)
        if world.late is not None:
            in_time = world._replace(late=None)
            yield "takes late", world.late, self._delivered(in_time, world.under_way, world.late)
        if not letters:
            if self._seat(world, COORDINATOR).ended:
                ends.add(world.nodes[COORDINATOR])
            else:
                yield from self._ticks(world)
        if world.fault:
            yield from self._with_fault(world, letters)

    def _ticks(self, world: Global) -> Iterator[Step]:
        """Let the time pass to the next timer."""
        due = min((left for left in world.timers if left is not None), default=None)
        if due is None:
            if world.late is None:
                raise AssertionError("nothing is under way, no timer runs, and it has not ended")
            return
        later = tuple(None if left is None else left - due for left in world.timers)
        for node, left in enumerate(later):
            if left == 0:
                yield f"tick of node {node}", None, self._ticked(world._replace(timers=later), node)

    def _with_fault(self, world: Global, letters: list[Letter]) -> Iterator[Step]:
        after = world._replace(fault=False, put=0)
        if sum(len(self._piles[pile]) for pile in world.under_way) == 1:
            (letter,) = letters
            rest = after._replace(under_way=self._without(world.under_way, letter))
            if "loss" in self._faults:
                yield "never takes", letter, rest
            if "late" in self._faults:
                yield "does not yet take", letter, rest._replace(late=letter)
        for node, state in enumerate(world.nodes):
            if "double" in self._faults:
                for message in self._doubles_for(node, state, world.put):
                    letter = Letter(node, message)
                    yield "takes a double", letter, self._delivered(after, after.under_way, letter)
            if "tick" in self._faults and world.timers[node] is not None:
                yield f"early tick of node {node}", None, self._ticked(after, node)

    def _doubles_for(self, node: int, state: int, put: int) -> list[int]:
        """Return the messages put so far of which a double makes a difference to a node."""
        found = self._doubles.get((node, state, put))
        if found is None:
            keys = self._nodes[node].seats[state].keys_so_far
            found = [
                message
                for message in sorted(self._histories[put])
                if self._messages[message].sender != node
                and any(_matches(key, self._messages[message].key) for key in keys)
                and not self._nodes[node].seats[state].ended
                and not self._has_no_effect(Letter(node, message), state)
            ]
            self._doubles[node, state, put] = found
        return found

    # What comes of it.

    def _delivered(self, world: Global, under_way: tuple[int, ...], letter: Letter) -> Global:
        node, message = letter
        key = (node, world.nodes[node], message)
        found = self._reactions.get(key)
        if found is None:
            reaction = self._nodes[node].after(world.nodes[node], self._messages[message].put)
            found = self._reactions[key] = reaction, self._said(node, reaction)
        return self._carried_out(world, under_way, node, *found)

    def _ticked(self, world: Global, node: int) -> Global:
        timers = _with(world.timers, node, None)
        reaction = self._nodes[node].after(world.nodes[node], None)
        said = self._said(node, reaction)
        after = world._replace(timers=timers)
        return self._carried_out(after, after.under_way, node, reaction, said)

    def _said(self, node: int, reaction: Reaction) -> tuple[int, ...]:
        """Return the numbers of the messages that a node puts."""
        found: list[int] = []
        for put in reaction.puts:
            letters = Letters(node, put.key, put.data)
            number = self._numbers.setdefault(letters, len(self._messages))
            if number == len(self._messages):
                self._messages.append(letters)
            found.append(number)
        return tuple(found)

    def _carried_out(
        self,
        world: Global,
        under_way: tuple[int, ...],
        node: int,
        reaction: Reaction,
        said: tuple[int, ...],
    ) -> Global:
        """Return the global state in which a node has reacted, with what was under way else."""
        nodes = _with(world.nodes, node, reaction.state)
        timers, put = world.timers, world.put
        if reaction.timer is not None:
            timers = _with(timers, node, reaction.timer.seconds)
        if said and world.fault and "double" in self._faults:
            put = self._with_history(put, said)
        piles = list(under_way)
        if piles[node]:
            piles[node] = self._after_arrival(node, reaction.state, piles[node], node, ())
        if said:
            for other, pile in enumerate(under_way):
                if other != node:
                    piles[other] = self._after_arrival(other, nodes[other], pile, node, said)
        if self._nodes[node].seats[reaction.state].ended:
            timers = _with(timers, node, None)
        return Global(nodes, tuple(piles), timers, put, world.late, world.fault)

    def _new_for(self, other: int, state: int, node: int, said: tuple[int, ...]) -> tuple[int, ...]:
        """Return what comes to another node of what a node puts."""
        found = self._new.get((other, state, node, said))
        if found is None:
            seat = self._nodes[other].seats[state]
            found = self._new[other, state, node, said] = tuple(
                number
                for number in said
                if any(_matches(key, self._messages[number].key) for key in seat.keys)
            )
        return found

    def _after_arrival(
        self, node: int, state: int, pile: int, speaker: int, said: tuple[int, ...]
    ) -> int:
        """Return the pile with what comes of it, without what is ignored, and assumed so later."""
        key = node, state, pile, speaker, said
        found = self._arrived.get(key)
        if found is None:
            new = self._new_for(node, state, speaker, said)
            messages = sorted((*self._piles[pile], *new))
            found = self._arrived[key] = (
                0
                if self._nodes[node].seats[state].ended
                else self._pile(
                    each for each in messages if not self._is_ignored(node, state, each)
                )
            )
        return found

    def _pile(self, messages: Iterable[int]) -> int:
        """Return the number of a pile."""
        pile = tuple(messages)
        found = self._pile_numbers.setdefault(pile, len(self._piles))
        if found == len(self._piles):
            self._piles.append(pile)
        return found

    def _letters_of(self, under_way: tuple[int, ...]) -> list[Letter]:
        """Return what is under way, equal messages once."""
        found = self._letters.get(under_way)
        if found is None:
            found = self._letters[under_way] = [
                Letter(node, message)
                for node, pile in enumerate(under_way)
                for message in dict.fromkeys(self._piles[pile])
            ]
        return found

    def _without(self, under_way: tuple[int, ...], letter: Letter) -> tuple[int, ...]:
        """Return what is under way when a message is not any more."""
        node, message = letter
        key = under_way[node], message
        found = self._smaller.get(key)
        if found is None:
            messages = list(self._piles[under_way[node]])
            messages.remove(message)
            found = self._smaller[key] = self._pile(messages)
        return _with(under_way, node, found)

    def _with_history(self, put: int, said: tuple[int, ...]) -> int:
        found = self._longer.get((put, said))
        if found is None:
            longer = self._histories[put].union(said)
            found = self._history_numbers.setdefault(longer, len(self._histories))
            if found == len(self._histories):
                self._histories.append(longer)
            self._longer[put, said] = found
        return found

    # What is ignored.

    def _is_ignored(self, node: int, state: int, message: int) -> bool:
        letter = Letter(node, message)
        if letter in self._not_guessed or not self._has_no_effect(letter, state):
            return False
        self._guessed.setdefault(letter, set()).add(state)
        return True

    def _has_no_effect(self, letter: Letter, state: int) -> bool:
        reaction = self._nodes[letter.node].after(state, self._messages[letter.message].put)
        return reaction.state == state and not reaction.puts and reaction.timer is None

    def _check_guesses(self) -> None:
        """Check that what was ignored is ignored in all later states of the node."""
        later = [node.steps() for node in self._nodes]
        wrong: set[Letter] = set()
        for letter, states in self._guessed.items():
            left, seen = list(states), set(states)
            while left:
                state = left.pop()
                if self._nodes[letter.node].seats[state].ended:
                    continue
                if not self._has_no_effect(letter, state):
                    wrong.add(letter)
                    break
                new = later[letter.node].get(state, set()) - seen
                seen |= new
                left += new
        if wrong:
            self._not_guessed |= wrong
            raise _WrongGuessError

    def _seat(self, world: Global, node: int) -> Seat:
        return self._nodes[node].seats[world.nodes[node]]

    def _told(self, what: str, letter: Letter | None) -> str:
        if letter is None:
            return what
        sender, _, data = self._messages[letter.message]
        return f"node {letter.node} {what} from node {sender}: {data.decode()}"


def _matches(listened: str, key: str) -> bool:
    """Return whether what is put on a key comes to who listens."""
    if listened.endswith(_EVERYTHING):
        return key.startswith(listened.removesuffix(_EVERYTHING))
    return listened == key


def _with(parts: tuple[Any, ...], at: int, part: object) -> tuple[Any, ...]:
    return (*parts[:at], part, *parts[at + 1 :])
