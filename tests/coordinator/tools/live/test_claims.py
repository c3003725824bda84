"""What is heard of a run, and the levels of one without rounds, without anybody who watches."""

import pytest

from cubepath.coordinator.runs.asking import Released
from cubepath.coordinator.tools.live import feed as module
from cubepath.coordinator.tools.live.feed import ClaimListener
from cubepath.coordinator.tools.live.remote_pages import Levels
from cubepath.coordinator.tools.viewing.run_view import NumberedWorld
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.scenes.specs import scene_from_spec
from cubepath.protocol.wire.free_messages import Attempt, Decision
from cubepath.protocol.wire.messages import Claim, Report

SCENE = scene_from_spec("agv:graph=grid3x3,n=2")
SITE = SCENE.start[0]
MOVES = [
    each
    for site in SCENE.start
    for each in SCENE.system.moves_at(site)
    if each.possible(SCENE.start_state)
]


def claim(number: int, *, module: int = 0) -> Claim:
    move = MOVES[0]
    return Claim(number, module, SITE, move.generator, move.at)


def report(number: int, *, won: bool = True, deliveries: int = 1) -> Report:
    site, heard = SITE, {"presence": [1] * deliveries}
    return Report(number, 0, site, site, "granted" if won else "lost", None, heard)


def test_what_comes_late_is_told_with_its_step() -> None:
    """A step that was told is told again, whole; nothing of a step that is not there yet."""
    found = ClaimListener(NumberedWorld(SCENE), free=False, before=3)
    found.take(report(4, won=False))
    assert found.news(0) is None
    assert found.news(1) == {"claims": [[1, []]], "kinds": ["presence"], "heard": [[1, [0, 1, 0]]]}
    assert found.news(1) is None
    found.take(claim(4))
    assert (found.news(1) or {})["claims"] == [[1, [0, 0, 0]]]
    found.take(claim(3))  # before the page begins
    assert found.news(1) is None


def test_what_cannot_be_is_passed_over() -> None:
    """Modules that there are not, and places that are none, break nothing."""
    found = ClaimListener(NumberedWorld(SCENE), free=False)
    found.take(claim(1, module=7))
    found.take(Claim(1, 0, "no site", "edge", ()))
    found.take(Claim(1, 1, SITE, "no such generator", SITE))
    assert (found.news(1) or {"claims": [[1, []]]})["claims"] == [[1, []]]


def test_deliveries_end_where_a_page_holds_no_more(monkeypatch: pytest.MonkeyPatch) -> None:
    """Their number is told from then on, in their place."""
    monkeypatch.setattr(module, "DELIVERIES_MAX", 5)
    found = ClaimListener(NumberedWorld(SCENE), free=False)
    found.take(report(1, deliveries=4))
    assert "heard" in (found.news(1) or {})
    found.take(report(2, deliveries=4))
    told = found.news(2) or {}
    assert told["left_out"] == 8
    assert "heard" not in told


def test_attempts_stand_above_all_that_was_made(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without rounds; old ones are forgotten, so that a long run takes no more memory."""
    monkeypatch.setattr(module, "_KEPT", 2)
    found = ClaimListener(NumberedWorld(SCENE), free=True)
    move = MOVES[0]
    found.take(Attempt(0, 0, 1, 1, SITE, move.generator, move.at))
    assert (found.news(1) or {})["claims"] == [[1, [0, 0, 2]]]
    found.take(Decision(0, 0, 1, "taken"))
    assert (found.news(9) or {})["claims"] == [[1, [0, 0, 0]]]
    assert not any([found._claims, found._step_of, found._outcomes])


def test_levels_are_told_from_the_first_that_changed() -> None:
    """In the order of recordings, whatever the order of release."""
    levels = Levels(SCENE.system)
    one, other = (Released(1, each.generator, each.at) for each in MOVES[:2])
    levels.add([other])
    assert levels.changed() == (0, [(MOVES[1].action,)])
    assert levels.changed() is None
    levels.add([Released(2, one.generator, one.at), one])
    expected = sorted(MOVES[:2], key=lambda each: str(each.at))
    assert levels.changed() == (0, [tuple(each.action for each in expected), (MOVES[0].action,)])
    levels.put(2, [Released(2, one.generator, one.at)])
    assert levels.changed() is None
    levels.put(2, [Released(2, other.generator, other.at)])
    assert levels.changed() == (1, [(MOVES[1].action,)])
    with pytest.raises(InputError, match="level 9: expected 1 to 3"):
        levels.add([Released(9, one.generator, one.at)])
