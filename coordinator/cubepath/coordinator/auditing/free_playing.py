"""Playing the rules of a run without rounds again, each module turn by turn.

Each module gets an `Actor` of its own, and a new one whenever its process began anew, as in a run;
it is given the observation that verification derives from the versions that the turn names.
"""

from __future__ import annotations

from collections.abc import Callable, Collection

from cubepath.agents.local.random_streams import HESITATE, RULE, stream
from cubepath.agents.rules.actor import Actor
from cubepath.agents.rules.registry import permitted_rule, rule_named
from cubepath.agents.rules.rule import Choice, InitialKnowledge, RuleType
from cubepath.agents.rules.schedule import SCHEDULE
from cubepath.coordinator.verification.free_transcript import turn_text
from cubepath.coordinator.verification.free_turns import Seen
from cubepath.coordinator.verification.parameters import hesitation_in, seed_in
from cubepath.coordinator.verification.transcript import site_in
from cubepath.protocol.core.errors import CubepathError, InputError, RuleError
from cubepath.protocol.recordings.recording import Recording
from cubepath.protocol.wire.free_messages import Turn


class FreeRuleAudit:
    """The rules of a recording; the `FreePlayer` of its verification."""

    def __init__(self, recording: Recording, files: Collection[str] = ()) -> None:
        """Find the rule; `unchecked` names what cannot be asked again.

        Of rules in files those of `files`, each FILE.py:NAME, are asked.
        """
        self._given = files
        self._scene = recording.scene
        self._seed = seed_in(recording.parameters)
        self._hesitate = hesitation_in(recording.parameters)
        self._unchecked: str | None = None
        self._wrong: str | None = None
        self._rule: RuleType | None = None
        self._length = 0
        self._actors: dict[int, Actor | None] = {}
        self._find(recording)

    def _find(self, recording: Recording) -> None:
        name = recording.parameters.get("rule")
        for key, value in (("rule", name), ("seed", self._seed), ("hesitate", self._hesitate)):
            if value is None:
                self._unchecked = f"the recording names no {key}"
                return
        if name is None or name == SCHEDULE or recording.schedule is not None:
            self._unchecked = None if recording.schedule is not None else "there is no schedule"
            return
        try:
            name = permitted_rule(name, self._given)
            self._rule = rule_named(name, self._scene.system, "free")
        except InputError as error:
            self._unchecked = str(error)
            return
        try:
            self._length = self._rule.length(len(self._scene.start), "free")
        except RuleError as error:
            self._rule, self._wrong = None, str(error)

    def unchecked(self) -> str | None:
        """Return in one line what was not asked again, and why; None if all was."""
        return self._unchecked

    def end(self, fail: Callable[[str], None]) -> None:
        """Say what is wrong with the rule itself."""
        if self._wrong is not None:
            fail(self._wrong)

    def turn(self, seen: Seen, fail: Callable[[str], None]) -> None:
        """Ask the rule in a turn, and call `fail` with one line for each other choice."""
        turn, rule = seen.turn, self._rule
        if rule is None:
            return
        if bool(turn.heard) != bool(self._length and self._reach(seen)):
            fail(f"{turn_text(turn)}: its rule hears {'others' if self._length else 'nobody'}")
        if seen.fresh:
            self._actors[turn.module] = self._born(rule, seen)
        actor = self._actors.get(turn.module)
        if actor is None:
            return
        try:
            choice = actor.act(seen.arrays(self._length))
        except RuleError as error:
            choice = Choice(failed=str(error))
        if _is_bare(turn) and choice == Choice(turn.action):
            return  # as nearly always, and as fast as can be
        for what, told, due in _compared(turn, choice):
            if told != due:
                fail(f"{turn_text(turn)}: its {what} is {told}, by its rule it is {due}")

    def _reach(self, seen: Seen) -> bool:
        return bool(self._scene.system.reach(self._scene.system.place_of(seen.site)))

    def _born(self, rule: RuleType, seen: Seen) -> Actor | None:
        module, seed = seen.turn.module, self._seed or 0
        knowledge = InitialKnowledge(
            system=self._scene.system,
            module=module,
            modules=len(self._scene.start),
            start=seen.entered,
            goals=self._scene.goals[module] if self._scene.goals else (),
            stream=stream(seed, module, RULE),
        )
        doubt = stream(seed, module, HESITATE) if self._hesitate else None
        try:
            return Actor(rule, knowledge, hesitate=self._hesitate or 0.0, doubt=doubt, clock="free")
        except CubepathError as error:
            self._wrong = self._wrong or str(error)
            return None


def _is_bare(turn: Turn) -> bool:
    """Return whether nothing but an action was chosen in a turn."""
    more = turn.guards or turn.heeds or turn.exchanges
    return not more and turn.note is None and turn.failed is None


def _compared(turn: Turn, choice: Choice) -> list[tuple[str, object, object]]:
    """Return what is on record beside what the rule chose."""
    exchanges = {site_in(place): list(note) for place, note in turn.exchanges}
    return [
        ("action", turn.action, choice.action),
        ("note", turn.note, None if choice.note is None else list(choice.note)),
        ("guards", [site_in(each) for each in turn.guards], list(choice.guards)),
        ("heeds", [site_in(each) for each in turn.heeds], list(choice.heeds)),
        ("exchanges", exchanges, {at: list(note) for at, note in choice.exchanges.items()}),
        ("giving up", turn.failed, choice.failed),
    ]
