"""The rule `tswap` without rounds.

Goals are registers at places: a vehicle that is started again takes up what
is in its register, and a goal goes from one register to another in one commit, so no goal is ever
lost or doubled, however late anything is seen.

A vehicle away from its goal g has a *want*, a vertex nearer to g. Every change of its place, goal
or want begins a new *stint*, numbered in its register. What a vehicle does depends on its own
register and that of the vehicle *ahead*, on the vertex that it wants, and is committed only if both
are as it saw them:

1. *Move* to an empty vertex nearer to g: the wanted one or, unless the vehicle is held, any.
2. *Exchange* goals with the vehicle ahead, if that is at rest at its goal, or wants the vertex of
   this one. Unless it is held, any vertex nearer to g will do, where a vehicle is at rest.
3. *Probe*: its own probe is (number, stint). The probe that it shows is the one that the vehicle
   ahead shows, with one hop more, if that is of a greater number than its own and has not gone
   further than there are vehicles; otherwise its own, with no hops. Once it has shown another's
   probe it is *held*: it keeps its want until the next stint.
4. *Rotate*: a vehicle whose own probe, of the present stint, is shown ahead gives its goal to the
   vehicle ahead and becomes a *hole*: no goal, nothing to do. A vehicle that is given a goal beside
   its own *carries* the own one to the vertex it wanted, and gives it to the vehicle there, until a
   hole takes it up. Holes, and vehicles that carry, show no probe and do nothing else.

*Sound*: if the probe of v_0 is shown ahead of v_0, in the stint that it is of, then following wants
from v_0 leads back to v_0. Say v_i took the probe over from v_(i-1) at the time t_i, and v_k is
ahead of v_0 now. By induction on i, v_i has stood and wanted the vertex of v_(i-1) from t_i until
now: v_0 is in the same stint; v_i is held, so it can only move onto that vertex, where v_(i-1)
stood all the time; others change the goal of a vehicle only where it rests, or wants their own
vertex. They would be v_(i-1), which wants v_(i-2) and not v_i, or v_0, which wants v_k. So v_0 ...
v_k are in a blocked cycle. A probe passes only vehicles of lesser number, so at most one vehicle of
a cycle finds it; and as long as a vehicle of the cycle has not been reached by the rotation, it
stays held behind one that stands. So the rotation comes through, and what it gives comes nearer.

*The goal is reached.* Let F be the sum of the squares of the distances of all goals, carried ones
too, from where their registers are. A move lowers F; an exchange turns d >= 2 and 0 into d - 1 and
1, or lowers both distances; what is given in a rotation comes nearer by one. So such commits are
finite in number. After the last one, suppose that not every goal is taken. Places, goals and wants
stand, and everybody comes to see what holds. Nobody carries, so there is no hole. No vehicle can
move or exchange, so following wants leads into a blocked cycle. Probes that are of none of its
vehicles have one hop more with each vehicle that takes them over, so they come to an end; then the
greatest number in the cycle is shown by all of it, and a rotation begins: a contradiction.

Distances are those of the static map; a vehicle without a way to its goal at birth gives up in one
line.
"""

from __future__ import annotations

from typing import NamedTuple

from cubepath.agents.local.observation import STAY, View
from cubepath.agents.rules.rule import Choice, InitialKnowledge
from cubepath.agents.rules.vehicle import Vehicle
from cubepath.protocol.core.sites import Site

NOTHING = -1
"""Instead of a goal: a hole, or nothing carried."""


class GoalRegister(NamedTuple):
    """A vehicle's register; vertices and goals by number."""

    goal: int
    want: int
    """A vertex nearer to the goal; at rest its own; where a carried goal goes to."""
    vehicle: int
    stint: int
    probe: int
    """Whose probe it shows; its own, if it has no hops."""
    probe_stint: int
    hops: int
    held: int
    carried: int

    def probe_shown(self, place: int) -> tuple[int, int, int] | None:
        """Return the probe that a vehicle at `place` shows: number, stint, hops."""
        if NOTHING in (self.goal, self.want) or self.carried != NOTHING or self.goal == place:
            return None
        return self.probe, self.probe_stint, self.hops

    def wants(self, place: int) -> bool:
        """Return whether it is on its way to `place`, where it does not stand."""
        return self.want == place and self.goal != NOTHING and self.carried == NOTHING

    def rests(self, place: int) -> bool:
        """Return whether it is at rest at `place`, where it stands."""
        return self.goal == place and self.carried == NOTHING

    def with_goal(self, goal: int, want: int, carried: int = NOTHING) -> GoalRegister:
        """Return the register in the next stint, with this goal."""
        stint = self.stint + 1
        return GoalRegister(goal, want, self.vehicle, stint, self.vehicle, stint, 0, 0, carried)


