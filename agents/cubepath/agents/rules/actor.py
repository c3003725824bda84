"""An actor: one module's rule with its memory, from PettingZoo observation to action.

The same actor acts for a module in the environment and in a process on the wire.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from cubepath.agents.local.observation import STAY, Array, checked_note, is_legal, view_of
from cubepath.agents.local.random_streams import HESITATE, RULE, RandomStream, stream
from cubepath.agents.rules.rule import Choice, InitialKnowledge, RuleType, as_choice
from cubepath.protocol.core.errors import InputError, RuleError
from cubepath.protocol.core.sites import Site
from cubepath.protocol.core.system import Scene


class Actor:
    """Acts for one module: asks its rule for a choice, and may hesitate to claim it.

    With `hesitate` P the module makes no claim in a round with probability P. Its rule is still
    asked and its note is still sent, as if the claim had been lost. Under the free clock nothing
    comes of the whole choice, as if the attempt had been refused.
    """

    def __init__(
        self,
        rule: RuleType,
        knowledge: InitialKnowledge,
        *,
        hesitate: float = 0.0,
        doubt: RandomStream | None = None,
        clock: str = "lockstep",
    ) -> None:
        """Make the rule for this module, with all that it knows; `doubt` decides hesitations."""
        self.note_length = rule.length(knowledge.modules, clock)
        self._clock = clock
        self._who = f"rule {rule.name!r}, module_{knowledge.module}"
        try:
            with RuleBlame(self._who):
                self._rule = rule.made(knowledge, clock)
        except RuleError as error:
            if isinstance(error.__cause__, InputError):  # the rule does not fit the scene
                raise error.__cause__ from None
            raise
        self._knowledge = knowledge
        self._hesitate = hesitate
        self._doubt = doubt

    def act(self, observation: Mapping[str, Array]) -> Choice:
        """Return the rule's choice, checked; RuleError if the rule fails or chooses badly."""
        view = view_of(self._knowledge.system, observation, self._knowledge.label)
        with RuleBlame(self._who):
            choice = as_choice(self._rule(view))
            if not is_legal(view.mask, choice.action):
                legal = view.mask.nonzero()[0].tolist()
                raise InputError(f"chose action {choice.action}, legal were {legal}")
            note = None if choice.note is None else checked_note(choice.note, self.note_length)
            exchanges = {
                place: checked_note(new, self.note_length)
                for place, new in choice.exchanges.items()
            }
        hesitates = self._doubt is not None and self._doubt.fraction() < self._hesitate
        if self._clock == "lockstep":
            return Choice(STAY if hesitates else choice.action, note, choice.failed)
        if hesitates:
            return Choice(failed=choice.failed)
        if note is None and not exchanges:
            return choice
        return replace(choice, note=note, exchanges=exchanges)


class RuleBlame:
    """Turns any error in a rule into one line that names the rule and its module."""

    def __init__(self, who: str) -> None:
        """Know who is to blame."""
        self._who = who

    def __enter__(self) -> None:
        """Begin with the rule."""

    def __exit__(self, _: object, error: BaseException | None, __: object) -> None:
        """Raise RuleError for what the rule has raised."""
        if isinstance(error, InputError):
            raise RuleError(f"{self._who}: {error}") from error
        if isinstance(error, (Exception, SystemExit)):
            text = " ".join(str(error).split())
            raise RuleError(f"{self._who}: {type(error).__name__}: {text}") from error


def actors_for(
    scene: Scene,
    rule: RuleType,
    *,
    seed: int,
    hesitate: float,
    modules: list[int] | None = None,
    sites: Mapping[int, Site] | None = None,
    clock: str = "lockstep",
) -> dict[int, Actor]:
    """Return an actor for each of the modules (by default all).

    `sites` says where they stand; by default at the start of the scene.
    """
    count = len(scene.start)
    return {
        module: Actor(
            rule,
            InitialKnowledge(
                system=scene.system,
                module=module,
                modules=count,
                start=scene.start[module] if sites is None else sites[module],
                goals=scene.goals[module] if scene.goals else (),
                stream=stream(seed, module, RULE),
            ),
            hesitate=hesitate,
            doubt=stream(seed, module, HESITATE) if hesitate else None,
            clock=clock,
        )
        for module in (range(count) if modules is None else modules)
    }
