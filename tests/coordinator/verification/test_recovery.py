"""Recovery: every message of every undamaged chunk comes back, and nothing else does."""

import re
from collections.abc import Iterable
from pathlib import Path

import pytest

from cubepath.coordinator.commands.main import main
from cubepath.coordinator.verification.recording import verify
from cubepath.coordinator.verification.recovery import recover
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.recordings.recording import read_recording
from cubepath.protocol.recordings.remains import remains_of
from cubepath.protocol.scenes.specs import scene_from_spec
from processes.command_line import GOLDEN
from tampering.wrecks import Kept, taken_apart, wholes, wreck


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


def without(name: str, folder: Path, *words: bytes) -> Path:
    """Return a golden recording in which all records with one of these words are damaged."""
    data = bytearray((GOLDEN / f"{name}.mcap").read_bytes())
    for word in words:
        place = data.find(word)
        while place >= 0:
            data[place - 4] ^= 0xFF
            place = data.find(word, place + 1)
    path = folder / "lost.mcap"
    path.write_bytes(data)
    return path


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
    """What is wrecked: golden recordings of both formats, closed and killed, with many chunks."""
    sizes = [len(whole.chunks) for whole in wholes()]
    assert len(sizes) == 11
    assert max(sizes) > 30
    formats = {each.data[each.data.index(b"cubepath-recording-") + 19] for each in wholes()}
    assert formats == {*b"45"}


@pytest.mark.slow
def test_what_no_damage_touched_is_recovered_and_nothing_is_made_up(tmp_path: Path) -> None:
    """Forty files, cut off and with flipped bits at random."""
    check(range(40), tmp_path)


@pytest.mark.nightly
def test_the_same_of_a_thousand(tmp_path: Path) -> None:
    """Cut off, with flipped bits, or both."""
    check(range(40, 1000), tmp_path)


