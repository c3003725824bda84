"""The router of a run: private unless told otherwise, and nothing is left of it."""

import contextlib
import os
import signal
import stat
import subprocess
import sys
import tempfile
import threading
from collections.abc import Generator, Iterator
from pathlib import Path

import pytest
import zenoh

from cubepath.protocol.core.errors import CubepathError, InputError
from cubepath.protocol.wire import sessions
from cubepath.protocol.wire.credentials import (
    COORDINATOR,
    GUEST,
    SCHEME,
    Credentials,
    discard,
    is_private,
    new_endpoint,
)
from cubepath.protocol.wire.router import Router
from cubepath.protocol.wire.sessions import open_client
from processes.elsewhere import soon

pytestmark = pytest.mark.slow


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """Return where temporary files go."""
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    yield tmp_path
    assert list(tmp_path.iterdir()) == []


def folder_of(endpoint: str) -> Path:
    """Return the folder of a private router."""
    assert endpoint.startswith(SCHEME)
    return Path(endpoint.removeprefix(SCHEME)).parent


def listeners(pid: int) -> int:
    """Return on how many TCP ports a process listens."""
    inodes = set()
    for each in Path(f"/proc/{pid}/fd").iterdir():
        target = str(each.readlink())
        if target.startswith("socket:["):
            inodes.add(target[8:-1])
    lines = Path(f"/proc/{pid}/net/tcp").read_text().splitlines()[1:]
    lines += Path(f"/proc/{pid}/net/tcp6").read_text().splitlines()[1:]
    listening = "0A"
    return sum(line.split()[3] == listening and line.split()[9] in inodes for line in lines)


def test_a_router_is_private(place: Path) -> None:
    """A socket in a folder of mode 0700, no TCP port; no password in a file or in a command."""
    with Router(processes=2) as router:
        folder = folder_of(router.endpoint)
        assert folder.parent == place
        assert stat.S_IMODE(folder.stat().st_mode) == 0o700
        assert sorted(each.name for each in folder.iterdir()) == ["socket", "socket.lock"]
        assert listeners(router.pid) == 0
        command = Path(f"/proc/{router.pid}/cmdline").read_bytes().decode()
        environment = Path(f"/proc/{router.pid}/environ").read_bytes().decode()
        for name in (COORDINATOR, "process_0", "process_1"):
            credentials = router.credentials(name)
            assert credentials.name == name
            assert len(credentials.password) >= 32
            assert credentials.password not in command + environment + repr(credentials)
        assert router.credentials("process_2") == GUEST
    with Router("tcp/127.0.0.1:0") as router:
        assert listeners(router.pid) == 1
        assert router.credentials(COORDINATOR) == GUEST


@pytest.mark.parametrize(
    ("name", "password"), [("guest", "wrong"), ("process_0", "guest"), ("somebody", "guest")]
)
def test_who_has_not_the_password_is_refused(place: Path, name: str, password: str) -> None:
    """In one line; and so is who has none."""
    with Router() as router:
        with pytest.raises(CubepathError, match=f"or {name} and its password are not known there"):
            open_client(router.endpoint, credentials=Credentials(name, password))
        config = zenoh.Config()
        config.insert_json5("mode", '"client"')
        config.insert_json5("connect/endpoints", f'["{router.endpoint}"]')
        config.insert_json5("scouting/multicast/enabled", "false")
        with pytest.raises(zenoh.ZError):
            zenoh.open(config)


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM])
def test_a_router_that_died_is_started_again_where_it_was(
    place: Path, number: signal.Signals
) -> None:
    """Though its socket and lock are still there; the passwords are the same."""
    with Router() as router:
        endpoint, pid = router.endpoint, router.pid
        os.kill(pid, number)
        soon(router.look_after)
        assert (router.endpoint, router.restarts, router.pid == pid) == (endpoint, 1, False)
        with open_client(endpoint, 30, credentials=router.credentials(COORDINATOR)):
            pass


def state_of(task: Path) -> str:
    """Return the state of a thread, T where it stands still."""
    return (task / "stat").read_text().rpartition(")")[2].split()[0]


