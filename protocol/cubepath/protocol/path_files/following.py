"""Timetables of vehicles that may follow one another: a line on the whole, then a move per line.

The first line has the rule and, by the numbers of moves in the input, what cancels. Each further
line has a move with its number in the input, and the number of the move that binds it: together
they prove that no move can begin earlier. A timetable whose moves are not those of its input has
neither. See docs/schedules.md.

This module reads and writes only the files it is given, and knows nothing of scheduling.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal, TypeAlias

import msgspec
import numpy as np
from numpy.typing import NDArray

from cubepath.protocol.core.errors import InputError, errors_at
from cubepath.protocol.core.input_files import InputFile, Source, opened
from cubepath.protocol.core.output_files import written_whole
from cubepath.protocol.path_files.durations import Number, Time, time_from
from cubepath.protocol.path_files.moves import decode_line, write_lines
from cubepath.protocol.path_files.proof_blocks import BlockReader, BlockWriter

FORMAT = "cubepath-following-1"
_HEAD_BYTES = 1 << 12

Count: TypeAlias = Annotated[int, msgspec.Meta(ge=0)]
Place: TypeAlias = Annotated[int, msgspec.Meta(ge=1)]
FileCell: TypeAlias = tuple[int, int]


class FollowingHead(
    msgspec.Struct,
    frozen=True,
    omit_defaults=True,
    forbid_unknown_fields=True,
    tag_field="format",
    tag=FORMAT,
):
    """The first line: the rule, how many vehicles and moves follow, and when the last one ends.

    `moves` is the number of lines. `rounds` is there where every move takes one round, otherwise
    `makespan`. `input_moves` is how many moves the input has, and `cancelled` the pairs of them
    that undo each other, as (earlier, later), by their numbers from 1: both are left out in a
    timetable of other moves than those of the input.
    """

    rule: Literal["mapf", "cgshop"]
    vehicles: Count
    moves: Count
    rounds: Count | None = None
    makespan: Number | None = None
    input_moves: Count | None = None
    cancelled: list[tuple[Place, Place]] | None = None


class FollowingLine(
    msgspec.Struct,
    frozen=True,
    gc=False,
    omit_defaults=True,
    forbid_unknown_fields=True,
    rename={"source": "from", "target": "to"},
):
    """A move: which vehicle goes from where to where, in which round, or from when to when.

    `move` is its number in the input, and `after` the number of the move that binds it: this one
    begins no earlier because of that one. A move that begins at the start has no `after`.
    """

    vehicle: Count
    source: FileCell
    target: FileCell
    round: Place | None = None
    start: Number | None = None
    end: Number | None = None
    move: Place | None = None
    after: Place | None = None

    @property
    def times(self) -> tuple[Time, Time]:
        """When the move begins and ends; in rounds, round 1 is from 0 to 1."""
        if self.round is not None:
            return self.round - 1, self.round
        return time_from(self.start or 0), time_from(self.end or 0)


@dataclass(frozen=True, slots=True)
class FollowingFile:
    """A whole timetable."""

    head: FollowingHead
    lines: tuple[FollowingLine, ...]


_head = msgspec.json.Decoder(FollowingHead).decode
_line = msgspec.json.Decoder(FollowingLine).decode


def read_following(source: Source) -> FollowingFile:
    """Read a timetable; InputError, with file and line, at the first invalid line.

    >>> head = FollowingHead("mapf", vehicles=1, moves=1, rounds=1)
    >>> write_following("follow.jsonl", FollowingFile(head, (FollowingLine(0, (0, 0), (1, 0), 1),)))
    >>> read_following("follow.jsonl").lines[0].target
    (1, 0)
    """
    with opened(source) as file:
        numbered = file.numbered_lines()
        head = _read_head(file, numbered)
        lines: list[FollowingLine] = []
        for number, text in numbered:
            try:
                found = decode_line(_line, text, 'the keys "vehicle", "from", "to" and "round"')
                _check_times(head, found)
            except InputError as error:
                raise InputError(f"{file.path}:{number}: {error}") from None
            lines.append(found)
        if len(lines) != head.moves:
            raise InputError(
                f"{file.path}: {len(lines)} moves, but the first line says {head.moves}"
            )
    return FollowingFile(head, tuple(lines))


def _read_head(file: InputFile, numbered: Iterator[tuple[int, bytes]]) -> FollowingHead:
    number, text = next(numbered, (1, b""))
    with errors_at(f"{file.path}:{number}"):
        head = decode_line(_head, text, f'"format": "{FORMAT}", "rule", "vehicles" and "moves"')
        _check_head(head)
    return head


def _check_head(head: FollowingHead) -> None:
    if (head.rounds is None) == (head.makespan is None):
        raise InputError('expected either "rounds" or "makespan"')
    if (head.input_moves is None) != (head.cancelled is None):
        raise InputError('expected both of "input_moves" and "cancelled", or neither')
    if head.makespan is not None:
        time_from(head.makespan)


def _check_times(head: FollowingHead, line: FollowingLine) -> None:
    timed = line.start is not None, line.end is not None
    if head.rounds is not None:
        if line.round is None or any(timed):
            raise InputError('expected a "round", and neither "start" nor "end"')
        return
    if line.round is not None or not all(timed):
        raise InputError('expected "start" and "end", and no "round"')
    begin, end = line.times
    if begin >= end:
        raise InputError(f"begins at {line.start} and ends at {line.end}, expected a later end")


def write_following(path: Path | str, timetable: FollowingFile) -> None:
    """Write a timetable, complete or not at all; InputError if it cannot be written.

    >>> head = FollowingHead("cgshop", vehicles=2, moves=0, rounds=0)
    >>> write_following("follow.jsonl", FollowingFile(head, ()))
    >>> read_following("follow.jsonl").head.rule
    'cgshop'
    """
    write_lines(path, [timetable.head, *timetable.lines])


FIRST_LINE = b"cubepath following proof 1\n"
_Number = Annotated[int, msgspec.Meta(ge=0, le=2**31 - 1)]
_WIDTH = 4
Cell: TypeAlias = tuple[int, int]


def _no_variables() -> NDArray[np.int32]:
    return np.zeros((0, _WIDTH), dtype=np.int32)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class FollowingProof:
    """The content of a file: no timetable has `refuted` rounds or fewer under `rule`; one has more.

    Vehicle a goes from ``starts[a]`` to ``ends[a]`` on a graph of `vertices`, which are cells, and
    `edges`, pairs of their positions there. `schedule` has for each round who goes where, as
    (vehicle, position of the vertex). `variables` has a row (kind, index, index, time) for each
    variable of the clauses, int32, the first of which is variable 1; `log` is a binary DRAT log, in
    pieces of any length, which is read once by `write_following_proof`. There are neither where
    some vehicle has further to go than `refuted`.
    """

    rule: Literal["mapf", "cgshop"]
    starts: Sequence[Cell]
    ends: Sequence[Cell]
    vertices: Sequence[Cell]
    edges: Sequence[tuple[int, int]]
    refuted: int
    solver: str = ""
    variables: NDArray[np.int32] = field(default_factory=_no_variables)
    log: Iterable[bytes] = ()
    schedule: Sequence[Sequence[tuple[int, int]]]


class _Statement(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    rule: Literal["mapf", "cgshop"]
    starts: list[Cell]
    ends: list[Cell]
    refuted: _Number
    solver: str
    standing: Literal["proved"] = "proved"


def write_following_proof(path: Path | str, proof: FollowingProof) -> None:
    """Write a proof; the file is complete afterwards, or unchanged.

    The log is taken piece by piece, so it need not fit into memory. Raises InputError if the file
    cannot be written, CheckError if the disk is full.

    >>> write_following_proof("way.proof", FollowingProof(
    ...     rule="mapf", starts=[(0, 0)], ends=[(2, 0)], vertices=[(0, 0), (1, 0), (2, 0)],
    ...     edges=[(0, 1), (1, 2)], refuted=1, schedule=[[(0, 1)], [(0, 2)]],
    ... ))
    >>> check_fewest_rounds(read_following_proof("way.proof")).optimal
    True
    """
    with written_whole(path) as stream:
        out = BlockWriter(stream, FIRST_LINE)
        out.statement(proof, _Statement)
        out.json("vertices", list(proof.vertices))
        out.json("edges", list(proof.edges))
        out.variables(proof.variables, _WIDTH)
        out.log(proof.log)
        out.json("schedule", [list(moves) for moves in proof.schedule])
        out.end()


def read_following_proof(source: Source) -> FollowingProof:
    """Read a proof whose checksums all hold.

    Whether it proves anything is not looked at, nor whether its numbers are those of vertices,
    vehicles and variables. Raises InputError if the file cannot be read or is no such proof, and
    CheckError, with the block and the byte at which it begins, if it was changed or its content is
    malformed.

    >>> write_following_proof("one.proof", FollowingProof(
    ...     rule="cgshop", starts=[(0, 0)], ends=[(1, 0)], vertices=[(0, 0), (1, 0)],
    ...     edges=[(0, 1)], refuted=0, schedule=[[(0, 1)]],
    ... ))
    >>> proof = read_following_proof("one.proof")
    >>> proof.rule, proof.ends, proof.refuted
    ('cgshop', [(1, 0)], 0)
    """
    with opened(source) as file:
        blocks = BlockReader(file, FIRST_LINE)
        statement = blocks.json("statement", _Statement, keys=6)
        vertices = blocks.json("vertices", list[Cell])
        edges = blocks.json("edges", list[tuple[_Number, _Number]])
        variables = blocks.variables(_WIDTH)
        log, schedule = blocks.log_and("schedule", list[list[tuple[_Number, _Number]]])
        blocks.end()
    fields = msgspec.structs.asdict(statement)
    del fields["standing"]  # a proof has no other
    return FollowingProof(
        **fields, vertices=vertices, edges=edges, variables=variables, log=log, schedule=schedule
    )
