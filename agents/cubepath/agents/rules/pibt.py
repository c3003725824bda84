"""The rule `pibt`: labelled vehicles go to their own goals; stronger ones push weaker ones aside.

Source: Okumura, Machida, Defago and Tamura, Priority inheritance with backtracking for iterative
multi-agent path finding (PIBT); made local, and for rounds in which no vehicle enters a vertex that
another leaves. In such rounds, inheritance reserves: the pushed vehicle goes first, and the pusher
waits.

*Priority.* A vehicle is stronger the longer it has been away from its goal; ties go to the smaller
number. Its key is the round in which it was last at its goal, and its number: smaller is stronger.
*Going.* It claims an empty vertex nearer to its goal; if there is none, it stands at p and pushes
the vehicle at a nearer vertex w, unless that vehicle acts for a stronger one. It announces a push
one round ahead if it can foresee it.
*Inheritance.* A push is (key, p, w). Remove p from the map and let depth be the distance from w. A
vehicle follows a push with a stronger key than its own that it hears from p, if it stands on w, or
otherwise from a vehicle one less deep. It takes over the key: it claims an empty vertex one deeper,
nearest to its own goal, ties at random; if there is none, it stays and passes the push on. Vertices
that pushes and claims aim at are closed to weaker vehicles.
*Backtracking.* A pushed vehicle is full if all vertices one deeper hold vehicles that said they are
full for this push, or if there are no such vertices. If the vehicle on w is full, the pusher gives
up w while it stands at p; if no nearer vertex remains, it gives way: it counts as having been at
its goal.

What remains of PIBT's guarantee. Let v be the strongest vehicle, at p, pushing w, and let K be the
component of w in the map without p. *If K has an empty vertex, v comes nearer to its goal*, with
probability one, under hesitation and lost claims. A vehicle that follows this push moves only to a
vertex one deeper. So either the vertices of depth 0, 1, 2, ... fill up with vehicles that pass the
push on, or one of these vehicles has an empty vertex one deeper. That vertex is closed to all
vehicles except such ones, so one of them claims it, and the empty vertex is one less deep; in the
end it is w, which is closed to all except v. *If v is told full, K is full*: all vertices of K, by
induction on depth, hold vehicles that stand still, and K stays full as long as v stays. So if K has
at least as many vertices as there are vehicles, for every p and w on v's way, v reaches its goal;
then it is the weakest, so every vehicle reaches its goal at some time. This holds in every graph
that stays connected without any one vertex (which PIBT asks for in a similar form), if at least one
vertex is empty; PIBT itself needs no empty vertex, since its full cycles may turn. As with PIBT,
nothing guarantees that all vehicles are at their goals at one time, and on trees, mazes and crowded
maps the rule may fail.

Failure. A vehicle gives up, in one line, when it has spent more than `patience` rounds of its life
away from its goal, or in the first round if there is no way to it. In a run that does not end, some
vehicle is away in every round, so one of n vehicles gives up within n times that many rounds.
Usually that happens much earlier, since usually a single vehicle is away throughout.

`free_pibt` has the rule without rounds.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from typing import NamedTuple

from cubepath.agents.local.observation import STAY, View
from cubepath.agents.rules import free_pibt
from cubepath.agents.rules.graph_distances import roads_of
from cubepath.agents.rules.rule import Choice, FreeRule, InitialKnowledge, Rule, RuleType
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.system import VehicleGraph

NOWHERE = -1
"""In a note, and for a vehicle: no vertex."""


def patience(vertices: int) -> int:
    """Return how many rounds of its life a vehicle spends away from its goal before it gives up."""
    return 400 + 4 * vertices


class PushNote(NamedTuple):
    """A vehicle's note; vertices by number."""

    key: int
    """Its own key, or the key of the push it follows."""
    pusher: int = NOWHERE
    """p of the push that it makes or passes on."""
    pushed: int = NOWHERE
    """w of that push."""
    want: int = NOWHERE
    """The empty vertex that it claims. If it also announces a push, it will push from there."""
    full: int = 0

    def pushes(self, at: int) -> bool:
        """Return whether it pushes from `at`, where it now stands."""
        return self.pusher != NOWHERE and (self.want == NOWHERE or self.pusher == at)


