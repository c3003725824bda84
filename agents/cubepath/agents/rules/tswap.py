"""The rule `tswap`: unlabelled vehicles exchange goals among neighbours until every goal is taken.

Source: Okumura and Defago, Solving simultaneous target assignment and path planning efficiently
with time-independent execution (TSWAP); made local, and for rounds in which no vehicle enters a
vertex that another leaves.

A vehicle has a goal and, while it is away from it, one wanted neighbour: a vertex nearer to the
goal. Its note says the goal and the want, so in every round all vehicles within distance two of one
another know the same facts, as of the start of the round:

1. *Move*: a wanted vertex that is empty is claimed.
2. *Exchange*: if it holds a vehicle that rests at its goal, the two exchange goals. All vehicles
   that want that vertex are its neighbours, hear one another, and agree: the highest goal number
   wins. A blocked vehicle may also *grant* one behind it, by its note, that they exchange goals if
   that lowers the sum of squares of their distances; who has granted does nothing else meanwhile.
3. *Rotate*: if wants close a cycle of vehicles away from their goals, each takes the goal of the
   one behind it, all in one round. In cycles of at most five, all hear all and rotate at once,
   if none has granted. In longer ones, a blocked vehicle says a probe (a vehicle's number, hops):
   its own, or the probe of the vehicle ahead if that number is higher. It passes on no probe that
   set out before it was itself blocked as it is now. A vehicle that hears its own number after k
   hops is in a cycle of k, and sends a countdown from k forwards around the cycle; a vehicle that
   hears a 1 from behind takes the goal from there. One that has passed on a probe, or a countdown,
   is *held*: it keeps its want. The others turn to an empty vertex, or to one whose vehicle would
   come nearer by an exchange. A vehicle behind which fewer than five wait in a row may be at the
   end of a tail; it passes on no probe, and is not held.

Goals are never lost or duplicated, since exchanges and rotations are disjoint, and both sides of
each act on the same notes. A vehicle wants one vertex, and one that exchanges wants or is a resting
vehicle. A granted exchange is made only if the vehicle behind wants the other and has granted
nothing, neither has moved, the other wants no resting vehicle, and neither counts down; a short
cycle through both contains the grant.

The rule reaches the goal. Let F be the sum of squares of the distances to the goals. A move lowers
one distance d by one; an exchange with a resting vehicle turns d >= 2 and 0 into d - 1 and 1; a
rotation lowers every distance in it by one; other exchanges lower F by their condition. So these
are finite in number. After the last, goals and places stand, and then the wants: of the pairs that
would come nearer by an exchange, not held, that of the smallest vertices is chosen by both. Suppose
a vehicle is not at its goal. No wanted vertex is empty (of several claims, the highest ranked is
granted) and no resting vehicle is wanted, so following wants leads into a blocked cycle. Grants are
drawn at random, so a short cycle rotates with probability one; in a longer one probes find it:

- *Sound.* Suppose v hears its own number after k hops, and has been blocked as it is for k rounds.
  Each vehicle that passed the probe on was blocked by the one before, and stays so as long as that
  one stands and is not at its goal, for exchanges keep its want. It stays held: a vehicle that
  learns that fewer than five wait behind it learns it after those behind it, which have let go of
  the probe before. So by induction along the hops all wants still hold.
- *Complete.* In a cycle each has ever more behind it. Probes flow against the wants, so none come
  in from tails. Probes older than the cycle end at the vehicle that closed it, after k hops at the
  latest; then all vehicles pass on the highest number in the cycle, and only that one returns. So
  a cycle that none leaves rotates within 3k rounds.

Hesitation and lost claims only cost time, since wants and goals do not depend on them. Distances
are those of the static map; a vehicle without a way to its goal at birth gives up in one line,
since it cannot know which goals in its part of the map are held by vehicles elsewhere.

*Without rounds.* Here goals are registers at places: a vehicle that is started again takes up what
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

from collections.abc import Iterable, Mapping
from typing import NamedTuple

from cubepath.agents.local.observation import STAY, View
from cubepath.agents.rules.graph_distances import Roads, roads_of
from cubepath.agents.rules.rule import Choice, FreeRule, InitialKnowledge, Rule, RuleType
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.sites import Site
from cubepath.protocol.core.system import VehicleGraph

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


class _FreeVehicle:
    def __init__(self, knowledge: InitialKnowledge, graph: VehicleGraph) -> None:
        if len(knowledge.goals) != 1:
            raise InputError(f"rule 'tswap' needs one goal a vehicle, found {len(knowledge.goals)}")
        self._knowledge = knowledge
        self._graph = graph
        self._roads: Roads = roads_of(graph)

    def __call__(self, view: View) -> Choice:
        here = self._graph.index[view.place]
        if view.register is None:
            return self._begin_free(here)
        mine = GoalRegister(*view.register)
        if mine.goal == NOTHING or mine.rests(here):
            return Choice()
        if mine.carried != NOTHING:
            return self._pass_on(view, mine, here)
        return self._move(view, mine, here) or self._wait(view, mine, here)

    def _wait(self, view: View, mine: GoalRegister, here: int) -> Choice:
        """Return what to do behind the vehicle ahead."""
        ahead = self._at(view, mine.want)
        turned = None if mine.held else self._turn(view, mine, here)
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

    def _begin_free(self, here: int) -> Choice:
        """Write the register that a vehicle begins with."""
        knowledge, (goal,) = self._knowledge, self._knowledge.goals
        target = self._graph.index[goal]
        if self._roads.distances(target)[here] < 0:
            return Choice(failed=f"no way from {knowledge.start!r} to the goal {goal!r}")
        vehicle = knowledge.module
        blank = GoalRegister(NOTHING, here, vehicle, 0, vehicle, 0, 0, 0, NOTHING)
        return Choice(note=self._now_for(blank, here, target))

    def _now_for(self, register: GoalRegister, place: int, goal: int) -> GoalRegister:
        """Return a vehicle's register when it has another goal, at the place where it stands."""
        return register.with_goal(goal, self._next(place, goal, ()))

    def _next(self, place: int, goal: int, taken: Iterable[int]) -> int:
        """Return the next vertex on the way, an empty one if possible; at the goal the place."""
        ways = self._roads.nearer(place, goal)
        return min(ways, key=lambda way: (way in taken, way), default=place)

    def _at(self, view: View, vertex: int) -> GoalRegister | None:
        note = view.notes.get(self._graph.vertices[vertex])
        return None if note is None else GoalRegister(*note)

    def _move(self, view: View, mine: GoalRegister, here: int) -> Choice | None:
        """Return the move to an empty vertex, if the vehicle may go to one."""
        index = self._graph.index
        free = {index[view.system.place_of(move.target)]: slot for slot, move in view.legal()}
        ways = [mine.want] if mine.held else self._roads.nearer(here, mine.goal)
        open_ways = [way for way in ways if way in free]
        if not open_ways:
            return None
        want = min(open_ways, key=lambda way: (way != mine.want, way))
        taken = {index[place] for place in (*view.occupied, *view.notes)}
        then = mine.with_goal(mine.goal, self._next(want, mine.goal, taken))
        return Choice(free[want], tuple(then))

    def _turn(self, view: View, mine: GoalRegister, here: int) -> Choice | None:
        """Return an exchange with a vehicle that rests on another way, if there is one."""
        for way in self._roads.nearer(here, mine.goal):
            other = self._at(view, way)
            if other is not None and other.rests(way):
                return self._give(
                    way, self._now_for(mine, here, other.goal), self._now_for(other, way, mine.goal)
                )
        return None

    def _pass_on(self, view: View, mine: GoalRegister, here: int) -> Choice:
        """Give the goal that is carried to the vehicle ahead, which carries its own in turn."""
        ahead = self._at(view, mine.want)
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


