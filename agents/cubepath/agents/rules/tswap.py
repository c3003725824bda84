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

Some rounds bring nothing: neither a move nor a smaller F. On dense grids these are the rounds in
which a long cycle is found, while all the rest stands. No rule whose notes go two vertices a round
can do without them, as long as F must not grow. Take a blocked cycle of k vehicles that are equally
far from their goals, on a graph in which any two neighbours differ by one in their distance to a
goal. There an exchange of neighbours takes one goal nearer and another further, which raises F,
and only a turn of the whole cycle lowers it. A line of vehicles that stand and want alike, but for
the vertex opposite, looks the same to each for k/4 rounds, and if it turned, the goal of its first
vehicle would go to its last. So about k/4 rounds must pass; the rule takes up to 3k.

Hesitation and lost claims only cost time, since wants and goals do not depend on them. Distances
are those of the static map; a vehicle without a way to its goal at birth gives up in one line,
since it cannot know which goals in its part of the map are held by vehicles elsewhere.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

from cubepath.agents.local.observation import View
from cubepath.agents.rules.rule import Choice, FreeRule, InitialKnowledge, RuleType
from cubepath.agents.rules.tswap_free import FreeTswapVehicle, GoalRegister
from cubepath.agents.rules.vehicle import Vehicle

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


class _Vehicle(Vehicle[ExchangeNote]):
    def __init__(self, knowledge: InitialKnowledge) -> None:
        super().__init__("tswap", knowledge, ExchangeNote)
        self._place = self._graph.index[knowledge.start]
        self._note_out = ExchangeNote(self._goal, NOBODY, NOBODY, NOBODY, 0, 0, 0, 0, NOBODY)
        self._want = self._next(self._place, self._goal, ())
        self._second = self._want
        self._blocked = NOBODY  # earlier rounds blocked by the same vehicle
        self._passed_on = False  # a probe, since it was blocked
        self._countdown = 0
        self._height = 0
        self._failed = self._lost()

    def __call__(self, view: View) -> Choice:
        before = self._place
        self._look(view)
        if self._place != before:
            self._turn_to(self._second)
        probe = (NOBODY, 0)
        goal = self._new_goal()
        self._goal = self._exchanged() if goal is None else goal
        if goal is not None or self._want not in self._roads.nearer(self._place, self._goal):
            self._turn_to(self._next(self._place, self._goal, self._taken))
        elif self._want in self._heard and self._heard[self._want].goal != self._want:
            probe = self._wait()
        else:
            self._turn_to(self._want)
        return self._say(view, probe)

    def _turn_to(self, want: int) -> None:
        self._want = want
        self._blocked = NOBODY
        self._passed_on = False
        self._countdown = 0

    def _new_goal(self) -> int | None:
        """Return the goal that an exchange or a rotation brings in this round, if any."""
        here, want = self._place, self._want
        behind = {at: note for at, note in self._heard.items() if note.want(at) == here}
        if self._goal == here:
            return max((note.goal for note in behind.values()), default=None)
        if want not in self._heard:
            return None
        if self._heard[want].goal == want:
            rivals = [note.goal for at, note in self._heard.items() if note.want(at) == want != at]
            return want if self._goal > max(rivals, default=NOBODY) else None
        for note in behind.values():
            if note.countdown == 1:
                return note.goal
        return None if self._note_out.grant != NOBODY else self._round_goal(behind)

    def _round_goal(self, behind: Mapping[int, ExchangeNote]) -> int | None:
        """Return the goal behind this vehicle in a short blocked cycle, in which nobody grants."""
        at = self._want
        for _ in range(SEEN_WHOLE - 1):
            if at not in self._heard or self._heard[at].grant != NOBODY:
                break
            if at in behind:
                return behind[at].goal
            at = self._heard[at].want(at)
        return None

    def _exchanged(self) -> int:
        """Return the goal after the exchange that this vehicle granted, or that it was granted."""
        here, grant = self._place, self._note_out.grant
        back, front = (here, self._want) if grant == NOBODY else (grant, here)
        notes = {**self._heard, here: self._note_out}
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

    def _grant(self, mine: ExchangeNote) -> int:
        """Return where the vehicle stands behind this one with which it may exchange goals."""
        here, notes = self._place, {**self._heard, self._place: mine}
        behind = {at: other for at, other in self._heard.items() if other.want(at) == here}
        short_cycle = self._round_goal(behind) is not None
        if self._blocked < 1 or short_cycle or self._knowledge.random.random() < 0.5:
            return NOBODY
        may = [at for at in behind if self._gains(at, here, notes)]
        distances = self._roads.distances
        return max(may, key=lambda at: (distances(behind[at].goal)[at], at), default=NOBODY)

    def _wait(self) -> tuple[int, int]:
        """Wait behind a vehicle that is not at its goal; return the probe to say."""
        self._blocked += 1
        behind = [note.height for at, note in self._heard.items() if note.want(at) == self._place]
        self._height = min(SEEN_WHOLE, 1 + max(behind, default=-1))
        self._countdown = max(self._countdown - 1, 0)
        for at, note in self._heard.items():
            if note.countdown > 1 and note.want(at) == self._place:
                self._countdown = note.countdown - 1
        ahead = self._heard[self._want]
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
            want = self._next(self._place, self._goal, self._taken)
            if want in self._taken:
                want = self._opposed()
            if want != self._want:
                self._turn_to(want)
                return (NOBODY, 0)
        return probe

    def _opposed(self) -> int:
        """Return where a vehicle stands that can come nearer by an exchange with this one.

        Of several such pairs, that of the smallest vertices comes first, so both choose it.
        """
        here = self._place
        pairs = [
            (min(here, way), max(here, way), way)
            for way in self._roads.nearer(here, self._goal)
            if (note := self._heard.get(way)) is not None
            and not note.held
            and here in self._roads.nearer(way, note.goal)
        ]
        return min(pairs)[2] if pairs else self._want

    def _say(self, view: View, probe: tuple[int, int]) -> Choice:
        self._second = self._next(self._want, self._goal, self._heard)
        held = int(self._passed_on or self._countdown > 0)
        known = self._goal, self._want, self._second, *probe, self._countdown, held, self._height
        note = ExchangeNote(*known, grant=NOBODY)
        note = self._note_out = note._replace(grant=self._grant(note))
        return Choice(self._action(view, self._want), tuple(note), self._failed)


TSWAP = RuleType(
    name="tswap",
    summary="vehicles go to their goals and exchange them with neighbours that are in the way",
    source="Okumura and Defago, TSWAP (target assignment and path planning), made local",
    fits=lambda system: system.graph is not None and system.labels is None,
    make=_Vehicle,
    note_length=lambda _: len(ExchangeNote._fields),
    free=FreeRule(
        why="goals are exchanged in one commit, and each commit comes nearer; a probe that returns"
        " has found a blocked cycle, which turns",
        make=FreeTswapVehicle,
        note_length=lambda _: len(GoalRegister._fields),
    ),
)
