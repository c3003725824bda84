"""A rule with messages: hexagons of `hex-open` move one by one, and stay connected.

Only the token's holder moves, if no neighbour is farther from the first goal cell along the
modules: that is the end of a way, so no other module hangs on it.
"""

from cubepath.agents import (
    Choice,
    Gradient,
    InitialKnowledge,
    Rule,
    RuleType,
    SiteDistances,
    Token,
    View,
)


def make(knowledge: InitialKnowledge) -> Rule:
    """Make the rule of one module."""
    me, count, stream = knowledge.module, knowledge.modules, knowledge.stream
    far = {goal: SiteDistances(knowledge.system, goal) for goal in knowledge.goals}
    token = Token(me, int(me == 0), me)

    def choose(view: View) -> Choice:
        nonlocal token
        q, r = view.place
        beside = {(q + a, r + b) for a in (-1, 0, 1) for b in (-1, 0, 1) if a != b}
        near = [Gradient(*note[:3]) for place, note in view.notes.items() if place in beside]
        source = view.place == knowledge.goals[0]
        way = Gradient.next(me, near, modules=count, source=source)
        others = [Token(*note[3:]) for note in view.notes.values()]
        had, token = token.mine, token.passed(others) if token.mine else token.taken(others)
        last = way.hops < count and all(other.hops <= way.hops for other in near)
        free = [far[goal] for goal in far if goal not in view.occupied]
        for action, move in view.legal() if last and token.mine and not had else ():
            here, there = (min(d.of(site) for d in free) for site in (view.site, move.target))
            if stream.fraction() < (0.5 if there <= here else 0.1):
                return Choice(action, (me, count, me, *token))  # its hops are unknown there
        return Choice(0, (*way, *token))

    return choose


WALKERS = RuleType(
    name="walkers",
    summary="hexagons move one by one, and stay connected",
    source="docs/extending.md",
    fits=lambda system: True,
    make=make,
    note_length=lambda modules: 6,
)
