"""The families of scenes by name, found by entry points.

Every family comes in by this door, those of the project too: its own entry point names them.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from typing import cast

from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.system import System
from cubepath.protocol.scenes.family import Family

GROUP = "cubepath.systems"
SCENE_KEYS = ("format", "start", "name", "family", "goal", "goals")
"""The keys of a scene's file that are no table of a system."""
_OWN = "cubepath"


def _entries() -> list[EntryPoint]:
    """Return the entry points: the project's own first, then by distribution and name."""

    def order(entry: EntryPoint) -> tuple[bool, str, str]:
        by = entry.dist.name if entry.dist is not None else ""
        return by != _OWN, by, entry.name

    # One that is found twice, since a folder is on the path twice, is one.
    return sorted(set(entry_points(group=GROUP)), key=order)


def _where(entry: EntryPoint) -> str:
    by = f" ({entry.dist.name})" if entry.dist is not None else ""
    return f"entry point {entry.name} of {GROUP}{by}"


def _loaded(entry: EntryPoint) -> tuple[Family, ...]:
    try:
        found = entry.load()
    except Exception as error:
        raise InputError(f"{_where(entry)}: {type(error).__name__}: {error}") from error
    several = found if isinstance(found, tuple) else (found,)
    for each in several:
        flaw = _flaw(each)
        if flaw is not None:
            raise InputError(f"{_where(entry)}: {flaw}")
    return several


def _flaw(found: object) -> str | None:
    """Return what keeps an entry from being a family of systems, None where nothing does."""
    if not isinstance(found, Family):
        return f"{found!r} is no Family"
    system = cast("object", found.system)  # an annotation binds nobody elsewhere
    if not (isinstance(system, type) and issubclass(system, System)):
        return f"{system!r} of {found.name!r} is no class of System"
    lacking = sorted(system.__abstractmethods__ | ({"table"} - {*dir(system)}))
    if lacking:
        return f"{system.__name__} of {found.name!r} does not define {', '.join(lacking)}"
    if system.table in SCENE_KEYS:
        return f"table [{system.table}] of {system.__name__} is a key that every scene has"
    return None


def _sound() -> Iterator[Family]:
    """Yield the families that can be loaded; what else is installed is left alone."""
    for entry in _entries():
        with suppress(InputError):
            yield from _loaded(entry)


@cache
def all_families() -> dict[str, Family]:
    """Return all families by name; InputError names an entry point that gives none, or one twice.

    Those of the project come first, the others by distribution and entry point.
    """
    found: dict[str, Family] = {}
    for entry in _entries():
        for family in _loaded(entry):
            if family.name in found:
                raise InputError(f"{_where(entry)}: system {family.name!r} exists")
            table = family.system.table
            other = kinds()[table]
            if family.system is not other:
                raise InputError(
                    f"{_where(entry)}: table [{table}] of {family.system.__name__} is that of"
                    f" {other.__name__}"
                )
            found[family.name] = family
    return found


@cache
def sound_families() -> dict[str, Family]:
    """Return the families that can be loaded, by name; of two of one name the first."""
    found: dict[str, Family] = {}
    for family in _sound():
        found.setdefault(family.name, family)
    return found


def family_named(name: str) -> Family | None:
    """Return the family of that name; a broken entry point hurts only who asks for what it has.

    InputError where there is none of that name and an entry point cannot be loaded, which may be
    the one that has it.
    """
    found = sound_families().get(name)
    return all_families().get(name) if found is None else found


@cache
def kinds() -> dict[str, type[System]]:
    """Return the classes of systems by the name of their TOML table."""
    found: dict[str, type[System]] = {}
    for family in sound_families().values():
        found.setdefault(family.system.table, family.system)
    return found
