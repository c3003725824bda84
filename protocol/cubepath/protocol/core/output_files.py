"""Output files: each written whole or not at all, and checked before long work begins.

A new file gets a name that nobody can guess, is created exclusively, and then takes the place of
the old one. A symbolic link in its path is followed, so that the link stays and the file that it
leads to is replaced, but only if the link belongs to you, to root, or to the owner of the folder it
is in: one that somebody else planted in a shared folder is refused. Linux has the same
rule for /tmp (``protected_symlinks`` in proc(5)). Anything but a regular file, such as standard
output, a pipe or a device, is written in place.
"""

import contextlib
import errno
import fcntl
import os
import stat
import sys
from collections.abc import Generator
from pathlib import Path
from secrets import token_hex
from typing import BinaryIO

from cubepath.protocol.core.errors import CheckError, CubepathError, InputError

STANDARD_OUTPUT = Path("/dev/stdout")
"""The path that writers take for standard output; on the command line it is ``-``."""
_NAME_MAX = 100
_LINKS_MAX = 40
"""Links in a row that are followed, as many as Linux follows."""
_FULL_OR_BROKEN = {errno.ENOSPC, errno.EDQUOT, errno.EIO}


@contextlib.contextmanager
def written_whole(path: Path | str) -> Generator[BinaryIO]:
    """Open a file for writing that is complete afterwards, or unchanged.

    A replaced file keeps its permissions, and links to it lead to the new one. Raises InputError if
    it cannot be written or its path has a link of another user, CheckError if that is standard
    output or the disk is full or broken, and BrokenPipeError if it has no reader any more. An
    OSError of the body counts as a failure to write; other errors of the body propagate.
    """
    path = Path(path)
    if path == STANDARD_OUTPUT:
        with _standard_output() as stream:
            yield stream
        return
    part: Path | None = None
    try:
        target = _resolved(path)  # a link stays a link
        if is_special(path):
            with special_file(path) as stream:
                yield stream
            return
        named = target.with_name(f".{target.name[:_NAME_MAX]}.{token_hex(8)}.part")
        before = target.stat().st_mode if target.exists() else None
        # Nobody may read the new file who could not read the old one, not even for a moment.
        with new_file(named, 0o666 if before is None else 0o600) as stream:
            part = named
            if before is not None:
                os.fchmod(stream.fileno(), stat.S_IMODE(before))
            yield stream
        part.replace(target)
    except BrokenPipeError:
        raise
    except OSError as error:
        raise unwritable(path, error) from None
    finally:
        if part is not None:
            with contextlib.suppress(OSError):
                part.unlink(missing_ok=True)


def new_file(path: Path, mode: int = 0o666) -> BinaryIO:
    """Create a file for writing, with these permissions at most; it never leads through a link.

    Raises FileExistsError if anything has that name already, and OSError if it cannot be made.
    """
    return os.fdopen(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, mode), "wb")


def special_file(path: Path) -> BinaryIO:
    """Open a pipe or a device for writing; OSError if it has become a regular file."""
    # Nothing is truncated, in case it is one. With O_CREAT the system guards pipes in /tmp.
    stream = os.fdopen(os.open(path, os.O_WRONLY | os.O_CREAT, 0o600), "wb")
    if stat.S_ISREG(os.fstat(stream.fileno()).st_mode):
        stream.close()
        raise FileExistsError(errno.EEXIST, os.strerror(errno.EEXIST))
    return stream


def appended_file(path: Path) -> BinaryIO:
    """Open or create a file to read and to add to; OSError if it is a symbolic link."""
    flags = os.O_RDWR | os.O_APPEND | os.O_CREAT | os.O_NOFOLLOW
    return os.fdopen(os.open(path, flags, 0o666), "a+b")


def locked_file(path: Path) -> BinaryIO:
    """Open a file as `appended_file` does, and lock it; BlockingIOError if another holds the lock.

    The lock lasts until this process, and each to which it has handed the file, has closed it or
    has ended.
    """
    file = appended_file(path)
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        file.close()
        raise
    return file


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
    if path == STANDARD_OUTPUT:
        return
    try:
        if path.is_dir():
            raise InputError(f"{path}: a folder, expected a file to write")
        folder = _resolved(path).parent
        if is_special(path):
            return
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
        folder = _resolved(folder)
        there = next(each for each in (folder, *folder.parents) if each.exists())
    except OSError as error:
        raise unwritable(folder, error) from None
    if not there.is_dir():
        raise InputError(f"{there}: not a folder, expected one to write to")
    if not os.access(there, os.W_OK | os.X_OK):
        raise unwritable(folder, PermissionError(errno.EACCES, os.strerror(errno.EACCES)))


def _resolved(path: Path) -> Path:
    """Return where a file is, or will be, after all links that its path leads through."""
    done, names, links = Path("/"), [*reversed(path.absolute().parts[1:])], 0
    while names:
        name = names.pop()
        here = done.parent if name == ".." else done / name
        if not here.is_symlink():
            done = here
            continue
        links += 1
        if links > _LINKS_MAX:
            raise OSError(errno.ELOOP, os.strerror(errno.ELOOP))
        if here.lstat().st_uid not in {os.geteuid(), 0, done.stat().st_uid}:
            raise PermissionError(
                errno.EACCES, f"{here} is a link of another user, expected none or your own"
            )
        target = here.readlink()
        if target.is_absolute():
            done = Path("/")
        names += reversed(target.parts[1:] if target.is_absolute() else target.parts)
    return done


def unwritable(path: Path, error: OSError) -> CubepathError:
    """Return the error to raise for a file that the system cannot write.

    It is a CheckError if the disk is full or broken, where another name would not help, otherwise
    an InputError.
    """
    kind = CheckError if error.errno in _FULL_OR_BROKEN else InputError
    return kind(f"{path}: cannot be written: {error.strerror or error}")
