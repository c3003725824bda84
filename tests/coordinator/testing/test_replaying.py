"""A recording replayed into the code under test: a function, or a rule."""

from __future__ import annotations

from collections import Counter

import pytest

from cubepath.coordinator.testing.fixtures import ReplayFixture
from cubepath.coordinator.testing.log import RunLog
from cubepath.coordinator.testing.replaying import replay_into
from cubepath.protocol.wire.keys import belongs
from cubepath.protocol.wire.messages import decode
from processes.command_line import GOLDEN
from samples.recordings import recorded

pytestmark = pytest.mark.slow


def test_a_function_is_called_with_each_message_in_order() -> None:
    """With the bytes on record and a key of the run; or with some of them."""
    log = RunLog(recorded("hex:n=4", "chain", processes=2, rounds=5))
    found = replay_into(log, lambda seen: seen, run="r")
    said = [each for each in log.all_deliveries if each.kind not in ("edges", "cube")]
    assert [each.data for each in found] == [
        each.data for each in said if each.kind not in ("certificate", "summary")
    ]
    assert all(belongs("r", each.key, decode(each.data)) for each in found)
    assert replay_into(log, lambda seen: seen.round, "reports", module=0) == [1, 2, 3, 4, 5]


def test_a_free_recording_is_replayed_as_well(cubepath_replay: ReplayFixture) -> None:
    """Its keys are those of such runs."""
    path = GOLDEN / "hex-free-5.mcap"
    kinds = Counter(cubepath_replay.into(path, lambda seen: seen.key.split("/")[2]))
    log = RunLog.read(path)
    assert kinds["moved"] == log.count("moved") > 0


def test_live_modules_are_tried_against_a_log(cubepath_replay: ReplayFixture) -> None:
    """The same to the end; a divergence fails the test, and no divergence one that expects it."""
    path = GOLDEN / "hex-5.mcap"
    assert cubepath_replay.live(path, [1, 2], processes=0).rounds == 29
    other = {"rule": "random", "processes": 0}
    with pytest.raises(AssertionError, match=r"for 3 rounds, then round 4, module_1: claims "):
        cubepath_replay.live(path, [1, 2], **other)
    found = cubepath_replay.live(path, [1, 2], diverging=True, **other)
    assert found.divergence is not None
    assert found.divergence.module == 1
    with pytest.raises(AssertionError, match="no divergence in 29 rounds, expected one"):
        cubepath_replay.live(RunLog.read(path), [1], diverging=True, processes=0)


def test_another_rule_takes_over_from_a_round_on(cubepath_replay: ReplayFixture) -> None:
    """The log of the new run is asked as any; it goes to the folder of the test."""
    path = GOLDEN / "agv-6.mcap"
    log = cubepath_replay.what_if(path, "random", from_round=5, max_rounds=9, processes=0)
    log.assert_legal()
    parent, moves = RunLog.read(path), log.recording.moves()
    assert log.rounds == 9
    early = (moves["round"] < 5).sum()
    assert moves["module"][:early].tolist() == parent.recording.moves()["module"][:early].tolist()
    assert log.recording.parameters["parent"] == "agv-6.mcap"
    assert cubepath_replay.told() == [
        f"recording {log.recording.path}: rule random from round 5 on"
    ]
    with pytest.raises(AssertionError, match="from round 5 on: it ended: max-rounds"):
        cubepath_replay.what_if(
            path, "random", from_round=5, max_rounds=9, failing=True, processes=0
        )


def test_a_rule_that_gives_up_fails_a_what_if(cubepath_replay: ReplayFixture) -> None:
    """Unless that is expected."""
    path = GOLDEN / "hex-5.mcap"
    given = {"from_round": 3, "processes": 0}
    with pytest.raises(AssertionError, match="rule chain from round 3 on: rule 'chain': no goal"):
        cubepath_replay.what_if(path, "chain", **given)
    assert cubepath_replay.what_if(path, "chain", failing=True, **given).rounds <= 3
