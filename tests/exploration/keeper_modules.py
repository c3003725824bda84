"""The modules of an exploration: abstract ones, which may do anything that they are given to do.

A module says the same again at any time, and enters again after a crash without memory. One that
may hold asks the keepers of what it senses, one after the other in increasing order, before an
attempt or not; it may give up at any moment, and lets go of what its attempt does not end.
"""

from collections.abc import Callable, Iterable, Iterator
from functools import partial

from cubepath.agents.keepers.attempts import planned
from cubepath.protocol.core.sites import Site, in_order, site_from_json, to_json
from cubepath.protocol.wire.free_messages import (
    Attempt,
    Decision,
    Entered,
    EnterRequest,
    Held,
    Hold,
)
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
        holds = scenario.holds.get(number, 0)
        return Module("idle", 0, 0, 0, scenario.scene.start[number], scenario.attempts, holds)

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
            if module.holds and not module.held:
                yield f"module {number} begins to hold", partial(self._holds_next, world, number)
        if module.phase == "holding" or (module.phase == "idle" and module.held):
            yield f"module {number} gives up", partial(self._gives_up, world, number)
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
        after = with_module(
            world,
            number,
            module._replace(
                phase="pending", says=(letter,), left=module.left - 1, number=attempt.number
            ),
        )
        return self._lets_go(after, number, chain)

    def born(self, world: World, number: int) -> World:
        """Let a module enter that remembers nothing but that this is a later incarnation."""
        module = world.modules[number]
        incarnation = module.incarnation + 1
        letters = tuple(
            self._letter(Letter(-number - 1, keeper, EnterRequest(number, incarnation)))
            for keeper in range(self._tiles.keepers)
        )
        start = self._scenario.scene.start[number]
        entering = Module(
            "entering", incarnation, 0, 0, start, module.left, module.holds, says=letters
        )
        return with_module(world, number, entering)

    # Holding.

    def _places(self, site: Site) -> list[tuple[int, list[Site]]]:
        """Return what a module senses, by keeper in increasing order."""
        shares: dict[int, list[Site]] = {}
        for place in in_order(
            {site, *(each for each in self._system.sensed(site) if each is not None)}
        ):
            shares.setdefault(self._tiles.keeper_of(place), []).append(place)
        return sorted(shares.items())

    def _holds_next(self, world: World, number: int) -> World:
        """Ask the next keeper."""
        module = world.modules[number]
        keeper, places = self._places(module.site)[module.held]
        asked = Hold(number, module.epoch, module.hold + 1, [to_json(each) for each in places], 1)
        letter = self._letter(Letter(-number - 1, keeper, asked))
        holding = module._replace(phase="holding", hold=module.hold + 1, says=(letter,))
        return with_module(world, number, holding)

    def _gives_up(self, world: World, number: int) -> World:
        module = world.modules[number]
        asked = module.held + (module.phase == "holding")
        idle = module._replace(phase="idle", says=(), held=asked)
        return self._lets_go(with_module(world, number, idle), number, ())

    def _lets_go(self, world: World, number: int, chain: Iterable[int]) -> World:
        """Give up what is held, but at the keepers of a chain; each is told once."""
        module = world.modules[number]
        if not module.held:
            return world
        letters, hold = [], module.hold
        for keeper, _ in self._places(module.site)[: module.held]:
            if keeper not in chain:
                hold += 1
                part = Hold(number, module.epoch, hold, [], 0)
                letters.append(self._letter(Letter(-number - 1, keeper, part)))
        rest = module._replace(held=0, hold=hold, holds=module.holds - 1)
        after = with_module(world, number, rest)
        return after._replace(under_way=after.under_way.union(letters))

    # What it takes note of.

    def heard(self, world: World, history: History, number: int, part: Part) -> World:
        """Let a module take what it is told; that is to be what was logged."""
        module = world.modules[number]
        if isinstance(part, Decision):
            history.check_told(part)
        if not is_heard(module, part):
            return world
        if isinstance(part, Held):
            held = module._replace(phase="idle", held=module.held + 1, says=())
            after = with_module(world, number, held)
            more = held.held < len(self._places(module.site))
            return self._holds_next(after, number) if more else after
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
            module.holds,
        )
        assert new.site == history.sites[number], "entered where the module is not"
        return with_module(world, number, new)


def is_heard(module: Module, part: Part) -> bool:
    """Return whether a module takes note of what it is told; if not now, then never."""
    if isinstance(part, Held):
        return module.phase == "holding" and (part.epoch, part.number) == (
            module.epoch,
            module.hold,
        )
    if isinstance(part, Decision):
        mine = module.epoch, module.number
        return module.phase == "pending" and (part.epoch, part.number) == mine
    assert isinstance(part, Entered)
    return module.phase == "entering" and part.incarnation == module.incarnation
