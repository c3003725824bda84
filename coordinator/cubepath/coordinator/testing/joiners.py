"""Commands of others that join a run under test, and are looked after until they have."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from typing import TypeAlias

from cubepath.coordinator.testing.commands import Command, check_command
from cubepath.protocol.core.errors import CheckError, InputError

CommandLine: TypeAlias = "str | Sequence[str]"


class Joiners:
    """The commands of one run, by their names."""

    def __init__(
        self,
        commands: Mapping[str, CommandLine] | Sequence[CommandLine],
        env: Mapping[str, str] | None,
        timeout_s: float,
    ) -> None:
        """Plan them; unless named they are ``own_0`` and so on. InputError for what is no list."""
        if isinstance(commands, str) or not isinstance(commands, Mapping | Sequence):  # pyright: ignore[reportUnnecessaryIsInstance]
            raise InputError(f"commands={commands}: expected a list, or names with commands")
        numbered = {f"own_{number}": line for number, line in enumerate(commands)}
        self.lines = dict(commands) if isinstance(commands, Mapping) else numbered
        for line in self.lines.values():
            check_command(line)
        if not isinstance(env, Mapping | None):  # pyright: ignore[reportUnnecessaryIsInstance]
            raise InputError(f"env={env!r}: expected names with values")
        self.running: dict[str, Command] = {}
        self._env = dict(env or {})
        self._timeout_s = timeout_s
        self._deadline: float | None = None

    def fit(self, secure: object) -> None:
        """Check that they can join a run with these certificates; InputError if not."""
        if secure is not None:
            raise InputError(
                f"commands with secure={secure}: they join a run without TLS, expected one of both"
            )

    def begin(self) -> None:
        """Let the time begin within which all are there."""
        self._deadline = time.monotonic() + self._timeout_s

    def start(self, way: Callable[[str], str]) -> None:
        """Start all; the way is where the one of a name finds the run."""
        for name, line in self.lines.items():
            where = way(name)
            filled = (
                line.replace("{endpoint}", where)
                if isinstance(line, str)
                else [text.replace("{endpoint}", where) for text in line]
            )
            env = {"CUBEPATH_ENDPOINT": where, **self._env}
            self.running[name] = Command(filled, name=name, env=env)

    def over(self) -> None:
        """Have it that all are there: who ends from now on, ends in the run."""
        self._deadline = None

    def check(self) -> None:
        """Raise CheckError if one has ended before the run began, or the time is over."""
        if self._deadline is None or not self.lines:
            return
        for name, command in self.running.items():
            code = command.returncode
            if code is not None:
                command.wait()  # until all that it said is read
                raise CheckError(f"{name} ended before it joined, exit code {code}; {command.told}")
        if time.monotonic() > self._deadline:
            told = [f"{name}: {each.told}" for name, each in self.running.items()]
            who = "; ".join(told) or "none was started"
            raise CheckError(f"not within {self._timeout_s:g} s: the commands have joined; {who}")
