"""What the fixture ``cubepath_run`` gives to a test, and what it does when that is over.

The plugin imports this when the fixture is asked for.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from contextlib import ExitStack, suppress
from inspect import signature
from itertools import chain, count
from pathlib import Path
from typing import Any

from cubepath.coordinator.runs.plan import Plan
from cubepath.coordinator.testing.run_under_test import CommandLine, RunUnderTest
from cubepath.protocol.core.options import known_name


class RecordingFolder:
    """Where the recordings of a test go."""

    def __init__(self, folder: Path) -> None:
        """Put them into a folder."""
        self._folder = folder
        self.all: list[Path] = []

    def new(self, name: str) -> Path:
        """Return a path that is not taken: ``run.mcap``, ``run-2.mcap``."""
        names = chain([name], (f"{name}-{number}" for number in count(2)))
        paths = (self._folder / f"{each}.mcap" for each in names)
        path = next(each for each in paths if not each.exists() and each not in self.all)
        self.all.append(path)
        return path


def marked(options: dict[str, Any]) -> dict[str, Any]:
    """Return the options of a marker; InputError for one that no run has."""
    takes = (signature(each).parameters for each in (RunUnderTest.__init__, Plan))
    known = {"seeds"}.union(*takes) - {"self", "system", "rule", "options"}
    for name in options:
        known_name("@pytest.mark.cubepath: ", name, sorted(known))
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

        The seed is that of the test, and the recording goes to its folder, unless told otherwise,
        as by a `Plan`.
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
