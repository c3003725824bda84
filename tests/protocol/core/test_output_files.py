"""Output files: whole or as before, with their permissions and links; and looked at beforehand."""

import errno
import os
import subprocess
import sys
import threading
from collections.abc import Callable
from pathlib import Path

import pytest

from cubepath.protocol.core.errors import CheckError, InputError
from cubepath.protocol.core.output_files import (
    appended_file,
    check_output,
    check_output_folder,
    new_file,
    same_file,
    special_file,
    written_whole,
)

FULL = """
import resource, sys
from pathlib import Path
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.output_files import written_whole
sys.dont_write_bytecode = True  # Python before 3.12 would leave half of a file
resource.setrlimit(resource.RLIMIT_FSIZE, (1000, 1000))
try:
    with written_whole(Path(sys.argv[1])) as stream:
        stream.write(bytes(100_000))
except InputError as error:
    print(error)
"""


def names(folder: Path) -> list[str]:
    """Return what is in a folder, hidden files too."""
    return sorted(each.name for each in folder.iterdir())


def test_a_file_is_replaced_at_the_end_and_keeps_its_permissions(tmp_path: Path) -> None:
    """Until then the old one is there."""
    path = tmp_path / "file"
    path.write_text("old")
    path.chmod(0o640)
    with written_whole(path) as stream:
        stream.write(b"new")
        assert path.read_text() == "old"
    assert (path.read_text(), path.stat().st_mode & 0o777) == ("new", 0o640)
    assert names(tmp_path) == ["file"]


@pytest.mark.parametrize("raised", [ValueError, KeyboardInterrupt, InputError])
def test_an_error_leaves_the_old_file_and_nothing_else(
    raised: type[BaseException], tmp_path: Path
) -> None:
    """An interrupt, too; and where there was no file there is none."""
    (tmp_path / "file").write_text("old")
    for path in (tmp_path / "file", tmp_path / "other"):
        with pytest.raises(raised), written_whole(path) as stream:
            stream.write(b"half")
            raise raised
    assert (tmp_path / "file").read_text() == "old"
    assert names(tmp_path) == ["file"]


@pytest.mark.slow
def test_a_full_disk_leaves_the_old_file_and_nothing_else(tmp_path: Path) -> None:
    """Told in one line with the system's reason."""
    path = tmp_path / "file"
    path.write_text("old")
    done = subprocess.run(
        [sys.executable, "-c", FULL, path], capture_output=True, text=True, timeout=60, check=True
    )
    assert done.stdout == f"{path}: cannot be written: File too large\n"
    assert (path.read_text(), names(tmp_path)) == ("old", ["file"])


@pytest.mark.parametrize(
    ("number", "raised"),
    [
        (errno.ENOSPC, CheckError),
        (errno.EDQUOT, CheckError),
        (errno.EIO, CheckError),
        (errno.EFBIG, InputError),
    ],
)
def test_a_disk_that_is_full_or_broken_is_no_bad_input(
    number: int, raised: type[Exception], tmp_path: Path
) -> None:
    """Another name would not help; a name that cannot be written is bad input."""
    path = tmp_path / "file"
    with pytest.raises(raised) as caught, written_whole(path):
        raise OSError(number, os.strerror(number))
    assert str(caught.value) == f"{path}: cannot be written: {os.strerror(number)}"


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="only some systems have /dev/full")
def test_a_full_device_is_no_bad_input() -> None:
    """It is told as a full standard output is."""
    told = "/dev/full: cannot be written: No space left"
    with pytest.raises(CheckError, match=told), written_whole(Path("/dev/full")) as stream:
        stream.write(b"text")


def test_a_link_stays_a_link(tmp_path: Path) -> None:
    """What it leads to is replaced, or made."""
    (tmp_path / "folder").mkdir()
    link = tmp_path / "link"
    link.symlink_to(Path("folder") / "file")
    for text in (b"one", b"two"):
        with written_whole(link) as stream:
            stream.write(text)
        assert link.is_symlink()
        assert (tmp_path / "folder" / "file").read_bytes() == text


