"""The arm rule `word`: segments turn until the arm spells the goal word.

Source: own, from the lattice of height functions of a positive arm.

Let h(i) be the number of x among the first i letters: the x-coordinate of the vertex after segment
i, which segment i knows from its own place. Turning the corner after segment i, or rotating the
last segment, changes h(i) by one and no other height. So each segment moves only when that brings
it nearer to its own goal height H(i). The arm reaches the goal: sum |h - H| falls by one with each
move, and while h != H some such move is admissible. To see this, consider the segments with h(i) <
H(i), and choose the rightmost among those with the least h(i). If its letter were x, then h(i-1) =
h(i) - 1 < H(i) - 1 <= H(i-1), so segment i-1 would be one with less height. If the next letter were
y, then h(i+1) = h(i) < H(i) <= H(i+1), so segment i+1 would be one further right. So the letters
are y, x (or y and the end of the arm), and the corner turns upwards in h. The case h > H is
symmetric. A segment that lost its claim tries again; the highest claim always wins, so some move is
made in every round, and the word is spelt after at most sum |h - H| rounds.

Without rounds: whatever it was chosen on, a move is committed only if it is admissible, and it
brings its segment nearer to H(i), so at most sum |h - H| are committed. While none is, nothing
changes, so the segment of the argument comes to see what holds, and its next attempt is committed.
The rule keeps nothing in mind, so a segment that is started again continues as before.
"""

from cubepath.agents.local.observation import STAY, View
from cubepath.agents.rules.rule import FreeRule, InitialKnowledge, Rule, RuleType
from cubepath.protocol.core.catalogue import EDGES
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.sites import Site


def _height(edge: Site) -> int:
    """Return the x-coordinate of the vertex after a segment on this edge."""
    x, _, axis = EDGES.check(edge)
    return x + (1 if axis == 0 else 0)


def make(knowledge: InitialKnowledge) -> Rule:
    """Return the rule of one segment; its only goal is its own edge in the goal word."""
    if not knowledge.goals:
        raise InputError("rule 'word' needs a goal word")
    wanted = _height(knowledge.goals[0])

    def choose(view: View) -> int:
        short = wanted - _height(view.site)
        for action, move in view.legal():
            if abs(wanted - _height(move.target)) < abs(short):
                return action
        return STAY

    return choose


WORD = RuleType(
    name="word",
    summary="each segment of a positive arm turns towards its height in the goal word",
    source="own: heights of a positive arm, see cubepath.agents.rules.word",
    fits=lambda system: (
        system.catalogue is not None
        and system.catalogue.lattice == EDGES
        and set(system.catalogue.by_name) == {"flip", "rotate"}
    ),
    make=make,
    free=FreeRule(why="each commit brings one height nearer, and one always can come nearer"),
)
