"""Files of named blocks with checksums, which hold proofs and the logs of solvers.

After a first line come blocks: a line with name, length and CRC-32, then as many bytes (zstd), and
a line end; the last line has the number of blocks and the SHA-256 of everything before it. So a
changed byte is refused with the name and position of its block. See docs/proofs.md.
"""

import re
import zlib
from collections.abc import Iterable, Iterator, Sequence
from hashlib import sha256
from typing import Any, BinaryIO, TypeVar

import msgspec
import numpy as np
import zstandard
from numpy.typing import NDArray

from cubepath.protocol.core.errors import CheckError, InputError
from cubepath.protocol.core.input_files import InputFile, readable
from cubepath.protocol.core.parsing import check_keys
from cubepath.protocol.core.sites import site_hook

LOG_BYTES = 1 << 20
"""The greatest size of a block of the log before compression."""
_BLOCK_BYTES = 1 << 27
"""The greatest size of any other block, compressed or not: ten million variables take no more.

So a false length, or a block that unpacks to more than it seems, takes no more memory than this."""
_HEAD = re.compile(rb"([a-z]+) (0|[1-9][0-9]{0,9}) ([0-9a-f]{8})\n", re.ASCII)
_END = re.compile(rb"end (0|[1-9][0-9]{0,9}) ([0-9a-f]{64})\n", re.ASCII)
_HEAD_BYTES = 100

_json = msgspec.json.Encoder().encode
_Type = TypeVar("_Type")


class BlockWriter:
    """A file of blocks being written: the hash of what was written, and the number of blocks."""

    def __init__(self, stream: BinaryIO, first_line: bytes) -> None:
        """Write the first line."""
        self._stream = stream
        self._hash = sha256()
        self._blocks = 0
        self._compressor = zstandard.ZstdCompressor(level=3)
        self._put(first_line)

    def statement(self, proof: object, kind: type[msgspec.Struct]) -> None:
        """Write what a proof says first: those of its attributes that are fields of a struct."""
        self.json(
            "statement", msgspec.convert(proof, kind, from_attributes=True, dec_hook=site_hook)
        )

    def json(self, name: str, content: Any) -> None:
        """Write a block that holds JSON."""
        self.block(name, _json(content))

    def variables(self, rows: NDArray[np.int32], width: int) -> None:
        """Write what variables mean: this many little-endian int32 for each."""
        found = np.ascontiguousarray(rows, dtype="<i4").reshape(-1, width)
        self.block("variables", found.tobytes())

    def log(self, chunks: Iterable[bytes]) -> None:
        """Write a log as blocks of `LOG_BYTES` at most, however long its pieces are."""
        for piece in _pieces(chunks):
            self.block("log", piece)

    def end(self) -> None:
        """Write the last line."""
        self._stream.write(b"end %d %s\n" % (self._blocks, self._hash.hexdigest().encode()))

    def block(self, name: str, content: bytes) -> None:
        """Write a block."""
        if len(content) > _BLOCK_BYTES:
            raise CheckError(
                f"the proof is too large: block {name}: {len(content)} bytes, expected"
                f" {_BLOCK_BYTES} at most"
            )
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


class Log:
    """The blocks of a log, compressed; each iteration yields them from the first."""

    def __init__(self, payloads: Sequence[bytes]) -> None:
        self._payloads = payloads

    def __iter__(self) -> Iterator[bytes]:
        for payload in self._payloads:
            yield zstandard.ZstdDecompressor().decompressobj().decompress(payload)


