"""Input files: each opened once, looked at to tell what it is, and read from its start.

Every reader takes a path, or a file that somebody has opened to see what it is: so a command opens
each of its inputs one time, and what it tells is of one moment. What has no start to go back to,
such as a pipe, is read into memory. It touches the files that it is told to.
"""

from __future__ import annotations

import contextlib
import io
import os
import sys
from collections.abc import Generator, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO, TypeAlias

from cubepath.protocol.core.errors import InputError

BYTE_ORDER_MARK = b"\xef\xbb\xbf"
STANDARD_INPUT = Path("/dev/stdin")
"""The path that readers take for standard input; command lines call it ``-``."""
_NAME = Path("standard input")


@dataclass(frozen=True, slots=True, eq=False)
class InputFile:
    """A file that is open for reading; each question goes back to its start.

    What cannot be read is an InputError with the path and the system's reason.
    """

    path: Path
    stream: BinaryIO

    def from_start(self) -> BinaryIO:
        """Return the stream at its start."""
        with readable(self.path):
            self.stream.seek(0)
        return self.stream

    def head(self, size: int) -> bytes:
        """Return the first bytes, fewer than `size` where the file has no more."""
        stream = self.from_start()
        with readable(self.path):
            return stream.read(size)

    def whole(self) -> bytes:
        """Return all bytes."""
        stream = self.from_start()
        with readable(self.path):
            return stream.read()

    def text(self) -> str:
        """Return all as UTF-8 text, line endings made one and a byte order mark taken off."""
        stream = io.TextIOWrapper(io.BytesIO(self.whole()), encoding="utf-8-sig")
        try:
            return stream.read()
        except UnicodeDecodeError as error:
            raise InputError(f"{self.path}: not UTF-8 text (byte {error.start})") from None

    def numbered_lines(self) -> Iterator[tuple[int, bytes]]:
        """Yield the lines that are not empty, each with its number from 1 and without its ending.

        CRLF and a byte order mark are taken off.
        """
        stream = self.from_start()
        with readable(self.path):
            for number, line in enumerate(stream, 1):
                text = (line.removeprefix(BYTE_ORDER_MARK) if number == 1 else line).strip()
                if text:
                    yield number, text


Source: TypeAlias = Path | InputFile
"""What readers take: where a file is, or the file itself, open."""


@contextlib.contextmanager
def readable(path: Path) -> Generator[None]:
    """Turn what the system says against reading a file into an InputError."""
    try:
        yield
    except OSError as error:
        raise InputError(f"{path}: {error.strerror or error}") from None


@contextlib.contextmanager
def opened(source: Source) -> Generator[InputFile]:
    """Open a file for as long as it is read, or take one that is open, which then stays so.

    InputError where it cannot be opened.
    """
    if isinstance(source, InputFile):
        yield source
        return
    path = _NAME if source == STANDARD_INPUT else source
    with contextlib.ExitStack() as stack:
        with readable(path):
            stream = stack.enter_context(_stream(source))
            if not stream.seekable() or stream.tell():
                stream = io.BytesIO(stream.read())
        yield InputFile(path, stream)


def _stream(source: Path) -> BinaryIO:
    if source != STANDARD_INPUT:
        return source.open("rb")
    stdin: object = sys.stdin  # None where it was closed when Python began, whatever its type says
    if stdin is None:
        raise InputError(f"{_NAME}: closed, expected what to read")
    return os.fdopen(os.dup(0), "rb")


def read_text(source: Source) -> str:
    """Return the text of an input file; InputError in one line where it cannot be read."""
    with opened(source) as file:
        return file.text()
