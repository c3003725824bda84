"""The findings of verifying a recording: its checks, and the first failure of each.

Part of `cubepath verify`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

from cubepath.protocol.core.errors import bounded

Progress = Callable[[int], object]
"""Called now and then with the number of rounds, or levels, checked since the last call."""
NO_END = "not checked: the end is not on record"


@dataclass(frozen=True, slots=True)
class Check:
    """One check: `detail` says in one line where it first fails, and is empty if it holds.

    If it was not made, or not on all of the recording, `checked` is False and `detail` says why.
    """

    name: str
    ok: bool
    detail: str
    checked: bool = True


class MissingMessages(NamedTuple):
    """How much is known to be missing: at least so much was there, and is not recorded."""

    rounds: int
    """Rounds that were begun, and that not every module has reported."""
    messages: int
    """Messages by their numbers, and those of the last phase that were counted."""


@dataclass(frozen=True, slots=True)
class Verification:
    """The result of verifying a recording; the numbers are derived, not read from the recording.

    `complete` is False if the end is missing. What was recovered of a run that was cut off is `ok`
    if it is correct as far as it goes.
    """

    ok: bool
    complete: bool
    missing: MissingMessages
    checks: tuple[Check, ...]
    moves: int
    rounds: int
    cubes: int
    path_digest: str

    def document(self) -> dict[str, Any]:
        """Return the keys of ``cubepath verify --json``."""
        checks = [
            {key: getattr(check, key) for key in ("name", "ok", "checked", "detail")}
            for check in self.checks
        ]
        found = {key: getattr(self, key) for key in self.__slots__}
        return found | {"checks": checks, "missing": self.missing._asdict()}


class StageFailures:
    """Called with a check that fails, and one line on where and why.

    `position` says where in its stage the next failures belong, however late they are found.
    """

    def __init__(self, failures: Failures, number: int) -> None:
        self._failures, self._number = failures, number
        self.position: tuple[int, ...] = ()

    def __call__(self, check: str, detail: str) -> None:
        """Take a failure."""
        self._failures.take((self._number, *self.position), check, detail)


class Failures:
    """The first failure of each check, and the number of failures.

    Rounds are derived while later ones are still being sorted. Which failure is the first does not
    depend on when a round was closed: what is found by sorting comes before what is derived.
    """

    def __init__(self, checks: Iterable[str]) -> None:
        self._first: dict[str, tuple[tuple[int, ...], str]] = {}
        self._count: dict[str, int] = dict.fromkeys(checks, 0)

    def stage(self, number: int) -> StageFailures:
        """Return what to call for a failure found in a stage; earlier stages come first."""
        return StageFailures(self, number)

    def take(self, place: tuple[int, ...], check: str, detail: str) -> None:
        """Take a failure; the one with the least place is the first."""
        known = self._first.get(check)
        if known is None or place < known[0]:
            self._first[check] = place, bounded(detail)
        self._count[check] += 1

    def checks(self, unchecked: Mapping[str, str]) -> tuple[Check, ...]:
        """Return all checks; `unchecked` says why one was not made, by its name."""
        return tuple(
            Check(name, ok=False, detail=self._detail(name), checked=name not in unchecked)
            if count
            else Check(name, ok=True, detail=unchecked.get(name, ""), checked=name not in unchecked)
            for name, count in self._count.items()
        )

    def _detail(self, name: str) -> str:
        more = self._count[name] - 1
        return self._first.get(name, ((), ""))[1] + (f" (and {more} more)" if more > 0 else "")
