"""Playing the rules of a recording again: notes, choices, hesitation, and who gave up.

Each module gets its own `Actor`, as in a run, with the random streams of the recorded seed. The
actor receives the observation that verification derives, with the recorded notes, so that a changed
note is reported once, where it was sent.

For a schedule, this module derives which module has to make which move from where the modules
stand. A run assigns all moves before it begins; here each round is derived separately. The two
agree as long as every earlier cube was carried out, and after a cube that was not, the schedule is
over.

Without rounds, a module's rule is asked turn by turn, and a module gets a new `Actor` whenever its
process restarted. The observation is the one that verification derives from the versions that the
turn names.
"""

from collections import deque
from collections.abc import Callable, Collection, Mapping, Sequence
from typing import TypeAlias

from cubepath.agents.rules.actor import Actor, actors_for
from cubepath.agents.rules.registry import permitted_rule, rule_named, rules, stands_for
from cubepath.agents.rules.rule import Choice, RuleName, RuleType
from cubepath.agents.rules.schedule import SCHEDULE, scheduled
from cubepath.coordinator.verification.choices import Arrays, Moment, Observing
from cubepath.coordinator.verification.findings import Progress, Verification
from cubepath.coordinator.verification.free_transcript import turn_text
from cubepath.coordinator.verification.free_turns import TurnView
from cubepath.coordinator.verification.parameters import (
    RuleStage,
    hesitation_in,
    seed_in,
    spans,
    stages_in,
)
from cubepath.coordinator.verification.recording import verify
from cubepath.coordinator.verification.transcript import Transcript
from cubepath.protocol.core.catalogue import GeneratorPlacement, Move
from cubepath.protocol.core.errors import CubepathError, InputError, RuleError
from cubepath.protocol.core.input_files import Source
from cubepath.protocol.core.sites import Site, site_text
from cubepath.protocol.core.system import System
from cubepath.protocol.path_files.durations import Cubes, schedule_from_jsonl
from cubepath.protocol.recordings.recording import Recording, recording_of
from cubepath.protocol.wire.free_messages import Turn
from cubepath.protocol.wire.messages import Claim, Note

Part: TypeAlias = GeneratorPlacement
"""What one module has to do in a round."""
_NO_MOVE = (InputError, TypeError, IndexError, ValueError)
"""What a system says of a place of whatever form, which no file was checked for."""


class ScheduleParts:
    """The parts of the modules in a schedule."""

    def __init__(self, system: System, cubes: Cubes) -> None:
        """Take the recorded schedule; obstacles do not change whose move it is."""
        self._cubes = cubes
        placed = ((move.generator, move.at) for cube in cubes for move in cube)
        try:
            self._system = system.with_moves((name, at) for name, at in placed if at is not None)
        except _NO_MOVE:
            self._system = system

    def of_round(
        self, number: int, sites: Sequence[Site]
    ) -> tuple[dict[int, Part], list[GeneratorPlacement]]:
        """Return the part of each module that has one, and the moves that are nobody's.

        A move is its mover's if the modules in its trace are those that it takes along.
        """
        if not 1 <= number <= len(self._cubes):
            return {}, []
        where = {site: module for module, site in enumerate(sites)}
        own: dict[int, Part] = {}
        nobodys: list[GeneratorPlacement] = []
        for placed in self._cubes[number - 1]:
            move = self._move(placed, where)
            if move is None:
                nobodys.append(placed)
            else:
                own[where[move.source]] = GeneratorPlacement(move.generator, move.at)
        return own, nobodys

    def _move(self, placed: GeneratorPlacement, where: dict[Site, int]) -> Move | None:
        at = placed.at
        if at is None:
            return None
        try:
            action = self._system.action(placed.generator, at)
        except _NO_MOVE:
            return None
        on = {site for site in action.trace if site in where}
        for move in self._system.moves_of(action):
            if on == {source for source, _ in move.motion}:
                return move
        return None


def _unnamed(parameters: Mapping[str, str]) -> str | None:
    """Return in one line what is not on record of how modules chose; None if all is."""
    for key, value in (
        ("rule", parameters.get("rule")),
        ("seed", seed_in(parameters)),
        ("hesitate", hesitation_in(parameters)),
    ):
        if value is None:
            return f"the recording names no {key}"
    return None


_Fail = Callable[[str], None]
_Named = tuple[str, Site | None] | None
"""A move by its generator and place; None where there is none."""


