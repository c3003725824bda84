"""A rule without memory that notes, so that it can begin anywhere and do the same."""

from collections.abc import Callable
from hashlib import sha256

from cubepath.agents.local.observation import View
from cubepath.agents.rules.rule import Choice, InitialKnowledge, RuleType

WHEN, WHO = 4, 3
"""In this round, counted from its birth, this module does other than by `noting`, in some rules."""


def _made(flavour: str) -> Callable[[InitialKnowledge], Callable[[View], Choice]]:
    def make(knowledge: InitialKnowledge) -> Callable[[View], Choice]:
        rounds = 0

        def choose(view: View) -> Choice:
            nonlocal rounds
            rounds += 1
            heard = sorted((repr(near), note) for near, note in view.notes.items())
            kind = "other" if flavour == "other" else "noting"
            seen = f"{kind} {knowledge.module} {view.site} {sorted(map(repr, view.occupied))}"
            drawn = sha256(f"{seen} {heard}".encode()).digest()
            legal = view.mask.nonzero()[0].tolist()
            action, note = legal[drawn[0] % len(legal)], (drawn[1], drawn[2])
            if (rounds, knowledge.module) == (WHEN, WHO):
                match flavour:
                    case "claiming":
                        action = legal[action == legal[0]]
                    case "notes":
                        note = (-1, -1)
                    case "giving_up":
                        return Choice(failed="no way")
                    case "raising":
                        raise ValueError("no idea")
                    case _:
                        pass
            return Choice(action, note=note)

        return choose

    return make


def _rule(name: str) -> RuleType:
    return RuleType(
        name=name,
        summary="claims and notes what follows from what it sees and hears alone",
        source="made up for tests",
        fits=lambda _: True,
        make=_made(name),
        note_length=lambda _: 2,
    )


noting = _rule("noting")
other = _rule("other")
"""Another one, whose notes are as long."""
claiming, notes, giving_up, raising = map(_rule, ("claiming", "notes", "giving_up", "raising"))
"""The same as `noting` but for one choice, one note, that a module gives up, or raises."""
