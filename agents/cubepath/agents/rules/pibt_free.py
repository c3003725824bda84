"""The rule `pibt` without rounds.

There is no common time, so priorities are causal, as in time-independent planning (Okumura, Tamura
and Defago):

*Priority.* A vehicle has a *time*, 0 at first. When it leaves its goal, or gives way, its time
becomes one more than the greatest that it knows of: its own, those in the registers within reach,
that of the push it follows. Away from its goal its key is its time, and its number; smaller is
stronger. At its goal it is weaker than all that are away.
There is no swap, hindrance or stepping aside without rounds; a swap would take two commits that
depend on each other, and failure in dead ends is as it was.
*Going, inheritance and backtracking* are as with rounds, but that a vehicle says in its register
that it pushes, or follows a push, before it does anything for it, and claims nothing: it moves.
A push is named by its key, p, w and the number of moves that the pusher has made and pushes that it
has given up, so an answer to an earlier push is none to this one. A move to a vertex is committed
only if the registers about that vertex, where pushes would close it, are as they were seen; a
vehicle says that it is full only if those one deeper still say so.

What remains of the guarantee. A vehicle that leaves its goal ends with a greater time, so a vehicle
that stays away becomes the strongest in the end, and the argument of `pibt` holds for it: let v be
that vehicle, at p, pushing w, and K the component of w without p. While v stands, its register
stands, and so, one depth after another, do those of the vehicles that follow its push; a chain of
registers that goes back to an earlier push comes to an end, from its root on. So the vertices one
deeper are closed to all others, also at the moment of their commits. *If K has an empty vertex, v
comes nearer,* with probability one: the attempt of a follower fails only where something about its
vertex has changed since it looked. *If v hears full, K is full*: each answer was committed while
those one deeper said the same to the same push, and these stand still. So vehicles reach their
goals under the conditions of `pibt`, also when they hesitate or see late, and not always at one
time.

Failure. A vehicle gives up, in one line, when it has made more than `patience` moves or given up
that many pushes in its life, or at once if there is no way to its goal. In a run that does not end
the strongest vehicle moves, or gives way, again and again; so somebody gives up. A vehicle that is
started again has forgotten alone which ways it had found full.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

from cubepath.agents.local.observation import View
from cubepath.agents.rules.rule import Choice, InitialKnowledge
from cubepath.agents.rules.vehicle import NOWHERE, PushedVehicle

AT_GOAL = (1 << 31) - 1
"""The time in the key of a vehicle at its goal."""


def patience(vertices: int) -> int:
    """Return for how many rounds of its life, or moves, a vehicle is away before it gives up."""
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
    def key(self) -> tuple[int, int]:
        """Return the key that it acts with."""
        return self.key_time, self.key_vehicle

    @property
    def push(self) -> tuple[int, ...]:
        """Return what names the push."""
        return self[2:7]

    def pushes(self, at: int) -> bool:
        """Return whether it makes or follows a push, wherever it stands."""
        del at
        return self.pusher != NOWHERE


class FreePibtVehicle(PushedVehicle[PushRegister]):
    """A vehicle among pushes, without rounds."""

    def __init__(self, knowledge: InitialKnowledge) -> None:
        """Note what it knows; its only goal is its own vertex."""
        super().__init__("pibt", knowledge, PushRegister)
        self._mine = PushRegister(0, 0, 0, knowledge.module)
        self._given_up: set[int] = set()  # full ways
        self._given_up_in = 0, NOWHERE  # the moves made, and the place, that they are of

    def __call__(self, view: View) -> Choice:
        """Return what the vehicle attempts."""
        self._look(view)
        if view.register is None:
            return Choice(note=tuple(self._idle()), failed=self._lost())
        mine = self._mine = PushRegister(*view.register)
        if (mine.moves, self._place) != self._given_up_in:
            self._given_up.clear()
            self._given_up_in = mine.moves, self._place
        most = patience(len(self._graph.vertices))
        if mine.moves > most:
            goal = self._knowledge.goals[0]
            return Choice(failed=f"more than {most} moves for the goal {goal!r}: others block it")
        push = min(self._pushes(self._key), key=lambda note: note.push, default=None)
        if push is not None:
            return self._give_way(view, push)
        return self._say(self._idle()) if self._place == self._goal else self._go(view)

    @property
    def _key(self) -> tuple[int, int]:
        at_goal = self._place == self._goal
        return AT_GOAL if at_goal else self._mine.time, self._knowledge.module

    def _idle(self) -> PushRegister:
        """Return the register of a vehicle that neither pushes nor is pushed."""
        return PushRegister(self._mine.time, self._mine.moves, *self._key)

    def _say(self, register: PushRegister, heeds: Iterable[int] = ()) -> Choice:
        """Write a register, if it is not there already."""
        if register == self._mine:
            return Choice()
        vertices = self._graph.vertices
        return Choice(note=tuple(register), heeds=tuple(vertices[each] for each in heeds))

    def _later(self, push_time: int = 0) -> int:
        """Return a time that is later than all that it knows of."""
        times = (note.time for note in self._heard.values())
        return 1 + max(self._mine.time, push_time, *times, 0)

    def _move(self, view: View, to: int, push_time: int = 0) -> Choice:
        """Move to a vertex, if the registers about it still say what they said."""
        time = self._later(push_time) if self._place == self._goal else self._mine.time
        key_time = AT_GOAL if to == self._goal else time
        then = PushRegister(time, self._mine.moves + 1, key_time, self._knowledge.module)
        near, vertices = self._roads.near[to], self._graph.vertices
        about = tuple(vertices[other] for other in near if other != self._place)
        return Choice(self._action(view, to), tuple(then), heeds=about)

    def _give_way(self, view: View, push: PushRegister) -> Choice:
        mine, heard = self._mine, self._heard
        follows = PushRegister(mine.time, mine.moves, *push.push)
        if mine.push != follows.push:
            return self._say(follows)
        further = self._roads.deeper(push.pusher, push.pushed, self._place)
        want = self._best(further, self._closed(push.key))
        if want != NOWHERE:
            return self._move(view, want, push.key_time)
        full = all(
            other in heard and heard[other].push == push.push and heard[other].full
            for other in further
        )
        return self._say(follows._replace(full=int(full)), further if full else ())

    def _go(self, view: View) -> Choice:
        here, mine, heard = self._place, self._mine, self._heard
        ways = self._roads.nearer(here, self._goal)
        want = self._best(ways, self._closed(self._key))
        if want != NOWHERE:
            return self._move(view, want)
        for way in ways:
            push = (*self._key, here, way, mine.moves)
            if way in heard and heard[way].push == push and heard[way].full:
                self._given_up.add(way)
        if all(way in self._given_up for way in ways):
            time = self._later()
            return self._say(PushRegister(time, mine.moves + 1, time, self._key[1]), ways)
        ways = [way for way in ways if way not in self._given_up]
        before = mine.pushed if mine.pusher == here else NOWHERE
        target = self._weaker(ways, self._key, before)
        if target == NOWHERE:
            return self._say(self._idle())
        return self._say(self._idle()._replace(pusher=here, pushed=target, stint=mine.moves))
