"""What the fixtures of the pytest plugin give to a test, and what they do when it is over.

The plugin imports this when a fixture is used.
"""

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from contextlib import ExitStack, suppress
from inspect import signature
from itertools import chain, count
from pathlib import Path
from typing import Any, Self, TypeVar

from cubepath.coordinator.playback.player import replay
from cubepath.coordinator.playback.replay_comparison import ReplayResult
from cubepath.coordinator.runs.continuing import what_if
from cubepath.coordinator.runs.live import LiveReplay, replay_live
from cubepath.coordinator.runs.plan import Plan
from cubepath.coordinator.simulation.faults import Fault
from cubepath.coordinator.testing.commands import Command, CommandLine, check_command
from cubepath.coordinator.testing.link import LinkProxy
from cubepath.coordinator.testing.log import RunLog, What, pattern_of
from cubepath.coordinator.testing.run_under_test import RunUnderTest
from cubepath.coordinator.testing.strategies import TrialResult, trial_of
from cubepath.coordinator.testing.wire_messages import RESULTS, WireMessage
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.options import function, known_name
from cubepath.protocol.recordings.writing import copy_recording
from cubepath.protocol.wire.free_messages import free_key
from cubepath.protocol.wire.keys import key_of
from cubepath.protocol.wire.nodes import Effect, Node

__tracebackhide__ = True  # pytest shows no frames of this module
T = TypeVar("T")


