"""Who has asked to join a run from elsewhere, with which modules: a pure table.

Whoever waits asks again every `ASK_S`, so who is not heard for `FORGET_S` has gone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

ASK_S = 2.0
FORGET_S = 10.0


@dataclass(slots=True)
class _Entry:
    modules: tuple[int, ...]
    name: int | None
    heard_s: float


class Roster:
    """The joiners of one run, up to the number that is expected."""

    def __init__(self, modules: int, expected: int) -> None:
        """Expect so many joiners for a scene with so many modules."""
        self._modules = modules
        self._expected = expected
        self._entries: dict[str, _Entry] = {}
        self._numbers: dict[str, int] | None = None

    @property
    def complete(self) -> bool:
        """Whether all that are expected are there."""
        return len(self._entries) == self._expected

    @property
    def missing(self) -> int:
        """Return how many are still expected."""
        return self._expected - len(self._entries)

    @property
    def free(self) -> list[int]:
        """Return the modules that nobody has taken, in order."""
        taken = {module for entry in self._entries.values() for module in entry.modules}
        return [module for module in range(self._modules) if module not in taken]

    def ask(
        self, joiner: str, modules: Sequence[int], name: int | None, now_s: float
    ) -> str | None:
        """Let a joiner in with these modules, as process `name` or any; return why not, if so.

        `joiner` says who asks; one that asks again changes nothing.
        """
        known = self._entries.get(joiner)
        if known is not None:
            known.heard_s = now_s
            return None
        if not self._expected:
            return "the run waits for no processes, expected one that has --wait-for N"
        if self._numbers is not None:
            return "the run has begun"
        reason = self._wrong_modules(modules) or self._wrong_name(name)
        if reason is None:
            self._entries[joiner] = _Entry(tuple(sorted(modules)), name, now_s)
        return reason

    def _wrong_modules(self, modules: Sequence[int]) -> str | None:
        strange = sorted({each for each in modules if not 0 <= each < self._modules})
        if strange or not modules:
            found = spans(strange) or "none"
            return f"modules {found}: the run has modules 0-{self._modules - 1}"
        if len(set(modules)) < len(modules):
            return "modules: one is named twice"
        taken = sorted(set(modules) - set(self.free))
        if taken:
            return f"modules {spans(taken)}: taken by another process"
        return None

    def _wrong_name(self, name: int | None) -> str | None:
        if self.complete:
            return f"the run waits for {self._expected} processes, and they are there"
        if name is not None and not 0 <= name < self._expected:
            return f"process_{name}: those that join are process_0 to process_{self._expected - 1}"
        if name is not None and name in (entry.name for entry in self._entries.values()):
            return f"process_{name}: there already"
        return None

    def forget(self, now_s: float) -> None:
        """Forget who has not asked for long, until the joiners are numbered."""
        if self._numbers is None:
            self._entries = {
                joiner: entry
                for joiner, entry in self._entries.items()
                if now_s - entry.heard_s < FORGET_S
            }

    def number(self) -> list[list[int]]:
        """Number the joiners, once and for all; return the modules of each.

        Who named itself has that number. The others have what is left, by their first modules.
        """
        named = {entry.name: joiner for joiner, entry in self._entries.items()}
        order = sorted(self._entries, key=lambda joiner: self._entries[joiner].modules)
        unnamed = iter([each for each in order if self._entries[each].name is None])
        joiners = [named[k] if k in named else next(unnamed) for k in range(len(order))]
        self._numbers = {joiner: number for number, joiner in enumerate(joiners)}
        return [list(self._entries[joiner].modules) for joiner in joiners]

    def number_of(self, joiner: str) -> int | None:
        """Return the number of a joiner, None before there is one."""
        return None if self._numbers is None else self._numbers.get(joiner)


def spans(modules: Sequence[int]) -> str:
    """Return modules in increasing order as ``0-7, 9``."""
    found: list[tuple[int, int]] = []
    for module in modules:
        if found and found[-1][1] == module - 1:
            found[-1] = found[-1][0], module
        else:
            found.append((module, module))
    return ", ".join(f"{a}" if a == b else f"{a}-{b}" for a, b in found)
