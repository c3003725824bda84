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
   wins.
3. *Rotate*: if wants close a cycle of vehicles away from their goals, each takes the goal of the
   one behind it, all in one round. In cycles of at most five, all hear all and rotate at once.
   In longer ones, a blocked vehicle says a probe (a goal, hops): its own goal, or the probe of the
   vehicle ahead if that goal is higher. It passes on no probe that set out before it was itself
   blocked as it is now. A vehicle that hears its own goal after k hops is in a cycle of k, and
   sends a countdown from k forwards around the cycle; a vehicle that hears a 1 from behind takes
   the goal from there.

Goals are never lost or duplicated: exchanges and cycles are disjoint, since a vehicle wants one
vertex, and a vehicle that exchanges wants or is a resting vehicle; both sides of each act on the
same notes.

The rule reaches the goal. Let F be the sum of squares of the distances to the goals. A move lowers
one distance d by one; an exchange turns d >= 2 and 0 into d - 1 and 1; a rotation lowers every
distance in it by one: each lowers F. And something happens while a vehicle is not at its goal: if
no wanted vertex is empty (of several claims, the highest ranked is granted) and no resting vehicle
is wanted, following wants from vehicle to vehicle leads into a blocked cycle. No vehicle in it can
move or exchange, and probes find it:

- *Sound.* Suppose v hears its own goal after k hops, and has been blocked as it is for k rounds.
  Each vehicle that passed the probe on was blocked by the one before, and stays so as long as that
  one stands and is not at its goal; v did, so by induction along the hops all wants still hold.
- *Complete.* Probes flow against the wants, so none come in from tails. Probes older than the cycle
  end at the vehicle that closed it, after k hops at the latest; then all vehicles pass on the
  highest goal in the cycle, and only that one returns. So a cycle rotates within 3k rounds.

A vehicle that has passed on no probe may change its want to an empty vertex. Hesitation and lost
claims only cost time, since wants and goals do not depend on them. Distances are those of the
static map; a vehicle without a way to its goal at birth gives up in one line, since it cannot know
which goals in its part of the map are held by vehicles elsewhere.

`free_tswap` has the rule without rounds.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import NamedTuple

from cubepath.agents.local.observation import STAY, View
from cubepath.agents.rules import free_tswap
from cubepath.agents.rules.graph_distances import roads_of
from cubepath.agents.rules.rule import Choice, FreeRule, InitialKnowledge, Rule, RuleType
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.system import VehicleGraph

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

    def want(self, place: int) -> int:
        """Return what it wants from `place`, where it now stands; at rest the place itself."""
        return self.second if place == self.first else self.first


class _Vehicle:
    def __init__(self, knowledge: InitialKnowledge, graph: VehicleGraph) -> None:
        if len(knowledge.goals) != 1:
            raise InputError(f"rule 'tswap' needs one goal a vehicle, found {len(knowledge.goals)}")
        self._graph = graph
        self._roads = roads_of(graph)
        self._goal = graph.index[knowledge.goals[0]]
        self._place = graph.index[knowledge.start]
        self._want = self._next(self._place, ())
        self._second = self._want
        self._blocked = NOBODY  # earlier rounds blocked by the same vehicle
        self._passed_on = False  # a probe, since it was blocked
        self._countdown = 0
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
        if goal is not None:
            self._goal = goal
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
        at = want
        for _ in range(SEEN_WHOLE - 1):
            if at in behind:
                return behind[at].goal
            if at not in heard:
                break
            at = heard[at].want(at)
        return None

    def _wait(self, heard: Mapping[int, ExchangeNote], taken: set[int]) -> tuple[int, int]:
        """Wait behind a vehicle that is not at its goal; return the probe to say."""
        self._blocked += 1
        self._countdown = max(self._countdown - 1, 0)
        for at, said in heard.items():
            if said.countdown > 1 and said.want(at) == self._place:
                self._countdown = said.countdown - 1
        ahead = heard[self._want]
        goal, hops = ahead.probe, ahead.hops + 1
        probe = (self._goal, 0)
        if goal >= self._goal and hops <= self._blocked:
            if goal > self._goal:
                probe = (goal, hops)
                self._passed_on = True
            elif not self._countdown:
                self._countdown = hops
        if not self._passed_on and not self._countdown:
            want = self._next(self._place, taken)
            if want not in taken:
                self._turn_to(want)
                return (NOBODY, 0)
        return probe

    def _say(self, view: View, heard: Mapping[int, ExchangeNote], probe: tuple[int, int]) -> Choice:
        self._second = self._next(self._want, heard)
        note = ExchangeNote(self._goal, self._want, self._second, *probe, self._countdown)
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
        make=free_tswap.make,
        note_length=lambda _: len(free_tswap.GoalRegister._fields),
    ),
)