@contextlib.contextmanager
def standing_still(router: Router, seconds: float = 3600.0) -> Generator[None]:
    """Stop a router for so long, or until the block ends."""
    os.kill(router.pid, signal.SIGSTOP)
    # A thread that runs on another core stands still a moment after the signal was sent.
    tasks = Path(f"/proc/{router.pid}/task")
    soon(lambda: all(state_of(task) == "T" for task in tasks.iterdir()), "the router runs on")
    again = threading.Timer(seconds, os.kill, (router.pid, signal.SIGCONT))
    again.start()
    try:
        yield
    finally:
        again.cancel()
        os.kill(router.pid, signal.SIGCONT)


def test_a_router_that_stands_still_is_waited_for(
    place: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Longer than one that is not there."""
    monkeypatch.setattr(sessions, "_OPEN_S", 0.5)
    monkeypatch.setattr(sessions, "_GONE_S_MAX", 0.5)
    with Router() as router, standing_still(router, 1.5), open_client(router.endpoint, None):
        pass


@pytest.mark.nightly
def test_a_router_may_stand_still_for_longer_than_an_attempt_takes(place: Path) -> None:
    """Processes that start meanwhile find it when it goes on."""
    with Router() as router, standing_still(router, 16.0), open_client(router.endpoint, None):
        pass


def test_nothing_is_said_of_passwords_where_a_router_stands_still(
    place: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Only that it did not answer, and for how long."""
    monkeypatch.setattr(sessions, "_OPEN_S", 0.5)
    with (
        Router() as router,
        standing_still(router),
        pytest.raises(CubepathError, match=r"no answer within 0\.5 s$"),
    ):
        open_client(router.endpoint)


def test_a_router_whose_starter_was_killed_removes_its_folder(place: Path) -> None:
    """Within seconds, by itself."""
    code = (
        "import sys, tempfile\n"
        "from cubepath.protocol.wire.router import Router\n"
        "router = Router()\n"
        "print(router.endpoint, router.pid, flush=True)\n"
        "sys.stdin.read()\n"
    )
    child = subprocess.Popen(
        [sys.executable, "-c", code],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        env={**os.environ, "TMPDIR": str(place)},
    )
    assert child.stdout is not None
    endpoint, pid = child.stdout.readline().split()
    assert folder_of(endpoint).exists()
    child.kill()
    child.communicate()
    soon(lambda: not folder_of(endpoint).exists(), "the folder is still there")
    soon(lambda: not Path(f"/proc/{pid}").exists(), "the router still runs")


def test_a_path_too_long_for_a_socket_is_not_taken(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Nor one that zenoh would misread; /tmp is taken, or else there is one line."""
    last_resort = Path("/tmp")  # noqa: S108 - where the folder is looked for
    for name in ("x" * 100, "a#b", "with space"):
        (tmp_path / name).mkdir()
        monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / name))
        endpoint = new_endpoint()
        try:
            assert folder_of(endpoint).parent == last_resort
            assert is_private(endpoint)
        finally:
            discard(endpoint)
        assert not folder_of(endpoint).exists()
    monkeypatch.setattr("cubepath.protocol.wire.credentials._LAST_RESORT", "/proc")
    with pytest.raises(CubepathError, match=r"no place for the router's socket, nor is /proc"):
        new_endpoint()


def test_only_the_folder_of_a_private_router_is_discarded(tmp_path: Path) -> None:
    """Another socket, and what lies beside it, stays."""
    for name in ("mine/socket", "cubepath-router-x/other"):
        path = tmp_path / name
        path.parent.mkdir()
        path.touch()
        discard(f"{SCHEME}{path}")
        discard(f"tcp/{path}")
        assert path.exists()


@pytest.mark.parametrize(
    ("endpoint", "line"),
    [
        ("tcp/127.0.0.1", "expected tcp/HOST:PORT or tls/HOST:PORT"),
        ("udp/127.0.0.1:1", "expected tcp/HOST:PORT or tls/HOST:PORT"),
        ("tcp/127.0.0.1:0#bind=127.0.0.2:0", "expected tcp/HOST:PORT or tls/HOST:PORT"),
        ("tls/127.0.0.1:0", r"expected a folder of certificates \(--secure DIR\)"),
        ("tcp/192.0.2.1:7447", "cannot listen there"),
    ],
)
def test_where_no_router_can_listen_is_one_line(place: Path, endpoint: str, line: str) -> None:
    """InputError, with what was found."""
    with pytest.raises(InputError, match=f"^endpoint {endpoint}: {line}"):
        Router(endpoint)
