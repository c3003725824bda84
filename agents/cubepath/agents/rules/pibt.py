"""The rule `pibt`: labelled vehicles go to their own goals; stronger ones push weaker ones aside.

Source: Okumura, Machida, Defago and Tamura, Priority inheritance with backtracking for iterative
multi-agent path finding (PIBT), with the swap of Okumura, Improving LaCAM, and an avoidance of
hindrance as in PIBT with hindrance and regret (arXiv 2505.12623); made local, and for rounds in
which no vehicle enters a vertex that another leaves. In such rounds, inheritance reserves: the
pushed vehicle goes first, and the pusher waits.

*Priority.* A vehicle is stronger the longer it has been away from its goal; ties go to the goal
that is remoter, by the sum of its distances on the static map, since vehicles that rest at the rim
are in nobody's way; then to the smaller number. Its key is the round in which it was last at its
goal, minus that sum, and its number: smaller is stronger.
*Going.* It claims an empty vertex nearer to its goal; if there is none, it stands at p and pushes
the vehicle at a nearer vertex w, unless that vehicle acts for a stronger one. It announces a push
one round ahead if it can foresee it. If all nearer vertices are held for stronger vehicles, it
steps aside with probability `STEP_ASIDE`.
*Inheritance.* A push is (key, p, w). Remove p from the map and let depth be the distance from w. A
vehicle follows a push with a stronger key than its own that it hears from p, if it stands on w, or
otherwise from a vehicle one less deep. It takes over the key: it claims an empty vertex one deeper,
nearest to its own goal, ties at random; if there is none, it stays and passes the push on. Vertices
that pushes and claims aim at are closed to weaker vehicles.
*Hindrance.* Of the vertices one deeper, those on the way to the pusher's goal, and those on which
the vehicle would have to swap with a stronger neighbour, come last: only when all the others are
full.
*Backtracking.* A pushed vehicle is full if all vertices one deeper hold vehicles that said they are
full for this push, or if there are no such vertices. If the vehicle on w is full, the pusher gives
up w while it stands at p; if no nearer vertex remains, it gives way: it counts as having been at
its goal.
*Swap.* Notes say goals, so a vehicle can see that it would push the one on w along a corridor only
to be in its way again, and that there is a junction behind itself. Then it goes back, pushing if it
must, and leaves p to the one on w, which follows; so on to the junction, where one lets the other
pass. No vehicle enters such a corridor in front of a stronger neighbour that must pass it there.
Vehicles in dead ends, at their goals, are remembered, since they can turn a fork into a corridor.

What remains of PIBT's guarantee. Let v be the strongest vehicle, at p, pushing w, and let K be the
component of w in the map without p. *If K has an empty vertex, v comes nearer to its goal*, with
probability one, under hesitation and lost claims. A vehicle that follows this push moves only to a
vertex one deeper. So either the vertices of depth 0, 1, 2, ... fill up with vehicles that pass the
push on, or one of these vehicles has an empty vertex one deeper. That vertex is closed to all
vehicles except such ones, so one of them claims it, once its better vertices are full, and the
empty vertex is one less deep; in the end it is w, which is closed to all except v. *If v hears
full, K is full*: all vertices of K, by induction on depth, hold vehicles that stand still, and K
stays full as long as v stays. So if K has at least as many vertices as there are vehicles, for
every p and w on v's way, v reaches its goal; then it is the weakest, so every vehicle reaches its
goal at some time. This holds in every graph that stays connected without any one vertex (which PIBT
asks for in a similar form), if at least one vertex is empty; PIBT itself needs no empty vertex,
since its full cycles may turn. As with PIBT, nothing guarantees that all vehicles are at their
goals at one time, and on trees, mazes and crowded maps the rule may fail. Swaps do not change this:
v goes back at most `MOST_RETREATS` times before it is at its goal, or gives way, and for its last
approach the argument holds.

Failure. A vehicle gives up, in one line, when it has spent more than `patience` rounds of its life
away from its goal, or in the first round if there is no way to it. In a run that does not end, some
vehicle is away in every round, so one of n vehicles gives up within n times that many rounds.
Usually that happens much earlier, since usually a single vehicle is away throughout.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable
from typing import NamedTuple

from cubepath.agents.local.observation import View
from cubepath.agents.rules.pibt_free import FreePibtVehicle, PushRegister, patience
from cubepath.agents.rules.rule import Choice, FreeRule, InitialKnowledge, RuleType
from cubepath.agents.rules.vehicle import NOWHERE, Key, PushedVehicle

STEP_ASIDE = 0.6
"""How often a vehicle makes room while stronger ones act."""
MOST_REMOTE = (1 << 31) - 1
"""What a note can hold; goals beyond that count as equally remote."""
MOST_RETREATS = 64
"""How often a vehicle goes back before it has been at its goal again."""


class PushNote(NamedTuple):
    """A vehicle's note; vertices by number."""

    key_time: int
    key_remoteness: int
    key_vehicle: int
    """Its own key, or the key of the push or pull it follows."""
    goal: int
    """Its own goal."""
    aim: int
    """The goal of the vehicle that has this key."""
    pusher: int = NOWHERE
    """p of the push that it makes or passes on."""
    pushed: int = NOWHERE
    """w of that push."""
    want: int = NOWHERE
    """The empty vertex that it claims. If it also announces a push, it will push from there."""
    full: int = 0
    pulled: int = NOWHERE
    """Where the vehicle stands that it pulls."""
    left: int = NOWHERE
    """The vertex that it leaves to the vehicle that it pulls."""

    @property
    def key(self) -> tuple[int, int, int]:
        """Return the key that it acts with."""
        return self.key_time, self.key_remoteness, self.key_vehicle

    def pushes(self, at: int) -> bool:
        """Return whether it pushes from `at`, where it now stands."""
        return self.pusher != NOWHERE and (self.want == NOWHERE or self.pusher == at)

    def says_full(self, push: PushNote) -> bool:
        """Return whether it says that it is full for a push."""
        return self.full == 1 and (self.key, *self[5:7]) == (push.key, *push[5:7])