class _Vehicle:
    def __init__(self, knowledge: InitialKnowledge, graph: VehicleGraph) -> None:
        if len(knowledge.goals) != 1:
            raise InputError(f"rule 'pibt' needs one goal a vehicle, found {len(knowledge.goals)}")
        self._graph = graph
        self._roads = roads_of(graph)
        self._knowledge = knowledge
        self._goal = graph.index[knowledge.goals[0]]
        self._round = 0
        self._at_goal = 0  # the last round there
        self._away = 0  # rounds elsewhere
        self._place = NOWHERE
        self._target = NOWHERE  # what it pushes, or will when it arrives
        self._given_up: set[int] = set()  # full ways from this place

    @property
    def _key(self) -> int:
        return self._at_goal * self._knowledge.modules + self._knowledge.module

    def __call__(self, view: View) -> Choice:
        index = self._graph.index
        self._round += 1
        here = index[view.place]
        if here != self._place:
            self._place = here
            self._given_up.clear()
        if here == self._goal:
            self._at_goal = self._round
        else:
            self._away += 1
        heard = {index[place]: PushNote(*note) for place, note in view.notes.items()}
        said = self._decide(heard, {index[place] for place in view.occupied})
        vertices = self._graph.vertices
        action = STAY
        for slot, move in view.legal():
            if said.want != NOWHERE and view.system.place_of(move.target) == vertices[said.want]:
                action = slot
        return Choice(action, tuple(said), self._failed())

    def _failed(self) -> str | None:
        start, goal = self._knowledge.start, self._knowledge.goals[0]
        if self._round == 1 and self._roads.distances(self._goal)[self._place] < 0:
            return f"no way from {self._knowledge.system.place_of(start)!r} to the goal {goal!r}"
        most = patience(len(self._graph.vertices))
        if self._away > most:
            return f"more than {most} rounds away from the goal {goal!r}: others are in the way"
        return None

    def _decide(self, heard: Mapping[int, PushNote], taken: set[int]) -> PushNote:
        push = self._heard_push(heard)
        if push is not None:
            self._target = NOWHERE
            return self._give_way(push, heard, taken)
        if self._place == self._goal:
            return PushNote(self._key)
        return self._go(heard, taken)

    def _heard_push(self, heard: Mapping[int, PushNote]) -> PushNote | None:
        """Return the strongest push that this vehicle must follow, if any."""
        pushes = [
            said
            for at in self._roads.near[self._place]
            if (said := heard.get(at)) is not None
            and said.pushes(at)
            and said.key < self._key
            and self._place in self._below(said, at)
        ]
        return min(pushes, default=None)

    def _below(self, said: PushNote, at: int) -> list[int]:
        """Return the vertices that a vehicle at `at` pushes towards: w, or those one deeper."""
        near = self._roads.near[at]
        if at == said.pusher:
            return [said.pushed]
        if at == said.pushed:
            return [other for other in near if other != said.pusher]
        depth = self._roads.distances(said.pushed, said.pusher)
        return [other for other in near if depth[other] == depth[at] + 1]

    def _give_way(self, push: PushNote, heard: Mapping[int, PushNote], taken: set[int]) -> PushNote:
        further = self._below(push, self._place)
        free = [other for other in further if other not in taken]
        want = self._best(free, push.key, heard)
        if want != NOWHERE:
            return PushNote(push.key, want=want)
        answer = PushNote(push.key, push.pusher, push.pushed, full=1)
        full = all(heard.get(other) == answer for other in further)
        return answer if full else answer._replace(full=0)

    def _go(self, heard: Mapping[int, PushNote], taken: set[int]) -> PushNote:
        here, key = self._place, self._key
        ways = self._roads.nearer(here, self._goal)
        want = self._best([way for way in ways if way not in taken], key, heard)
        if want != NOWHERE:
            ahead = self._roads.nearer(want, self._goal)
            blocked = all(way in heard for way in ahead)
            self._target = self._weaker(ahead, heard) if blocked else NOWHERE
            if self._target == NOWHERE:
                return PushNote(key, want=want)
            return PushNote(key, want, self._target, want=want)
        full = {way for way in ways if heard.get(way) == PushNote(key, here, way, full=1)}
        self._given_up |= full
        ways = [way for way in ways if way not in self._given_up]
        if not ways:
            self._at_goal = self._round
            self._given_up.clear()
        self._target = self._weaker(ways, heard)
        return PushNote(self._key) if self._target == NOWHERE else PushNote(key, here, self._target)

    def _weaker(self, ways: Iterable[int], heard: Mapping[int, PushNote]) -> int:
        """Return the way to push: the one being pushed if that is allowed, else the first."""
        may = [way for way in ways if way in heard and heard[way].key >= self._key]
        return min(may, key=lambda way: (way != self._target, way), default=NOWHERE)

    def _best(self, free: Collection[int], key: int, heard: Mapping[int, PushNote]) -> int:
        """Return the best of the empty vertices that are not closed to a vehicle with this key."""
        if not free:
            return NOWHERE
        closed: set[int] = set()
        for at, said in heard.items():
            if said.key < key:
                closed.add(said.want)
                if said.pushes(at):
                    closed.update(self._below(said, at))
        distance = self._roads.distances(self._goal)

        def cost(vertex: int) -> tuple[int, int, float]:
            onward = sum(way not in heard for way in self._roads.nearer(vertex, self._goal))
            return distance[vertex], -onward, self._knowledge.random.random()

        return min((vertex for vertex in free if vertex not in closed), key=cost, default=NOWHERE)


def make(knowledge: InitialKnowledge) -> Rule:
    """Return the rule of one vehicle, whose only goal is its own vertex."""
    graph = knowledge.system.graph
    if graph is None:
        raise InputError("rule 'pibt' is for vehicles on a graph")
    return _Vehicle(knowledge, graph)


PIBT = RuleType(
    name="pibt",
    summary="vehicles go to their own goals; the one that has travelled longest pushes the others",
    source="Okumura, Machida, Defago and Tamura, PIBT (multi-agent path finding), made local",
    fits=lambda system: system.graph is not None and system.labels is not None,
    make=make,
    note_length=lambda _: len(PushNote._fields),
    free=FreeRule(
        why="priorities are causal, and a vehicle that follows a push announces it first;"
        " under the conditions of the rule with rounds every vehicle reaches its goal at some time",
        make=free_pibt.make,
        note_length=lambda _: len(free_pibt.PushRegister._fields),
    ),
)
