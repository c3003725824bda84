"""A path may be text: wherever a function on the three large faces takes a path."""

import importlib
import inspect
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from cubepath.coordinator.auditing.rule_audit import audit
from cubepath.coordinator.playback.player import replay
from cubepath.coordinator.runs.contents import info
from cubepath.coordinator.verification.recording import verify
from cubepath.coordinator.verification.recovery import recover
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.input_files import opened, read_text
from cubepath.protocol.core.output_files import written_whole
from cubepath.protocol.recordings.recording import read_recording
from faces import FACES, ROOT

GOLDEN = str(ROOT / "logs" / "golden" / "hex-5.mcap")


def paths_alone() -> Iterator[str]:
    """Yield the parameters that take a `Path` and nothing else that is a path."""
    for face in FACES[:3]:
        package = importlib.import_module(face)
        for name in package.__all__:
            each = getattr(package, name)
            if inspect.isfunction(each):
                for parameter in inspect.signature(each).parameters.values():
                    told = str(parameter.annotation)
                    if re.search(r"\bPath\b", told) and "str" not in told:
                        yield f"{name}({parameter.name}: {told})"


def test_no_function_takes_a_path_and_not_its_text() -> None:
    """As their signatures say, for type checkers."""
    assert list(paths_alone()) == []


def test_files_are_opened_by_the_text_of_their_path(tmp_path: Path) -> None:
    """To be read, where messages name it, and to be written whole."""
    name = str(tmp_path / "file")
    with written_whole(name) as stream:
        stream.write(b"text")
    assert read_text(name) == "text"
    with opened(name) as file:
        assert file.path == Path(name)
    with pytest.raises(InputError, match="none: No such file or directory"):
        read_text(str(tmp_path / "none"))


@pytest.mark.parametrize("what", [verify, audit, info, replay])
def test_what_takes_a_recording_takes_its_file(what: object) -> None:
    """By its path or the text of that, with the same answer; a missing file is named."""
    assert callable(what)
    found = [what(each) for each in (read_recording(GOLDEN), Path(GOLDEN), GOLDEN)]
    if what is replay:
        found = [each.path_digest for each in found]
    assert found[0] == found[1] == found[2]
    with pytest.raises(InputError, match=r"nothing.mcap: No such file or directory"):
        what("nothing.mcap")


def test_what_is_recovered_is_written_to_the_text_of_a_path(tmp_path: Path) -> None:
    """From the text of a path, too; the answer names the new file as a path."""
    found = recover(GOLDEN, str(tmp_path / "whole.mcap"))
    assert found.out == tmp_path / "whole.mcap"
    assert verify(str(found.out)).ok
