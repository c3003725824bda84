"""A recording replayed into the code under test: a function, a node, a process on a wire."""

import sys
from collections import Counter
from typing import Any

import pytest

from cubepath.agents.processes.config import ProcessConfig
from cubepath.agents.processes.node import HostNode
from cubepath.coordinator.testing.fixtures import ReplayFixture
from cubepath.coordinator.testing.log import RunLog
from cubepath.protocol.core.errors import CheckError
from cubepath.protocol.wire.keys import belongs
from cubepath.protocol.wire.messages import Bundle, Reports, decode
from cubepath.protocol.wire.nodes import Put
from processes.command_line import GOLDEN
from samples.recordings import recorded

pytestmark = pytest.mark.slow
READER = """
import sys, zenoh
from queue import SimpleQueue
came = SimpleQueue()
settings = '{mode: "client", connect: {endpoints: ["' + sys.argv[1] + '"]}}'
with zenoh.open(zenoh.Config.from_json5(settings)) as session:
    session.declare_subscriber("cubepath/**", came.put)
    print("it is of", sys.argv[2], flush=True)
    for n in range(int(sys.argv[3])):
        sample = came.get(timeout=30)
        if n + 1 == int(sys.argv[3]):
            print("last", str(sample.key_expr).split("/", 2)[2], flush=True)
"""


def test_a_function_is_called_with_each_message_in_order(cubepath_replay: ReplayFixture) -> None:
    """With the bytes on record and a key of the run; or with some of them."""
    log = RunLog(recorded("hex:n=4", "chain", processes=2, rounds=5))
    found = cubepath_replay.into(log, lambda seen: seen, run="r")
    said = [each for each in log.all_deliveries if each.kind not in ("edges", "cube")]
    assert [each.data for each in found] == [
        each.data for each in said if each.kind not in ("certificate", "summary")
    ]
    assert all(belongs("r", each.key, decode(each.data)) for each in found)
    assert cubepath_replay.into(log, lambda seen: seen.round, "reports", module=0) == [
        1,
        2,
        3,
        4,
        5,
    ]


def test_a_free_recording_is_replayed_as_well(cubepath_replay: ReplayFixture) -> None:
    """Its keys are those of such runs."""
    path = GOLDEN / "hex-free-5.mcap"
    kinds = Counter(cubepath_replay.into(path, lambda seen: seen.key.split("/")[2]))
    log = RunLog.read(path)
    assert kinds["commit"] == log.count("commit") > 0


def test_a_node_does_again_what_it_did(cubepath_replay: ReplayFixture) -> None:
    """A process that hears all that was said on record says and reports the same again."""
    recording = recorded("hex:n=4", "chain", processes=2, rounds=5)
    log = RunLog(recording)
    orders = ProcessConfig(
        endpoint="",
        run="replayed",
        process=0,
        modules=[0, 1],
        processes=[[0, 1], [2, 3]],
        scene="",
        rule="chain",
        seed=0,
        hesitate=0.0,
        note_length=0,
    )
    heard = cubepath_replay.into_node(
        log, HostNode(orders, recording.scene), where=lambda seen: seen.sender != "process_0"
    )
    puts = [decode(each.data) for each in heard if isinstance(each, Put)]
    due = [each.message for each in log.deliveries(sender="process_0")]
    kinds = (Bundle, Reports)
    assert [each for each in puts if isinstance(each, kinds)] == [
        each for each in due if isinstance(each, kinds)
    ]


def test_a_process_hears_it_on_a_wire(cubepath_replay: ReplayFixture) -> None:
    """It is waited for until it listens, so that it misses nothing."""
    log = RunLog.read(GOLDEN / "agv-3.mcap")
    count = sum(log.count(kind) for kind in ("bundle", "reports"))
    command = [sys.executable, "-c", READER, "{endpoint}", "{run}", str(count)]
    found = cubepath_replay.to(log, command)
    assert found.replayed.same
    assert found.command.says("it is of (.*)")[1] == found.replayed.run
    assert found.command.says(r"last (\w+)/")[1] == "reports"
    assert found.command.wait() == 0


def test_a_process_that_does_not_listen_is_told(cubepath_replay: ReplayFixture) -> None:
    """With what it said instead."""
    command = [sys.executable, "-c", "print('busy')"]
    with pytest.raises(CheckError, match=r"listens to the run: it ended before; stdout: busy"):
        cubepath_replay.to(GOLDEN / "agv-3.mcap", command)


@pytest.mark.thorough
def test_live_modules_are_tried_against_a_log(cubepath_replay: ReplayFixture) -> None:
    """The same to the end; a divergence fails the test, and no divergence one that expects it."""
    path = GOLDEN / "hex-5.mcap"
    assert cubepath_replay.live(path, [1, 2], processes=0).rounds == 29
    other: dict[str, Any] = {"rule": "random", "processes": 0}
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
    assert cubepath_replay._places.report_lines() == [
        f"recording {log.recording.path}: rule random from round 5 on"
    ]
    with pytest.raises(AssertionError, match="from round 5 on: it ended: max-rounds"):
        cubepath_replay.what_if(
            path, "random", from_round=5, max_rounds=9, failing=True, processes=0
        )


def test_a_rule_that_gives_up_fails_a_what_if(cubepath_replay: ReplayFixture) -> None:
    """Unless that is expected."""
    path = GOLDEN / "hex-5.mcap"
    given: dict[str, Any] = {"from_round": 3, "processes": 0}
    with pytest.raises(AssertionError, match="rule chain from round 3 on: rule 'chain': no goal"):
        cubepath_replay.what_if(path, "chain", **given)
    assert cubepath_replay.what_if(path, "chain", failing=True, **given).rounds <= 3
