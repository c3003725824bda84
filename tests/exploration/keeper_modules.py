"""The modules of an exploration: abstract ones, which may do anything that they are given to do.

A module says the same again at any time, and enters again after a crash without memory.
"""

from collections.abc import Callable, Iterator
from functools import partial

from cubepath.agents.keepers.attempts import planned
from cubepath.protocol.core.sites import site_from_json
from cubepath.protocol.wire.free_messages import Attempt, Decision, Entered, EnterRequest
from exploration.keeper_history import History
from exploration.keeper_world import Dealt, Letter, Module, Part, Scenario, World, with_module

Happening = tuple[str, Callable[[], World]]
"""What may happen, in words, and as a function to what comes of it."""


class Modules:
    """What the modules of a scenario may do, and what they take note of."""

    def __init__(self, scenario: Scenario, tiles: Dealt, letter: Callable[[Letter], int]) -> None:
        """`letter` numbers what is said."""
        self._scenario = scenario
        self._system = scenario.scene.system
        self._tiles = tiles
        self._letter = letter

    def first(self, number: int) -> Module:
        """Return a module at the start."""
        scenario = self._scenario
        return Module("idle", 0, 0, 0, scenario.scene.start[number], scenario.attempts)

    # What it may do.

    def may(self, world: World, number: int) -> Iterator[Happening]:
        """Yield what a module may do now."""
        module, faults = world.modules[number], world.faults
        if module.phase == "idle" and module.left:
            for attempt in self._attempts(number, module):
                yield (
                    f"module {number} begins {attempt.sensed} {attempt.notes}",
                    partial(self._begun, world, number, attempt),
                )
        if faults.module and module.phase != "dead":
            rest = world._replace(faults=faults._replace(module=faults.module - 1))
            yield f"module {number} crashes", partial(self.born, rest, number)
            dead = module._replace(phase="dead", says=())
            yield f"module {number} dies", partial(with_module, rest, number, dead)

    def _attempts(self, number: int, module: Module) -> Iterator[Attempt]:
        for target, guards in self._scenario.targets(number, module.site):
            (move,) = [
                each
                for each in self._system.moves(module.site)
                if each is not None and each.target == target
            ]
            sensed = {module.site: module.site, target: None, **dict(guards)}
            yield Attempt(
                number,
                module.epoch,
                module.number + 1,
                0,
                module.site,
                move.generator,
                move.at,
                sorted(sensed.items()),
            )
        yield from self._scenario.others(number, module)

    def _begun(self, world: World, number: int, attempt: Attempt) -> World:
        module = world.modules[number]
        chain = planned(self._system, self._tiles, attempt).chain
        letter = self._letter(Letter(-number - 1, chain[0], attempt))
        pending = module._replace(
            phase="pending", says=(letter,), left=module.left - 1, number=attempt.number
        )
        return with_module(world, number, pending)

    def born(self, world: World, number: int) -> World:
        """Let a module enter that remembers nothing but that this is a later incarnation."""
        module = world.modules[number]
        incarnation = module.incarnation + 1
        letters = tuple(
            self._letter(Letter(-number - 1, keeper, EnterRequest(number, incarnation)))
            for keeper in range(self._tiles.keepers)
        )
        start = self._scenario.scene.start[number]
        entering = Module("entering", incarnation, 0, 0, start, module.left, says=letters)
        return with_module(world, number, entering)

    # What it takes note of.

    def heard(self, world: World, history: History, number: int, part: Part) -> World:
        """Let a module take what it is told; that is to be what was logged."""
        module = world.modules[number]
        if isinstance(part, Decision):
            history.check_told(part)
        if not is_heard(module, part):
            return world
        if isinstance(part, Decision):
            site = module.site
            if part.commit is not None:
                for who, _, to, _ in part.commit.motion:
                    site = site_from_json(to) if who == number else site
            return with_module(world, number, module._replace(phase="idle", site=site, says=()))
        assert isinstance(part, Entered)
        assert part.occupant.epoch == history.epochs[number], "entered in an epoch that is over"
        new = Module(
            "idle",
            module.incarnation,
            part.occupant.epoch,
            part.occupant.number,
            site_from_json(part.site),
            module.left,
        )
        assert new.site == history.sites[number], "entered where the module is not"
        return with_module(world, number, new)


def is_heard(module: Module, part: Part) -> bool:
    """Return whether a module takes note of what it is told; if not now, then never."""
    if isinstance(part, Decision):
        mine = module.epoch, module.number
        return module.phase == "pending" and (part.epoch, part.number) == mine
    assert isinstance(part, Entered)
    return module.phase == "entering" and part.incarnation == module.incarnation
