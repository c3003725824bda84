"""Plays a task in a separate process: loads the rule, asks it, and notes what it uses.

The process is new, so nothing of the rule was loaded before.
"""

import os
import sys
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

from cubepath.agents.environments.free_environment import FreeEnv
from cubepath.agents.environments.world import World
from cubepath.agents.local.observation import Note, Observation
from cubepath.agents.local.random_streams import HESITATE, RULE, stream
from cubepath.agents.locality import plays
from cubepath.agents.locality.traps import Traps, place
from cubepath.agents.rules.actor import Actor, knowledge_of, line_of
from cubepath.agents.rules.rule import Choice, InitialKnowledge, RuleName, RuleType
from cubepath.protocol.core.errors import InputError, RuleError
from cubepath.protocol.core.system import Scene
from cubepath.protocol.scenes.specs import scene_from_spec

_NOBODY = -1
"""Instead of a module: the rule's file is loaded for all."""


def played(task: plays.PlayTask) -> plays.PlayResult:
    """Play a task; it changes the process permanently."""
    os.chdir(task.folder)
    _surround(task.conditions.environment)
    file = RuleName.of(task.rule).file
    home = {str(Path(file).resolve())} if file else set[str]()
    traps = Traps(task.conditions, home.__contains__)
    traps.install()
    with traps.asking(_NOBODY, 0):
        rule, module = _loaded(task.rule, task.clock)
    if task.clock not in rule.clocks:
        raise InputError(
            f"not for the {task.clock} clock: rule {task.rule!r}, expected one that says why it"
            " holds there"
        )
    if isinstance(task.play, plays.FitQuestion):
        return plays.PlayResult(specs=tuple(spec for spec in task.play.specs if _fits(rule, spec)))
    if not rule.is_for(task.play.scene.system):
        raise InputError(f"{task.play.scene.spec}: not for this system: rule {task.rule!r}")
    traps.home = _home_of(module, home)
    before = _globals(module)
    sites: list[tuple[Any, ...]]
    try:
        if not isinstance(task.play, plays.WholeRun):
            lives, sites = _replayed(task.play, rule, traps, task.clock), []
        elif task.clock == "free":
            lives, sites = _in_turns(task.play, rule, traps)
        else:
            lives, sites = _together(task.play, rule, traps)
    except InputError as error:  # from a rule that is not for this scene
        return plays.PlayResult(unfit=str(error), accesses=frozenset(traps.accesses))
    after = _globals(module)
    changed = tuple(name for name in sorted(after) if before.get(name) != after[name])
    return plays.PlayResult(lives, sites, frozenset(traps.accesses), changed)


def _surround(environment: int) -> None:
    """Set the variables of the environment that differ from place to place."""
    user = "somebodyelse" if environment else "user"
    here = place(environment)
    os.environ.update(HOME=here, PWD=here, USER=user, LOGNAME=user, HOSTNAME=f"{user}-machine")
    os.environ.update(LANG="C.UTF-8", TZ="Asia/Tokyo" if environment else "UTC")


def _loaded(name: str, clock: str) -> tuple[RuleType, Any]:
    """Return a rule, and the module that makes it."""
    from cubepath.agents.rules.registry import find_rule, unknown_rule  # noqa: PLC0415 - under traps

    rule = find_rule(name)
    if rule is None:
        raise unknown_rule(name)
    free = None if clock == "lockstep" or rule.free is None else rule.free.make
    return rule, sys.modules.get(getattr(free or rule.make, "__module__", ""))


def _fits(rule: RuleType, spec: str) -> bool:
    try:
        system = scene_from_spec(spec).system
    except InputError:  # a family may need more than its defaults
        return False
    return system.local and rule.is_for(system)


def _home_of(module: Any, home: set[str]) -> Callable[[str], bool]:
    """Return which files are the rule's: its own, and those of its distribution's package."""
    own = getattr(module, "__file__", None)
    package = sys.modules.get(getattr(module, "__name__", "").partition(".")[0])
    root = getattr(package, "__file__", None)
    files = home | ({own} if own else set[str]())
    folder = f"{Path(root).parent}{os.sep}" if root and root.endswith("__init__.py") else None
    return lambda file: file in files or (folder is not None and file.startswith(folder))


