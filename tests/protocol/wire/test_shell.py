"""The shell of a node on zenoh: messages in their order, and ticks however many there are."""

import time
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import contextmanager

import pytest
import zenoh

import cubepath.protocol.wire.shell as shell_module
from cubepath.protocol.wire.credentials import COORDINATOR
from cubepath.protocol.wire.nodes import BatchNode, Effect, End, Listen, Timer
from cubepath.protocol.wire.router import Router
from cubepath.protocol.wire.sessions import open_client, put
from cubepath.protocol.wire.shell import Shell
from processes.ears import wait_for_subscriber

pytestmark = pytest.mark.slow

KEY = "cubepath/test/echo"
ENOUGH_S = 60.0


class Listener:
    """Hears until its timer runs out, and calls back for each message that it hears."""

    def __init__(self, wait_s: float, on_heard: Callable[[], None] = lambda: None) -> None:
        """Tick once, after `wait_s`."""
        self.wait_s = wait_s
        self.on_heard = on_heard
        self.heard: list[bytes] = []
        self.heard_at_tick: int | None = None

    def start(self) -> list[Effect]:
        """Listen."""
        return [Listen((KEY,)), Timer(self.wait_s)]

    def receive(self, key: str, data: bytes) -> list[Effect]:
        """Note what was said."""
        assert key == KEY
        self.heard.append(data)
        self.on_heard()
        return []

    def tick(self) -> list[Effect]:
        """End."""
        self.heard_at_tick = len(self.heard)
        return [End()]


@pytest.fixture
def router() -> Iterator[Router]:
    """Return a router of its own for each test, with nothing on its way from another."""
    with Router() as found:
        yield found


@pytest.fixture
def endpoint(router: Router) -> str:
    """Return where it listens."""
    return router.endpoint


@pytest.fixture
def guest(router: Router) -> Iterator[zenoh.Session]:
    """Return somebody else who talks to the node, and may."""
    with open_client(router.endpoint, credentials=router.credentials(COORDINATOR)) as found:
        yield found


def arrived(shell: Shell) -> int:
    """Return how many messages wait to be taken; nothing else shows it."""
    return shell._queue.qsize()


def say(guest: zenoh.Session, shell: Shell, *messages: bytes) -> None:
    """Say messages to a shell that listens, and wait until all of them have arrived."""
    before = arrived(shell)
    wait_for_subscriber(guest, KEY)
    for each in messages:
        put(guest, KEY, each)
    begun = time.monotonic()
    while arrived(shell) < before + len(messages):
        assert time.monotonic() - begun < ENOUGH_S
        time.sleep(0.001)


def test_a_tick_comes_while_messages_never_stop(endpoint: str, guest: zenoh.Session) -> None:
    """A node that is talked to without a gap still asks again, and its patience still ends."""

    def chatter() -> None:
        for _ in range(2):
            put(guest, KEY, b"more")

    node = Listener(ENOUGH_S, on_heard=chatter)
    with Shell(node, endpoint) as shell:
        shell.start()
        say(guest, shell, *[b"more"] * 100)
        shell.carry_out([Timer(0.2)])
        begun = time.monotonic()
        while not shell.ended and time.monotonic() - begun < ENOUGH_S:
            shell.step(1.0)
    assert node.heard_at_tick


@contextmanager
def due(node: Listener, endpoint: str, guest: zenoh.Session) -> Generator[Shell]:
    """Give a shell whose timer has run out, and to which three messages have come before."""
    with Shell(node, endpoint) as shell:
        shell.start()
        say(guest, shell, b"a", b"b", b"c")
        shell.carry_out([Timer(0.0)])
        yield shell


def test_what_had_arrived_is_taken_before_the_tick(endpoint: str, guest: zenoh.Session) -> None:
    """A process that was stopped hears what was said meanwhile before it asks again."""
    node = Listener(ENOUGH_S)
    with due(node, endpoint, guest) as shell:
        while not shell.ended:
            assert shell.step(ENOUGH_S)
    assert (node.heard, node.heard_at_tick) == ([b"a", b"b", b"c"], 3)


def test_a_flood_takes_bounded_memory_and_what_comes_later_is_heard(
    endpoint: str, guest: zenoh.Session, monkeypatch: pytest.MonkeyPatch
) -> None:
    """More than so many messages or bytes do not wait; those that do are taken, and new ones."""
    for most, name in ((10, "_QUEUE_MAX"), (10 * len(b"more"), "_QUEUE_BYTES_MAX")):
        monkeypatch.setattr(shell_module, name, most)
        node = Listener(ENOUGH_S)
        with Shell(node, endpoint) as shell:
            shell.start()
            say(guest, shell, *[b"more"] * 10)
            for _ in range(1000):
                put(guest, KEY, b"lost")
            begun = time.monotonic()
            while shell.dropped < 1000:
                assert time.monotonic() - begun < ENOUGH_S
                time.sleep(0.001)
            for _ in range(10):
                assert shell.step(ENOUGH_S)
            say(guest, shell, b"late")
            assert shell.step(ENOUGH_S)
        assert node.heard == [b"more"] * 10 + [b"late"]
        monkeypatch.undo()


class Gatherer(Listener, BatchNode):
    """Takes what has arrived together."""

    def __init__(self, wait_s: float) -> None:
        """Tick once, after `wait_s`."""
        super().__init__(wait_s)
        self.batches: list[int] = []

    def receive_all(self, messages: Sequence[tuple[str, bytes]]) -> list[Effect]:
        """Note what was said, and how many messages it was."""
        self.batches.append(len(messages))
        return [effect for each in messages for effect in Listener.receive(self, *each)]


def test_what_has_arrived_is_one_batch_that_ends_where_a_tick_is_due(
    endpoint: str, guest: zenoh.Session, monkeypatch: pytest.MonkeyPatch
) -> None:
    """And never more than so many messages; what comes later waits for the tick."""
    monkeypatch.setattr(shell_module, "_BATCH_MAX", 4)
    node = Gatherer(ENOUGH_S)
    with due(node, endpoint, guest) as shell:
        assert shell.step(ENOUGH_S)
        say(guest, shell, b"late")
        assert (node.heard, node.heard_at_tick) == ([b"a", b"b", b"c"], None)
        assert shell.step(ENOUGH_S)
        assert (node.heard, node.heard_at_tick) == ([b"a", b"b", b"c"], 3)
        say(guest, shell, *[b"more"] * 5)
        while len(node.heard) < 9:
            assert shell.step(ENOUGH_S)
    assert node.batches == [3, 4, 2]


def test_a_timer_that_is_set_anew_begins_anew(endpoint: str, guest: zenoh.Session) -> None:
    """A tick that was due comes no more if a message before it has stopped the timer."""
    node = Listener(ENOUGH_S)
    with due(node, endpoint, guest) as shell:
        assert shell.step(ENOUGH_S)
        shell.carry_out([Timer(None)])
        assert shell.step(ENOUGH_S)
        assert shell.step(ENOUGH_S)
        assert not shell.step(0.01)
    assert (node.heard, node.heard_at_tick) == ([b"a", b"b", b"c"], None)
