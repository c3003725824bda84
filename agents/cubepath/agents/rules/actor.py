"""An actor: one module's rule with its memory, from PettingZoo observation to action.

The same actor acts for a module in the environment and in a process on the wire.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from traceback import walk_tb

from cubepath.agents.keepers.attempts import support_units
from cubepath.agents.local.observation import STAY, Array, Note, checked_note, is_legal, view_of
from cubepath.agents.local.random_streams import HESITATE, RULE, RandomStream, stream
from cubepath.agents.rules.rule import Choice, InitialKnowledge, RuleType, as_choice
from cubepath.protocol.core.catalogue import Move
from cubepath.protocol.core.errors import InputError, RuleError
from cubepath.protocol.core.sites import Site, in_order
from cubepath.protocol.core.system import Scene, System
from cubepath.protocol.wire.free_messages import Attempt
from cubepath.protocol.wire.keys import Tiles

_OWN = str(Path(__file__).parent)


class Actor:
    """Acts for one module: asks its rule for a choice, and may hesitate to claim it.

    With `hesitate` P the module makes no claim in a round with probability P. Its rule is still
    asked and its note is still sent, as if the claim had been lost. Under the free clock the whole
    choice has no effect, as if the attempt had been refused.
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
        self._name = f"rule {rule.name!r}, module_{knowledge.module}"
        with RuleBlame(self._name, making=True):
            self._rule = rule.made(knowledge, clock)
        self._knowledge = knowledge
        self._hesitate = hesitate
        self._doubt = doubt

    def act(self, observation: Mapping[str, Array], round_number: int | None = None) -> Choice:
        """Return the rule's choice, checked; RuleError if the rule fails or chooses badly."""
        view = view_of(self._knowledge.system, observation, self._knowledge.label)
        when = "" if round_number is None else f", round {round_number}"
        with RuleBlame(self._name + when):
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
    """Turns any error in a rule into one line that names the rule and its module.

    An InputError while it is `making` the rule is left as it is: the rule does not fit the scene.
    """

    def __init__(self, name: str, *, making: bool = False) -> None:
        """Know who is to blame."""
        self._name = name
        self._making = making

    def __enter__(self) -> None:
        """Begin with the rule."""

    def __exit__(self, _: object, error: BaseException | None, __: object) -> None:
        """Raise RuleError for what the rule has raised."""
        if isinstance(error, InputError):
            if not self._making:
                raise RuleError(f"{self._name}: {error}{line_of(error)}") from error
        elif isinstance(error, (Exception, SystemExit)):
            text = " ".join(str(error).split())
            text = f"{type(error).__name__}: {text}{line_of(error)}"
            raise RuleError(f"{self._name}: {text}") from error


def line_of(error: BaseException) -> str:
    """Return which line of the rule's file, the first that is none of these, raised an error."""
    way = [(frame.f_code.co_filename, line) for frame, line in walk_tb(error.__traceback__)]
    file = next((file for file, _ in way if not file.startswith(_OWN)), None)
    lines = [line for each, line in way if each == file]
    return "" if file is None else f" at {Path(file).name}:{lines[-1]}"


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
    starts = dict(enumerate(scene.start)) if sites is None else sites
    return {
        module: Actor(
            rule,
            knowledge_of(scene, module, starts[module], seed),
            hesitate=hesitate,
            doubt=stream(seed, module, HESITATE) if hesitate else None,
            clock=clock,
        )
        for module in (range(len(scene.start)) if modules is None else modules)
    }


def knowledge_of(scene: Scene, module: int, start: Site, seed: int) -> InitialKnowledge:
    """Return what a module that begins at `start` knows from then on."""
    return InitialKnowledge(
        system=scene.system,
        module=module,
        modules=len(scene.start),
        start=start,
        goals=scene.goals[module] if scene.goals else (),
        stream=stream(seed, module, RULE),
    )


