"""The rule `pibt` without rounds.

`pibt` has the source, its words, and the rule with rounds. Without them there is no common time, so
priorities are causal, as in time-independent planning (Okumura, Tamura and Defago):

*Priority.* A vehicle has a *time*, 0 at first. When it leaves its goal, or gives way, its time
becomes one more than the greatest that it knows of: its own, those in the registers within reach,
that of the push it follows. Away from its goal its key is its time, and its number; smaller is
stronger. At its goal it is weaker than all that are away.
*Going, inheritance and backtracking* are as with rounds, but that a vehicle says in its register
that it pushes, or follows a push, before it does anything for it, and claims nothing: it moves.
A push is named by its key, p, w and the number of moves that the pusher has made and pushes that it
has given up, so an answer to an earlier push is none to this one. A move to a vertex is committed
only if the registers about that vertex, where pushes would close it, are as they were seen; a
vehicle says that it is full only if those one deeper still say so.

What remains of the guarantee. A vehicle that leaves its goal ends with a greater time, so whoever
stays away becomes the strongest in the end, and the argument of `pibt` holds for it: let v be that
vehicle, at p, pushing w, and K the component of w without p. While v stands, its register stands,
and so, one depth after another, do those of the vehicles that follow its push; a chain of registers
that goes back to an earlier push comes to an end, from its root on. So the vertices one deeper are
closed to all others, also at the moment of their commits. *If K has an empty vertex, v comes
nearer,* with probability one: the attempt of a follower fails only where something about its vertex
has changed since it looked. *If v is told full, K is full*: each answer was committed while those
one deeper said the same to the same push, and these stand still. So vehicles reach their goals
under the conditions of `pibt`, also when they hesitate or see late, and not always at one time.

Failure. A vehicle gives up, in one line, when it has made more than `patience` moves or given up so
many pushes in its life, or at once if there is no way to its goal. In a run that does not end the
strongest vehicle moves, or gives way, again and again; so somebody gives up. A vehicle that is
started again has forgotten alone which ways it had found full.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from typing import NamedTuple, TypeAlias

from cubepath.agents.local.observation import View
from cubepath.agents.rules.graph_distances import roads_of
from cubepath.agents.rules.rule import Choice, InitialKnowledge, Rule
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.system import VehicleGraph

NOWHERE = -1
"""In a register: no vertex."""
AT_GOAL = (1 << 31) - 1
"""The time in the key of a vehicle at its goal."""
Key: TypeAlias = tuple[int, int]


def patience(vertices: int) -> int:
    """Return how many moves and vain pushes a vehicle makes in its life before it gives up."""
    return 400 + 4 * vertices


class PushRegister(NamedTuple):
    """A vehicle's register; vertices by number."""

    time: int
    """When it was last at its goal."""
    moves: int
    """How many moves it has made, and pushes given up."""
    key_time: int
    key_vehicle: int
    """Its own key, or the key of the push that it makes or follows."""
    pusher: int = NOWHERE
    """p of that push."""
    pushed: int = NOWHERE
    """w of that push."""
    stint: int = 0
    """The moves of the pusher."""
    full: int = 0

    @property
    def key(self) -> Key:
        """Return the key that it acts with."""
        return self.key_time, self.key_vehicle

    @property
    def push(self) -> tuple[int, ...]:
        """Return what names the push."""
        return self[2:7]


