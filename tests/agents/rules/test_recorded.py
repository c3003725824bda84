"""The rule of a module that chooses again what it chose on record."""

import pytest

from cubepath.agents.environments.world import World
from cubepath.agents.local.arbitration import priority, seed_in
from cubepath.agents.rules.actor import actors_for
from cubepath.agents.rules.schedule import RecordedChoice, RecordedChoices, as_recorded
from cubepath.coordinator.verification.parameters import RECORDED as IN_RECORDINGS
from cubepath.protocol.core.catalogue import GeneratorPlacement
from cubepath.protocol.core.errors import RuleError
from cubepath.protocol.scenes.specs import scene_from_spec

EDGE = GeneratorPlacement("edge", (0, 1))
FAR = GeneratorPlacement("edge", (3, 4))


def test_it_claims_and_notes_what_is_on_record_round_by_round() -> None:
    """And gives up where it did, or where its move is none from where it stands."""
    scene = scene_from_spec("agv:graph=P6,n=1")
    chosen = [
        RecordedChoice(None, [1]),
        RecordedChoice(EDGE, None),
        RecordedChoice(None, [2], "no way"),
        RecordedChoice(FAR, [3]),
    ]
    told = RecordedChoices({0: chosen}, note_length=1)
    rule = as_recorded(told)
    assert rule.name == IN_RECORDINGS
    world = World(scene, seed=0, note_length=1)
    actor = actors_for(scene, rule, seed=0, hesitate=0.0)[0]
    found = [actor.act(world.observe(0)) for _ in chosen]
    assert [choice.note for choice in found] == [(1,), None, (2,), (3,)]
    moves = scene.system.moves(scene.start[0])
    assert [choice.action for choice in found] == [
        0,
        1 + next(n for n, move in enumerate(moves) if move is not None and move.at == (0, 1)),
        0,
        0,
    ]
    assert [choice.failed for choice in found] == [
        None,
        None,
        "no way",
        "edge at [3,4] is no move from 0",
    ]
    with pytest.raises(RuleError, match="StopIteration"):
        actor.act(world.observe(0))


def test_ranks_follow_the_seed_of_the_round() -> None:
    """The last that began by then; without later seeds it is that of the run."""
    later = [(4, 7), (6, 8)]
    assert [seed_in(number, 3, later) for number in range(1, 9)] == [3, 3, 3, 7, 7, 8, 8, 8]
    assert seed_in(5, 3, ()) == 3
    assert priority(seed_in(5, 3, later), 5, 0) == priority(7, 5, 0)