class _Vehicle(PushedVehicle[PushNote]):
    def __init__(self, knowledge: InitialKnowledge) -> None:
        """Note what it knows; its only goal is its own vertex."""
        super().__init__("pibt", knowledge, PushNote)
        self._remoteness = min(sum(self._roads.distances(self._goal)), MOST_REMOTE)
        self._round = 0
        self._at_goal = 0  # the last round there
        self._away = 0  # rounds elsewhere
        self._target = NOWHERE  # what it pushes, or will when it arrives
        self._given_up: set[int] = set()  # full ways from this place
        self._shut: set[int] = set()  # dead ends in which vehicles were at their goals
        self._pull: tuple[PushNote, int] | None = None  # what it said, and whom it pulls, by goal
        self._retreats = 0  # since it was at its goal

    @property
    def _key(self) -> tuple[int, int, int]:
        return self._at_goal, -self._remoteness, self._knowledge.module

    @property
    def _own(self) -> PushNote:
        return PushNote(*self._key, self._goal, self._goal)

    def __call__(self, view: View) -> Choice:
        self._round += 1
        before = self._place
        self._look(view)
        if self._place != before:
            self._given_up.clear()
        if self._place == self._goal:
            self._rank_last()
        else:
            self._away += 1
        self._look_at_dead_ends(self._graph.index[place] for place in view.system.reach(view.place))
        note = self._decide()
        return Choice(self._action(view, note.want), tuple(note), self._failed())

    def _rank_last(self) -> None:
        self._at_goal = self._round
        self._retreats = 0

    def _look_at_dead_ends(self, seen: Iterable[int]) -> None:
        for vertex in seen:
            if len(self._roads.near[vertex]) == 1:
                self._shut.discard(vertex)
                if vertex in self._heard and self._heard[vertex].goal == vertex:
                    self._shut.add(vertex)

    def _failed(self) -> str | None:
        most = patience(len(self._graph.vertices))
        if self._away > most:
            goal = self._knowledge.goals[0]
            return f"more than {most} rounds away from the goal {goal!r}: others are in the way"
        return self._lost() if self._round == 1 else None

    def _decide(self) -> PushNote:
        waiting, self._pull = self._pull, None
        push, pull = min(self._pushes(self._key), default=None), self._heard_pull()
        if pull is not None and (push is None or pull.key < push.key):
            self._target = NOWHERE
            return self._follow(pull)
        if push is not None:
            self._target = NOWHERE
            return self._give_way(push)
        if self._place == self._goal:
            return self._own
        if waiting is not None and self._may_follow(*waiting):
            self._pull = waiting
            return waiting[0]
        return self._go()

    def _heard_pull(self) -> PushNote | None:
        """Return the strongest pull that this vehicle must follow, or has just followed, if any."""
        heeded = [note for note in self._heard.values() if self._place in (note.pulled, note.left)]
        return min((note for note in heeded if note.key < self._key), default=None)

    def _follow(self, pull: PushNote) -> PushNote:
        """Enter the vertex that the puller has left; who stands there waits for the next order."""
        follows = PushNote(*pull.key, self._goal, pull.aim)
        open_to_it = pull.left not in self._taken and pull.left not in self._closed(pull.key)
        enters = open_to_it and self._place == pull.pulled
        return follows._replace(want=pull.left) if enters else follows

    def _may_follow(self, pull: PushNote, goal: int) -> bool:
        """Return whether the vehicle with that goal, which this one pulls, may still follow."""
        other = self._heard.get(pull.pulled)
        comes = other is not None and other.goal == goal and other.key >= pull.key
        return comes and self._place == pull.want and pull.left not in self._taken

    def _give_way(self, push: PushNote) -> PushNote:
        further = self._roads.deeper(push.pusher, push.pushed, self._place)
        follows = PushNote(*push.key, self._goal, push.aim)
        hinders = self._head_on(further, push.key)
        hinders.update(self._roads.nearer(self._place, push.aim))
        heard = self._heard
        full = {other for other in further if other in heard and heard[other].says_full(push)}
        closed = self._closed(push.key)
        if not hinders.union(full).issuperset(further):
            closed |= hinders
        want = self._best(further, closed)
        if want != NOWHERE:
            return follows._replace(want=want)
        all_full = int(full.issuperset(further))
        return follows._replace(pusher=push.pusher, pushed=push.pushed, full=all_full)

    def _head_on(self, ways: Iterable[int], weakest: Key) -> set[int]:
        """Return the ways on which this vehicle would have to change places with a neighbour.

        `weakest` is the greatest key of a neighbour that counts.
        """
        here, heard, swap = self._place, self._heard, self._roads.swap
        strong = [at for at in self._roads.near[here] if at in heard and heard[at].key <= weakest]
        return {
            way
            for way in ways
            for at in strong
            if way != at and swap((here, heard[at].goal), (way, self._goal), self._shut)
        }

    def _go(self) -> PushNote:
        here, (*first, vehicle) = self._place, self._key
        ways = self._roads.nearer(here, self._goal)
        closed = self._closed(self._key) | self._head_on(ways, (*first, vehicle - 1))
        want = self._best(ways, closed)
        if want != NOWHERE:
            return self._advance(want)
        self._note_full()
        pull = self._retreat(ways)
        if pull is not None:
            return pull
        ways = [way for way in ways if way not in self._given_up]
        if not ways:
            self._rank_last()
            self._given_up.clear()
        self._target = self._weaker(ways, self._key, self._target)
        if self._target == NOWHERE:
            return self._step_aside(closed)
        return self._own._replace(pusher=here, pushed=self._target)

    def _advance(self, want: int) -> PushNote:
        """Claim a nearer vertex, and announce the push from there that can be foreseen."""
        ahead = self._roads.nearer(want, self._goal)
        blocked = all(way in self._heard for way in ahead)
        self._target = self._weaker(ahead, self._key, self._target) if blocked else NOWHERE
        claim = self._own._replace(want=want)
        pusher = NOWHERE if self._target == NOWHERE else want
        return claim._replace(pusher=pusher, pushed=self._target)

    def _note_full(self) -> None:
        for way in self._roads.near[self._place]:
            push = self._own._replace(pusher=self._place, pushed=way)
            if way in self._heard and self._heard[way].says_full(push):
                self._given_up.add(way)

    def _step_aside(self, closed: Collection[int]) -> PushNote:
        """Stay while stronger vehicles act, or sometimes make room."""
        aside = self._knowledge.random.random() < STEP_ASIDE
        want = self._best(self._roads.near[self._place], closed) if aside else NOWHERE
        return self._own._replace(want=want)

    def _retreat(self, ways: Iterable[int]) -> PushNote | None:
        """Return the note of a vehicle that goes back and pulls the one in its way, if it must."""
        me = self._place, self._goal
        for way in ways if self._retreats < MOST_RETREATS else ():
            other = self._heard.get(way)
            if other is None or other.key < self._key:
                continue
            if self._roads.swap(me, (way, other.goal), self._shut):
                pull = self._own._replace(pulled=way, left=self._place)
                return self._go_back(pull, other.goal)
        return None

    def _go_back(self, pull: PushNote, other: int) -> PushNote | None:
        """Go to a vertex behind, best one that the other does not need; push who stands there."""
        here, distance = self._place, self._roads.distances(self._goal)
        back = [way for way in self._roads.near[here] if way != pull.pulled]
        needed = self._roads.nearer(here, other)

        def cost(way: int) -> tuple[bool, int, int]:
            return way in needed, -distance[way], way

        closed = self._closed(self._key) | self._taken
        want = min((way for way in back if way not in closed), key=cost, default=NOWHERE)
        if want != NOWHERE:
            self._retreats += 1
            self._pull = pull._replace(want=want), other
            return self._pull[0]
        back = [way for way in sorted(back, key=cost) if way not in self._given_up]
        self._target = self._weaker(back, self._key, self._target)
        if self._target == NOWHERE:
            return None
        return pull._replace(pusher=here, pushed=self._target)

    def _closed(self, key: Key) -> set[int]:
        stronger = [note for note in self._heard.values() if note.key < key]
        return super()._closed(key).union(*((note.want, note.left) for note in stronger))


PIBT = RuleType(
    name="pibt",
    summary="vehicles go to their own goals; the one that has travelled longest pushes the others",
    source="Okumura, Machida, Defago and Tamura, PIBT with the swap of LaCAM, made local",
    fits=lambda system: system.graph is not None and system.labels is not None,
    make=_Vehicle,
    note_length=lambda _: len(PushNote._fields),
    free=FreeRule(
        why="priorities are causal, and a vehicle that follows a push announces it first;"
        " under the conditions of the rule with rounds every vehicle reaches its goal at some time",
        make=FreePibtVehicle,
        note_length=lambda _: len(PushRegister._fields),
    ),
)
