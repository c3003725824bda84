"""Batches: what the modules of a process say in a phase goes to the regions that it is for.

Part of `cubepath verify`: where each part has to go is derived from the neighbourhoods of the
system.
"""

from __future__ import annotations

from collections.abc import Iterable
from functools import lru_cache

from cubepath.coordinator.verification.transcript import Fail, Round, named, site_in
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.sites import Site
from cubepath.protocol.core.system import System
from cubepath.protocol.wire.messages import Part, Report, Said, Verdict, kind_of

_SAID_IN = {"here": "sense", "note": "sense", "claim": "claim", "verdict": "settle"}


class Batches:
    """The batches of a run, a round at a time; `fail` is called for each violation."""

    def __init__(self, system: System, fail: Fail) -> None:
        """Begin before the first round, when no module has spoken yet."""
        self._system = system
        self._fail = fail
        self._process_of: dict[int, int] = {}
        self._regions = lru_cache(maxsize=1 << 14)(self._regions_near)

    def check(self, number: int, this: Round) -> None:
        """Check the batches of a round, which is complete."""
        numbers: dict[tuple[int, str, str], set[int]] = {}
        gone: dict[tuple[str, int], set[str]] = {}
        for batch in this.batches:
            if isinstance(batch, Said):
                key = (batch.process, batch.phase, batch.region)
                numbers.setdefault(key, set()).add(batch.number)
            for part in batch.parts:
                self._check_process(part, batch.process)
                if isinstance(batch, Said) and not isinstance(part, Report):
                    self._check_phase(part, batch.phase)
                    gone.setdefault((kind_of(part), part.module), set()).add(batch.region)
        for (process, phase, region), found in sorted(numbers.items()):
            if found != set(range(len(found))):
                self._fail(
                    "said",
                    f"round {number}, process_{process}: what it said to region {region} in phase"
                    f" {phase} is numbered {sorted(found)}, not from 0 on",
                )
        for who, regions in sorted(gone.items()):
            self._check_regions(this.said.get(who), regions)

    def _check_process(self, part: Part | Report, process: int) -> None:
        if self._process_of.setdefault(part.module, process) != process:
            self._fail(
                "said",
                f"{named(part)} comes from process_{process}, but the module is in"
                f" process_{self._process_of[part.module]}",
            )

    def _check_phase(self, part: Part, phase: str) -> None:
        due = _SAID_IN[kind_of(part)]
        if phase != due:
            self._fail("said", f"{named(part)} is said in phase {phase}, not in {due}")

    def _check_regions(self, part: Part | None, regions: set[str]) -> None:
        due = None if part is None else self._due(part)
        if part is None or due is None:
            return  # named elsewhere: there is no such module, or no such place
        if regions - due:
            self._fail("said", f"{named(part)} goes to region {min(regions - due)} in vain")
        if due - regions:
            self._fail("said", f"{named(part)} does not go to region {min(due - regions)}")

    def _due(self, part: Part) -> frozenset[str] | None:
        """Return the regions that a part is for; None if one of its sites is malformed."""
        try:
            if isinstance(part, Verdict):
                places = [site_in(place) for place in part.to]
                if all(self._is_place(place) for place in places):
                    return frozenset(self._system.region(place) for place in places)
                return None
            site = site_in(part.site)
            place = None if site is None else self._system.place_of(site)
            if self._is_place(place):
                return self._regions(place, kind_of(part) == "here")
        except (TypeError, IndexError, ValueError, InputError):
            pass  # it is no site of this system
        return None

    def _is_place(self, place: Site | None) -> bool:
        return place is not None and self._system.has_place(place)

    def _regions_near(self, place: Site, here: bool) -> frozenset[str]:  # noqa: FBT001 - a cache key
        system = self._system
        near: Iterable[Site] = system.listeners(place) if here else system.reach(place)
        return frozenset(system.region(each) for each in near)