class _Vehicle:
    def __init__(self, knowledge: InitialKnowledge, graph: VehicleGraph) -> None:
        if len(knowledge.goals) != 1:
            raise InputError(f"rule 'pibt' needs one goal a vehicle, found {len(knowledge.goals)}")
        self._graph = graph
        self._roads = roads_of(graph)
        self._knowledge = knowledge
        self._goal = graph.index[knowledge.goals[0]]
        self._given_up: dict[int, None] = {}
        """Full ways."""
        self._given_up_in = 0, NOWHERE
        """The moves made, and the place, that they are of."""

    def __call__(self, view: View) -> Choice:
        index = self._graph.index
        here = index[view.place]
        number = self._knowledge.module
        if view.register is None:
            mine = PushRegister(0, 0, AT_GOAL if here == self._goal else 0, number)
            return Choice(note=tuple(mine), failed=self._lost(here))
        mine = PushRegister(*view.register)
        if (mine.moves, here) != self._given_up_in:
            self._given_up.clear()
            self._given_up_in = mine.moves, here
        heard = {index[place]: PushRegister(*note) for place, note in view.notes.items()}
        taken = {index[place] for place in view.occupied}
        turn = _Turn(view, here, mine, heard, taken)
        most = patience(len(self._graph.vertices))
        if mine.moves > most:
            goal = self._knowledge.goals[0]
            return Choice(failed=f"more than {most} moves for the goal {goal!r}: others block it")
        push = self._heard_push(turn)
        if push is not None:
            return self._give_way(turn, push)
        if here == self._goal:
            return self._say(turn, self._idle(turn))
        return self._go(turn)

    def _lost(self, here: int) -> str | None:
        if self._roads.distances(self._goal)[here] >= 0:
            return None
        start = self._graph.vertices[here]
        return f"no way from {start!r} to the goal {self._knowledge.goals[0]!r}"

    def _key(self, turn: _Turn) -> Key:
        """Return the vehicle's own key."""
        return AT_GOAL if turn.here == self._goal else turn.mine.time, self._knowledge.module

    def _idle(self, turn: _Turn) -> PushRegister:
        """Return the register of a vehicle that neither pushes nor is pushed."""
        return PushRegister(turn.mine.time, turn.mine.moves, *self._key(turn))

    def _say(self, turn: _Turn, register: PushRegister, heeds: Iterable[int] = ()) -> Choice:
        """Write a register, if it is not there already."""
        if register == turn.mine:
            return Choice()
        return Choice(
            note=tuple(register), heeds=tuple(self._graph.vertices[each] for each in heeds)
        )

    def _move(self, turn: _Turn, to: int, push_time: int = 0) -> Choice:
        """Move to a vertex, if the registers about it still say what they said."""
        vertices, mine = self._graph.vertices, turn.mine
        time = mine.time
        if turn.here == self._goal:
            time = 1 + max(time, push_time, *(said.time for said in turn.heard.values()), 0)
        key_time = AT_GOAL if to == self._goal else time
        then = PushRegister(time, mine.moves + 1, key_time, self._knowledge.module)
        action = next(
            slot
            for slot, move in turn.view.legal()
            if turn.view.system.place_of(move.target) == vertices[to]
        )
        about = tuple(vertices[near] for near in self._roads.near[to] if near != turn.here)
        return Choice(action, tuple(then), heeds=about)

    def _heard_push(self, turn: _Turn) -> PushRegister | None:
        """Return the strongest push that this vehicle must follow, if any."""
        key = self._key(turn)
        pushes = [
            said
            for at in self._roads.near[turn.here]
            if (said := turn.heard.get(at)) is not None
            and said.pusher != NOWHERE
            and said.key < key
            and turn.here in self._below(said, at)
        ]
        return min(pushes, key=lambda said: said.push, default=None)

    def _below(self, said: PushRegister, at: int) -> list[int]:
        """Return the vertices that a vehicle at `at` pushes towards: w, or those one deeper."""
        near = self._roads.near[at]
        if at == said.pusher:
            return [said.pushed]
        depth = self._roads.distances(said.pushed, said.pusher)
        return [other for other in near if depth[other] == depth[at] + 1]

    def _give_way(self, turn: _Turn, push: PushRegister) -> Choice:
        mine = turn.mine
        follows = PushRegister(mine.time, mine.moves, *push.push)
        if mine.push != follows.push:
            return self._say(turn, follows)
        further = self._below(follows, turn.here)
        want = self._best([other for other in further if other not in turn.taken], turn, push.key)
        if want != NOWHERE:
            return self._move(turn, want, push.key_time)
        full = all(
            other in turn.heard and turn.heard[other].push == push.push and turn.heard[other].full
            for other in further
        )
        return self._say(turn, follows._replace(full=int(full)), further if full else ())

    def _go(self, turn: _Turn) -> Choice:
        here, mine, heard = turn.here, turn.mine, turn.heard
        ways = self._roads.nearer(here, self._goal)
        want = self._best([way for way in ways if way not in turn.taken], turn, self._key(turn))
        if want != NOWHERE:
            return self._move(turn, want)
        for way in ways:
            push = (*self._key(turn), here, way, mine.moves)
            if way in heard and heard[way].push == push and heard[way].full:
                self._given_up[way] = None
        if all(way in self._given_up for way in ways):
            time = 1 + max(mine.time, *(said.time for said in heard.values()), 0)
            gives_way = PushRegister(time, mine.moves + 1, time, self._knowledge.module)
            return self._say(turn, gives_way, ways)
        may = [
            way
            for way in ways
            if way not in self._given_up and way in heard and heard[way].key >= self._key(turn)
        ]
        if not may:
            return self._say(turn, self._idle(turn))
        target = min(may, key=lambda way: (way != mine.pushed or mine.pusher != here, way))
        pushes = self._idle(turn)._replace(pusher=here, pushed=target, stint=mine.moves)
        return self._say(turn, pushes)

    def _best(self, free: Collection[int], turn: _Turn, key: Key) -> int:
        """Return the best of the empty vertices that are not closed to a vehicle with this key."""
        if not free:
            return NOWHERE
        closed: set[int] = set()
        for at, said in turn.heard.items():
            if said.key < key and said.pusher != NOWHERE:
                closed.update(self._below(said, at))
        distance = self._roads.distances(self._goal)

        def cost(vertex: int) -> tuple[int, int, float]:
            onward = sum(way not in turn.heard for way in self._roads.nearer(vertex, self._goal))
            return distance[vertex], -onward, self._knowledge.random.random()

        return min((vertex for vertex in free if vertex not in closed), key=cost, default=NOWHERE)


class _Turn(NamedTuple):
    """What a vehicle knows in a turn; vertices by number."""

    view: View
    here: int
    mine: PushRegister
    heard: Mapping[int, PushRegister]
    taken: Collection[int]


def make(knowledge: InitialKnowledge) -> Rule:
    """Return the rule of one vehicle, whose only goal is its own vertex."""
    graph = knowledge.system.graph
    if graph is None:
        raise InputError("rule 'pibt' is for vehicles on a graph")
    return _Vehicle(knowledge, graph)
