"""The bytes of a recording, read where they are asked for.

A file stays open for as long as anyone may read from it, so that a recording need not fit into
memory; of a pipe, which cannot be read twice, the bytes are kept.
"""

from __future__ import annotations

import os
import stat
import weakref
import zlib
from hashlib import sha256

from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.input_files import InputFile, readable

_WINDOW = 1 << 20
"""Bytes read at a time, and kept for whoever reads on from there."""


class Stored:
    """The bytes that a file had when it was opened; InputError if it has fewer later."""

    def __init__(self, file: InputFile) -> None:
        """Take over the file: it is read on its own descriptor, even after it was closed."""
        self.path = file.path
        self._kept: bytes | None = None
        self._descriptor = -1
        self._at, self._window = 0, b""
        with readable(self.path):
            descriptor = _descriptor_of(file)
            if descriptor is None:
                self._kept = file.whole()
                self.size = len(self._kept)
            else:
                weakref.finalize(self, os.close, descriptor)
                self._descriptor = descriptor
                self.size = os.fstat(descriptor).st_size

    def read(self, offset: int, size: int) -> bytes:
        """Return the bytes from an offset on, fewer than `size` only at the end of the file."""
        begin = offset - self._at
        if begin < 0 or begin + size > len(self._window):
            self._window = self._fetch(offset, max(size, _WINDOW))
            self._at, begin = offset, 0
        return self._window[begin : begin + size]

    def crc(self, end: int) -> int:
        """Return the CRC-32 of the bytes before an offset."""
        found = 0
        for offset in range(0, end, _WINDOW):
            found = zlib.crc32(self._fetch(offset, min(_WINDOW, end - offset)), found)
        return found

    def sha256(self) -> str:
        """Return the SHA-256 of all bytes in hexadecimal, as ``sha256sum`` prints it."""
        found = sha256()
        for offset in range(0, self.size, _WINDOW):
            found.update(self._fetch(offset, min(_WINDOW, self.size - offset)))
        return found.hexdigest()

    def _fetch(self, offset: int, size: int) -> bytes:
        size = min(size, self.size - offset)
        if self._kept is not None:
            return self._kept[offset : offset + size]
        found = b""
        with readable(self.path):
            while len(found) < size:
                piece = os.pread(self._descriptor, size - len(found), offset + len(found))
                if not piece:
                    cut = offset + len(found)
                    raise InputError(
                        f"{self.path}: cut to {cut} bytes while it was read, expected {self.size}"
                    )
                found = found + piece if found else piece
        return found


def _descriptor_of(file: InputFile) -> int | None:
    """Return a descriptor of a regular file, None for anything else."""
    stream = file.from_start()
    try:
        number = stream.fileno()
    except OSError:  # what was read from a pipe has none
        return None
    return os.dup(number) if stat.S_ISREG(os.fstat(number).st_mode) else None
