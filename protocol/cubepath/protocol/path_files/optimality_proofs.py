"""Proofs of optimality: a schedule, and the refutation of every schedule with fewer rounds.

Room: protocol; touches only the file that it is given. This is the format, described in
docs/proofs.md: blocks with a name, a length and a CRC, and at the end the hash of the whole file,
so that any changed byte is refused with its block and place. What a proof proves is decided in the
coordinator, by `cubepath.coordinator.verification`, which shares only this module with the code
that makes proofs.
"""

from __future__ import annotations

import re
import zlib
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from hashlib import sha256
from pathlib import Path
from typing import Annotated, Any, BinaryIO, Literal, NamedTuple, TypeAlias, TypeVar

import msgspec
import numpy as np
import zstandard
from numpy.typing import NDArray

from cubepath.protocol.core.actions import Action
from cubepath.protocol.core.errors import CheckError, InputError
from cubepath.protocol.core.input_files import InputFile, Source, opened, readable
from cubepath.protocol.core.json_keys import check_keys
from cubepath.protocol.core.names import GeneratorPlacement
from cubepath.protocol.core.output_files import written_whole
from cubepath.protocol.core.sites import (
    Site,
    in_order,
    pairs_from_json,
    sites_from_json,
    to_json,
)

FIRST_LINE = b"cubepath proof 1\n"
SUFFIX = ".proof"
LOG_BYTES = 1 << 20
"""The greatest size of a block of the log before compression."""
BLOCKS = ("statement", "moves", "sites", "variables", "ladders", "groups", "log", "schedule")
"""The names of the blocks in their order; there may be any number of blocks of the log."""
_BLOCK_BYTES = 1 << 30
"""The greatest size of any other block, so that a false length takes no more memory than this."""
_HEAD = re.compile(rb"([a-z]+) (0|[1-9][0-9]{0,9}) ([0-9a-f]{8})\n", re.ASCII)
_END = re.compile(rb"end (0|[1-9][0-9]{0,9}) ([0-9a-f]{64})\n", re.ASCII)
_HEAD_BYTES = 100

Standing: TypeAlias = Literal["proved", "agreed"]
LadderKind: TypeAlias = Literal["on", "off", "stay"]
GroupKind: TypeAlias = Literal["at most one", "exactly one"]
_Number = Annotated[int, msgspec.Meta(ge=0, le=2**31 - 1)]


class Ladder(NamedTuple):
    """At most one of these moves: an order of move variables that prefix variables count along.

    All are of one round, and `site`, an index, is in the trace of each. They turn it on, turn it
    off, or hold it in their trace ("stay"). `members` are numbers of variables, from 1.
    """

    site: int
    round: int
    kind: LadderKind
    members: Sequence[int]


class Group(NamedTuple):
    """Sites, by index, of which at most one or exactly one is on in every state."""

    kind: GroupKind
    sites: Sequence[int]


def _no_variables() -> NDArray[np.int32]:
    return np.zeros((0, 3), dtype=np.int32)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class OptimalityProof:
    """The content of a proof file: no schedule has `refuted` rounds or fewer; one has `cubes`.

    `system` is the scene as TOML, or None, in which case `moves` are the actions themselves instead
    of their names. `start` and `goal` are complete states. Actions and sites have their positions
    in `moves` and `sites` as numbers. `variables` has a row (kind, index, time) for each variable
    of the clauses, int32, the first of which is variable 1. `log` is a binary DRAT log, in pieces
    of any length; it is read once by `write_proof`. What was read from a file can be read again.
    Where the windows alone refute so many rounds there are no variables, ladders, groups and log.
    """

    system: str | None
    start: Sequence[Site]
    goal: Sequence[Site]
    refuted: int
    cubes: int
    solver: str = ""
    standing: Standing = "proved"
    moves: Sequence[GeneratorPlacement] | Sequence[Action]
    sites: Sequence[Site] = ()
    variables: NDArray[np.int32] = field(default_factory=_no_variables)
    ladders: Sequence[Ladder] = ()
    groups: Sequence[Group] = ()
    log: Iterable[bytes] = ()
    schedule: Sequence[Sequence[int]]


