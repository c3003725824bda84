"""Recordings replayed to a process under test, on a wire."""

from collections.abc import Collection, Mapping, Sequence
from contextlib import ExitStack
from typing import Any, Self

from cubepath.coordinator.playback.player import replay
from cubepath.coordinator.playback.replay_comparison import ReplayResult
from cubepath.coordinator.testing.commands import Command, check_command
from cubepath.coordinator.testing.link import LinkProxy
from cubepath.coordinator.testing.log import RunLog
from cubepath.coordinator.testing.wire_messages import WireMessage
from cubepath.protocol.core.errors import CheckError
from cubepath.protocol.wire.free_messages import free_key
from cubepath.protocol.wire.keys import key_of


def on_wire(seen: WireMessage, run: str) -> WireMessage:
    """Return a message of a log as it was on the wire of a run of this name."""
    message: Any = seen.message
    if message is None:
        return seen
    has_rounds = getattr(message, "round", None) is not None
    key = key_of(run, message) if has_rounds else free_key(run, message)
    return WireMessage(key, seen.data, seen.at_s)


class Listener:
    """A command of others to which a recording was replayed on a wire, as a context manager.

    The command is started first. The replay begins when it listens to something of the run, and is
    over when this was made; what the command does then is for the test to ask.
    """

    def __init__(
        self,
        log: RunLog,
        command: str | Sequence[str],
        *,
        timeout_s: float = 30.0,
        topics: Collection[str] = (),
        rate: float | None = None,
        env: Mapping[str, str] | None = None,
    ) -> None:
        """Replay the messages of modules, or these topics, at this many rounds a second.

        ``{endpoint}`` in the command is where it listens, ``{run}`` the name of the run; they are
        in ``CUBEPATH_ENDPOINT`` and ``CUBEPATH_RUN`` too. CheckError if it ends before it listens,
        or does not within the time; otherwise as `cubepath.coordinator.replay`.
        """
        check_command(command)
        self._resources = ExitStack()
        self._command: Command | None = None

        def announce(endpoint: str, run: str) -> None:
            link = self._resources.enter_context(LinkProxy("listener", endpoint))

            found = Command(command, env=env, timeout_s=timeout_s, endpoint=link.endpoint, run=run)
            self._command = self._resources.enter_context(found)
            listens = f"cubepath/{run}/**"
            found.until(lambda: link.listens(listens), "listens to the run")

        try:
            self.replayed: ReplayResult = replay(
                log.recording,
                rate=rate,
                topics=topics,
                endpoint="tcp/127.0.0.1:0",
                announce=announce,
            )
        except BaseException:
            self.close()
            raise

    @property
    def command(self) -> Command:
        """Return the command."""
        if self._command is None:
            raise CheckError("the command has not been started")
        return self._command

    def close(self) -> None:
        """End the command."""
        self._resources.close()

    def __enter__(self) -> Self:
        """Return the listener."""
        return self

    def __exit__(self, *_: object) -> None:
        """End the command."""
        self.close()
