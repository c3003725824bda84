"""What a commit touches: the units of its move, and the modules that it changes or holds.

Part of `cubepath verify`, from the catalogue alone.
"""

from collections.abc import Iterable, Mapping

from cubepath.protocol.core.actions import Action
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.sites import Site
from cubepath.protocol.core.system import System
from cubepath.protocol.wire.free_messages import Commit

NO_SITE = (TypeError, ValueError, IndexError, KeyError, AttributeError, OverflowError)
"""What systems raise, beside `InputError`, for a value that is none of their sites."""


def unit_in(system: System, unit: Site) -> Site | None:
    """Return a unit that a message names, or None if the system has no such unit."""
    try:
        place = unit if system.labels is not None else system.place_of(unit)
        return unit if system.has_place(place) else None
    except (*NO_SITE, InputError):
        return None


def on_unit(system: System, unit: Site, standing: Mapping[Site, Site]) -> Site | None:
    """Return the site that is on at a unit, by what stands at places."""
    if system.labels is not None:
        return standing.get(unit)
    site = standing.get(system.place_of(unit))
    return site if site == unit else None


def units_of(system: System, action: Action) -> tuple[frozenset[Site], frozenset[Site]]:
    """Return the units that an action reads, and those that it writes.

    With labels a unit is a place, otherwise a site. What is no place never changes.
    """
    labelled = system.labels is not None

    def units(sites: Iterable[Site]) -> frozenset[Site]:
        found = {site: system.place_of(site) for site in sites}
        return frozenset(
            place if labelled else site for site, place in found.items() if system.has_place(place)
        )

    writes = units(action.trace)
    return units(action.support) - writes, writes


def changed_by(moved: Commit) -> dict[int, int]:
    """Return the modules that a commit moves or whose registers it writes, with their versions."""
    found = {module: version for module, _, _, version in moved.motion}
    for _, module, version, note in moved.notes:
        if note is not None:
            found.setdefault(module, version)
    return found


def held_by(moved: Commit) -> dict[int, int]:
    """Return the modules whose registers only had to hold, with their versions."""
    changed = changed_by(moved)
    return {module: version for _, module, version, _ in moved.notes if module not in changed}
