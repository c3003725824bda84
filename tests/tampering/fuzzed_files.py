"""Files that users give, changed in every way: each is read, or refused in one line."""

from collections.abc import Callable
from functools import cache
from io import BytesIO
from pathlib import Path
from random import Random

from cubepath.protocol.core.errors import CubepathError
from cubepath.protocol.core.input_files import InputFile
from cubepath.protocol.path_files.certificates import certificate_from_json
from cubepath.protocol.path_files.durations import read_durations, schedule_from_jsonl
from cubepath.protocol.path_files.following import read_following
from cubepath.protocol.path_files.moves import read_cubes, read_moves
from cubepath.protocol.path_files.numbered import IrregularError, read_path
from cubepath.protocol.scenes.specs import scene_from_spec
from cubepath.protocol.scenes.toml import scene_from_toml, scene_to_toml
from tampering.junk import changed_json, changed_lines, changed_toml

SPEC = "agv:graph=P6,n=2"
MOVES = b"".join(
    b'{"generator":"edge","at":[%d,%d]}\n' % at for at in ((1, 2), (2, 3), (2, 3), (1, 2))
)
CONTENTS = b"".join(
    b'{"id":%d,"support":[%d,"a",[%d,0]],"trace":[%d],"before":[%d],"after":[]}\n' % ((n,) * 5)
    for n in range(4)
)
CUBES = b'{"moves":[1,"a"]}\n{"moves":[{"generator":"edge","at":[0,1]},3]}\n'
SCHEDULE = b'{"moves":[{"generator":"edge","at":[1,2]}]}\n{"moves":[]}\n'
FOLLOWING = (
    b'{"format":"cubepath-following-1","rule":"mapf","vehicles":1,"moves":1,"rounds":1}\n'
    b'{"vehicle":0,"from":[0,0],"to":[1,0],"round":1}\n'
)
DURATIONS = (
    b'{"format":"cubepath-durations-1","default":1,"generators":{"edge":"1/2"},"ids":{"a":2},'
    b'"moves":[{"generator":"edge","at":[0,1],"duration":2.5}]}'
)
CERTIFICATE = (
    b'{"format":"cubepath-certificate-1","moves":2,"cancelled":[[0,1]],"cubes":[[0]],"chain":[0]}'
)
SPECS = (
    *("hex:n=4", "hex-tunnel:n=4", "sliding:p=2,q=1,n=3", "agv-labelled:graph=grid3x3,n=3"),
    *("agv:graph=K4,n=2", "arms:n=1", "arm:n=4", "arm-free:n=3", "assembly:kind=wall,n=3"),
    *("triangulation:n=6", "polygon:n=6", "words:word=abcab,relations=ab~ba+bc~cb"),
)


@cache
def _toml(spec: str) -> str:
    return scene_to_toml(scene_from_spec(spec))


def _file(data: bytes, name: str = "junk") -> InputFile:
    return InputFile(Path(name), BytesIO(data))


def _moves(random: Random) -> None:
    lines = random.choice((MOVES, CONTENTS))
    data = changed_lines(random, lines)
    scene = scene_from_spec(SPEC) if lines == MOVES else None
    try:
        found = read_path(_file(data), scene)
    except IrregularError:
        list(read_moves(_file(data), scene))
        return
    # Two readers of the same file: what one takes, the other does, and it is as much.
    assert len(list(read_moves(_file(data), scene))) == len(found.numbers)


FILES: tuple[Callable[[Random], object], ...] = (
    _moves,
    lambda random: list(read_cubes(_file(changed_lines(random, CUBES)))),
    lambda random: schedule_from_jsonl(changed_lines(random, SCHEDULE)),
    lambda random: read_following(_file(changed_lines(random, FOLLOWING))),
    lambda random: read_durations(_file(changed_json(random, DURATIONS), "junk.json")),
    lambda random: certificate_from_json(changed_json(random, CERTIFICATE)),
    lambda random: scene_from_toml(changed_toml(random, _toml(random.choice(SPECS))), "junk"),
)
"""Readers of files, each of a file that is changed at random."""


def refusal(read: Callable[[Random], object], random: Random) -> str | None:
    """Return why a file is refused, in one line; None if it is read."""
    try:
        read(random)
    except CubepathError as error:
        line = str(error)
    else:
        return None
    assert "\n" not in line, line
    return line
