"""Output files: each written whole or not at all, and checked before long work begins.

Anything but a regular file, such as standard output, a pipe or a device, is written in place.
"""

from __future__ import annotations

import contextlib
import errno
import os
import stat
import sys
from collections.abc import Generator
from pathlib import Path
from typing import BinaryIO

from cubepath.protocol.core.errors import CheckError, CubepathError, InputError

STANDARD_OUTPUT = Path("/dev/stdout")
"""The path that writers take for standard output; on the command line it is ``-``."""
_NAME_MAX = 100
_FULL_OR_BROKEN = {errno.ENOSPC, errno.EDQUOT, errno.EIO}


@contextlib.contextmanager
def written_whole(path: Path | str) -> Generator[BinaryIO]:
    """Open a file for writing that is complete afterwards, or unchanged.

    A replaced file keeps its permissions, and links to it lead to the new one. Raises InputError if
    it cannot be written, CheckError if that is standard output or the disk is full or broken, and
    BrokenPipeError if it has no reader any more. An OSError of the body counts as a failure to
    write; other errors of the body propagate.
    """
    path = Path(path)
    if path == STANDARD_OUTPUT:
        with _standard_output() as stream:
            yield stream
        return
    part: Path | None = None
    try:
        target = path
        if not is_special(path):
            target = _resolved(path)  # a link stays a link
            part = target.with_name(f".{target.name[:_NAME_MAX]}.{os.getpid()}.part")
        with (part or target).open("wb") as stream:
            if part is not None and target.exists():
                part.chmod(stat.S_IMODE(target.stat().st_mode))
            yield stream
        if part is not None:
            part.replace(target)
    except BrokenPipeError:
        raise
    except OSError as error:
        raise unwritable(path, error) from None
    finally:
        if part is not None:
            with contextlib.suppress(OSError):
                part.unlink(missing_ok=True)


@contextlib.contextmanager
def _standard_output() -> Generator[BinaryIO]:
    try:
        sys.stdout.flush()
        # By its descriptor: opened by its path, a file would be truncated and written from its
        # start.
        with os.fdopen(os.dup(1), "wb") as stream:
            yield stream
    except BrokenPipeError:
        raise
    except OSError as error:
        raise CheckError(f"standard output: {error.strerror or error}") from None


def is_special(path: Path) -> bool:
    """Return whether a path exists and is neither a regular file nor a folder."""
    try:
        mode = path.stat().st_mode
    except (OSError, RuntimeError):
        return False
    return not stat.S_ISREG(mode) and not stat.S_ISDIR(mode)


def same_file(one: Path | str, other: Path | str) -> bool:
    """Return whether two paths lead to the same file, existing or not; False for special files.

    Hard links, symbolic links and other spellings of a path lead to the same file.
    """
    one, other = Path(one), Path(other)
    if is_special(one) or is_special(other):
        return False
    try:
        return one.samefile(other)
    except (OSError, RuntimeError):
        return os.path.realpath(one) == os.path.realpath(other)


def check_output(path: Path) -> None:
    """Check that a file can be written; InputError says why not. No folder is created."""
    if path == STANDARD_OUTPUT or is_special(path):
        return
    try:
        if path.is_dir():
            raise InputError(f"{path}: a folder, expected a file to write")
        folder = _resolved(path).parent
        if not folder.is_dir():
            named = folder if path.is_symlink() else path.parent
            raise InputError(f"{path}: there is no folder {named}, expected one to write to")
        if not os.access(folder, os.W_OK | os.X_OK):
            raise PermissionError(13, os.strerror(13))
        if path.exists() and not os.access(path, os.W_OK):
            raise PermissionError(13, os.strerror(13))
    except OSError as error:
        raise unwritable(path, error) from None


def check_output_folder(folder: Path) -> None:
    """Check that a folder can be written to, or made where files will be; InputError if not."""
    try:
        there = next(each for each in (folder, *folder.absolute().parents) if each.exists())
    except OSError as error:
        raise unwritable(folder, error) from None
    if not there.is_dir():
        raise InputError(f"{there}: not a folder, expected one to write to")
    if not os.access(there, os.W_OK | os.X_OK):
        raise unwritable(folder, PermissionError(errno.EACCES, os.strerror(errno.EACCES)))


def _resolved(path: Path) -> Path:
    try:
        return path.resolve()
    except RuntimeError as error:  # a loop of links, up to Python 3.12
        raise OSError(errno.ELOOP, os.strerror(errno.ELOOP)) from error


def unwritable(path: Path, error: OSError) -> CubepathError:
    """Return the error to raise for a file that the system cannot write.

    It is a CheckError if the disk is full or broken, where another name would not help, otherwise
    an InputError.
    """
    kind = CheckError if error.errno in _FULL_OR_BROKEN else InputError
    return kind(f"{path}: cannot be written: {error.strerror or error}")