class BlockReader:
    """A file of blocks being read: where its next block begins, and the hash of what was read."""

    def __init__(self, file: InputFile, first_line: bytes) -> None:
        """Take a file; InputError if it has another first line."""
        self._path = file.path
        if file.head(len(first_line)) != first_line:
            expected = first_line.decode().strip()
            raise InputError(f"{file.path}: no proof: expected {expected!r} as its first line")
        with readable(file.path):
            self._size = file.stream.seek(0, 2)
            self._stream = file.stream
            self._stream.seek(len(first_line))
        self._hash = sha256(first_line)
        self._at = len(first_line)
        self._blocks = 0
        self._name = ""
        self._expected: tuple[str, ...] = ()

    def json(self, name: str, kind: type[_Type], keys: int = 0) -> _Type:
        """Return what the next block holds; an object with this many keys, if it is one."""
        content = self.block(name)
        found = self.decode(kind, content)
        if keys:
            try:
                check_keys(content, keys)
            except InputError as error:
                raise self.error(str(error)) from None
        return found

    def decode(self, kind: type[_Type], content: bytes) -> _Type:
        """Return what JSON in the last block holds."""
        try:
            return msgspec.json.decode(content, type=kind, dec_hook=site_hook)
        except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
            raise self.error(str(error)) from None

    def variables(self, width: int) -> NDArray[np.int32]:
        """Return the block of variables, with shape (variables, width)."""
        content = self.block("variables")
        if len(content) % (4 * width):
            raise self.error(f"{len(content)} bytes, expected {4 * width} for each variable")
        return np.frombuffer(content, dtype="<i4").astype(np.int32).reshape(-1, width)

    def log_and(self, name: str, kind: type[_Type]) -> tuple[Log, _Type]:
        """Return the log, any number of blocks, and what the block of JSON after it holds."""
        self._expected = ("log", name)
        log: list[bytes] = []
        payload = self._payload()
        while self._name == "log":
            self._content(payload, LOG_BYTES)
            log.append(payload)
            payload = self._payload()
        return Log(log), self.decode(kind, self._content(payload))

    def block(self, name: str) -> bytes:
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
                raise self.error("it is missing")
            raise self.error(f"found {_shown(line)}, expected its name, length and CRC")
        self._name = head[1].decode()
        size = int(head[2])
        left = self._size - self._at - len(line)
        if size >= left:
            raise self.error(f"{size} bytes and a line end are to follow, the file has {left}")
        if size > _BLOCK_BYTES:
            raise self.error(f"{size} bytes, expected {_BLOCK_BYTES} at most")
        with readable(self._path):
            payload, newline = self._stream.read(size), self._stream.read(1)
        found = zlib.crc32(payload, zlib.crc32(line[: head.start(3)]))
        if found != int(head[3], 16):
            raise self.error(f"its CRC is {found:08x}, expected {head[3].decode()}: it was changed")
        if newline != b"\n":
            raise self.error("its last byte is no line end: it was changed")
        for part in (line, payload, newline):
            self._hash.update(part)
        self._blocks += 1
        return payload

    def _content(self, payload: bytes, most: int = _BLOCK_BYTES) -> bytes:
        """Return what a block holds; not more than `most` bytes."""
        try:
            size = zstandard.frame_content_size(payload)
            if not 0 <= size <= most:
                length = "of unknown length" if size < 0 else f"{size} bytes"
                raise self.error(f"what it holds is {length}, expected {most} bytes at most")
            # Into the size that it claims: what holds more is refused before it is unpacked.
            found: bytes = zstandard.ZstdDecompressor().decompress(payload, allow_extra_data=False)
        except zstandard.ZstdError as error:
            raise self.error(f"it does not decompress: {error}") from None
        return found

    def end(self) -> None:
        """Read the last line; nothing may follow it."""
        self._at, self._name = self._stream.tell(), "end"
        with readable(self._path):
            line = self._stream.readline(_HEAD_BYTES)
            rest = self._stream.read(1)
        found = _END.fullmatch(line)
        if found is None:
            raise self.error(f"found {_shown(line)}, expected 'end', a number and a SHA-256")
        if int(found[1]) != self._blocks:
            raise self.error(f"{found[1].decode()} blocks, the file has {self._blocks}")
        if found[2].decode() != self._hash.hexdigest():
            raise self.error("another SHA-256 than that of the file: it was changed")
        if rest:
            self._at += len(line)
            raise self.error("more bytes follow, expected none")

    def error(self, why: str) -> CheckError:
        """Return an error that names the file, the block and its place."""
        return CheckError(f"{self._path}: block {self._name}, byte {self._at}: {why}")


def _shown(line: bytes) -> str:
    if not line:
        return "the end of the file"
    text = line.decode("ascii", errors="backslashreplace").rstrip("\n")
    return repr(text if len(text) <= 60 else text[:57] + "...")