def _globals(module: Any) -> dict[str, str]:
    """Return what the rule's file holds, as text: enough to see that it has changed."""
    found: dict[str, str] = {}
    for name, value in list(vars(module).items()) if module is not None else ():
        if not name.startswith("__"):
            try:
                found[name] = repr(value)
            except Exception as error:  # noqa: BLE001 - whatever a class of the user's raises
                found[name] = type(error).__name__
    return found


def _ask(actor: Actor | None, seen: Observation) -> plays.RuleChoice:
    """Ask a rule; an error is a choice too, so that errors can be compared."""
    if actor is None:
        return plays.RuleChoice(error="not made")
    try:
        choice = actor.act({key: array.copy() for key, array in seen.items()})
    except RuleError as error:
        return plays.RuleChoice(error=_type_of(error))
    # A rule may have returned a subclass, or another mapping, that cannot be pickled.
    plain = Choice(choice.action, choice.note, choice.failed, choice.guards, choice.heeds)
    return plays.RuleChoice(replace(plain, exchanges=dict(choice.exchanges)))


def _type_of(error: RuleError) -> str:
    """Return the type of a rule's own error; its text may hold addresses of objects."""
    cause = error.__cause__
    text = "" if not isinstance(cause, InputError | AttributeError | TypeError) else f": {cause}"
    return f"{type(cause).__name__}{text}{'' if cause is None else line_of(cause)}"


def _made(
    rule: RuleType, scene: Scene, life: plays.ModuleLife, traps: Traps, clock: str
) -> Actor | None:
    knowledge = knowledge_of(scene, life.module, scene.start[life.module], life.seed)
    with traps.asking(life.module, 0):
        try:
            return Actor(rule, knowledge, clock=clock)
        except RuleError as error:
            life.choices.append(plays.RuleChoice(error=_type_of(error)))
            return None


def _all_made(
    play: plays.WholeRun, rule: RuleType, traps: Traps, clock: str
) -> tuple[dict[int, plays.ModuleLife], dict[int, Actor | None]]:
    """Make the rule for all modules, in the order of the play."""
    numbers = range(len(play.scene.start))
    lives: dict[int, plays.ModuleLife] = {}
    actors: dict[int, Actor | None] = {}
    for module in reversed(numbers) if play.backwards else numbers:
        lives[module] = plays.ModuleLife(module, play.seed)
        actors[module] = _made(rule, play.scene, lives[module], traps, clock)
    return lives, actors


def _together(
    play: plays.WholeRun, rule: RuleType, traps: Traps
) -> tuple[dict[int, plays.ModuleLife], list[tuple[Any, ...]]]:
    scene = play.scene
    numbers = list(range(len(scene.start)))
    order = numbers[::-1] if play.backwards else numbers
    lives, actors = _all_made(play, rule, traps, "lockstep")
    doubts = {module: stream(play.seed, module, HESITATE) for module in numbers}
    world = World(scene, seed=play.seed, note_length=rule.note_length(len(numbers)))
    sites = [tuple(world.sites)]
    ended = any(life.choices for life in lives.values())
    notes: dict[int, Note] = {}
    while not ended and world.round < play.rounds and not scene.reached(world.sites):
        seen = {module: world.observe(module) for module in numbers}
        actions: dict[int, int] = {}
        for module in order:
            with traps.asking(module, world.round + 1):
                chosen = _ask(actors[module], seen[module])
            lives[module].observations.append(seen[module])
            lives[module].choices.append(chosen)
            lives[module].before.append(world.round)
            ended = ended or chosen.ends
            choice = chosen.choice
            actions[module] = 0 if doubts[module].fraction() < play.hesitate else choice.action
            if choice.note is not None:
                notes[module] = choice.note
        world.step(actions, notes)
        sites.append(tuple(world.sites))
    return {module: lives[module] for module in numbers}, sites


