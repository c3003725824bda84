"""The rule `pibt`: labelled vehicles go to their own goals; stronger ones push weaker ones aside.

Source: Okumura, Machida, Defago and Tamura, Priority inheritance with backtracking for iterative
multi-agent path finding (PIBT), with the swap of Okumura, Improving LaCAM, and an avoidance of
hindrance as in PIBT with hindrance and regret (arXiv 2505.12623); made local, and for rounds in
which no vehicle enters a vertex that another leaves. In such rounds, inheritance reserves: the
pushed vehicle goes first, and the pusher waits.

*Priority.* A vehicle is stronger the longer it has been away from its goal; ties go to the smaller
number. Its key is the round in which it was last at its goal, and its number: smaller is stronger.
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

*Without rounds.* There is no common time, so priorities are causal, as in time-independent planning
(Okumura, Tamura and Defago):

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

from collections.abc import Collection, Iterable, Mapping
from typing import NamedTuple, TypeAlias

from cubepath.agents.local.observation import STAY, View
from cubepath.agents.rules.graph_distances import roads_of
from cubepath.agents.rules.rule import Choice, FreeRule, InitialKnowledge, RuleType
from cubepath.protocol.core.errors import InputError

NOWHERE = -1
"""In a note or a register, and for a vehicle: no vertex."""
AT_GOAL = (1 << 31) - 1
"""The time in the key of a vehicle at its goal."""
STEP_ASIDE = 0.3
"""How often a vehicle makes room while stronger ones act."""
MOST_RETREATS = 64
"""How often a vehicle goes back before it has been at its goal again."""
Key: TypeAlias = tuple[int, int]


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
    def key(self) -> Key:
        """Return the key that it acts with."""
        return self.key_time, self.key_vehicle

    @property
    def push(self) -> tuple[int, ...]:
        """Return what names the push."""
        return self[2:7]


class _OnRoads:
    """A vehicle among pushes, in a run with rounds or without."""

    def __init__(self, knowledge: InitialKnowledge) -> None:
        graph = knowledge.system.graph
        if graph is None:
            raise InputError("rule 'pibt' is for vehicles on a graph")
        if len(knowledge.goals) != 1:
            raise InputError(f"rule 'pibt' needs one goal a vehicle, found {len(knowledge.goals)}")
        self._graph = graph
        self._roads = roads_of(graph)
        self._knowledge = knowledge
        self._goal = graph.index[knowledge.goals[0]]

    def _below(self, said: PushRegister | PushNote, at: int) -> list[int]:
        """Return the vertices that a vehicle at `at` pushes towards: w, or those one deeper."""
        if at == said.pusher:
            return [said.pushed]
        depth = self._roads.distances(said.pushed, said.pusher)
        return [other for other in self._roads.near[at] if depth[other] == depth[at] + 1]

    def _best(self, free: Iterable[int], closed: Collection[int], heard: Collection[int]) -> int:
        """Return the best of the empty vertices that are not closed."""
        distance = self._roads.distances(self._goal)

        def cost(vertex: int) -> tuple[int, int, float]:
            onward = sum(way not in heard for way in self._roads.nearer(vertex, self._goal))
            return distance[vertex], -onward, self._knowledge.random.random()

        return min((vertex for vertex in free if vertex not in closed), key=cost, default=NOWHERE)


class _FreeVehicle(_OnRoads):
    def __init__(self, knowledge: InitialKnowledge) -> None:
        """Note what it knows; its only goal is its own vertex."""
        super().__init__(knowledge)
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

    def _give_way(self, turn: _Turn, push: PushRegister) -> Choice:
        mine = turn.mine
        follows = PushRegister(mine.time, mine.moves, *push.push)
        if mine.push != follows.push:
            return self._say(turn, follows)
        further = self._below(follows, turn.here)
        free = [other for other in further if other not in turn.taken]
        want = self._best(free, self._closed(turn, push.key), turn.heard)
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
        free = [way for way in ways if way not in turn.taken]
        want = self._best(free, self._closed(turn, self._key(turn)), heard)
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

    def _closed(self, turn: _Turn, key: Key) -> set[int]:
        """Return the vertices that are closed to a vehicle with this key."""
        return {
            vertex
            for at, said in turn.heard.items()
            if said.key < key and said.pusher != NOWHERE
            for vertex in self._below(said, at)
        }


class _Turn(NamedTuple):
    """What a vehicle knows in a turn; vertices by number."""

    view: View
    here: int
    mine: PushRegister
    heard: Mapping[int, PushRegister]
    taken: Collection[int]


class PushNote(NamedTuple):
    """A vehicle's note; vertices by number."""

    key: int
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

    def pushes(self, at: int) -> bool:
        """Return whether it pushes from `at`, where it now stands."""
        return self.pusher != NOWHERE and (self.want == NOWHERE or self.pusher == at)

    def says_full(self, push: PushNote) -> bool:
        """Return whether it says that it is full for a push."""
        return self.full == 1 and (self.key, *self[3:5]) == (push.key, *push[3:5])


