"""The rules `crossing` and `geodesic`: a module takes a legal move that brings it nearer.

It keeps nothing in mind and says nothing. It senses only whether its own moves are legal, and knows
its goals; how far it is from them is `OwnPotential`. Under both rules some module has such a move
while the goal is not reached, and every such move lowers the sum of the potentials, so the goal is
reached after at most as many moves as that sum. In every round the claim that outranks all others
is granted, so hesitation and lost claims cost rounds and nothing else. Without rounds a move
is committed only if it is admissible, so each commit lowers the sum, whatever it was chosen on;
while none is committed every module comes to see what holds, and the next attempt of one that can
come nearer succeeds.

`crossing`, for triangulations: a diagonal flips if the new one crosses fewer edges of the goal.
Source: Hanke, Ottmann and Schuierer, The edge-flipping distance of triangulations (1996), who show
that some flip lowers the number of crossings while there are any. The number of rounds is not the
least: it was 1.10 times the proved optimum in the mean over 20 random scenes of 30 to 60 points.

`geodesic`, for systems whose states are order ideals: a place changes its letter towards its letter
in the goal. Source: geodesics of CAT(0) cube complexes, Niblo and Reeves (1998); Ardila, Owen and
Sullivant (2012). Each place goes through its letters in a line, one at a time; a *step* is that it
goes from one to the next. Some steps *need* others: a move that makes a step reads that what it
needs is made, and that what needs it is not (`step_needs` checks this). So the states that are
reached from an ideal, a set of steps that holds all that its steps need, are all ideals; the start
and the goal of a scene are ideals. Let I be the state and G the goal.

- A step in I and not in G that no other such step needs can be undone: whatever needs it is not in
  G, so not in I. A step in G and not in I that needs no other such step can be made. So I and G
  differ by one step less after each move, and there is such a move while they differ. These are the
  moves that cross a hyperplane that separates I from G, since a hyperplane is a step.
- Such moves commute. If those of the steps s and t did not, one would need the other, say t needs
  s. Both are made: then s is made before t can be. Both are undone: then t is undone first. If s is
  undone, t is in I or in G only if s is, so t is made only if s is in G: s is not undone.
- So no claim is ever lost. A step is made, or undone, as soon as all that must precede it are, each
  of which takes a round in every path: the number of rounds is the least possible.

The positive arm is such a system, too, with segments in place of places; its rule is `word`, which
needs no neighbour that says which height it has.
"""

from cubepath.agents.local.observation import STAY, View
from cubepath.agents.rules.potential import OwnPotential
from cubepath.agents.rules.rule import FreeRule, InitialKnowledge, Rule, RuleType
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.ideals import step_needs


def make(knowledge: InitialKnowledge) -> Rule:
    """Return the rule of one module; InputError if it knows no goal."""
    if not knowledge.goals:
        raise InputError(f"module_{knowledge.module} has no goal to come nearer to")
    potential = OwnPotential(knowledge)

    def choose(view: View) -> int:
        here = potential.of(view.site)
        nearer = (action for action, move in view.legal() if potential.of(move.target) < here)
        return next(nearer, STAY)

    return choose


CROSSING = RuleType(
    name="crossing",
    summary="a diagonal flips if the new one crosses fewer edges of the goal",
    source="Hanke, Ottmann and Schuierer, The edge-flipping distance of triangulations",
    fits=lambda system: system.descends,
    make=make,
    free=FreeRule(why="each commit lowers the number of crossings, and some flip always can"),
)

GEODESIC = RuleType(
    name="geodesic",
    summary="a place changes its letter towards the goal as soon as what this needs is there",
    source="Niblo and Reeves; Ardila, Owen and Sullivant: geodesics of CAT(0) cube complexes",
    fits=lambda system: step_needs(system) is not None,
    make=make,
    free=FreeRule(
        why="each commit crosses a hyperplane that separates from the goal, and some can"
    ),
)
