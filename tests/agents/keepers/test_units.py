"""Moves of every kind of system, one after the other through some keepers, against one state."""

from random import Random

import pytest

from cubepath.agents.keepers.attempts import Share
from cubepath.agents.keepers.journal import MemoryJournal
from cubepath.agents.keepers.keeper import Keeper
from cubepath.agents.rules.actor import attempt_of
from cubepath.agents.rules.rule import Choice
from cubepath.protocol.core.actions import Action, commute
from cubepath.protocol.core.sites import Site, site_from_json
from cubepath.protocol.scenes.specs import scene_from_spec
from cubepath.protocol.wire.free_messages import Commit, Decision, Forwards, Replies
from cubepath.protocol.wire.keys import Tiles

SPECS = (
    "hex:n=4",
    "hex-open:n=4",
    "agv:graph=grid4x4,n=4",
    "agv-labelled:graph=grid4x4,n=4",
    "sliding:p=2,q=1,n=3",
    "arm:n=4",
    "arm-free:n=3",
    "arms",
    "polygon:n=6",
    "assembly:n=3",
)


class Together:
    """Keepers whose messages arrive at once, in order."""

    def __init__(self, spec: str, count: int) -> None:
        self.scene = scene_from_spec(spec)
        self.tiles = Tiles(self.scene.system, count)
        self.journals = [MemoryJournal() for _ in range(count)]
        self.keepers = [
            Keeper(me, self.scene, self.tiles, journal) for me, journal in enumerate(self.journals)
        ]
        self.moved: list[Commit] = []
        self.told: list[Decision] = []

    def go_on(self) -> None:
        """Deliver until nothing is under way."""
        while True:
            said = [message for keeper in self.keepers for message in keeper.outgoing()]
            for message in said:
                if isinstance(message, Forwards):
                    for part in message.parts:
                        self.keepers[message.to].hear(message.keeper, part)
                elif isinstance(message, Replies):
                    self.told += [part for part in message.parts if isinstance(part, Decision)]
                elif isinstance(message, Commit):
                    self.moved.append(message)
            if not said:
                return


@pytest.mark.parametrize("spec", SPECS)
def test_keepers_come_to_the_same_state_as_the_moves(spec: str) -> None:
    """Where everybody is, levels as in the heap, and versions; also after each has come back."""
    run = Together(spec, 3)
    system, random = run.scene.system, Random(1)  # noqa: S311 - to be repeated
    sites: list[Site] = list(run.scene.start)
    done: list[tuple[int, Action]] = []
    known: dict[str, list[int]] = {}
    """By unit its version, and how often that was read."""
    for number in range(1, 40):
        occupants = {system.place_of(site): site for site in sites}
        on = {*sites, *system.filled}
        possible = [
            (module, action, move)
            for module, site in enumerate(sites)
            for action, move in enumerate(system.moves(site), 1)
            if move is not None and move.possible(on)
        ]
        module, action, move = random.choice(possible)
        attempt = attempt_of(
            system,
            run.tiles,
            module=module,
            epoch=0,
            number=number,
            turn=0,
            site=sites[module],
            occupants=occupants,
            notes={},
            register=(),
            choice=Choice(action),
        )
        assert attempt is not None
        first = min(
            run.tiles.keeper_of(
                site_from_json(unit)
                if system.labels is not None
                else system.place_of(site_from_json(unit))
            )
            for unit, _ in attempt.sensed
        )
        run.keepers[first].ask(0, attempt)
        run.go_on()
        assert len(run.moved) == number
        level = 1 + max((one for one, old in done if not commute(old, move.action)), default=0)
        assert run.moved[-1].level == level
        done.append((level, move.action))
        for unit, version in run.moved[-1].read:
            count = known.setdefault(repr(unit), [0, 0])
            assert version == count[0]
            count[1] += 1
        for unit, version, reads in run.moved[-1].written:
            assert [version, reads] == known.get(repr(unit), [0, 0])
            known[repr(unit)] = [version + 1, 0]
        for who, source, target, _ in run.moved[-1].motion:
            assert sites[who] == site_from_json(source)
            sites[who] = site_from_json(target)
        _agree(run, sites)
    for me, journal in enumerate(run.journals):
        before = run.keepers[me].units
        run.keepers[me] = Keeper(me, run.scene, run.tiles, journal)
        assert run.keepers[me].units.touched() == before.touched()
        assert run.keepers[me].units.serials == before.serials
    _agree(run, sites)
    assert all(decision.commit is not None for decision in run.told)


@pytest.mark.parametrize(
    ("version", "reads", "why"),
    [
        (0, None, None),
        (0, 0, None),
        (1, None, "has version 0, read 0 times, expected version 1"),
        (0, 2, "has version 0, read 0 times, expected version 0, read 2 times"),
    ],
)
def test_a_move_of_a_schedule_waits_for_its_versions(
    version: int, reads: int | None, why: str | None
) -> None:
    """A unit at another version, or read another number of times, keeps an attempt from commit."""
    run = Together("hex:n=4", 1)
    unit = run.scene.start[0]
    share = Share((), (), (), (), (), ((unit, version, reads),), frozenset(), frozenset())
    assert run.keepers[0].units.why_not(share) == (why and f"{unit!r} {why}")


def _agree(run: Together, sites: list[Site]) -> None:
    """Check that keepers show exactly these modules, where they have the places."""
    shown = {
        module: keeper.units.module(module)[0]
        for keeper in run.keepers
        for module in keeper.units.place_of
    }
    assert shown == dict(enumerate(sites))
    for module, site in enumerate(sites):
        place = run.scene.system.place_of(site)
        occupant = run.keepers[run.tiles.keeper_of(place)].units.occupant(place)
        assert occupant is not None
        assert occupant.module == module
