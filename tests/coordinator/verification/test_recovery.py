"""Recovery: every message of every undamaged chunk comes back, and nothing else does."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import pytest

from command_line import GOLDEN
from cubepath.coordinator.commands.main import main
from cubepath.coordinator.verification.recording import recover, verify
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.recordings.recording import read_recording
from cubepath.protocol.recordings.remains import remains_of
from cubepath.protocol.scenes.specs import scene_from_spec
from wrecks import Kept, taken_apart, wholes, wreck


def recovered(data: bytes, folder: Path) -> list[Kept] | None:
    """Return what recovery writes of the bytes of a file; None if it finds nothing."""
    path, out = folder / "wreck.mcap", folder / "out.mcap"
    path.write_bytes(data)
    out.unlink(missing_ok=True)
    try:
        recover(path, out)
    except InputError:
        return None
    return taken_apart("out", out.read_bytes()).messages


def is_part(some: Iterable[Kept], whole: Iterable[Kept]) -> bool:
    """Return whether some messages stand in a whole, in its order, each once."""
    left = iter(whole)
    return all(each in left for each in some)


def check(seeds: Iterable[int], folder: Path) -> None:
    """Wreck recordings, recover them, and compare."""
    for seed in seeds:
        made = wreck(seed)
        found = recovered(made.data, folder)
        if found is None:
            assert not made.undamaged, f"seed {seed}: {made.whole.name}: refused"
            continue
        where = f"seed {seed}: {made.whole.name}: {len(found)} of {len(made.undamaged)}"
        assert is_part(found, made.whole.messages), f"{where}: something was made up"
        assert is_part(made.undamaged, found), f"{where}: something was lost"


def test_the_wrecks_are_of_all_formats_and_many_chunks() -> None:
    """What is wrecked: golden recordings of three formats, closed and killed, with many chunks."""
    sizes = [len(whole.chunks) for whole in wholes()]
    assert len(sizes) == 11
    assert max(sizes) > 40
    formats = {each.data[each.data.index(b"cubepath-recording-") + 19] for each in wholes()}
    assert formats == {*b"123"}


@pytest.mark.slow
def test_what_no_damage_touched_is_recovered_and_nothing_is_made_up(tmp_path: Path) -> None:
    """Forty files, cut off and with flipped bits at random."""
    check(range(40), tmp_path)


@pytest.mark.thorough
def test_the_same_of_a_thousand(tmp_path: Path) -> None:
    """Cut off, with flipped bits, or both."""
    check(range(40, 1000), tmp_path)


def test_a_recording_without_its_scene_is_recovered_alone_and_whole_once_it_is_told(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The messages first, for other tools; with --system a recording that verifies."""
    whole = (GOLDEN / "hex-5.mcap").read_bytes()
    place = whole.index(b"cubepath-system-1")
    lost, alone, told = (tmp_path / f"{name}.mcap" for name in ("lost", "alone", "told"))
    lost.write_bytes(whole[:place] + b"C" + whole[place + 1 :])
    assert main(["verify", str(lost), "--recover", str(alone)]) == 0
    assert "its scene is lost" in (said := capsys.readouterr().err)
    assert "--system hex:n=5 makes a recording" in said
    messages = taken_apart("whole", whole).messages
    assert taken_apart("alone", alone.read_bytes()).messages == messages
    with pytest.raises(InputError, match=r"the attachment scene\.toml is lost"):
        read_recording(alone)
    for source in (lost, alone):
        told.unlink(missing_ok=True)
        assert main(["verify", str(source), "--recover", str(told), "--system", "hex:n=5"]) == 0
        assert verify(told).ok
        assert read_recording(told).scene.start == scene_from_spec("hex:n=5").start
    assert taken_apart("told", told.read_bytes()).messages == messages


@pytest.mark.parametrize("name", ["hex-5", "hex-free-5"])
def test_without_parameters_the_format_is_known_by_the_messages(name: str, tmp_path: Path) -> None:
    """And their loss is told, also by who verifies what was recovered."""
    whole = (GOLDEN / f"{name}.mcap").read_bytes()
    place = whole.index(b"cubepath-recording-")
    path = tmp_path / "lost.mcap"
    path.write_bytes(whole[: place - 4] + b"\xff" + whole[place - 3 :])
    with pytest.raises(InputError, match="no cubepath recording"):
        read_recording(path)
    found = remains_of(path)
    assert found.format == read_recording(GOLDEN / f"{name}.mcap").format
    assert any("parameters are lost" in problem for problem in found.problems)
    saved = recover(path, tmp_path / "out.mcap")
    assert saved.messages == len(taken_apart("", whole).messages)
    again = read_recording(tmp_path / "out.mcap")
    assert again.scene.start == scene_from_spec("hex:n=5").start
    assert not verify(again).ok


def test_nothing_to_recover_is_bad_input(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A file cut before its first chunk ends, or that is no recording: exit code 2, one line."""
    whole = (GOLDEN / "hex-5.mcap").read_bytes()
    begin, end, _ = taken_apart("", whole).chunks[0]
    path, out = tmp_path / "cut.mcap", tmp_path / "out.mcap"
    for data in (whole[: end - 1], whole[:begin], b"no recording", b""):
        path.write_bytes(data)
        assert main(["verify", str(path), "--recover", str(out)]) == 2
        assert capsys.readouterr().err.count("\n") == 1
        assert not out.exists()
    path.write_bytes(whole[:end])
    assert main(["verify", str(path), "--recover", str(out)]) == 0
    assert out.exists()
