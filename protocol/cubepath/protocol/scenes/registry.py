"""The families of scenes by name, of the project and of other distributions.

All are found by the entry points of one group and held to the same rules. The project's own are
also imported directly: listing what is installed takes longer than anything else at the start of a
process, and a broken distribution must not affect users of other families.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, cast

from cubepath.protocol.core.actions import State
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.formatting import did_you_mean
from cubepath.protocol.core.parsing import Keys
from cubepath.protocol.core.sites import Site
from cubepath.protocol.core.system import Scene, System
from cubepath.protocol.scenes.families.own import OWN_FAMILIES, OWN_KINDS

Values = Mapping[str, str]
MODULES_MAX = 100_000
"""The largest number of modules, or of anything else, that a spec may ask for."""

_WHOLE = re.compile(r"[+-]?[0-9]{1,18}")


@dataclass(frozen=True, slots=True)
class Family:
    """A family of scenes: its keys with their defaults and one line on each.

    Families are found by the entry points of the group ``cubepath.systems``, both the project's own
    and those of other distributions. An entry names a `Family`, or a tuple of several.

    >>> from cubepath.protocol.scenes.registry import all_families
    >>> hexagons = all_families()["hex"]
    >>> hexagons.rule, hexagons.system.__name__, hexagons.keys["n"][0]
    ('chain', 'LatticeSystem', '12')
    """

    name: str
    summary: str
    keys: Keys
    build: Callable[[str, Values], Scene]
    """Make the scene for a name and the values of all keys."""
    system: type[System]
    """The class of its systems, which defines the name and the reading of their TOML table."""
    rule: str = "metropolis"
    """The rule that leads to the goal, if a scene has one; empty without runs."""
    one_class: Callable[[System, State], bool] = lambda *_: False
    """Return whether all paths between two states reachable from the given one are known to be
    homotopic; the proof stands beside the function. It is called for every system of the class, so
    it looks at what the system is, not at its name."""
    is_file: Callable[[str, str], bool] = lambda *_: False
    """Return whether the value of a key is the path of a file. In a sweep's file such a path is
    relative to its folder and stays in it, and a name in a recording opens no file."""


def whole(values: Values, key: str, *, least: int, most: int = MODULES_MAX) -> int:
    """Return the value of a key as a whole number within bounds; InputError names the key."""
    text = values[key]
    # Not all that int takes: it allows spaces around a number, 1_0 and the digits of any script.
    number = int(text) if _WHOLE.fullmatch(text) else None
    if number is None or not least <= number <= most:
        shown = text if text.isprintable() else repr(text)
        raise InputError(
            f"{key}={shown}: expected a whole number of at least {least}, at most {most}"
        )
    return number


def scene_of(
    name: str, system: System, start: Iterable[Site], goal: Iterable[Site], *, own: bool = False
) -> Scene:
    """Return a family's scene whose modules know the whole goal, or each its `own` site of it.

    Without a site there is no goal.
    """
    modules, sites = tuple(start), tuple(goal)
    goals = tuple((site,) for site in sites) if own else (sites,) * len(modules)
    return Scene(name, name, system, modules, frozenset(sites) or None, goals if sites else ())


if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

GROUP = "cubepath.systems"
SCENE_KEYS = ("format", "start", "name", "family", "goal", "goals", "rule")
"""The keys of a scene's file that are not tables of systems."""
PAGE_KEYS = ("keys", "map", "scenes")
"""Those that only a page has."""
_OWN = "cubepath"


def _entries() -> list[EntryPoint]:
    """Return the entry points: the project's own first, then by distribution and name."""
    from importlib.metadata import entry_points  # noqa: PLC0415 - takes long, see above

    def order(entry: EntryPoint) -> tuple[bool, str, str]:
        by = entry.dist.name if entry.dist is not None else ""
        return by != _OWN, by, entry.name

    # An entry is found twice if its folder is on the path twice; it counts once.
    return sorted(set(entry_points(group=GROUP)), key=order)


def _where(entry: EntryPoint) -> str:
    by = f" ({entry.dist.name})" if entry.dist is not None else ""
    return f"entry point {entry.name} of {GROUP}{by}"


def _loaded(entry: EntryPoint) -> tuple[Family, ...]:
    try:
        found = entry.load()
    except (Exception, SystemExit) as error:
        raise InputError(f"{_where(entry)}: {type(error).__name__}: {error}") from error
    several = found if isinstance(found, tuple) else (found,)
    for each in several:
        flaw = _flaw(each)
        if flaw is not None:
            raise InputError(f"{_where(entry)}: {flaw}")
    return several