class RuleAudit:
    """The rules of a recording; the `Player` of its verification."""

    def __init__(self, recording: Recording, files: Collection[str] = ()) -> None:
        """Find the rule; `unchecked` names what cannot be asked again.

        Of rules in files those of `files`, each FILE.py:NAME, are asked.
        """
        self._given = files
        self._foreign: dict[str, set[int]] = {}
        scene, parameters = recording.scene, recording.parameters
        self._scene = scene
        self._system = scene.system
        self._parameters = parameters
        self._observing = Observing(scene)
        self._seed = seed_in(parameters)
        self._hesitate = hesitation_in(parameters)
        self._wrong: str | None = None
        self._rules: dict[int, str] = {}
        self._actors: dict[int, Actor] = {}
        self._notes: dict[int, tuple[int, ...]] = {}
        self._first_choice = 1
        self._parts: ScheduleParts | None = None
        self._stages = deque(stages_in(recording))
        self._unchecked = _unnamed(parameters)
        if self._unchecked is None:
            if recording.schedule is not None:
                self._follow_schedule(recording.schedule)
            elif "stages" in parameters:
                self._unchecked = None if self._stages else "the stages on record are none"
            else:
                self._follow(parameters["rule"], 1, scene.start)

    def _follow_schedule(self, text: bytes) -> None:
        try:
            self._parts = ScheduleParts(self._system, schedule_from_jsonl(text))
        except InputError:
            self._unchecked = "the schedule on record is none"

    def _follow(self, name: str, first_choice: int, sites: Sequence[Site]) -> None:
        """Give every module a new actor with this rule, or say why not."""
        self._parts = None
        self._actors, self._notes = {}, {}
        self._first_choice = first_choice
        self._assign(name, list(range(len(sites))), sites)

    def _assign(self, name: str, modules: list[int], sites: Sequence[Site]) -> None:
        """Give modules new actors with a rule, or say why not."""
        found = self._installed(name)
        if found is None or self._seed is None or self._hesitate is None:
            return
        try:
            actors = actors_for(
                self._scene,
                found,
                seed=self._seed,
                hesitate=self._hesitate,
                modules=modules,
                sites=dict(enumerate(sites)),
            )
        except CubepathError as error:
            self._wrong = str(error)
            return
        self._actors |= actors
        self._rules |= dict.fromkeys(actors, found.name)
        for module, actor in actors.items():
            if len(self._notes.get(module, ())) != actor.note_length:
                self._notes[module] = (0,) * actor.note_length

    def _take_stages(self, moment: Moment) -> None:
        while self._stages and self._stages[0].begins <= moment.round:
            self._begin(self._stages.popleft(), moment)

    def _begin(self, stage: RuleStage, moment: Moment) -> None:
        """Follow the rules of a stage, each module from where it stands."""
        before, self._unchecked = self._unchecked, None
        self._actors = {}
        self._seed, self._hesitate = stage.seed, stage.hesitate
        if stage.heard:  # what was said last is still said; of unknown rules it is as on record
            for module in range(len(moment.sites)):
                note = moment.recorded.messages.get(("note", module))
                if module not in self._notes and isinstance(note, Note):
                    self._notes[module] = tuple(note.note)
        else:
            self._notes = {}
            self._first_choice = moment.round
        named = 0
        for name in stage.rules:
            modules = stage.modules(name)
            named += len(modules)
            self._assign(name, modules, moment.sites)
        if self._unchecked is None and named < len(moment.sites):
            self._unchecked = f"the rules of {len(moment.sites) - named} modules are not named"
        if self._unchecked is not None:
            self._unchecked = f"from round {stage.begins} on: {self._unchecked}"
        self._unchecked = "; ".join(filter(None, (before, self._unchecked))) or None

    def _installed(self, name: str) -> RuleType | None:
        if name == SCHEDULE:
            self._unchecked = "the schedule is not on record"
            return None
        try:
            name = permitted_rule(name, self._given)
        except InputError as error:
            self._unchecked = str(error)
            return None
        try:
            return rule_named(name, self._system)
        except InputError as error:
            if _is_known(name):
                self._wrong = str(error)
            else:
                self._unchecked = f"rule {name!r} is not installed"
            return None

    def unchecked(self) -> str | None:
        """Return in one line what was not asked again, and why; None if all was."""
        foreign = [
            f"module_{spans(modules)}, whose process names its own rule: {rule!r}"
            if len(modules) == 1
            else f"modules {spans(modules)}, whose processes name a rule of their own: {rule!r}"
            for rule, modules in sorted(self._foreign.items())
        ]
        return "; ".join(filter(None, (self._unchecked, *foreign))) or None

    def round(self, moment: Moment, transcript: Transcript, fail: _Fail) -> None:
        """Ask the rules in a round, and call `fail` for each choice that is another on record."""
        self._take_stages(moment)
        if self._parts is None:
            for module, rule in transcript.own_rules.items():
                self._actors.pop(module, None)
                self._foreign.setdefault(rule, set()).add(module)
        over = transcript.schedule_over
        if self._parts is not None and over is not None and moment.round > over:
            self._take_over(moment)
        if self._parts is not None:
            self._play_parts(self._parts, moment, fail)
        elif self._actors:
            self._play(moment, fail)
        self._tell(fail)

    def _take_over(self, moment: Moment) -> None:
        """Follow the rule that continues after the schedule, each module from where it stands."""
        name = self._parameters.get("repair")
        if name is None:
            self._parts = None
            self._unchecked = f"from round {moment.round} on: the recording names no rule"
            return
        self._follow(name, moment.round, moment.sites)
        if self._unchecked is not None:
            self._unchecked = f"from round {moment.round} on: {self._unchecked}"

    def _tell(self, fail: _Fail) -> None:
        """Say once what is wrong with the rule itself."""
        if self._wrong is not None:
            fail(self._wrong)
            self._wrong = None

    # A rule.

    def _play(self, moment: Moment, fail: _Fail) -> None:
        length = next(iter(self._actors.values())).note_length
        self._check_notes(moment, length, fail)
        observed = self._observing.observations(moment, length)
        for module in sorted(self._actors):
            try:
                choice = self._actors[module].act(observed[module])
            except RuleError as error:
                del self._actors[module]  # in a run its process would have ended
                fail(f"round {moment.round}: {error}")
                continue
            if choice.note:
                self._notes[module] = choice.note
            self._compare(moment, module, choice, fail)

    def _check_notes(self, moment: Moment, length: int, fail: _Fail) -> None:
        speaks = length and moment.round > self._first_choice
        for module, site in enumerate(moment.sites):
            due = self._notes[module] if speaks and module in self._actors else None
            message = moment.recorded.messages.get(("note", module))
            recorded = tuple(message.note) if isinstance(message, Note) else None
            # A note that would reach no place is not sent.
            silent = recorded is None and not self._system.reach(self._system.place_of(site))
            if recorded != due and not silent and (module in self._actors or not speaks):
                stated, by_rule = (_listed(each) for each in (recorded, due))
                fail(
                    f"{_module_text(moment, module)}: its note is {stated},"
                    f" by its rule it is {by_rule}"
                )

    def _compare(self, moment: Moment, module: int, choice: Choice, fail: _Fail) -> None:
        """Compare a choice with the claim and the report in the recording."""
        due = _chosen(self._system, moment.sites[module], choice)
        message = moment.recorded.messages.get(("claim", module))
        recorded: _Named = None
        if isinstance(message, Claim):
            recorded = message.generator, message.at
        silent = recorded is None and not self._system.reach(
            self._system.place_of(moment.sites[module])
        )
        if recorded != due and not silent:
            stated, by_rule = (_text(each) for each in (recorded, due))
            fail(
                f"{_module_text(moment, module)}: its claim is {stated},"
                f" by its rule it is {by_rule}"
            )
        failed = moment.recorded.reports[module].failed
        if failed != choice.failed:
            fail(
                f"{_module_text(moment, module)}: it gave up: {failed or 'no'}, by its rule:"
                f" {choice.failed or 'no'}"
            )

    def end(self, moment: Moment, transcript: Transcript, fail: _Fail) -> None:
        """Check that a rule that is recorded as having ended the run raises in the next round."""
        self._tell(fail)
        summary = transcript.summary
        if summary is None or summary.ended != "failed":
            return
        self._take_stages(moment)
        if not self._actors:
            return
        error = (summary.error or "").rpartition("; then ")[2]
        blamed = [n for n in self._actors if error.startswith(f"{self._named(n)}, round ")]
        if not blamed:
            return
        length = self._actors[blamed[0]].note_length
        if moment.round > self._first_choice and length:
            for module, numbers in self._notes.items():
                note = Note(moment.round, module, None, list(numbers))
                moment.recorded.messages["note", module] = note
        seen = self._observing.observations(moment, length)[blamed[0]]
        if self._raised(blamed[0], seen) is None:
            fail(f"the run ended with {error!r}, but in round {moment.round} it raises nothing")

    def _named(self, module: int) -> str:
        return f"rule {self._rules.get(module, '')!r}, module_{module}"

    def _raised(self, module: int, seen: Arrays) -> str | None:
        try:
            self._actors[module].act(seen)
        except RuleError as error:
            return str(error)
        return None

    # A schedule.

    def _play_parts(self, parts: ScheduleParts, moment: Moment, fail: _Fail) -> None:
        self._check_notes(moment, 0, fail)
        own, nobodys = parts.of_round(moment.round, moment.sites)
        gave_up = [n for n, each in moment.recorded.reports.items() if each.failed is not None]
        observed = self._observing.observations(moment, 0) if own or gave_up else []

        def asked(module: int, part: Part) -> Choice:
            return self._scheduled(module, moment.sites[module], part).act(observed[module])

        # Of a move that the system does not have it is not known whose it was: it may be that of
        # any module that gave up for it.
        for part in nobodys:
            for module in gave_up:
                if module not in own and (
                    asked(module, part).failed == moment.recorded.reports[module].failed
                ):
                    own[module] = part
                    break
        for module in range(len(moment.sites)):
            choice = asked(module, own[module]) if module in own else Choice()
            self._compare(moment, module, choice, fail)

    def _scheduled(self, module: int, site: Site, part: GeneratorPlacement) -> Actor:
        """Return an actor whose whole schedule is one move in its first round."""
        rule = scheduled({module: {1: part}})
        return actors_for(
            self._scene,
            rule,
            seed=self._seed or 0,
            hesitate=0.0,
            modules=[module],
            sites={module: site},
        )[module]


