"""Input files: opened once, looked at and read from the start, refused in one line."""

from pathlib import Path

import pytest

from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.input_files import opened, read_text
from cubepath.protocol.core.sites import Ordinals


def test_each_question_goes_back_to_the_start(tmp_path: Path) -> None:
    """The head, all of it, and its lines, in any order and more than once."""
    path = tmp_path / "file"
    path.write_bytes(b"\xef\xbb\xbfone\r\n\n  \n two\n")
    with opened(path) as file:
        for _ in range(2):
            assert list(file.numbered_lines()) == [(1, b"one"), (4, b"two")]
            assert file.head(4) == b"\xef\xbb\xbfo"
            assert file.text() == "one\n\n  \n two\n"
            assert file.whole() == path.read_bytes()
        assert file.head(100) == path.read_bytes()
        assert file.from_start().read(3) == b"\xef\xbb\xbf"


def test_an_open_file_stays_open_for_who_opened_it(tmp_path: Path) -> None:
    """A reader that is given one leaves it as it is; a reader that is given a path closes it."""
    path = tmp_path / "file"
    path.write_text("text")
    with opened(path) as file:
        assert read_text(file) == "text"
        with opened(file) as same:
            assert same is file
        assert not file.stream.closed
        assert list(file.numbered_lines()) == [(1, b"text")]
    assert file.stream.closed


def test_what_cannot_be_read_is_refused_with_its_path(tmp_path: Path) -> None:
    """Nothing there, a folder, and what is no text."""
    with pytest.raises(InputError, match=r"none: No such file or directory$"):
        read_text(tmp_path / "none")
    with pytest.raises(InputError, match="a folder, expected a file"):
        read_text(tmp_path)
    (tmp_path / "file").write_bytes(b"ab\xff")
    with pytest.raises(InputError, match=r"file: not UTF-8 text \(byte 2\)$"):
        read_text(tmp_path / "file")


def test_things_are_numbered_as_they_are_asked_for() -> None:
    """Equal ones alike, and by no other question."""
    numbers = Ordinals[object]()
    assert [numbers[each] for each in ("a", (1, 2), "a", (1.0, 2))] == [0, 1, 0, 1]
    assert ("b" in numbers, numbers.get("b"), list(numbers)) == (False, None, ["a", (1, 2)])