def attempt_of(
    system: System,
    tiles: Tiles,
    *,
    module: int,
    epoch: int,
    number: int,
    turn: int,
    site: Site,
    occupants: Mapping[Site, Site],
    notes: Mapping[Site, Note],
    register: Note,
    choice: Choice,
) -> Attempt | None:
    """Return the attempt that a choice makes, None if it changes nothing.

    `occupants` maps other places to the site that was seen on there, `notes` maps places to the
    registers that were seen there, `register` is the module's own, ``()`` while it is empty. An
    action that is not admissible where that was seen counts as stay. A note that repeats the
    register writes nothing, but holds the attempt to it. InputError if a guard is not sensed or has
    no move to guard, or if a register is out of reach, or is to be exchanged and nothing was heard
    from it.
    """
    place = system.place_of(site)
    move = _move(system, site, occupants, choice.action)
    if choice.guards and choice.action == STAY:
        raise InputError("guards without a move")
    registers = _registers(system, place, notes, register, choice)
    if move is None and all(new is None for _, new in registers.values()):
        return None
    if move is None:  # the fence is at the module's own place
        registers.setdefault(place, (register, None))
    units = {} if move is None else _units(system, tiles, occupants, move, choice.guards)
    return Attempt(
        module=module,
        epoch=epoch,
        number=number,
        turn=turn,
        site=site,
        generator=None if move is None else move.generator,
        at=None if move is None else move.at,
        sensed=[(unit, units[unit]) for unit in in_order(units)],
        notes=[
            (near, list(shown), None if new is None else list(new))
            for near in in_order(registers)
            for shown, new in (registers[near],)
        ],
    )


def _move(system: System, site: Site, occupants: Mapping[Site, Site], action: int) -> Move | None:
    moves = system.moves(site)
    move = moves[action - 1] if STAY < action <= len(moves) else None
    if move is None:
        return None
    near = (occupants.get(each) for each in system.sensed(system.place_of(site)))
    on = {site, *(each for each in near if each is not None)}
    return move if move.possible(on | (system.filled & move.action.support)) else None


def _registers(
    system: System, place: Site, notes: Mapping[Site, Note], register: Note, choice: Choice
) -> dict[Site, tuple[Note, Note | None]]:
    """Return what must be in registers, and what is to be there, None if it must only hold."""
    near = {place, *system.reach(place)}
    found: dict[Site, tuple[Note, Note | None]] = {}
    for each in choice.heeds:
        if each not in near:
            raise InputError(f"heeds the register at {each!r}, which is out of reach")
        found[each] = register if each == place else notes.get(each, ()), None
    for each, new in choice.exchanges.items():
        if each == place or each not in near:
            raise InputError(f"exchanges with {each!r}, expected another place within reach")
        if not notes.get(each):
            raise InputError(f"exchanges with {each!r}, from where nothing was heard")
        found[each] = notes[each], tuple(new)
    if choice.note is not None:
        found[place] = register, None if tuple(choice.note) == register else tuple(choice.note)
    return found


def _units(
    system: System, tiles: Tiles, occupants: Mapping[Site, Site], move: Move, guards: Iterable[Site]
) -> dict[Site, Site | None]:
    """Return what was sensed on the units of a move and of its guards."""
    place = system.place_of(move.source)
    reads, writes = support_units(system, tiles, move)
    units = {*reads, *writes}
    sensed = {place, *system.sensed(place)}
    for guard in guards:
        if guard not in sensed:
            raise InputError(f"guards {guard!r}, which is not sensed from {place!r}")
        if not system.has_place(guard):
            continue  # it never changes, so no keeper has it
        if system.letters:
            shown = occupants.get(guard)
            units |= {(guard, letter) for letter in system.letters} if shown is None else {shown}
        else:
            units.add(guard)
    found: dict[Site, Site | None] = {}
    for unit in units:
        at = unit if system.labels is not None else system.place_of(unit)
        on = move.source if at == place else occupants.get(at)
        found[unit] = on if system.labels is not None or on == unit else None
    return found