def _is_known(name: str) -> bool:
    try:
        return RuleName.of(name).without_values in rules()
    except InputError:  # another distribution cannot be loaded, so it may have the rule
        return False


def _chosen(system: System, site: Site, choice: Choice) -> _Named:
    if not choice.action:
        return None
    move = system.moves(site)[choice.action - 1]
    return None if move is None else (move.generator, move.at)


def _module_text(moment: Moment, module: int) -> str:
    return f"round {moment.round}, module_{module}"


def _listed(note: tuple[int, ...] | None) -> str:
    return "none" if note is None else str(list(note))


def _text(move: _Named) -> str:
    if move is None:
        return "none"
    generator, at = move
    return f"{generator} at {'no site' if at is None else site_text(at)}"


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
        self._unchecked = _unnamed(recording.parameters)
        if self._unchecked is not None:
            return
        name = recording.parameters["rule"]
        if name == SCHEDULE or recording.schedule is not None:
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

    def turn(self, seen: TurnView, fail: Callable[[str], None]) -> None:
        """Ask the rule in a turn, and call `fail` with one line for each other choice."""
        turn, rule = seen.turn, self._rule
        if rule is None:
            return
        if bool(turn.received) != bool(self._length and self._reach(seen)):
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
        for what, stated, due in _compared(turn, choice):
            if stated != due:
                fail(f"{turn_text(turn)}: its {what} is {stated}, by its rule it is {due}")

    def _reach(self, seen: TurnView) -> bool:
        return bool(self._scene.system.reach(self._scene.system.place_of(seen.site)))

    def _born(self, rule: RuleType, seen: TurnView) -> Actor | None:
        module = seen.turn.module
        try:
            return actors_for(
                self._scene,
                rule,
                seed=self._seed or 0,
                hesitate=self._hesitate or 0.0,
                modules=[module],
                sites={module: seen.entered},
                clock="free",
            )[module]
        except CubepathError as error:
            self._wrong = self._wrong or str(error)
            return None


