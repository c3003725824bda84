"""The processes of a run under test, ours and those of others: found by their modules too."""

import re
from collections.abc import Collection
from contextlib import suppress
from dataclasses import replace
from typing import Any

from cubepath.coordinator.runs.run import Run
from cubepath.coordinator.testing.log import What
from cubepath.coordinator.testing.process_faults import ProcessFaults
from cubepath.coordinator.testing.rules import Pattern, Rule
from cubepath.coordinator.testing.wire import Target
from cubepath.protocol.core.errors import CubepathError, InputError
from cubepath.protocol.core.formatting import did_you_mean
from cubepath.protocol.core.options import known_name, whole_number
from cubepath.protocol.wire.credentials import COORDINATOR

_PROCESS_LIKE = ("process_", "keeper_", "module_", COORDINATOR, "router")
_MODULE = re.compile(r"module_(\d+)")
_REGION = re.compile(r"-?\d+(,-?\d+)*")


class RunProcesses(ProcessFaults):
    """The processes of a run, what a test does to them, and what it does to their messages."""

    run: Run

    def __init__(self, *, links: bool | Collection[str]) -> None:
        """Put links before all processes, none, or those of these names; InputError for others."""
        super().__init__(links=links)
        self._modules: dict[str, tuple[int, ...]] = {}

    @property
    def pids(self) -> dict[str, int]:
        """Return the process ids by name, those of commands included; none of a run that ended.

        One of the run's own that has died is there until the run has noticed.
        """
        found: dict[str, int] = {}
        with suppress(CubepathError):
            found = self.run.pids
        return found | super().pids

    def name_of(self, target: Target) -> str:
        """Return the name of a process that is given by its name, or by one of its modules.

        InputError for a name or a module that is not there.
        """
        found = _MODULE.fullmatch(target) if isinstance(target, str) else None
        if isinstance(target, str) and found is None:
            known = *self._known, *sorted(self._speakers - self._known.keys())
            if not known:
                raise InputError(f"{target}: there is none, the run has not begun or has ended")
            return known_name("", target, known)
        module = int(found[1]) if found is not None else target
        self._check_module(module)
        for name, modules in self._modules.items():
            if module in modules:
                return name
        raise InputError(f"module_{module}: has no process of its own name, expected a name")

    @property
    def _speakers(self) -> set[str]:
        return {link.speaks_as for link in self.links.values()}

    def _check_module(self, module: object) -> None:
        if module is not None:
            whole_number("module", module, 0, len(self.run.scene.start) - 1)

    def _check_speaker(self, sender: str) -> None:
        known = {*self._known, *self._speakers, COORDINATOR} - {"router"}
        known_name("sender=", sender, sorted(known))

    def _is_region(self, name: str) -> bool:
        """Return whether a name may be that of a region or a tile."""
        scene = self.run.scene
        regions = map(scene.system.region, (*scene.start, *(scene.goal or ())))
        return _REGION.fullmatch(name) is not None or name in regions

    def _named(self, target: str | int | None) -> str | None:
        """Return the name of a process that is given by its name or one of its modules."""
        if target is None or (isinstance(target, str) and _MODULE.fullmatch(target) is None):
            return target
        return self.name_of(target)

    def _pattern(self, what: What = "", **options: Any) -> Pattern:
        for key in options.keys() & {"sender", "to"}:
            options[key] = self._named(options[key])
        pattern = super()._pattern(what, **options)
        self._check_module(pattern.module)
        return pattern

    def _place(self, pattern: Pattern, **rule: Any) -> Rule:
        """Add a rule at the link of a receiver, or at all: messages are met at their sender's."""
        if not self.links:
            raise InputError(f"{rule['action']}: no process has a link, expected links=True")
        to, sender = self._named(pattern.to), self._speaks_as(self._named(pattern.sender))
        if to is not None and (to in self.links or to.startswith(_PROCESS_LIKE)):
            if sender is not None:
                self._check_speaker(sender)
            made = Rule(pattern=replace(pattern, to=None, sender=sender), **rule)
            return self.link_of(to).add(made, ("down",))
        if to is not None and not self._is_region(to):
            raise InputError(
                f"to={to}: expected a process, a region or a tile{did_you_mean(to, self.links)}"
            )
        if sender not in (None, COORDINATOR):
            self.link_of(str(sender))  # what it says is met there alone
        receivers = frozenset(link.speaks_as for link in self.links.values())
        made = Rule(pattern=replace(pattern, sender=sender), upstream=receivers, **rule)
        for link in self.links.values():
            link.add(made)
        return made

    def _speaks_as(self, name: str | None) -> str | None:
        """Return the name in keys of a process that is given by that of its link."""
        return self.links[name].speaks_as if name in self.links else name

    def _role(self, name: str) -> str:
        modules = self._modules.get(name, ())
        return f", modules {', '.join(map(str, modules))}" if modules else ""
