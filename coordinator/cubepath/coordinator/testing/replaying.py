"""Recordings replayed into the code under test: a function, a node, a process, a rule."""

import time
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any, Self, TypeVar

from cubepath.coordinator.playback.comparing import ReplayResult
from cubepath.coordinator.playback.player import replay
from cubepath.coordinator.runs.continuing import what_if
from cubepath.coordinator.runs.live import LiveReplay, replay_live
from cubepath.coordinator.testing.commands import Command, check_command
from cubepath.coordinator.testing.link import LinkProxy
from cubepath.coordinator.testing.log import RunLog, What, pattern_of
from cubepath.coordinator.testing.wire_messages import RESULTS, WireMessage
from cubepath.protocol.core.errors import CheckError, InputError
from cubepath.protocol.core.options import function
from cubepath.protocol.wire.free_messages import free_key
from cubepath.protocol.wire.keys import key_of
from cubepath.protocol.wire.nodes import Effect, Node

T = TypeVar("T")
RUN = "replayed"
_POLL_S = 0.01


def replay_into(
    log: RunLog, to: Callable[[WireMessage], T], what: What = "", *, run: str = RUN, **pattern: Any
) -> list[T]:
    """Call a function with each message of a log, in its order; return what it returned.

    The bytes are those of the recording, and the keys those of a run of this name. What the
    coordinator found at the end was on no wire, and is left out. With `what` and the keys of
    `Pattern`, messages are those that they mean.
    """
    _check_log(log)
    function("to", to)
    meant = pattern_of(what, **pattern)
    return [
        to(_on_wire(each, run))
        for each in log.all_deliveries
        if each.kind not in RESULTS and meant.holds(each)
    ]


def replay_into_node(
    log: RunLog, node: Node, what: What = "", *, run: str = RUN, **pattern: Any
) -> list[Effect]:
    """Start a node and give it each message of a log; return its effects, in their order.

    The rest is as for `replay_into`. The node's timers are not waited for.
    """
    if not all(callable(getattr(node, name, None)) for name in ("start", "receive")):
        raise InputError(f"node={node!r}: expected a node")
    found = list(node.start())

    def give(seen: WireMessage) -> None:
        found.extend(node.receive(seen.key, seen.data))

    replay_into(log, give, what, run=run, **pattern)
    return found


def _check_log(log: object) -> None:
    if not isinstance(log, RunLog):
        raise InputError(f"{log!r}: expected a Log")


def _on_wire(seen: WireMessage, run: str) -> WireMessage:
    message: Any = seen.message
    if message is None:
        return seen
    has_rounds = getattr(message, "round", None) is not None
    key = key_of(run, message) if has_rounds else free_key(run, message)
    return WireMessage(key, seen.data, seen.at_s)


def live_modules(
    log: RunLog, modules: Iterable[int] | None = None, *, diverging: bool = False, **options: Any
) -> LiveReplay:
    """Replay a log with these modules live, by default all, and the others as in the recording.

    The options are those of `cubepath.coordinator.replay_live`, such as ``rule``. AssertionError
    names the first divergence, or with `diverging` says that there was none.

    >>> log = RunLog.read("logs/golden/agv-6.mcap")
    >>> live_modules(log, [0, 1], processes=0).rounds
    16
    """
    __tracebackhide__ = True
    _check_log(log)
    found = replay_live(log.recording, modules, **options)
    if diverging and found.same:
        raise AssertionError(f"no divergence in {found.rounds} rounds, expected one")
    if not diverging and not found.same:
        raise AssertionError(f"the same for {found.rounds} rounds, then {found.divergence}")
    return found


def other_rule(
    log: RunLog,
    rule: str,
    *,
    from_round: int,
    failing: bool = False,
    out: Path | str | None = None,
    **options: Any,
) -> RunLog:
    """Go on from a round of a log with another rule; return the log of the new run.

    It is recorded in the file `out`, by default a new one in the folder ``logs``. The options are
    those of `cubepath.coordinator.what_if`. AssertionError if the run fails, or if it does not and
    is expected to (`failing`).

    >>> log = RunLog.read("logs/golden/agv-6.mcap")
    >>> other_rule(log, "random", from_round=5, max_rounds=9, processes=0, out="if.mcap").rounds
    9
    """
    __tracebackhide__ = True
    _check_log(log)
    outcome = what_if(log.recording, rule, from_round=from_round, log=out, **options)
    if (outcome.ended == "failed") is not failing:
        found = f"it ended: {outcome.ended}" if failing else outcome.error
        raise AssertionError(f"rule {rule} from round {from_round} on: {found}")
    return RunLog(outcome.recording())


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
        kinds: Collection[str] | None = None,
        rate: float | None = None,
        env: Mapping[str, str] | None = None,
    ) -> None:
        """Replay the messages of modules, of these kinds, at this many rounds a second.

        ``{endpoint}`` in the command is where it listens, ``{run}`` the name of the run; they are
        in ``CUBEPATH_ENDPOINT`` and ``CUBEPATH_RUN`` too. CheckError if it ends before it listens,
        or does not within the time; otherwise as `cubepath.coordinator.replay`.
        """
        _check_log(log)
        check_command(command)
        self._resources = ExitStack()
        self._command: Command | None = None

        def announce(endpoint: str, run: str) -> None:
            link = self._resources.enter_context(LinkProxy("listener", endpoint))

            def filled(text: str) -> str:
                return text.replace("{endpoint}", link.endpoint).replace("{run}", run)

            line = filled(command) if isinstance(command, str) else list(map(filled, command))
            own = {"CUBEPATH_ENDPOINT": link.endpoint, "CUBEPATH_RUN": run, **(env or {})}
            self._command = self._resources.enter_context(Command(line, env=own))
            _wait_until_it_listens(self._command, link, run, timeout_s)

        try:
            self.replayed: ReplayResult = replay(
                log.recording, rate=rate, kinds=kinds, endpoint="tcp/127.0.0.1:0", announce=announce
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


def _wait_until_it_listens(command: Command, link: LinkProxy, run: str, timeout_s: float) -> None:
    deadline = time.monotonic() + timeout_s
    while not link.listens(f"cubepath/{run}/**"):
        over = command.returncode is not None
        if over or time.monotonic() > deadline:
            why = "ended before" if over else f"did not within {timeout_s:g} s"
            raise CheckError(f"{command.name} listens to the run: it {why}; {command.told}")
        time.sleep(_POLL_S)