def _is_bare(turn: Turn) -> bool:
    """Return whether nothing but an action was chosen in a turn."""
    more = turn.guards or turn.heeds or turn.exchanges
    return not more and turn.note is None and turn.failed is None


def _compared(turn: Turn, choice: Choice) -> list[tuple[str, object, object]]:
    """Return what is recorded beside what the rule chose."""
    exchanges = {place: list(note) for place, note in turn.exchanges}
    return [
        ("action", turn.action, choice.action),
        ("note", turn.note, None if choice.note is None else list(choice.note)),
        ("guards", list(turn.guards), list(choice.guards)),
        ("heeds", list(turn.heeds), list(choice.heeds)),
        ("exchanges", exchanges, {at: list(note) for at, note in choice.exchanges.items()}),
        ("giving up", turn.failed, choice.failed),
    ]


def audit(
    recording: Recording | Source, progress: Progress | None = None, *, rules: Collection[str] = ()
) -> Verification:
    """Verify a recording or its file, `choices` included: each module chose as its rule does.

    Where the rule is not installed, or the recording does not say how it chose, that check is
    marked as not checked. A rule in a file is asked only if you give it in `rules`, as
    FILE.py:NAME, since a recording can name any file. Nothing is raised, unless the recording
    cannot be read, or is changed while it is read.

    >>> found = audit("logs/golden/hex-5.mcap")
    >>> found.ok, [check.checked for check in found.checks if check.name == "choices"]
    (True, [True])
    """
    found = recording_of(recording)
    return verify(
        found,
        progress,
        player=lambda: RuleAudit(found, rules),
        free_player=lambda: FreeRuleAudit(found, rules),
    )


def unused_rules(recording: Recording, rules: Collection[str]) -> set[str]:
    """Return those of the rules, each FILE.py:NAME, that the recording does not name.

    >>> unused_rules(read_recording("logs/golden/hex-5.mcap"), ["mine.py:MINE"])
    {'mine.py:MINE'}
    """
    parameters = recording.parameters
    named = {parameters.get("rule", ""), parameters.get("repair", "")}
    named.update(*(stage.rules for stage in stages_in(recording)))
    return {each for each in rules if not any(stands_for(each, name) for name in named)}