class RecordingFolder:
    """Where the recordings of a test go."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._taken: set[Path] = set()
        self.kept: list[str] = []
        """A line for each recording that is there whether its test fails or not."""

    def new(self, name: str) -> Path:
        """Return a path that is not taken: ``run.mcap``, ``run-2.mcap``."""
        numbered = (self._folder / f"{name}-{number}.mcap" for number in count(2))
        paths = chain([self._folder / f"{name}.mcap"], numbered)
        path = next(each for each in paths if not each.exists() and each not in self._taken)
        self._taken.add(path)
        return path

    def report_lines(self) -> list[str]:
        """Return a line for each recording that was kept."""
        return self.kept


def marked(options: dict[str, Any]) -> dict[str, Any]:
    """Return the options of a marker; InputError for one that no run has."""
    takes = (signature(each).parameters for each in (RunUnderTest.__init__, Plan, trial_of))
    known = {"seeds"}.union(*takes) - {"self", "system", "rule", "options", "faults"}
    for name in options:
        known_name("@pytest.mark.cubepath: ", name, sorted(known))
    return options


class RunFixture:
    """The fixture ``cubepath_run``: starts runs, and ends them when the test is over."""

    def __init__(self, places: RecordingFolder, defaults: Mapping[str, Any]) -> None:
        self._places = places
        self._defaults = dict(defaults)
        self._resources = ExitStack()
        self.rigs: list[RunUnderTest] = []

    def __call__(
        self,
        system: Any = None,
        rule: str | None = None,
        *,
        commands: Mapping[str, CommandLine] | Sequence[CommandLine] = (),
        links: bool | Collection[str] = True,
        **options: Any,
    ) -> RunUnderTest:
        """Start a run; the arguments are those of `RunUnderTest`.

        The seed is that of the test, and the recording goes to its folder, unless a `Plan` or an
        argument says otherwise.
        """
        given: dict[str, Any] = {**self._defaults, "links": links, "commands": commands, **options}
        if isinstance(system, Plan) and "seed" not in options:
            del given["seed"]
        if "log" not in given and not (isinstance(system, Plan) and system.log is not None):
            given["log"] = self._places.new("run")
        rig = RunUnderTest(system, rule, **given)
        self.rigs.append(rig)
        return self._resources.enter_context(rig)

    def close(self) -> None:
        """End all runs."""
        self._resources.close()

    def report_lines(self) -> list[str]:
        """Return a line for each run: its recording, and how it stands."""
        found: list[str] = []
        for rig in self.rigs:
            with suppress(Exception):  # what a report lacks is no reason to have none
                plan, status = rig.run.plan, rig.run.status
                what = f"{rig.run.scene.spec}, seed {plan.seed}"
                found.append(
                    f"recording {rig.path}: {what}, round {status.round}, {status.moves} moves"
                    + (f", ended: {status.ended}" if status.ended else "")
                )
        return found


class SimulateFixture:
    """The fixture ``cubepath_simulate``: runs under faults in virtual time, checked."""

    def __init__(
        self, places: RecordingFolder, seed: int, defaults: Mapping[str, Any] | None = None
    ) -> None:
        """Simulate with this seed and these options of `trial_of` by default.

        Of the defaults, options that only runs in processes have are left out.
        """
        known = signature(trial_of).parameters.keys() - {"faults"}
        self._places = places
        self._defaults = {key: each for key, each in (defaults or {}).items() if key in known}
        self._seed = int(self._defaults.pop("seed", seed))

    def __call__(
        self,
        system: str,
        rule: str | None = None,
        *,
        faults: Sequence[Fault] = (),
        seed: int | None = None,
        check: bool = True,
        **options: Any,
    ) -> TrialResult:
        """Simulate a run under faults; the arguments are those of `trial_of`.

        Unless `check` is False, AssertionError tells what does not hold of it. The recording of a
        run that fails is kept.
        """
        chosen = self._seed if seed is None else seed
        given: dict[str, Any] = {**self._defaults, **options}
        tried = trial_of(system, rule, faults=faults, seed=chosen, **given).play()
        if tried.run.failure is not None:
            with suppress(Exception):  # a run without rounds has none
                path = self._places.new("simulated")
                copy_recording(tried.log.recording, path)
                self._places.kept.append(f"recording {path}: {system}, seed {chosen}, simulated")
        if check:
            tried.assert_holds()
        return tried


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
        self.command: Command
        """The command."""

        def announce(endpoint: str, run: str) -> None:
            link = self._resources.enter_context(LinkProxy("listener", endpoint))

            found = Command(command, env=env, timeout_s=timeout_s, endpoint=link.endpoint, run=run)
            self.command = self._resources.enter_context(found)
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

    def close(self) -> None:
        """End the command."""
        self._resources.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


class ReplayFixture:
    """The fixture ``cubepath_replay``: puts a recording into the code under test."""

    def __init__(self, timeout_s: float, places: RecordingFolder) -> None:
        """Wait this long for commands and for phases of runs by default."""
        self._timeout_s = timeout_s
        self._places = places
        self._resources = ExitStack()

    def into(
        self,
        log: RunLog | Path | str,
        to: Callable[[WireMessage], T],
        what: What = "",
        *,
        run: str = "replayed",
        **pattern: Any,
    ) -> list[T]:
        """Call a function with each message of a log, in its order; return what it returned.

        The bytes are those of the recording, and the keys those of a run of this name. What the
        coordinator found at the end was on no wire, and is left out. With `what` and the keys of
        `Pattern`, messages are those that they mean.
        """
        function("to", to)
        meant = pattern_of(what, **pattern)
        return [
            to(on_wire(each, run))
            for each in _log(log).all_deliveries
            if each.kind not in RESULTS and meant.holds(each)
        ]

    def into_node(
        self, log: RunLog | Path | str, node: Node, what: What = "", **pattern: Any
    ) -> list[Effect]:
        """Start a node, and give it each message as `into` does; return its effects in their order.

        The node's timers are not waited for.
        """
        if not all(callable(getattr(node, name, None)) for name in ("start", "receive")):
            raise InputError(f"node={node!r}: expected a node")
        found = list(node.start())
        self.into(
            log, lambda seen: found.extend(node.receive(seen.key, seen.data)), what, **pattern
        )
        return found

    def to(self, log: RunLog | Path | str, command: CommandLine, **options: Any) -> Listener:
        """Start a command, replay to it on a wire, and return both; as `Listener`."""
        given: dict[str, Any] = {"timeout_s": self._timeout_s, **options}
        return self._resources.enter_context(Listener(_log(log), command, **given))

    def live(
        self,
        log: RunLog | Path | str,
        modules: Iterable[int] | None = None,
        *,
        diverging: bool = False,
        **options: Any,
    ) -> LiveReplay:
        """Replay a log with these modules live, by default all, and the others as recorded.

        The options are those of `cubepath.coordinator.replay_live`, such as ``rule``.
        AssertionError names the first divergence, or with `diverging` says that there was none.
        """
        found = replay_live(_log(log).recording, modules, **self._of_a_run(options))
        if diverging and found.same:
            raise AssertionError(f"no divergence in {found.rounds} rounds, expected one")
        if not diverging and not found.same:
            raise AssertionError(f"the same for {found.rounds} rounds, then {found.divergence}")
        return found

    def what_if(
        self,
        log: RunLog | Path | str,
        rule: str,
        *,
        from_round: int,
        failing: bool = False,
        **options: Any,
    ) -> RunLog:
        """Go on from a round of a log with another rule; return the log of the new run.

        The recording goes to the folder of the test unless there is a ``log``. The options are
        those of `cubepath.coordinator.what_if`. AssertionError if the run fails, or if it does not
        and is expected to (`failing`).
        """
        given = self._of_a_run(options)
        path = given.setdefault("log", self._places.new("what-if"))
        self._places.kept.append(f"recording {path}: rule {rule} from round {from_round} on")
        outcome = what_if(_log(log).recording, rule, from_round=from_round, **given)
        if (outcome.ended == "failed") is not failing:
            found = f"it ended: {outcome.ended}" if failing else outcome.error
            raise AssertionError(f"rule {rule} from round {from_round} on: {found}")
        return RunLog(outcome.recording())

    def _of_a_run(self, options: Mapping[str, Any]) -> dict[str, Any]:
        return {"patience": self._timeout_s, "processes": 2, **options}

    def close(self) -> None:
        """End all commands."""
        self._resources.close()


def _log(log: RunLog | Path | str) -> RunLog:
    return log if isinstance(log, RunLog) else RunLog.read(log)