def _in_turns(
    play: plays.WholeRun, rule: RuleType, traps: Traps
) -> tuple[dict[int, plays.ModuleLife], list[tuple[Any, ...]]]:
    """Play without rounds; who acts when follows from the seed alone."""
    scene = play.scene
    lives, actors = _all_made(play, rule, traps, "free")
    doubts = {module: stream(play.seed, module, HESITATE) for module in lives}
    env = FreeEnv(scene, max_cycles=play.rounds, note_length=rule.length(len(lives), "free"))
    env.reset(seed=play.seed)
    sites = [tuple(env.sites)]
    ended = any(life.choices for life in lives.values()) or scene.reached(env.sites)
    while not ended:
        name = env.agent_selection
        module = env.possible_agents.index(name)
        life, seen = lives[module], env.observe(name)
        with traps.asking(module, len(life.choices) + 1):
            chosen = _ask(actors[module], seen)
        life.observations.append(seen)
        life.choices.append(chosen)
        life.before.append(len(sites) - 1)
        hesitates = doubts[module].fraction() < play.hesitate
        env.act(Choice() if hesitates else chosen.choice)
        sites.append(tuple(env.sites))
        ended = chosen.ends or env.terminations[name] or env.truncations[name]
    return {module: lives[module] for module in sorted(lives)}, sites


def _replayed(
    play: plays.ModuleReplay, rule: RuleType, traps: Traps, clock: str
) -> dict[int, plays.ModuleLife]:
    recorded, module = play.life, play.life.module
    life = replace(recorded, choices=[])
    others = _Others(play.scene, play.surroundings, life, rule, traps, clock=clock)
    actor: Actor | None = None
    for _ in others.making():
        actor = _made(rule, play.scene, life, traps, clock)
    if not life.choices:
        for round_number, seen in enumerate(recorded.observations, 1):
            # As in a run, the world is where a rule that looks through its callers would find it.
            for world, index in others.asking(round_number):
                if world is not None:
                    _check_the_same(module, seen, world.observe(index))
                with traps.asking(module, round_number):
                    life.choices.append(_ask(actor, seen))
            if life.choices[-1].error is not None:
                break
    return {module: life}


def _check_the_same(module: int, seen: Observation, here: Observation) -> None:
    """Raise AssertionError if a module sees something else in surroundings that look the same."""
    for key in ("observation", "action_mask"):
        if here[key].tolist() != seen[key].tolist():
            raise AssertionError(f"module_{module} sees {key} from beyond its reach")


class _Others:
    """The modules around the one whose rule is played again, in their own world."""

    def __init__(
        self,
        scene: Scene,
        around: plays.Surroundings | None,
        life: plays.ModuleLife,
        rule: RuleType,
        traps: Traps,
        *,
        clock: str,
    ) -> None:
        self._scene, self._around, self._own = scene, around, life.module
        self._rule, self._traps, self._clock = rule, traps, clock
        self._actors: dict[int, Actor] = {}

    def making(self) -> Iterator[None]:
        """Make the others in the order of numbers; yield when it is the module's own turn."""
        if self._around is None:
            yield None
            return
        start = self._around.settings[0]
        for number in sorted(start):
            if number == self._own:
                yield None
                continue
            knowledge = InitialKnowledge(
                system=self._scene.system,
                module=number,
                modules=len(self._scene.start),
                start=start[number],
                goals=self._around.goals[number],
                stream=stream(self._around.seed, number, RULE),
            )
            with self._traps.asking(number, 0):
                try:
                    self._actors[number] = Actor(self._rule, knowledge, clock=self._clock)
                except (RuleError, InputError):
                    continue  # not for a rule that wants more of a scene

    def asking(self, round_number: int) -> Iterator[tuple[World | None, int]]:
        """Ask the others, in the order of numbers.

        Yield the world, and which one the module is there, when it is the module's own turn.
        """
        if self._around is None:
            yield None, 0
            return
        setting = self._around.settings[round_number]
        scene = plays.surrounding_scene(self._scene, setting, self._around.goals)
        note_length = self._rule.length(len(self._scene.start), self._clock)
        world = World(scene, seed=self._around.seed, note_length=note_length)
        for index, number in enumerate(sorted(setting)):
            if number == self._own:
                yield world, index
            elif number in self._actors:
                with self._traps.asking(number, round_number):
                    _ask(self._actors[number], world.observe(index))
