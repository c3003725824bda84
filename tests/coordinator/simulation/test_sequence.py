"""The picture of a simulated run, drawn and read back."""

import re
from pathlib import Path

import pytest
from PIL import Image

from cubepath.coordinator.simulation.faults import Fault, ListedFaults
from cubepath.coordinator.simulation.network import Trace
from cubepath.coordinator.simulation.sequence import ARROWS_MAX, sequence_picture
from cubepath.protocol.core.errors import InputError
from exploration.counting import counted

FAULTS = [
    Fault("process_1 up", 2, "loss"),
    Fault("process_0 down", 3, "loss"),
    Fault("process_0 up", 2, "duplicate", 400),
    Fault("process_2", 4, "pause", 2_000_000),
    Fault("process_0", 6, "slow", 2_000),
    Fault("router", 24, "router", 300_000),
    Fault("process_1", 9, "crash"),
]
NAMES = ["coordinator", *(f"process_{number}" for number in range(3))]


def drawn(path: Path, trace: Trace) -> str:
    """Draw a trace; return the text of the file."""
    sequence_picture(trace, NAMES, path, title="three workers", label=bytes.decode)
    return path.read_text("utf-8")


def crowded() -> Trace:
    """Return what happens under one fault of each kind that can be seen."""
    network, _, _, trace = counted(ListedFaults(FAULTS), upto=7)
    assert {fault.kind for fault in network.fired} == {fault.kind for fault in FAULTS}
    return trace


@pytest.mark.slow
def test_lifelines_messages_and_faults_are_there(tmp_path: Path) -> None:
    """Each process and the router that died, what was said, and each fault by its name."""
    text = drawn(tmp_path / "a.svg", crowded())
    said = re.findall("<!-- (.*?) -->", text)
    assert {*NAMES, "router", "three workers", "0 1", "1 2"} <= set(said)
    for fault in ("paused 2 s", "slow 40 ms", "crashed", "router down 300 ms"):
        assert fault in said
    assert "process_1 died: killed by signal 9" in said


@pytest.mark.slow
def test_a_picture_is_the_same_each_time_and_a_png_as_well(tmp_path: Path) -> None:
    """The same trace gives the same bytes; the suffix says the format."""
    trace = crowded()
    assert drawn(tmp_path / "a.svg", trace) == drawn(tmp_path / "b.svg", trace)
    sequence_picture(trace, NAMES, tmp_path / "a.png", title="", label=bytes.decode)
    with Image.open(tmp_path / "a.png") as picture:
        assert picture.format == "PNG"
        assert min(picture.size) > 500
    with pytest.raises(InputError, match=r"a\.gif: expected a name that ends in \.png"):
        sequence_picture(trace, NAMES, tmp_path / "a.gif", title="", label=bytes.decode)


@pytest.mark.slow
def test_of_a_long_run_the_end_is_shown(tmp_path: Path) -> None:
    """The first messages are left out, and how many they are is said."""
    _, _, _, trace = counted(ListedFaults(()), upto=100)
    left_out = len(trace.arrows) - ARROWS_MAX
    assert left_out > 0
    text = drawn(tmp_path / "a.svg", trace)
    assert f"three workers; the first {left_out} messages are left out" in text
    assert "<!-- 0 1 -->" not in text
    assert "<!-- 0 100 -->" in text


def test_nothing_is_drawn_of_nothing(tmp_path: Path) -> None:
    """A run without any message has lifelines."""
    assert "process_2" in drawn(tmp_path / "a.svg", Trace())