def _flaw(found: object) -> str | None:
    """Return what keeps an entry from being a family of systems; None if nothing does."""
    if not isinstance(found, Family):
        return f"{found!r} is no Family"
    # Other distributions need not follow the annotations.
    name, keys = cast("object", found.name), cast("object", found.keys)
    system = cast("object", found.system)
    if not isinstance(name, str) or not name or ":" in name or name.endswith(".toml"):
        return f"{name!r} is no name of a system"
    if not isinstance(keys, Mapping):
        return f"the keys of {name!r} are {keys!r}, expected a mapping"
    return _flaw_of_class(name, system)


def _flaw_of_class(name: str, system: object) -> str | None:
    if not (isinstance(system, type) and issubclass(system, System)):
        return f"{system!r} of {name!r} is no class of System"
    lacking = sorted(system.__abstractmethods__ | ({"table"} - {*dir(system)}))
    if lacking:
        return f"{system.__name__} of {name!r} does not define {', '.join(lacking)}"
    table = system.table
    if table in SCENE_KEYS:
        return f"table [{table}] of {system.__name__} is a key that every scene has"
    if OWN_KINDS.get(table, system) is not system:
        return f"table [{table}] of {system.__name__} is that of {OWN_KINDS[table].__name__}"
    return None


@cache
def all_families() -> dict[str, Family]:
    """Return all families by name; InputError names an entry point with none, or with one twice.

    The project's own come first, the others by distribution and entry point.

    >>> list(all_families())[:4]
    ['hex', 'hex-open', 'hex-tunnel', 'sliding']
    """
    found: dict[str, Family] = {}
    tables: dict[str, type[System]] = {}
    for entry in _entries():
        for family in _loaded(entry):
            if family.name in found:
                raise InputError(f"{_where(entry)}: system {family.name!r} exists")
            table = family.system.table
            other = tables.setdefault(table, family.system)
            if family.system is not other:
                raise InputError(
                    f"{_where(entry)}: table [{table}] of {family.system.__name__} is that of"
                    f" {other.__name__}"
                )
            found[family.name] = family
    return found


@cache
def _sound_families() -> dict[str, Family]:
    """Return the families that can be loaded, by name; the first of several with one name."""
    found: dict[str, Family] = {}
    for family in _sound():
        found.setdefault(family.name, family)
    return found


def _sound() -> Iterator[Family]:
    for entry in _entries():
        with suppress(InputError):
            yield from _loaded(entry)


def sound_family(name: str) -> Family | None:
    """Return the family of that name; None if there is none that can be loaded."""
    if name in OWN_FAMILIES or not name:
        return OWN_FAMILIES.get(name)
    return _sound_families().get(name)


def family_named(name: str) -> Family:
    """Return the family of that name; a broken entry point affects only its own families.

    Raises InputError if there is none. If an entry point cannot be loaded, the error names that one
    instead, since it may be the one with the family.
    """
    found = sound_family(name) or all_families().get(name)
    if found is None:
        names = ", ".join(all_families())
        near = did_you_mean(name, all_families())
        raise InputError(f"unknown system {name!r}{near}, expected one of {names} or a .toml file")
    return found


def families_of(system: System) -> list[Family]:
    """Return the families whose systems are of this very class.

    For the project's own classes, only the project's families count: other distributions are
    trusted only about their own systems.
    """
    own = OWN_KINDS.get(system.table) is type(system)
    known: Mapping[str, Family] = OWN_FAMILIES if own else _sound_families()
    return [family for family in known.values() if family.system is type(system)]


def contradiction(family: Family, system: System) -> str | None:
    """Return what keeps a system that a family has made from being read back; None if nothing."""
    made = type(system)
    if made is not family.system:
        return f"its system is of {made.__name__}, {family.name!r} says {family.system.__name__}"
    reader = OWN_KINDS.get(made.table) or kinds().get(made.table)
    if reader is not made:
        by = "nobody" if reader is None else reader.__name__
        return f"its system is of {made.__name__}, whose table [{made.table}] is read by {by}"
    return None


@cache
def kinds() -> dict[str, type[System]]:
    """Return all classes of systems by the name of their TOML table; the first of several."""
    found = dict(OWN_KINDS)
    for family in _sound_families().values():
        found.setdefault(family.system.table, family.system)
    return found
