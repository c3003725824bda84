"""How records stand in MCAP files: heads, lengths that agree, and finding records again.

A record is a kind, a length and a body, and most bodies have lengths of their own in them. Where
both agree the next record is where they say; where they do not, or the kind is none, what follows
is searched for the next record that a CRC or a checksum vouches for.
"""

from __future__ import annotations

import re
import struct
import zlib
from collections.abc import Callable, Iterator, Mapping
from hashlib import sha256
from typing import Final

import msgspec
from mcap.opcode import Opcode

from cubepath.protocol.recordings.stored import Stored

MAGIC = b"\x89MCAP0\r\n"
HEAD = struct.Struct("<BQ")
"""The kind of a record, and the length of its body."""
CRC = struct.Struct("<I")
_WINDOW = 1 << 20
_U32: Final = 4
_U64: Final = 8
_PATTERN = re.compile(
    # A chunk compressed by zstd or lz4, or by nothing; an attachment; metadata of ours.
    rb"\x06(?=.{36}(?:\x04\0\0\0zstd|\x03\0\0\0lz4|\0\0\0\0))"
    rb"|\x09(?=.{24}[\x01-\xff]\0\0\0)"
    rb"|\x0c(?=.{8}[\x08-\x0f]\0\0\0cubepath)",
    re.DOTALL,
)
_SEEN = 48
"""So many bytes a pattern looks at, and some."""


def plausible(opcode: int) -> bool:
    """Return whether records of a kind may stand in the data section."""
    return Opcode.HEADER <= opcode <= Opcode.DATA_END


def expect_crc(data: bytes, expected: int) -> None:
    """ValueError if the CRC-32 of the data is another."""
    found = zlib.crc32(data)
    if found != expected:
        raise ValueError(f"its CRC is {found:08x}, expected {expected:08x}")


def checksum(values: Mapping[str, str]) -> str:
    """Return the checksum of the values of a metadata record.

    Such a record has no CRC, and the CRC of the data section comes at the end of the file.
    """
    return sha256(msgspec.json.encode(sorted(values.items()))).hexdigest()


def fits(stored: Stored, offset: int) -> bool:
    """Return whether a record begins at an offset: of a kind, with lengths that agree."""
    start = offset + HEAD.size
    if start > stored.size:
        return False
    opcode: int
    length: int
    opcode, length = HEAD.unpack(stored.read(offset, HEAD.size))
    if start + length > stored.size or not plausible(opcode):
        return False
    body = _Body(stored, start, length)
    match opcode:
        case Opcode.HEADER | Opcode.METADATA:
            end = body.after(body.after(0, _U32), _U32)
        case Opcode.CHUNK:
            end = body.after(body.after(28, _U32), _U64)
        case Opcode.MESSAGE_INDEX:
            end = body.after(2, _U32)
        case Opcode.ATTACHMENT:
            end = body.after(body.after(body.after(16, _U32), _U32), _U64) + CRC.size
        case Opcode.DATA_END:
            end = CRC.size
        case _:  # they do not say it twice
            return True
    return end == length


class _Body:
    """The body of a record, in which numbers tell how many bytes follow them."""

    def __init__(self, stored: Stored, start: int, length: int) -> None:
        self._stored, self._start, self._length = stored, start, length

    def after(self, place: int, width: int) -> int:
        """Return where that ends whose length stands at a place; beyond the end if it cannot."""
        if place + width > self._length:
            return self._length + 1
        told = self._stored.read(self._start + place, width)
        return place + width + int.from_bytes(told, "little")


def found_after(stored: Stored, offset: int, holds: Callable[[int], bool]) -> int | None:
    """Return where the next record after an offset begins that `holds`; None if there is none.

    Chunks, attachments and metadata are looked for; `holds` is asked of each place where one could
    begin, and its lengths agree.
    """
    return next((each for each in _places(stored, offset + 1) if holds(each)), None)


def _places(stored: Stored, begin: int) -> Iterator[int]:
    while begin < stored.size:
        # One that begins in this window is seen whole.
        window = stored.read(begin, _WINDOW + _SEEN)
        for found in _PATTERN.finditer(window):
            if found.start() >= _WINDOW:
                break
            if fits(stored, begin + found.start()):
                yield begin + found.start()
        begin += _WINDOW
