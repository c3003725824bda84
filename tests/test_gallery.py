"""The gallery of the site shows every system, as it runs."""

from pathlib import Path

import pytest
from PIL import Image

import gallery
from cubepath.protocol.scenes.registry import all_families


def test_each_system_is_shown_once() -> None:
    """None of `cubepath system list` is missing."""
    assert sorted(map(gallery.name_of, gallery.shown())) == sorted(all_families())


@pytest.mark.slow
def test_an_entry_becomes_a_picture_and_a_page(tmp_path: Path) -> None:
    """By the command that the gallery prints, and two of `cubepath view`."""
    entry = next(each for each in gallery.shown() if gallery.name_of(each) == "words")
    gallery.draw(entry, tmp_path)
    with Image.open(tmp_path / "words.png") as picture:
        assert picture.width > 200
    assert "words" in (tmp_path / "words.html").read_text()


def test_a_command_that_fails_is_shown(tmp_path: Path) -> None:
    """A picture is missing for a reason, which the build prints."""
    with pytest.raises(RuntimeError, match=r"exit code 2\ncubepath: unknown system"):
        gallery.draw({"system": "no-such", "cube": 0}, tmp_path)
