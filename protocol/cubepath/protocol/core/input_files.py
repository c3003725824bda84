"""Input files: each opened once, inspected to tell its format, and read from its start.

Every reader takes a path, or a file that is already open because its format was inspected. So a
command opens each of its inputs once, and everything it reports concerns one moment. Input that
cannot be rewound, such as a pipe, is read into memory. Readers open only the files they are given,
and those that these name in their own folder; see `file_within`.
"""

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
"""The path that readers take for standard input; on the command line it is ``-``."""
_NAME = Path("standard input")


@dataclass(frozen=True, slots=True, eq=False)
class InputFile:
    """A file that is open for reading; each method goes back to its start.

    A failure to read raises InputError with the path and the system's reason.
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
        """Return the UTF-8 text, with line endings normalized and a byte order mark removed."""
        stream = io.TextIOWrapper(io.BytesIO(self.whole()), encoding="utf-8-sig")
        try:
            return stream.read()
        except UnicodeDecodeError as error:
            raise InputError(f"{self.path}: not UTF-8 text (byte {error.start})") from None

    def numbered_lines(self) -> Iterator[tuple[int, bytes]]:
        """Yield the lines that are not blank, each with its number from 1.

        White space around a line, its ending included, and a byte order mark are removed.
        """
        stream = self.from_start()
        with readable(self.path):
            for number, line in enumerate(stream, 1):
                text = (line.removeprefix(BYTE_ORDER_MARK) if number == 1 else line).strip()
                if text:
                    yield number, text


_PIECE = 1 << 16
"""Bytes read from a pipe at a time."""
Source: TypeAlias = Path | str | InputFile
"""What readers take: the path of a file, or the open file itself."""


@contextlib.contextmanager
def readable(path: Path) -> Generator[None]:
    """Turn an OSError from reading a file into an InputError."""
    try:
        yield
    except IsADirectoryError:
        raise InputError(f"{path}: a folder, expected a file") from None
    except OSError as error:
        raise InputError(f"{path}: {error.strerror or error}") from None


@contextlib.contextmanager
def opened(source: Source) -> Generator[InputFile]:
    """Open a file for the length of the block; one that is already open stays open.

    Raises InputError if it cannot be opened.
    """
    if isinstance(source, InputFile):
        yield source
        return
    if not isinstance(source, str | Path) or source == "":  # pyright: ignore[reportUnnecessaryIsInstance]
        raise InputError(f"path={source!r}: expected the path of a file")
    source = Path(source)
    path = _NAME if source == STANDARD_INPUT else source
    with contextlib.ExitStack() as stack:
        with readable(path):
            opened_stream = stack.enter_context(_stream(source))
            stream: BinaryIO = opened_stream
            if not stream.seekable() or stream.tell():
                stream = _in_memory(opened_stream)
        yield InputFile(path, stream)


def _in_memory(stream: io.BufferedReader) -> BinaryIO:
    """Read the rest of a stream piece by piece: Python sees an interrupt only in between."""
    found = io.BytesIO()
    while piece := stream.read1(_PIECE):
        found.write(piece)
    found.seek(0)
    return found


def _stream(source: Path) -> io.BufferedReader:
    if source != STANDARD_INPUT:
        return source.open("rb")
    stdin: object = sys.stdin  # None if it was closed when Python began, whatever its type says
    if stdin is None:
        raise InputError(f"{_NAME}: closed, expected what to read")
    return os.fdopen(os.dup(0), "rb")


def file_within(folder: Path, name: Path | str) -> Path:
    """Return the path of what an input in a folder names, or of a file in a folder that you gave.

    InputError unless it is in that folder: an absolute path, ``..`` or a symbolic link could lead
    anywhere, and an input does not choose what is read and written there.
    """
    path, real = folder / name, os.path.realpath(folder)
    try:
        inside = os.path.commonpath([real, os.path.realpath(path)]) == real
    except ValueError:  # no file has a NUL in its name
        inside = False
    if Path(name).is_absolute() or not inside:
        raise InputError(
            f"{path}: leads out of {folder}, expected a path in that folder, or the file itself on"
            " the command line"
        )
    return path


def read_text(source: Source) -> str:
    """Return the text of an input file; InputError if it cannot be read."""
    with opened(source) as file:
        return file.text()
