"""What the fixtures of the pytest plugin give to a test, and what they do when it is over.

The plugin imports this when a fixture is used.
"""

import re
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from contextlib import ExitStack, suppress
from inspect import signature
from pathlib import Path
from typing import Any, TypeVar

from cubepath.coordinator.runs.live import LiveReplay
from cubepath.coordinator.runs.plan import Plan
from cubepath.coordinator.simulation.faults import Fault
from cubepath.coordinator.testing.checks import check_name
from cubepath.coordinator.testing.log import RunLog
from cubepath.coordinator.testing.replaying import (
    Listener,
    live_modules,
    other_rule,
    replay_into,
    replay_into_node,
)
from cubepath.coordinator.testing.run_under_test import CommandLine, RunUnderTest
from cubepath.coordinator.testing.strategies import TrialResult, trial_of
from cubepath.coordinator.testing.wire_messages import WireMessage
from cubepath.protocol.wire.nodes import Effect, Node

T = TypeVar("T")


class RecordingFolder:
    """Where the recordings of a test go."""

    def __init__(self, folder: Path, prefix: str = "") -> None:
        """Put them into a folder; their names begin with a prefix."""
        self._folder = folder
        self._prefix = re.sub(r"[^\w.-]+", "-", prefix).strip("-")
        self.all: list[Path] = []

    def new(self, name: str) -> Path:
        """Return a path that is not taken: ``run.mcap``, ``run-2.mcap``."""
        self._folder.mkdir(parents=True, exist_ok=True)
        stem = f"{self._prefix}-{name}" if self._prefix else name
        number = 1
        while (path := self._path(stem, number)).exists() or path in self.all:
            number += 1
        self.all.append(path)
        return path

    def _path(self, stem: str, number: int) -> Path:
        return self._folder / f"{stem}{f'-{number}' if number > 1 else ''}.mcap"


def marked(options: dict[str, Any]) -> dict[str, Any]:
    """Return the options of a marker; InputError for one that no run has."""
    takes = (signature(each).parameters for each in (RunUnderTest.__init__, Plan, trial_of))
    known = {"seeds"}.union(*takes) - {"self", "system", "rule", "options", "faults"}
    for name in options:
        check_name("@pytest.mark.cubepath: ", name, sorted(known))
    return options


class RunFixture:
    """The fixture ``cubepath_run``: starts runs, and ends them when the test is over."""

    def __init__(self, places: RecordingFolder, defaults: Mapping[str, Any]) -> None:
        """Start runs with these defaults."""
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
        __tracebackhide__ = True
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

    def told(self) -> list[str]:
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
        self._told: list[str] = []

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
        __tracebackhide__ = True
        chosen = self._seed if seed is None else seed
        given: dict[str, Any] = {**self._defaults, **options}
        tried = trial_of(system, rule, faults=faults, seed=chosen, **given).play()
        if tried.run.failure is not None:
            with suppress(Exception):  # a run without rounds has none
                path = self._places.new("simulated")
                tried.write(path)
                self._told.append(f"recording {path}: {system}, seed {chosen}, simulated")
        if check:
            tried.assert_holds()
        return tried

    def told(self) -> list[str]:
        """Return a line for each recording that was kept."""
        return self._told


class ReplayFixture:
    """The fixture ``cubepath_replay``: puts a recording into the code under test."""

    def __init__(self, timeout_s: float, places: RecordingFolder) -> None:
        """Wait this long for commands and for phases of runs by default."""
        self._timeout_s = timeout_s
        self._places = places
        self._told: list[str] = []
        self._resources = ExitStack()

    def into(
        self,
        log: RunLog | Path | str,
        to: Callable[[WireMessage], T],
        what: str = "",
        **pattern: Any,
    ) -> list[T]:
        """Call a function with each message; as `replay_into`."""
        return replay_into(_log(log), to, what, **pattern)

    def into_node(
        self, log: RunLog | Path | str, node: Node, what: str = "", **pattern: Any
    ) -> list[Effect]:
        """Give each message to a node; as `replay_into_node`."""
        return replay_into_node(_log(log), node, what, **pattern)

    def to(self, log: RunLog | Path | str, command: CommandLine, **options: Any) -> Listener:
        """Start a command, replay to it on a wire, and return both; as `Listener`."""
        given: dict[str, Any] = {"timeout_s": self._timeout_s, **options}
        return self._resources.enter_context(Listener(_log(log), command, **given))

    def live(
        self, log: RunLog | Path | str, modules: Iterable[int] | None = None, **options: Any
    ) -> LiveReplay:
        """Try live modules against a log, up to the first divergence; as `live_modules`."""
        __tracebackhide__ = True
        return live_modules(_log(log), modules, **self._of_a_run(options))

    def what_if(
        self, log: RunLog | Path | str, rule: str, *, from_round: int, **options: Any
    ) -> RunLog:
        """Go on from a round with another rule, in a new run; as `other_rule`.

        Its recording goes to the folder of the test by default.
        """
        __tracebackhide__ = True
        given = self._of_a_run(options)
        path = given.setdefault("out", self._places.new("what-if"))
        self._told.append(f"recording {path}: rule {rule} from round {from_round} on")
        return other_rule(_log(log), rule, from_round=from_round, **given)

    def _of_a_run(self, options: Mapping[str, Any]) -> dict[str, Any]:
        return {"patience": self._timeout_s, "processes": 2, **options}

    def told(self) -> list[str]:
        """Return a line for each recording that was made."""
        return self._told

    def close(self) -> None:
        """End all commands."""
        self._resources.close()


def _log(log: RunLog | Path | str) -> RunLog:
    return log if isinstance(log, RunLog) else RunLog.read(log)