def make_free(knowledge: InitialKnowledge) -> Rule:
    """Return the rule of one vehicle; its only goal is a vertex that some vehicle must take."""
    graph = knowledge.system.graph
    if graph is None:
        raise InputError("rule 'tswap' is for vehicles on a graph")
    return _FreeVehicle(knowledge, graph)


NOBODY = -1
"""In a note: no probe."""
SEEN_WHOLE = 5
"""In a cycle of this many vehicles any two are within distance two, so all hear all."""


class ExchangeNote(NamedTuple):
    """A vehicle's note; vertices and goals by number."""

    goal: int
    first: int
    """What it wanted from where it stood then: the one vertex it may have moved to since."""
    second: int
    """What it wants if it has moved there."""
    probe: int
    hops: int
    countdown: int
    held: int
    """Whether it keeps its want: it has passed on a probe, or a countdown."""
    height: int
    """How many vehicles wait one behind another for this one, up to `SEEN_WHOLE`."""
    grant: int
    """Where a vehicle stands that may slide its goal to this one."""

    def want(self, place: int) -> int:
        """Return what it wants from `place`, where it now stands; at rest the place itself."""
        return self.second if place == self.first else self.first


class _Vehicle:
    def __init__(self, knowledge: InitialKnowledge, graph: VehicleGraph) -> None:
        if len(knowledge.goals) != 1:
            raise InputError(f"rule 'tswap' needs one goal a vehicle, found {len(knowledge.goals)}")
        self._graph = graph
        self._roads = roads_of(graph)
        self._knowledge = knowledge
        self._goal = graph.index[knowledge.goals[0]]
        self._place = graph.index[knowledge.start]
        self._said = ExchangeNote(self._goal, NOBODY, NOBODY, NOBODY, 0, 0, 0, 0, NOBODY)
        self._want = self._next(self._place, ())
        self._second = self._want
        self._blocked = NOBODY  # earlier rounds blocked by the same vehicle
        self._passed_on = False  # a probe, since it was blocked
        self._countdown = 0
        self._height = 0
        self._failed: str | None = None
        if self._roads.distances(self._goal)[self._place] < 0:
            self._failed = f"no way from {knowledge.start!r} to the goal {knowledge.goals[0]!r}"

    def _next(self, place: int, taken: Iterable[int]) -> int:
        """Return the next vertex on the way from `place` to the goal, an empty one if possible."""
        ways = self._roads.nearer(place, self._goal)
        return min(ways, key=lambda way: (way in taken, way), default=place)

    def __call__(self, view: View) -> Choice:
        index = self._graph.index
        heard = {index[place]: ExchangeNote(*note) for place, note in view.notes.items()}
        taken = {index[place] for place in view.occupied}
        self._arrive(index[view.place])
        probe = (NOBODY, 0)
        goal = self._new_goal(heard)
        self._goal = self._exchanged(heard) if goal is None else goal
        if goal is not None or self._want not in self._roads.nearer(self._place, self._goal):
            self._turn_to(self._next(self._place, taken))
        elif self._want in heard and heard[self._want].goal != self._want:
            probe = self._wait(heard, taken)
        else:
            self._turn_to(self._want)
        return self._say(view, heard, probe)

    def _arrive(self, place: int) -> None:
        if place != self._place:
            self._place = place
            self._turn_to(self._second)

    def _turn_to(self, want: int) -> None:
        self._want = want
        self._blocked = NOBODY
        self._passed_on = False
        self._countdown = 0

    def _new_goal(self, heard: Mapping[int, ExchangeNote]) -> int | None:
        """Return the goal that an exchange or a rotation brings in this round, if any."""
        here, want = self._place, self._want
        behind = {at: said for at, said in heard.items() if said.want(at) == here}
        if self._goal == here:
            return max((said.goal for said in behind.values()), default=None)
        if want not in heard:
            return None
        if heard[want].goal == want:
            rivals = [said.goal for at, said in heard.items() if said.want(at) == want != at]
            return want if self._goal > max(rivals, default=NOBODY) else None
        for said in behind.values():
            if said.countdown == 1:
                return said.goal
        return None if self._said.grant != NOBODY else self._round_goal(behind, heard)

    def _round_goal(
        self, behind: Mapping[int, ExchangeNote], heard: Mapping[int, ExchangeNote]
    ) -> int | None:
        """Return the goal behind this vehicle in a short blocked cycle, in which nobody grants."""
        at = self._want
        for _ in range(SEEN_WHOLE - 1):
            if at not in heard or heard[at].grant != NOBODY:
                break
            if at in behind:
                return behind[at].goal
            at = heard[at].want(at)
        return None

    def _exchanged(self, heard: Mapping[int, ExchangeNote]) -> int:
        """Return the goal after the exchange that this vehicle granted, or that it was granted."""
        here, grant = self._place, self._said.grant
        back, front = (here, self._want) if grant == NOBODY else (grant, here)
        notes = {**heard, here: self._said}
        if front not in notes or notes[front].grant != back or not self._gains(back, front, notes):
            return self._goal
        return notes[front if back == here else back].goal

    def _gains(self, behind: int, at: int, notes: Mapping[int, ExchangeNote]) -> bool:
        """Return whether the vehicles there may exchange goals, and whether that lowers F."""
        if behind not in notes:
            return False
        back, front = notes[behind], notes[at]
        want = front.first
        rests = want in notes and notes[want].goal == want
        busy = back.grant != NOBODY or back.countdown or front.countdown
        if back.first != at or want == at or rests or busy:
            return False
        far, near = self._roads.distances(back.goal), self._roads.distances(front.goal)
        if (front.held and far[want] >= far[at]) or (back.held and near[at] >= near[behind]):
            return False
        return far[at] ** 2 + near[behind] ** 2 < far[behind] ** 2 + near[at] ** 2

    def _grant(self, heard: Mapping[int, ExchangeNote], mine: ExchangeNote) -> int:
        """Return where the vehicle stands behind this one with which it may exchange goals."""
        here, notes = self._place, {**heard, self._place: mine}
        behind = {at: said for at, said in heard.items() if said.want(at) == here}
        short_cycle = self._round_goal(behind, heard) is not None
        if self._blocked < 1 or short_cycle or self._knowledge.random.random() < 0.5:
            return NOBODY
        may = [at for at in behind if self._gains(at, here, notes)]
        distances = self._roads.distances
        return max(may, key=lambda at: (distances(behind[at].goal)[at], at), default=NOBODY)

    def _wait(self, heard: Mapping[int, ExchangeNote], taken: set[int]) -> tuple[int, int]:
        """Wait behind a vehicle that is not at its goal; return the probe to say."""
        self._blocked += 1
        behind = [said.height for at, said in heard.items() if said.want(at) == self._place]
        self._height = min(SEEN_WHOLE, 1 + max(behind, default=-1))
        self._countdown = max(self._countdown - 1, 0)
        for at, said in heard.items():
            if said.countdown > 1 and said.want(at) == self._place:
                self._countdown = said.countdown - 1
        ahead = heard[self._want]
        number, hops = ahead.probe, ahead.hops + 1
        probe = (self._knowledge.module, 0)
        if self._height < SEEN_WHOLE:
            self._passed_on = False
        elif number >= self._knowledge.module and hops <= self._blocked:
            if number > self._knowledge.module:
                probe = (number, hops)
                self._passed_on = True
            elif not self._countdown:
                self._countdown = hops
        if not self._passed_on and not self._countdown:
            want = self._next(self._place, taken)
            if want in taken:
                want = self._opposed(heard)
            if want != self._want:
                self._turn_to(want)
                return (NOBODY, 0)
        return probe

    def _opposed(self, heard: Mapping[int, ExchangeNote]) -> int:
        """Return where a vehicle stands that can come nearer by an exchange with this one.

        Of several such pairs, that of the smallest vertices comes first, so both choose it.
        """
        here = self._place
        pairs = [
            (min(here, way), max(here, way), way)
            for way in self._roads.nearer(here, self._goal)
            if (said := heard.get(way)) is not None
            and not said.held
            and here in self._roads.nearer(way, said.goal)
        ]
        return min(pairs)[2] if pairs else self._want

    def _say(self, view: View, heard: Mapping[int, ExchangeNote], probe: tuple[int, int]) -> Choice:
        self._second = self._next(self._want, heard)
        held = int(self._passed_on or self._countdown > 0)
        note = ExchangeNote(
            self._goal,
            self._want,
            self._second,
            *probe,
            self._countdown,
            held,
            self._height,
            NOBODY,
        )
        note = self._said = note._replace(grant=self._grant(heard, note))
        target = self._graph.vertices[self._want]
        action = next((action for action, move in view.legal() if move.target == target), STAY)
        return Choice(action, tuple(note), self._failed)


def make(knowledge: InitialKnowledge) -> Rule:
    """Return the rule of one vehicle; its only goal is a vertex that some vehicle must take."""
    graph = knowledge.system.graph
    if graph is None:
        raise InputError("rule 'tswap' is for vehicles on a graph")
    return _Vehicle(knowledge, graph)


TSWAP = RuleType(
    name="tswap",
    summary="vehicles go to their goals and exchange them with neighbours that are in the way",
    source="Okumura and Defago, TSWAP (target assignment and path planning), made local",
    fits=lambda system: system.graph is not None and system.labels is None,
    make=make,
    note_length=lambda _: len(ExchangeNote._fields),
    free=FreeRule(
        why="goals are exchanged in one commit, and each commit comes nearer; a probe that returns"
        " has found a blocked cycle, which turns",
        make=make_free,
        note_length=lambda _: len(GoalRegister._fields),
    ),
)
