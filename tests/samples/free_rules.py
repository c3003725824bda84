"""A rule for runs without rounds in tests: random moves with guards, registers and exchanges."""

from cubepath.agents.local.observation import View
from cubepath.agents.rules.rule import Choice, FreeRule, InitialKnowledge, Rule, RuleType


def make(knowledge: InitialKnowledge) -> Rule:
    """Return a rule that counts its turns, and tells the count to those near it now and then."""
    turns = 0

    def choose(view: View) -> Choice:
        nonlocal turns
        turns += 1
        random = knowledge.random
        legal = view.mask.nonzero()[0]
        action = int(legal[random.integers(len(legal))])
        near = [place for place in view.system.sensed(view.place) if place is not None]
        guards = tuple(place for place in near if random.random() < 0.2) if action else ()
        note = (turns, knowledge.module) if random.random() < 0.2 else None
        if random.random() < 0.3 and view.notes and view.register is not None:
            other = min(view.notes, key=repr)
            return Choice(note=view.notes[other], exchanges={other: view.register})
        heeds = tuple(view.notes)[:1] if random.random() < 0.3 else ()
        return Choice(action, note, guards=guards, heeds=heeds)

    return choose


GOSSIP = RuleType(
    name="gossip",
    summary="any legal action, with notes that are exchanged",
    source="own",
    fits=lambda _: True,
    make=make,
    note_length=lambda _: 2,
    free=FreeRule("any action is legal", note_length=lambda _: 2),
)