class _Statement(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    system: str | None
    start: list[Any]
    goal: list[Any]
    refuted: _Number
    cubes: _Number
    solver: str
    standing: Standing


class _OwnMove(msgspec.Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    support: list[Any]
    trace: list[Any]
    before: list[Any]
    after: list[Any]
    free: list[Any] = []
    guards: list[tuple[Any, Any]] = []


_json = msgspec.json.Encoder().encode
_Type = TypeVar("_Type")


def write_proof(path: Path | str, proof: OptimalityProof) -> None:
    """Write a proof; the file is complete afterwards, or unchanged.

    The log is taken piece by piece, so it need not fit into memory. Raises InputError if the file
    cannot be written, CheckError if the disk is full.

    >>> left, right = Action([1, 2], [1, 2], [1], [2]), Action([2, 3], [2, 3], [2], [3])
    >>> write_proof("two.proof", OptimalityProof(
    ...     system=None, start=[1], goal=[3], refuted=1, cubes=2,
    ...     moves=[left, right], schedule=[[0], [1]],
    ... ))
    >>> check_optimality(read_proof("two.proof")).optimal
    True
    """
    with written_whole(path) as stream:
        _Writing(stream).write(proof)


class _Writing:
    """A proof being written: the hash of what was written, and the number of blocks."""

    def __init__(self, stream: BinaryIO) -> None:
        self._stream = stream
        self._hash = sha256()
        self._blocks = 0
        self._compressor = zstandard.ZstdCompressor(level=3)

    def write(self, proof: OptimalityProof) -> None:
        self._put(FIRST_LINE)
        statement = _Statement(
            proof.system,
            to_json(tuple(proof.start)),
            to_json(tuple(proof.goal)),
            proof.refuted,
            proof.cubes,
            proof.solver,
            proof.standing,
        )
        self._block("statement", _json(statement))
        self._block("moves", _json([_move_to_json(move) for move in proof.moves]))
        self._block("sites", _json(to_json(tuple(proof.sites))))
        variables = np.ascontiguousarray(proof.variables, dtype="<i4").reshape(-1, 3)
        self._block("variables", variables.tobytes())
        ladders = [[*each[:3], [int(move) for move in each.members]] for each in proof.ladders]
        self._block("ladders", _json(ladders))
        groups = [[each.kind, [int(site) for site in each.sites]] for each in proof.groups]
        self._block("groups", _json(groups))
        for piece in _pieces(proof.log):
            self._block("log", piece)
        schedule = [[int(action) for action in cube] for cube in proof.schedule]
        self._block("schedule", _json(schedule))
        self._stream.write(b"end %d %s\n" % (self._blocks, self._hash.hexdigest().encode()))

    def _block(self, name: str, content: bytes) -> None:
        payload = self._compressor.compress(content)
        head = f"{name} {len(payload)} ".encode()
        crc = zlib.crc32(payload, zlib.crc32(head))
        self._put(b"%s%08x\n" % (head, crc))
        self._put(payload)
        self._put(b"\n")
        self._blocks += 1

    def _put(self, data: bytes) -> None:
        self._stream.write(data)
        self._hash.update(data)


def _move_to_json(move: GeneratorPlacement | Action) -> Any:
    if isinstance(move, GeneratorPlacement):
        return [move.generator, to_json(move.at)]
    before, after = move.ends
    return _OwnMove(
        support=to_json(in_order(move.support)),
        trace=to_json(in_order(move.trace)),
        before=to_json(in_order(before)),
        after=to_json(in_order(after)),
        free=to_json(in_order(move.free)),
        guards=to_json(in_order(move.guards)),
    )


def _pieces(chunks: Iterable[bytes]) -> Iterator[bytes]:
    """Yield the same bytes in pieces of the size of a block."""
    waiting = bytearray()
    for chunk in chunks:
        waiting += chunk
        while len(waiting) >= LOG_BYTES:
            yield bytes(waiting[:LOG_BYTES])
            del waiting[:LOG_BYTES]
    if waiting:
        yield bytes(waiting)


def is_proof(source: Source) -> bool:
    """Return whether a file begins as a proof does; InputError if it cannot be read."""
    with opened(source) as file:
        return file.head(len(FIRST_LINE)) == FIRST_LINE


def read_proof(source: Source) -> OptimalityProof:
    """Read a proof whose checksums all hold.

    Whether it proves anything is not looked at, nor whether its numbers are those of sites, moves
    and variables. Raises InputError if the file cannot be read or is no proof, and CheckError, with
    the block and the byte at which it begins, if it was changed or its content is malformed.

    >>> step = Action([1, 2], [1, 2], [1], [2])
    >>> write_proof("one.proof", OptimalityProof(
    ...     system=None, start=[1], goal=[2], refuted=0, cubes=1, moves=[step], schedule=[[0]],
    ... ))
    >>> proof = read_proof("one.proof")
    >>> proof.start, proof.goal, proof.refuted, proof.standing
    ((1,), (2,), 0, 'proved')
    """
    with opened(source) as file:
        return _Reading(file).proof()


class _Log:
    """The blocks of a log, compressed; each iteration yields them from the first."""

    def __init__(self, payloads: Sequence[bytes]) -> None:
        self._payloads = payloads

    def __iter__(self) -> Iterator[bytes]:
        for payload in self._payloads:
            yield zstandard.ZstdDecompressor().decompressobj().decompress(payload)


class _Reading:
    """A proof being read: where its next block begins, and the hash of what was read."""

    def __init__(self, file: InputFile) -> None:
        self._path = file.path
        if file.head(len(FIRST_LINE)) != FIRST_LINE:
            expected = FIRST_LINE.decode().strip()
            raise InputError(f"{file.path}: no proof: expected {expected!r} as its first line")
        with readable(file.path):
            self._size = file.stream.seek(0, 2)
            self._stream = file.stream
            self._stream.seek(len(FIRST_LINE))
        self._hash = sha256(FIRST_LINE)
        self._at = len(FIRST_LINE)
        self._blocks = 0
        self._name = ""
        self._expected: tuple[str, ...] = BLOCKS[:1]

    def proof(self) -> OptimalityProof:
        """Return the proof, once everything to the end of the file was read."""
        said = self._json("statement", _Statement, keys=7)
        start, goal = self._sites(said.start), self._sites(said.goal)
        moves = self._moves(said.system is not None)
        sites = self._sites(self._json("sites", list[Any]))
        variables = self._variables()
        ladders = self._json("ladders", list[tuple[_Number, _Number, LadderKind, list[_Number]]])
        groups = self._json("groups", list[tuple[GroupKind, list[_Number]]])
        self._expected = ("log", "schedule")
        log: list[bytes] = []
        payload = self._payload()
        while self._name == "log":
            self._content(payload, LOG_BYTES)
            log.append(payload)
            payload = self._payload()
        schedule = self._decode(list[list[_Number]], self._content(payload))
        self._end()
        return OptimalityProof(
            system=said.system,
            start=start,
            goal=goal,
            refuted=said.refuted,
            cubes=said.cubes,
            solver=said.solver,
            standing=said.standing,
            moves=moves,
            sites=sites,
            variables=variables,
            ladders=[Ladder(*each) for each in ladders],
            groups=[Group(*each) for each in groups],
            log=_Log(log),
            schedule=schedule,
        )

    def _moves(self, named: bool) -> Sequence[GeneratorPlacement] | Sequence[Action]:  # noqa: FBT001
        content = self._block("moves")
        if named:
            pairs = self._decode(list[tuple[str, Any]], content)
            places = self._sites([at for _, at in pairs])
            return [
                GeneratorPlacement(name, at) for (name, _), at in zip(pairs, places, strict=True)
            ]
        own = self._decode(list[_OwnMove], content)
        try:
            check_keys(content, 4 * len(own))
            return [_own_action(number, move) for number, move in enumerate(own)]
        except InputError as error:
            raise self._error(str(error)) from None

    def _variables(self) -> NDArray[np.int32]:
        content = self._block("variables")
        if len(content) % 12:
            raise self._error(f"{len(content)} bytes, expected 12 for each variable")
        return np.frombuffer(content, dtype="<i4").astype(np.int32).reshape(-1, 3)

    def _sites(self, values: Iterable[object]) -> tuple[Site, ...]:
        try:
            return sites_from_json(values)
        except InputError as error:
            raise self._error(str(error)) from None

    def _json(self, name: str, kind: type[_Type], keys: int = 0) -> _Type:
        content = self._block(name)
        found = self._decode(kind, content)
        if keys:
            try:
                check_keys(content, keys)
            except InputError as error:
                raise self._error(str(error)) from None
        return found

    def _decode(self, kind: type[_Type], content: bytes) -> _Type:
        try:
            return msgspec.json.decode(content, type=kind)
        except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
            raise self._error(str(error)) from None

    def _block(self, name: str) -> bytes:
        """Return the content of the next block, which must have this name."""
        self._expected = (name,)
        return self._content(self._payload())

    def _payload(self) -> bytes:
        """Return what the next block holds, compressed; its checksum holds."""
        self._at = self._stream.tell()
        self._name = " or ".join(self._expected)
        with readable(self._path):
            line = self._stream.readline(_HEAD_BYTES)
        head = _HEAD.fullmatch(line)
        if head is None or head[1].decode() not in self._expected:
            if _END.fullmatch(line) or not line:
                raise self._error("it is missing")
            raise self._error(f"found {_shown(line)}, expected its name, length and CRC")
        self._name = head[1].decode()
        size = int(head[2])
        left = self._size - self._at - len(line)
        if size >= left:
            raise self._error(f"{size} bytes and a line end are to follow, the file has {left}")
        if size > _BLOCK_BYTES:
            raise self._error(f"{size} bytes, expected {_BLOCK_BYTES} at most")
        with readable(self._path):
            payload, newline = self._stream.read(size), self._stream.read(1)
        found = zlib.crc32(payload, zlib.crc32(line[: head.start(3)]))
        if found != int(head[3], 16):
            raise self._error(
                f"its CRC is {found:08x}, expected {head[3].decode()}: it was changed"
            )
        if newline != b"\n":
            raise self._error("its last byte is no line end: it was changed")
        for part in (line, payload, newline):
            self._hash.update(part)
        self._blocks += 1
        return payload

    def _content(self, payload: bytes, most: int = _BLOCK_BYTES) -> bytes:
        """Return what a block holds; not more than `most` bytes."""
        try:
            size = zstandard.frame_content_size(payload)
            if not 0 <= size <= most:
                told = "of unknown length" if size < 0 else f"{size} bytes"
                raise self._error(f"what it holds is {told}, expected {most} bytes at most")
            decompressor = zstandard.ZstdDecompressor().decompressobj()
            found: bytes = decompressor.decompress(payload)
        except zstandard.ZstdError as error:
            raise self._error(f"it does not decompress: {error}") from None
        if len(found) != size or decompressor.unused_data:
            raise self._error("it is not one compressed frame")
        return found

    def _end(self) -> None:
        self._at, self._name = self._stream.tell(), "end"
        with readable(self._path):
            line = self._stream.readline(_HEAD_BYTES)
            rest = self._stream.read(1)
        found = _END.fullmatch(line)
        if found is None:
            raise self._error(f"found {_shown(line)}, expected 'end', a number and a SHA-256")
        if int(found[1]) != self._blocks:
            raise self._error(f"{found[1].decode()} blocks, the file has {self._blocks}")
        if found[2].decode() != self._hash.hexdigest():
            raise self._error("another SHA-256 than that of the file: it was changed")
        if rest:
            self._at += len(line)
            raise self._error("more bytes follow, expected none")

    def _error(self, why: str) -> CheckError:
        return CheckError(f"{self._path}: block {self._name}, byte {self._at}: {why}")


def _own_action(number: int, move: _OwnMove) -> Action:
    return Action(
        sites_from_json(move.support),
        sites_from_json(move.trace),
        sites_from_json(move.before),
        sites_from_json(move.after),
        free=sites_from_json(move.free),
        guards=pairs_from_json(move.guards),
        label=f"move {number}",
    )


def _shown(line: bytes) -> str:
    if not line:
        return "the end of the file"
    text = line.decode("ascii", errors="backslashreplace").rstrip("\n")
    return repr(text if len(text) <= 60 else text[:57] + "...")