def test_a_recording_without_its_scene_is_recovered_alone_and_whole_once_it_is_told(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The messages first, for other tools; with --system a recording that verifies."""
    whole = (GOLDEN / "hex-5.mcap").read_bytes()
    lost = without("hex-5", tmp_path, b"cubepath-system-1")
    alone, told = (tmp_path / f"{name}.mcap" for name in ("alone", "told"))
    assert main(["log", "recover", str(lost), "-o", str(alone)]) == 0
    assert "its scene is lost" in (said := capsys.readouterr().err)
    assert "--system hex:n=5 makes a recording" in said
    messages = taken_apart("whole", whole).messages
    assert taken_apart("alone", alone.read_bytes()).messages == messages
    with pytest.raises(InputError, match=r"the attachment scene\.toml is lost"):
        read_recording(alone)
    for source in (lost, alone):
        told.unlink(missing_ok=True)
        assert main(["log", "recover", str(source), "-o", str(told), "--system", "hex:n=5"]) == 0
        assert verify(told).ok
        assert read_recording(told).scene.start == scene_from_spec("hex:n=5").start
    assert taken_apart("told", told.read_bytes()).messages == messages


@pytest.mark.parametrize("name", ["hex-5", "hex-free-5"])
def test_without_parameters_the_format_is_known_by_the_messages(name: str, tmp_path: Path) -> None:
    """And their loss is told, also by who verifies what was recovered."""
    whole = (GOLDEN / f"{name}.mcap").read_bytes()
    path = without(name, tmp_path, b"cubepath-recording-")
    with pytest.raises(InputError, match="no cubepath recording"):
        read_recording(path)
    found = remains_of(path)
    assert found.format == read_recording(GOLDEN / f"{name}.mcap").format
    assert any("parameters are lost" in problem for problem in found.problems)
    saved = recover(path, tmp_path / "out.mcap")
    assert saved.messages == len(taken_apart("", whole).messages)
    again = read_recording(tmp_path / "out.mcap")
    assert again.scene.start == scene_from_spec("hex:n=5").start
    checked = {check.name: check for check in verify(again).checks}
    if again.clock == "free":
        assert not checked["parameters"].ok  # nobody knows how many keepers there were
    else:
        assert checked["claims"].detail.startswith("not checked: the seed is lost")
        assert verify(again).ok


@pytest.mark.parametrize(
    ("name", "system", "said"),
    [
        ("hex-5", "hex:n=6", "names? hex:n=5"),
        ("hex-5", "hex-open:n=5", "names? hex:n=5"),
        ("agv-6", "agv:graph=grid4x4,n=6", "name agv-labelled:graph=grid4x4,n=6"),
    ],
)
def test_another_system_than_the_parameters_name_is_refused(
    name: str, system: str, said: str, tmp_path: Path
) -> None:
    """In one line, and nothing is written."""
    path, out = without(name, tmp_path, b"cubepath-system-1"), tmp_path / "out.mcap"
    with pytest.raises(InputError, match=f"system={system}: the parameters of .* {said}"):
        recover(path, out, scene=scene_from_spec(system))
    assert not out.exists()


@pytest.mark.parametrize(
    ("name", "system", "said"),
    [
        ("hex-5", "hex:n=4", r"round 1, module_4: the system has 4 modules"),
        ("hex-5", "agv:n=5", r"round 1: unknown generator 'pivot-2-right', expected edge"),
        ("hex-free-5", "hex:n=3", r"level \d+, module_\d: the system has 3 modules"),
        ("agv-6", "hex:n=6", r"round 1, module_2: begins at \[\[0,2\],2\], in the system at"),
        ("hex-5", "hex-open:n=5", None),
    ],
)
def test_a_system_that_cannot_be_it_is_refused_by_the_first_message_that_says_so(
    name: str, system: str, said: str | None, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Where the parameters are lost too; where only the whole of it is wrong, that is said."""
    path = without(name, tmp_path, b"cubepath-system-1", b"cubepath-recording-")
    out = tmp_path / "out.mcap"
    words = ["log", "recover", str(path), "-o", str(out), "--system", system]
    if said is None:
        assert main(words) == 0
        doubt = "bundle, deliveries, normal, class, certificate, summary fail"
        assert f"cubepath: with --system {system} {doubt}: is the run of" in capsys.readouterr().err
        return
    assert main(words) == 2
    line = capsys.readouterr().err
    assert re.fullmatch(f"cubepath: system={system}: {path}: {said}.*\n", line)
    assert not out.exists()


def headless(folder: Path) -> Path:
    """Return the beginning of a golden recording whose parameters and scene are lost."""
    data = (GOLDEN / "hex-5.mcap").read_bytes()
    chunks = taken_apart("hex-5", data).chunks
    begin, end = chunks[0][0], chunks[3][1]
    path = folder / "headless.mcap"
    path.write_bytes(data[:8] + bytes(begin - 8) + data[begin : end + 9])
    return path


def test_the_right_system_is_not_doubted_for_what_damage_has_taken(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """That the end is missing says nothing of the system."""
    words = ["log", "recover", str(headless(tmp_path)), "-o", str(tmp_path / "out.mcap")]
    assert main([*words, "--system", "hex:n=5"]) == 0
    said = capsys.readouterr().err
    assert "checks failed: readable, complete" in said
    assert "another system" not in said


def test_a_system_with_modules_that_never_report_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """All modules have reported a round before the next one is begun."""
    words = ["log", "recover", str(headless(tmp_path)), "-o", str(tmp_path / "out.mcap")]
    assert main([*words, "--system", "hex:n=6"]) == 2
    line = capsys.readouterr().err
    assert line.endswith("module_5: no report in 9 rounds; the system has 6 modules\n")
    assert not (tmp_path / "out.mcap").exists()


def test_a_scene_that_is_not_lost_is_not_told_anew(tmp_path: Path) -> None:
    """The same one may be told, another one is refused."""
    path = GOLDEN / "hex-5.mcap"
    assert recover(path, tmp_path / "out.mcap", scene=scene_from_spec("hex:n=5")).rounds == 29
    with pytest.raises(InputError, match=r"system=hex:n=6: the scene of .* is not lost, and it is"):
        recover(path, tmp_path / "other.mcap", scene=scene_from_spec("hex:n=6"))


def test_nothing_to_recover_is_bad_input(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A file cut before its first chunk ends, or that is no recording: exit code 2, one line."""
    whole = (GOLDEN / "hex-5.mcap").read_bytes()
    begin, end, _ = taken_apart("", whole).chunks[0]
    path, out = tmp_path / "cut.mcap", tmp_path / "out.mcap"
    for data in (whole[: end - 1], whole[:begin], b"no recording", b""):
        path.write_bytes(data)
        assert main(["log", "recover", str(path), "-o", str(out)]) == 2
        assert capsys.readouterr().err.count("\n") == 1
        assert not out.exists()
    path.write_bytes(whole[:end])
    assert main(["log", "recover", str(path), "-o", str(out)]) == 0
    assert out.exists()
