"""A rule for runs without rounds that uses all there is: moves, guards, registers, exchanges."""

from collections.abc import Sequence

from cubepath.agents.local.observation import STAY, View
from cubepath.agents.rules.rule import Choice, FreeRule, InitialKnowledge, Rule, RuleType
from cubepath.protocol.core.sites import Site, in_order


def make(knowledge: InitialKnowledge) -> Rule:
    """Return a rule that draws everything from the module's own stream."""
    draw = knowledge.random

    def some(places: Sequence[Site]) -> tuple[Site, ...]:
        return tuple(place for place in places if draw.random() < 0.5)

    def choose(view: View) -> Choice:
        legal = view.mask.nonzero()[0]
        action = int(legal[draw.integers(len(legal))])
        near = [place for place in knowledge.system.sensed(view.place) if place is not None]
        others = in_order(view.notes)
        exchanges: dict[Site, tuple[int, ...]] = {}
        if others and draw.random() < 0.3:
            exchanges = {others[draw.integers(len(others))]: (int(draw.integers(3)),)}
        return Choice(
            action,
            (int(draw.integers(3)),) if draw.random() < 0.4 else None,
            guards=() if action == STAY else some(near),
            heeds=some(others),
            exchanges=exchanges,
        )

    return choose


RESTLESS = RuleType(
    name="restless",
    summary="anything at all",
    source="none needed",
    fits=lambda _: True,
    make=make,
    free=FreeRule(why="it relies on nothing", make=make, note_length=lambda _: 1),
)