def test_nobody_can_guess_the_name_of_an_unfinished_file(tmp_path: Path) -> None:
    """Two of the same destination differ, and a link of the old name leads nowhere."""
    path = tmp_path / "file"
    (tmp_path / "mine").write_text("mine")
    (tmp_path / f".file.{os.getpid()}.part").symlink_to("mine")
    before = names(tmp_path)
    found = set()
    for _ in range(2):
        with written_whole(path) as stream:
            stream.write(b"new")
            found |= set(names(tmp_path)) - {*before, "file"}
    assert len(found) == 2
    assert (path.read_text(), (tmp_path / "mine").read_text()) == ("new", "mine")


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can give a link away")
def test_a_link_that_a_stranger_planted_is_refused(tmp_path: Path) -> None:
    """Nothing is touched; a link that belongs to the owner of its folder is followed."""
    (tmp_path / "mine").write_text("mine")
    folder = tmp_path / "shared"
    folder.mkdir()
    (folder / "file").symlink_to(tmp_path / "mine")
    os.chown(folder / "file", 4711, 4711, follow_symlinks=False)
    for write in (check_output, lambda path: written_whole(path).__enter__()):
        with pytest.raises(InputError) as caught:
            write(folder / "file")
        assert str(caught.value) == (
            f"{folder / 'file'}: cannot be written: {folder.resolve() / 'file'} is a link of"
            " another user, expected none or your own"
        )
    assert ((tmp_path / "mine").read_text(), names(folder)) == ("mine", ["file"])
    os.chown(folder, 4711, 4711)
    with written_whole(folder / "file") as stream:
        stream.write(b"new")
    assert (tmp_path / "mine").read_text() == "new"


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can give a link away")
@pytest.mark.parametrize("what", ["folder", "pipe"])
def test_no_link_of_a_stranger_leads_to_a_folder_or_a_pipe(tmp_path: Path, what: str) -> None:
    """It is refused wherever in the path it is, and whatever it leads to."""
    target = tmp_path / what
    if what == "pipe":
        os.mkfifo(target)
    else:
        target.mkdir()
    shared = tmp_path / "shared"
    shared.mkdir()
    (shared / "link").symlink_to(target)
    os.chown(shared / "link", 4711, 4711, follow_symlinks=False)
    path = shared / "link" if what == "pipe" else shared / "link" / "file"
    for write in (check_output, lambda path: written_whole(path).__enter__()):
        with pytest.raises(InputError, match="link is a link of another user"):
            write(path)
    with pytest.raises(InputError, match="link is a link of another user"):
        check_output_folder(shared / "link" / "new")
    assert what == "pipe" or names(target) == []


def test_links_in_a_circle_are_told(tmp_path: Path) -> None:
    """With the system's reason, before anything is written."""
    (tmp_path / "one").symlink_to("two")
    (tmp_path / "two").symlink_to("one")
    with pytest.raises(InputError, match="one: cannot be written: Too many levels"):
        check_output(tmp_path / "one")


@pytest.mark.parametrize(
    "open_it",
    [
        lambda path: new_file(path).close(),
        lambda path: special_file(path).close(),
        lambda path: appended_file(path).close(),
    ],
)
def test_a_new_file_never_leads_through_a_link(
    open_it: Callable[[Path], None], tmp_path: Path
) -> None:
    """Whether the link leads to a file or to nothing; the file keeps its bytes."""
    (tmp_path / "mine").write_text("mine")
    (tmp_path / "link").symlink_to("mine")
    with pytest.raises(OSError, match=r"exists|symbolic links"):
        open_it(tmp_path / "link")
    assert (tmp_path / "mine").read_text() == "mine"


def test_a_pipe_is_written_in_place(tmp_path: Path) -> None:
    """It is a pipe afterwards, and who reads it gets all."""
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    read: list[bytes] = []
    reader = threading.Thread(target=lambda: read.append(pipe.read_bytes()))
    reader.start()
    with written_whole(pipe) as stream:
        stream.write(b"text")
    reader.join()
    assert (read, pipe.is_fifo(), names(tmp_path)) == ([b"text"], True, ["pipe"])


def test_what_cannot_be_written_is_known_beforehand(tmp_path: Path) -> None:
    """A folder, a file in no folder, a file in a file; a new file and a device are no error."""
    (tmp_path / "file").write_text("")
    for path, why in (
        (tmp_path, "a folder, expected a file"),
        (tmp_path / "none" / "file", f"there is no folder {tmp_path / 'none'}, expected one"),
        (tmp_path / "file" / "file", f"there is no folder {tmp_path / 'file'}, expected one"),
    ):
        with pytest.raises(InputError) as caught:
            check_output(path)
        assert str(caught.value).startswith(f"{path}: {why}")
    check_output(tmp_path / "new")
    check_output(tmp_path / "file")
    check_output(Path(os.devnull))
    assert names(tmp_path) == ["file"]


def test_a_link_to_no_folder_is_told_with_that_folder(tmp_path: Path) -> None:
    """Not with the folder of the link, which is there."""
    link = tmp_path / "link"
    link.symlink_to(Path("nowhere") / "file")
    with pytest.raises(InputError) as caught:
        check_output(link)
    folder = tmp_path.resolve() / "nowhere"
    assert str(caught.value) == f"{link}: there is no folder {folder}, expected one to write to"


def test_a_file_is_known_by_every_name(tmp_path: Path) -> None:
    """By links and other spellings, there or not; a device is never the same."""
    (tmp_path / "folder").mkdir()
    file = tmp_path / "file"
    other = tmp_path / "folder" / ".." / "file"
    assert same_file(file, other)
    file.write_text("")
    (tmp_path / "hard").hardlink_to(file)
    (tmp_path / "soft").symlink_to("file")
    assert all(same_file(file, tmp_path / name) for name in ("hard", "soft", "folder/../file"))
    assert not same_file(file, tmp_path / "folder")
    assert not same_file(Path(os.devnull), Path(os.devnull))
