"""Timetables of vehicles that follow one another, as files."""

from fractions import Fraction
from pathlib import Path

import pytest

from cubepath.protocol.core.errors import InputError
from cubepath.protocol.file_forms import form_of
from cubepath.protocol.path_files.following import (
    FollowingFile,
    FollowingHead,
    FollowingLine,
    read_following,
    write_following,
)

HEAD = '{"format":"cubepath-following-1","rule":"mapf","vehicles":1,"moves":1,"rounds":1}'
TIMED = HEAD.replace('"rounds"', '"makespan"')
LINE = '{"vehicle":0,"from":[0,0],"to":[1,0],"round":1}'


def test_what_is_written_is_read(tmp_path: Path) -> None:
    """Both by rounds and by times, with and without the input's moves."""
    head = FollowingHead(
        "cgshop", vehicles=2, moves=1, makespan="5/2", input_moves=3, cancelled=[(1, 2)]
    )
    line = FollowingLine(1, (0, -1), (0, 0), start=1, end="5/2", move=3, after=2)
    path = tmp_path / "follow.jsonl"
    write_following(path, FollowingFile(head, (line,)))
    found = read_following(path)
    assert found == FollowingFile(head, (line,))
    assert found.lines[0].times == (Fraction(1), Fraction(5, 2))
    assert form_of(path).name == "following timetable"


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "follow.jsonl:1: found no whole JSON object"),
        (HEAD.replace("mapf", "bus"), "follow.jsonl:1: Invalid enum value 'bus'"),
        (HEAD.replace(',"rounds":1', ""), 'expected either "rounds" or "makespan"'),
        (HEAD[:-1] + ',"input_moves":1}', 'expected both of "input_moves" and "cancelled"'),
        (HEAD, "0 moves, but the first line says 1"),
        (f"{HEAD}\n{LINE}\n{LINE}", "2 moves, but the first line says 1"),
        (f"{HEAD}\n{LINE[:-1]}", "follow.jsonl:2: found no whole JSON object"),
        (f"{HEAD}\n{LINE.replace('1}', '0}')}", "follow.jsonl:2: Expected `int` >= 1"),
        (f"{HEAD}\n{LINE.replace('round', 'start')}", 'expected a "round"'),
        (f"{TIMED}\n{LINE}", 'expected "start" and "end"'),
        (f"{TIMED}\n{LINE.replace('round', 'end')}", 'expected "start" and "end"'),
        (
            f'{TIMED}\n{LINE.replace("round", "start")[:-1]},"end":"1/2"}}',
            "begins at 1 and ends at 1/2, expected a later end",
        ),
        (f'{HEAD}\n{LINE[:-1]},"round":2}}', "stands twice"),
    ],
)
def test_bad_files_are_refused_with_the_line(tmp_path: Path, text: str, said: str) -> None:
    """One line says what was found, where, and what was expected."""
    path = tmp_path / "follow.jsonl"
    path.write_text(text)
    with pytest.raises(InputError) as error:
        read_following(path)
    assert said in str(error.value)
    assert "\n" not in str(error.value)