class FreeTswapVehicle(Vehicle[GoalRegister]):
    """A vehicle that exchanges goals, without rounds."""

    def __init__(self, knowledge: InitialKnowledge) -> None:
        """Know the goal of the start; later it is in the register."""
        super().__init__("tswap", knowledge, GoalRegister)

    def __call__(self, view: View) -> Choice:
        """Return what the vehicle attempts."""
        self._look(view)
        here = self._place
        if view.register is None:
            return self._begin()
        mine = GoalRegister(*view.register)
        if mine.goal == NOTHING or mine.rests(here):
            return Choice()
        if mine.carried != NOTHING:
            return self._pass_on(mine, here)
        return self._move(view, mine, here) or self._wait(mine, here)

    def _wait(self, mine: GoalRegister, here: int) -> Choice:
        """Return what to do behind the vehicle ahead."""
        ahead = self._heard.get(mine.want)
        turned = None if mine.held else self._turn(mine, here)
        if ahead is None:  # it has not written its register yet
            return turned or Choice()
        if ahead.rests(mine.want) or ahead.wants(here):
            return self._give(
                mine.want,
                self._now_for(mine, here, ahead.goal),
                self._now_for(ahead, mine.want, mine.goal),
            )
        shown = ahead.probe_shown(mine.want)
        if shown is not None and shown[:2] == (mine.vehicle, mine.stint):
            hole = mine.with_goal(NOTHING, here)
            return self._give(mine.want, hole, ahead.with_goal(mine.goal, ahead.want, ahead.goal))
        return turned or self._probe(mine, shown)

    def _begin(self) -> Choice:
        """Write the register that a vehicle begins with."""
        here, vehicle = self._place, self._knowledge.module
        if failed := self._lost():
            return Choice(failed=failed)
        blank = GoalRegister(NOTHING, here, vehicle, 0, vehicle, 0, 0, 0, NOTHING)
        return Choice(note=self._now_for(blank, here, self._goal))

    def _now_for(self, register: GoalRegister, place: int, goal: int) -> GoalRegister:
        """Return a vehicle's register when it has another goal, at the place where it stands."""
        return register.with_goal(goal, self._next(place, goal, ()))

    def _move(self, view: View, mine: GoalRegister, here: int) -> Choice | None:
        """Return the move to an empty vertex, if the vehicle may go to one."""
        index = self._graph.index
        free = {index[view.system.place_of(move.target)]: slot for slot, move in view.legal()}
        ways = [mine.want] if mine.held else self._roads.nearer(here, mine.goal)
        open_ways = [way for way in ways if way in free]
        if not open_ways:
            return None
        want = min(open_ways, key=lambda way: (way != mine.want, way))
        taken = {*self._taken, *self._heard}
        then = mine.with_goal(mine.goal, self._next(want, mine.goal, taken))
        return Choice(free[want], tuple(then))

    def _turn(self, mine: GoalRegister, here: int) -> Choice | None:
        """Return an exchange with a vehicle that rests on another way, if there is one."""
        for way in self._roads.nearer(here, mine.goal):
            other = self._heard.get(way)
            if other is not None and other.rests(way):
                return self._give(
                    way, self._now_for(mine, here, other.goal), self._now_for(other, way, mine.goal)
                )
        return None

    def _pass_on(self, mine: GoalRegister, here: int) -> Choice:
        """Give the goal that is carried to the vehicle ahead, which carries its own in turn."""
        ahead = self._heard.get(mine.want)
        if ahead is None:
            return Choice()
        then = self._now_for(mine, here, mine.goal)
        if ahead.goal == NOTHING:
            taken_up = self._now_for(ahead, mine.want, mine.carried)
        elif ahead.carried == NOTHING:
            taken_up = ahead.with_goal(mine.carried, ahead.want, ahead.goal)
        else:
            return Choice()
        return self._give(mine.want, then, taken_up)

    def _give(self, to: int, mine: GoalRegister, other: GoalRegister) -> Choice:
        """Write both registers in one commit."""
        place: Site = self._graph.vertices[to]
        return Choice(STAY, tuple(mine), exchanges={place: tuple(other)})

    def _probe(self, mine: GoalRegister, shown: tuple[int, int, int] | None) -> Choice:
        """Show the probe of the vehicle ahead, or the own one."""
        probe, stint, hops = mine.vehicle, mine.stint, 0
        if shown is not None and shown[0] > mine.vehicle and shown[2] + 1 < self._knowledge.modules:
            probe, stint, hops = shown[0], shown[1], shown[2] + 1
        then = mine._replace(
            probe=probe, probe_stint=stint, hops=hops, held=int(mine.held or hops > 0)
        )
        if then == mine:
            return Choice()
        return Choice(note=tuple(then), heeds=(self._graph.vertices[mine.want],))