class _Vehicle(_OnRoads):
    def __init__(self, knowledge: InitialKnowledge) -> None:
        """Note what it knows; its only goal is its own vertex."""
        super().__init__(knowledge)
        self._round = 0
        self._at_goal = 0  # the last round there
        self._away = 0  # rounds elsewhere
        self._place = NOWHERE
        self._target = NOWHERE  # what it pushes, or will when it arrives
        self._given_up: set[int] = set()  # full ways from this place
        self._shut: set[int] = set()  # dead ends in which vehicles were at their goals
        self._pull: tuple[PushNote, int] | None = None  # what it said, and whom it pulls, by goal
        self._retreats = 0  # since it was at its goal

    @property
    def _key(self) -> int:
        return self._at_goal * self._knowledge.modules + self._knowledge.module

    @property
    def _own(self) -> PushNote:
        return PushNote(self._key, self._goal, self._goal)

    def __call__(self, view: View) -> Choice:
        index = self._graph.index
        self._round += 1
        here = index[view.place]
        if here != self._place:
            self._place = here
            self._given_up.clear()
        if here == self._goal:
            self._rank_last()
        else:
            self._away += 1
        heard = {index[place]: PushNote(*note) for place, note in view.notes.items()}
        self._look_at_dead_ends([index[place] for place in view.system.reach(view.place)], heard)
        said = self._decide(heard, {index[place] for place in view.occupied})
        vertices = self._graph.vertices
        action = STAY
        for slot, move in view.legal():
            if said.want != NOWHERE and view.system.place_of(move.target) == vertices[said.want]:
                action = slot
        return Choice(action, tuple(said), self._failed())

    def _rank_last(self) -> None:
        self._at_goal = self._round
        self._retreats = 0

    def _look_at_dead_ends(self, seen: Iterable[int], heard: Mapping[int, PushNote]) -> None:
        for vertex in seen:
            if len(self._roads.near[vertex]) == 1:
                self._shut.discard(vertex)
                if vertex in heard and heard[vertex].goal == vertex:
                    self._shut.add(vertex)

    def _failed(self) -> str | None:
        start, goal = self._knowledge.start, self._knowledge.goals[0]
        if self._round == 1 and self._roads.distances(self._goal)[self._place] < 0:
            return f"no way from {self._knowledge.system.place_of(start)!r} to the goal {goal!r}"
        most = patience(len(self._graph.vertices))
        if self._away > most:
            return f"more than {most} rounds away from the goal {goal!r}: others are in the way"
        return None

    def _decide(self, heard: Mapping[int, PushNote], taken: set[int]) -> PushNote:
        waiting, self._pull = self._pull, None
        push, pull = self._heard_push(heard), self._heard_pull(heard)
        if pull is not None and (push is None or pull.key < push.key):
            self._target = NOWHERE
            return self._follow(pull, heard, taken)
        if push is not None:
            self._target = NOWHERE
            return self._give_way(push, heard, taken)
        if self._place == self._goal:
            return self._own
        if waiting is not None and self._may_follow(*waiting, heard, taken):
            self._pull = waiting
            return waiting[0]
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

    def _heard_pull(self, heard: Mapping[int, PushNote]) -> PushNote | None:
        """Return the strongest pull that this vehicle must follow, or has just followed, if any."""
        heeded = [said for said in heard.values() if self._place in (said.pulled, said.left)]
        return min((said for said in heeded if said.key < self._key), default=None)

    def _follow(self, pull: PushNote, heard: Mapping[int, PushNote], taken: set[int]) -> PushNote:
        """Enter the vertex that the puller has left; who stands there waits for the next order."""
        follows = PushNote(pull.key, self._goal, pull.aim)
        open_to_it = pull.left not in taken and pull.left not in self._closed(pull.key, heard)
        if open_to_it and self._place == pull.pulled:
            return follows._replace(want=pull.left)
        return follows

    def _may_follow(
        self, pull: PushNote, goal: int, heard: Mapping[int, PushNote], taken: set[int]
    ) -> bool:
        """Return whether the vehicle with that goal, which this one pulls, may still follow."""
        other = heard.get(pull.pulled)
        comes = other is not None and other.goal == goal and other.key >= pull.key
        return comes and self._place == pull.want and pull.left not in taken

    def _give_way(self, push: PushNote, heard: Mapping[int, PushNote], taken: set[int]) -> PushNote:
        further = self._below(push, self._place)
        follows = PushNote(push.key, self._goal, push.aim)
        hinders = self._head_on(further, heard, push.key)
        hinders.update(self._roads.nearer(self._place, push.aim))
        full = {other for other in further if other in heard and heard[other].says_full(push)}
        free = [other for other in further if other not in taken]
        if not hinders.union(full).issuperset(further):
            free = [other for other in free if other not in hinders]
        want = self._best(free, self._closed(push.key, heard), heard)
        if want != NOWHERE:
            return follows._replace(want=want)
        all_full = int(full.issuperset(further))
        return follows._replace(pusher=push.pusher, pushed=push.pushed, full=all_full)

    def _head_on(
        self, ways: Iterable[int], heard: Mapping[int, PushNote], weakest: int
    ) -> set[int]:
        """Return the ways on which this vehicle would have to change places with a neighbour.

        `weakest` is the greatest key of a neighbour that counts.
        """
        here, swap = self._place, self._roads.swap
        strong = [at for at in self._roads.near[here] if at in heard and heard[at].key <= weakest]
        return {
            way
            for way in ways
            for at in strong
            if way != at and swap((here, heard[at].goal), (way, self._goal), self._shut)
        }

    def _go(self, heard: Mapping[int, PushNote], taken: set[int]) -> PushNote:
        here, key = self._place, self._key
        ways = self._roads.nearer(here, self._goal)
        closed = self._closed(key, heard) | self._head_on(ways, heard, key - 1)
        want = self._best([way for way in ways if way not in taken], closed, heard)
        if want != NOWHERE:
            return self._advance(want, heard)
        self._note_full(heard)
        pull = self._retreat(ways, heard, taken)
        if pull is not None:
            return pull
        ways = [way for way in ways if way not in self._given_up]
        if not ways:
            self._rank_last()
            self._given_up.clear()
        self._target = self._weaker(ways, heard)
        if self._target == NOWHERE:
            return self._step_aside(closed, heard, taken)
        return self._own._replace(pusher=here, pushed=self._target)

    def _advance(self, want: int, heard: Mapping[int, PushNote]) -> PushNote:
        """Claim a nearer vertex, and announce the push from there that can be foreseen."""
        ahead = self._roads.nearer(want, self._goal)
        blocked = all(way in heard for way in ahead)
        self._target = self._weaker(ahead, heard) if blocked else NOWHERE
        claim = self._own._replace(want=want)
        if self._target == NOWHERE:
            return claim
        return claim._replace(pusher=want, pushed=self._target)

    def _note_full(self, heard: Mapping[int, PushNote]) -> None:
        for way in self._roads.near[self._place]:
            push = self._own._replace(pusher=self._place, pushed=way)
            if way in heard and heard[way].says_full(push):
                self._given_up.add(way)

    def _step_aside(
        self, closed: Collection[int], heard: Mapping[int, PushNote], taken: set[int]
    ) -> PushNote:
        """Stay while stronger vehicles act, or sometimes make room."""
        want = NOWHERE
        if self._knowledge.random.random() < STEP_ASIDE:
            free = [other for other in self._roads.near[self._place] if other not in taken]
            want = self._best(free, closed, heard)
        return self._own._replace(want=want)

    def _retreat(
        self, ways: Iterable[int], heard: Mapping[int, PushNote], taken: set[int]
    ) -> PushNote | None:
        """Return the note of a vehicle that goes back and pulls the one in its way, if it must."""
        me = self._place, self._goal
        for way in ways if self._retreats < MOST_RETREATS else ():
            other = heard.get(way)
            if other is None or other.key < self._key:
                continue
            if self._roads.swap(me, (way, other.goal), self._shut):
                pull = self._own._replace(pulled=way, left=self._place)
                return self._go_back(pull, other.goal, heard, taken)
        return None

    def _go_back(
        self, pull: PushNote, other: int, heard: Mapping[int, PushNote], taken: set[int]
    ) -> PushNote | None:
        """Go to a vertex behind, best one that the other does not need; push who stands there."""
        here, distance = self._place, self._roads.distances(self._goal)
        back = [way for way in self._roads.near[here] if way != pull.pulled]
        needed = self._roads.nearer(here, other)

        def cost(way: int) -> tuple[bool, int, int]:
            return way in needed, -distance[way], way

        closed = self._closed(self._key, heard) | taken
        want = min((way for way in back if way not in closed), key=cost, default=NOWHERE)
        if want != NOWHERE:
            self._retreats += 1
            self._pull = pull._replace(want=want), other
            return self._pull[0]
        back = [way for way in sorted(back, key=cost) if way not in self._given_up]
        self._target = self._weaker(back, heard)
        if self._target == NOWHERE:
            return None
        return pull._replace(pusher=here, pushed=self._target)

    def _weaker(self, ways: Iterable[int], heard: Mapping[int, PushNote]) -> int:
        """Return the way to push: the one being pushed if that is allowed, else the first."""
        may = [way for way in ways if way in heard and heard[way].key >= self._key]
        return min(may, key=lambda way: way != self._target, default=NOWHERE)

    def _closed(self, key: int, heard: Mapping[int, PushNote]) -> set[int]:
        """Return the vertices that are closed to a vehicle with this key."""
        closed: set[int] = set()
        for at, said in heard.items():
            if said.key < key:
                closed.update((said.want, said.left))
                if said.pushes(at):
                    closed.update(self._below(said, at))
        return closed


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
        make=_FreeVehicle,
        note_length=lambda _: len(PushRegister._fields),
    ),
)
