"""Durations: read exactly, and refused in words."""

from fractions import Fraction
from pathlib import Path

import pytest

from cubepath.protocol.core.errors import InputError
from cubepath.protocol.path_files.durations import Durations, durations_in_words, read_durations

GOOD = """\
format = "cubepath-durations-1"
default = 2

[generators]
slide = 1.5
turn = "4/6"

[ids]
7 = 3

[[moves]]
generator = "slide"
at = [0, 1]
duration = "0.1"
"""


def test_durations_are_read_exactly(tmp_path: Path) -> None:
    """Decimals as they are written, fractions reduced; TOML and JSON alike."""
    path = tmp_path / "d.toml"
    path.write_text(GOOD)
    found = read_durations(path)
    assert found.default == 2
    assert found.named == {"slide": Fraction(3, 2), "turn": Fraction(2, 3), "7": 3}
    assert found.placed == {("slide", (0, 1)): Fraction(1, 10)}
    other = tmp_path / "d.json"
    other.write_text(
        '{"format": "cubepath-durations-1", "default": 2, "ids": {"7": 3},'
        ' "generators": {"slide": 1.50, "turn": "2/3"},'
        ' "moves": [{"generator": "slide", "at": [0, 1], "duration": 0.1}]}'
    )
    assert read_durations(other) == found


FORM = 'format = "cubepath-durations-1"\n'
MOVE = "[[moves]]\ngenerator = {}\nat = {}\nduration = {}\n"


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("", "format: found None, expected 'cubepath-durations-1'"),
        (
            'format = "cubepath-durations-2"',
            "format: found 'cubepath-durations-2', expected 'cubepath-durations-1'",
        ),
        (FORM + "defalt = 1", "unknown field `defalt`"),
        (FORM + "default = 0", "default: found the duration 0, expected more than 0"),
        (FORM + "default = -1", "default: found the time '-1', expected a number"),
        (FORM + "default = inf", "found the time 'Infinity'"),
        (FORM + "default = 1e9", "found the time '1E+9'"),
        (FORM + 'default = "1/0"', "found the time '1/0'"),
        (FORM + "default = true", "default: found True, expected a number such as 2, 1.5 or 3/2"),
        (FORM + "default = [1]", "default: found [1], expected a number"),
        (FORM + "default = 2020-01-01", "default: found datetime.date(2020, 1, 1), expected"),
        (FORM + "generators = 2", "Expected `object`, got `int` - at `$.generators`"),
        (FORM + "[generators]\nslide = 0.0", "generators.slide: found the duration 0"),
        (FORM + "[generators]\nslide = {}", "generators.slide: found {}, expected a number"),
        (FORM + '[ids]\n7 = "soon"', "ids.7: found the time 'soon', expected a number"),
        (FORM + "moves = 1", "Expected `array`, got `int` - at `$.moves`"),
        (FORM + "moves = [1]", "Expected `object`, got `int` - at `$.moves[0]`"),
        (FORM + '[[moves]]\ngenerator = "s"', "missing required field `at` - at `$.moves[0]`"),
        (FORM + "[[moves]]\nat = 1\nduraton = 1", "unknown field `duraton` - at `$.moves[0]`"),
        (FORM + MOVE.format("1", "1", "1"), "got `int` - at `$.moves[0].generator`"),
        (FORM + MOVE.format('"s"', "{}", "1"), "moves 1.at: a site is a JSON number, string"),
        (FORM + MOVE.format('"s"', "1", "0"), "moves 1.duration: found the duration 0, expected"),
        (FORM + "[generators]\na = 1\n[ids]\na = 1", "'a' is among the generators and the ids"),
        (FORM + MOVE.format('"s"', "1", "1") * 2, "moves 2: generator 's' at 1 comes twice"),
        (FORM + "default = ", "not TOML: Invalid value (at end of document)"),
        (FORM + "default = " + "[" * 50_000, "lists in lists, nested too deeply"),
    ],
)
def test_what_is_no_duration_is_refused(tmp_path: Path, text: str, reason: str) -> None:
    """In one line with the file, what was found, and where."""
    path = tmp_path / "d.toml"
    path.write_text(text)
    with pytest.raises(InputError) as refusal:
        read_durations(path)
    assert str(refusal.value).startswith(f"{path}: ")
    assert reason in str(refusal.value)
    assert "\n" not in str(refusal.value)


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("", "not JSON: Expecting value: line 1 column 1"),
        ("[]", "Expected `object`, got `array`"),
        ('{"format": "cubepath-durations-1", "default": NaN}', "default: found the time 'NaN'"),
        ('{"format": "cubepath-durations-1", "default": null}', "default: found None, expected"),
        ('{"default": 1, "default": 2}', 'line 1: key "default" stands twice'),
        ("[" * 100_000, "lists in lists, nested too deeply"),
    ],
)
def test_what_is_wrong_in_json_is_told_as_in_toml(tmp_path: Path, text: str, reason: str) -> None:
    """By its keys, and by line and column where it is no JSON."""
    path = tmp_path / "d.json"
    path.write_text(text)
    with pytest.raises(InputError) as refusal:
        read_durations(path)
    assert str(refusal.value).startswith(f"{path}: {reason}")
    assert "\n" not in str(refusal.value)


def test_a_place_has_its_decimals_as_numbers(tmp_path: Path) -> None:
    """Only times are read as they are written."""
    path = tmp_path / "d.toml"
    path.write_text(FORM + MOVE.format('"s"', "[0.5, 1.0]", "0.5"))
    assert read_durations(path).placed == {("s", (0.5, 1)): Fraction(1, 2)}


@pytest.mark.parametrize(
    ("texts", "reason"),
    [
        (["slide"], "slide: expected NAME=TIME, as in slide=3/2"),
        (["=2"], "=2: expected NAME=TIME"),
        (["slide="], "slide=: found the time '', expected a number such as 2, 1.5 or 3/2"),
        (["slide=0"], "slide=0: found the duration 0, expected more than 0"),
        (["slide=1", "turn=1", "slide=2"], "slide=2: 'slide' has a duration already"),
    ],
)
def test_what_is_no_duration_in_words_is_refused(texts: list[str], reason: str) -> None:
    """The text that is wrong, and what was expected."""
    with pytest.raises(InputError) as refusal:
        durations_in_words(texts)
    assert str(refusal.value).startswith(reason)


def test_a_duration_of_no_move_is_told_with_the_nearest_name() -> None:
    """A generator or an id that is misspelt."""
    told = Durations(named={"slid": Fraction(2)}).unused(["slide", 7])
    assert told == "'slid' (did you mean 'slide'?) is no generator and no id of a move"
