"""Output files: each written whole or not at all, and looked at before long work begins.

What is no regular file, such as standard output, a pipe or a device, is written in place.
"""

from __future__ import annotations

import contextlib
import os
import stat
import sys
from collections.abc import Generator
from pathlib import Path
from typing import BinaryIO

from cubepath.protocol.core.errors import CheckError, InputError

STANDARD_OUTPUT = Path("/dev/stdout")
"""The path that writers take for standard output; command lines call it ``-``."""
_NAME_MAX = 100


@contextlib.contextmanager
def written_whole(path: Path) -> Generator[BinaryIO]:
    """Open a file for writing that is complete afterwards, or as it was before.

    A file that is replaced keeps its permissions, and links to it lead to the new one. InputError
    where it cannot be written, for standard output CheckError; BrokenPipeError where nobody reads
    it any more. Errors of the body go through.
    """
    if path == STANDARD_OUTPUT:
        with _standard_output() as stream:
            yield stream
        return
    part: Path | None = None
    try:
        target = path
        if not is_special(path):
            target = path.resolve()  # a link stays a link
            part = target.with_name(f".{target.name[:_NAME_MAX]}.{os.getpid()}.part")
        with (part or target).open("wb") as stream:
            if part is not None and target.exists():
                part.chmod(stat.S_IMODE(target.stat().st_mode))
            yield stream
        if part is not None:
            part.replace(target)
    except BrokenPipeError:
        raise
    except (OSError, RuntimeError) as error:  # the second for a loop of links, up to Python 3.12
        raise _unwritable(path, error) from None
    finally:
        if part is not None:
            with contextlib.suppress(OSError):
                part.unlink(missing_ok=True)


@contextlib.contextmanager
def _standard_output() -> Generator[BinaryIO]:
    try:
        sys.stdout.flush()
        # By its number: by its path a file would be truncated and written from its start.
        with os.fdopen(os.dup(1), "wb") as stream:
            yield stream
    except BrokenPipeError:
        raise
    except OSError as error:
        raise CheckError(f"standard output: {error.strerror or error}") from None


def is_special(path: Path) -> bool:
    """Tell whether a path is there and is neither a regular file nor a folder."""
    try:
        mode = path.stat().st_mode
    except (OSError, RuntimeError):
        return False
    return not stat.S_ISREG(mode) and not stat.S_ISDIR(mode)


def same_file(one: Path, other: Path) -> bool:
    """Tell whether two paths lead to one file, there already or to be made; never a special one.

    Links, hard and soft, and other spellings lead to the same file.
    """
    if is_special(one) or is_special(other):
        return False
    try:
        return one.samefile(other)
    except (OSError, RuntimeError):
        return os.path.realpath(one) == os.path.realpath(other)


def check_output(path: Path) -> None:
    """See that a file can be written; InputError says why not. No folder is made for it."""
    if path == STANDARD_OUTPUT or is_special(path):
        return
    if path.is_dir():
        raise InputError(f"{path}: a folder, expected a file to write")
    try:
        folder = path.resolve().parent
        if not folder.is_dir():
            raise InputError(f"{path}: there is no folder {path.parent}, expected one to write to")
        if not os.access(folder, os.W_OK | os.X_OK):
            raise PermissionError(13, os.strerror(13))
        if path.exists() and not os.access(path, os.W_OK):
            raise PermissionError(13, os.strerror(13))
    except (OSError, RuntimeError) as error:
        raise _unwritable(path, error) from None


def _unwritable(path: Path, error: OSError | RuntimeError) -> InputError:
    reason = error.strerror if isinstance(error, OSError) else None
    return InputError(f"{path}: cannot be written: {reason or error}")
