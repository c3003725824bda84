"""Which messages are played, and on which keys."""

import pytest

from cubepath.coordinator.playback.selection import KeyMapping, PlayedMessages
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.recordings.recording import read_recording
from cubepath.protocol.recordings.stored_messages import Record
from processes.command_line import GOLDEN
from samples.recordings import recorded

HEX = read_recording(GOLDEN / "hex-5.mcap")


def topics(*patterns: str, exclude: tuple[str, ...] = ()) -> set[str]:
    """Return the topics that are played."""
    selection = PlayedMessages(HEX, topics=patterns, exclude=exclude)
    return {record.topic for record in HEX.records if selection.takes(record)}


def test_topics_are_chosen_by_patterns() -> None:
    """Of any kind; a kind stands for all its topics, and what is excluded is left out."""
    assert topics("edges/*") == {"edges/coordinator"} == topics("edges")
    assert topics("go", "ready/process_1") == {"go/coordinator", "ready/process_1"}
    assert topics("re*") == {*topics("reports"), *topics("ready")}
    assert topics("*") == {record.topic for record in HEX.records}
    assert topics("reports", exclude=("*/process_[1-4]",)) == {"reports/process_0"}
    assert topics(exclude=("reports",)) == topics("bundle")


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"topics": ["verdict"]}, "topics verdict: nothing on record matches"),
        ({"topics": [""]}, "topics: found '', expected a pattern"),
        ({"exclude": ["a#"]}, "exclude a#: nothing on record matches"),
        ({"exclude": ["nobody"]}, "exclude nobody: nothing on record matches"),
        ({"topics": ["bundle/nobody"]}, "topics bundle/nobody: nothing on record matches"),
        ({"exclude": ["*"]}, r"exclude=\*: leaves nothing to play, expected some topics of"),
        (
            {"topics": ["bundle"], "exclude": ["bundle"]},
            "topics=bundle, exclude=bundle: leaves nothing to play",
        ),
    ],
)
def test_what_chooses_nothing_is_refused(given: dict[str, list[str]], said: str) -> None:
    """A part of a batch is no topic, for example."""
    with pytest.raises(InputError, match=said):
        PlayedMessages(HEX, **given)


def keys(*remap: str) -> dict[str, str]:
    """Return the first key of each topic of a run in batches."""
    recording = recorded("hex:n=4", "chain", rounds=5)
    found = KeyMapping(recording, "r", remap)
    return {record.topic: found.key(record) for record in reversed(recording.records)}


def test_keys_are_remapped_by_topic_and_by_their_own_beginning() -> None:
    """In whole parts: the first that fits; with a slash outside of the run."""
    plain = keys()
    assert plain["reports/process_0"] == "cubepath/r/reports/process_0"
    assert keys("reports/process_0=left")["reports/process_0"] == "cubepath/r/left"
    assert keys("reports=b/c")["reports/process_0"] == "cubepath/r/b/c/process_0"
    assert keys("reports=/b")["reports/process_0"] == "b/process_0"
    assert keys("report=b")["reports/process_0"] == plain["reports/process_0"]
    region = plain["bundle/process_0"].removeprefix("cubepath/r/to/")
    assert keys("to=from")["bundle/process_0"] == f"cubepath/r/from/{region}"
    assert keys("bundle=heard")["bundle/process_0"] == "cubepath/r/heard/process_0"


@pytest.mark.parametrize("remap", ["nobody=a", "cube=a", "report=a", "to/nobody=a"])
def test_what_concerns_no_message_that_is_played_is_refused(remap: str) -> None:
    """Neither a topic nor a key of one begins so; a part of a batch has neither."""
    recording = recorded("hex:n=4", "chain", rounds=5)
    takes = PlayedMessages(recording).takes_topic
    KeyMapping(recording, "r", ["bundle=heard", "to=from", "reports/process_0=left"]).check_remap(
        takes
    )
    old = remap.partition("=")[0]
    with pytest.raises(InputError, match=f"remap={remap}: nothing that is played is on {old}, "):
        KeyMapping(recording, "r", ["bundle=heard", remap]).check_remap(takes)


def test_what_other_tools_wrote_keeps_its_topic() -> None:
    """Its bytes are not looked into."""
    assert (
        KeyMapping(HEX, "r").key(Record("/viewer/scene", b"\0", 0, 0, 0))
        == "cubepath/r/viewer/scene"
    )


@pytest.mark.parametrize("remap", ["a", "=a", "a=", "a=b=c", "a=/", "a*=b", "a=b//c", "a=b*"])
def test_what_is_no_key_is_refused(remap: str) -> None:
    """In one line."""
    with pytest.raises(InputError, match="remap="):
        KeyMapping(HEX, "r", [remap])


@pytest.mark.parametrize("run", ["", "a/b", "*", "a$b", "a?", "a#", "a\n"])
def test_what_is_no_part_of_a_key_is_no_run(run: str) -> None:
    """In one line."""
    with pytest.raises(InputError, match="run="):
        KeyMapping(HEX, run)
