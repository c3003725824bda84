"""Pages: scene files that are pleasant to write.

A page may draw its generators, draw or describe its cells, have several scenes, and keys with
defaults. Everything past this module sees one scene, with all cells listed; docs/files.md has the
format.
"""

import re
from collections.abc import Iterable, Iterator, Mapping
from typing import Any, cast

import msgspec

from cubepath.protocol.core.actions import Action
from cubepath.protocol.core.catalogue import Catalogue, Generator, Lattice, lattice_named
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.parsing import converted
from cubepath.protocol.core.sites import sites_from_json, to_json
from cubepath.protocol.scenes.drawings import DrawingError, Sketch
from cubepath.protocol.scenes.drawn_generators import generators_of
from cubepath.protocol.scenes.page_keys import key_values, number_of, page_keys
from cubepath.protocol.scenes.page_shapes import Shape, cells_of, mapped
from cubepath.protocol.scenes.registry import PAGE_KEYS
from cubepath.protocol.systems.lattice import LatticeSystem

_CELLS = ("workspace", "filled", "empty")
_SCENE_KEYS = ("start", "goal", "goals", "map", *_CELLS)
_NAME = re.compile(r"[^\W\d]\w*")
_HEADER = re.compile(r"\s*\[+\s*([^\],]*?)\s*\]+\s*(#.*)?")
_DRAWING = re.compile(r"(\s*([\w-]+)\s*=\s*(?:\"{3}|'{3}|\"|'))(.*)")
_Lines = Mapping[tuple[str, int, str], tuple[int, int]]


class PageError(InputError):
    """Mistakes in the generators of a page: the first, and how many more; `mistakes` has all."""

    def __init__(self, mistakes: list[InputError]) -> None:
        """Take at least one."""
        more = f" (and {len(mistakes) - 1} more)" if len(mistakes) > 1 else ""
        super().__init__(f"{mistakes[0]}{more}")
        self.mistakes = tuple(mistakes)


class _PageLattice(msgspec.Struct, forbid_unknown_fields=True):
    name: str
    generators: list[Any]
    workspace: Any = None
    filled: Any = None
    empty: Any = None
    connected: bool = False


def expanded(
    table: Mapping[str, Any], text: str, given: str
) -> tuple[dict[str, Any], LatticeSystem, str]:
    """Return the table of one scene, its system, and the name of the scene, if it has one.

    `given` are values of keys, as ``n=4,scene=gap``. `text` is what the table was read from: errors
    name its lines. PageError if generators are wrong, InputError for everything else.
    """
    found = {key: value for key, value in table.items() if key not in (*PAGE_KEYS, *_SCENE_KEYS)}
    scenes = cast("dict[str, dict[str, Any]]", _table(table, "scenes"))
    keys = page_keys(_table(table, "keys"))
    values, chosen = key_values(keys, scenes, given)
    page = converted(_table(table, "lattice"), _PageLattice, "lattice")
    _check_used(keys, [table, _table(table, "lattice"), *scenes.values()])
    lattice = lattice_named(page.name)
    lines = _lines(text)
    catalogue = Catalogue(lattice, page_generators(lattice, page.generators, lines))
    cells = _cells(lattice, table, chosen, lines, values)
    walls = {key: sites_from_json(cells.pop(key)) for key in _CELLS if key in cells}
    system = LatticeSystem(catalogue, **walls, connected=page.connected)
    if isinstance(cells.get("goal"), dict):
        cells["goal"] = _walk_end(system, cells, values)
    return found | cells, system, chosen


def _check_used(keys: Iterable[str], parts: Iterable[Mapping[str, Any]]) -> None:
    """Raise InputError for a key that no number in any scene has."""
    cells = (part.get(key) for part in parts for key in _SCENE_KEYS if isinstance(part, dict))
    used = {name for each in cells if not isinstance(each, str) for name in _names(each)}
    unused = [key for key in keys if key not in used]
    if unused:
        raise InputError(f"keys: {unused[0]!r} is unused, expected it in a number of some scene")


def _names(value: object) -> Iterator[str]:
    """Yield the names in the texts of lists and tables of cells."""
    if isinstance(value, str):
        yield from _NAME.findall(value)
    elif isinstance(value, dict | list):
        for each in value.values() if isinstance(value, dict) else value:
            yield from _names(each)


def _table(table: Mapping[str, Any], key: str) -> dict[str, Any]:
    found = table.get(key, {})
    if not isinstance(found, dict):
        raise InputError(f"{key}: expected a table, found {found!r}")
    return cast("dict[str, Any]", found)


def _lines(text: str) -> _Lines:
    """Return where texts begin and tables stand: by header, number of the header, and key.

    The key of a table's header itself is empty.
    """
    found: dict[tuple[str, int, str], tuple[int, int]] = {}
    count: dict[str, int] = {}
    header = ""
    for number, line in enumerate(text.split("\n"), 1):
        if table := _HEADER.fullmatch(line):
            header = re.sub(r"[\s\"']", "", table[1])
            count[header] = count.get(header, -1) + 1
            found[header, count[header], ""] = (number, 0)
        elif drawing := _DRAWING.match(line):
            key = header, count.get(header, 0), drawing[2]
            at = (number, len(drawing[1])) if drawing[3] else (number + 1, 0)
            found.setdefault(key, at)
    return found


def page_generators(
    lattice: Lattice, tables: Iterable[Any], lines: _Lines
) -> tuple[Generator, ...]:
    """Return the generators of tables ``[[lattice.generators]]``; PageError for all mistakes."""
    mistakes: list[InputError] = []
    known: dict[Action, str] = {}
    found: list[Generator] = []
    for number, each in enumerate(tables):
        at = {
            key: line
            for (header, place, key), line in lines.items()
            if (header, place) == ("lattice.generators", number)
        }
        try:
            found += _generators(lattice, each, at, known)
        except DrawingError as error:
            mistakes.append(error)
        except InputError as error:
            line = f"line {at[''][0]}: " if at else ""
            mistakes.append(InputError(f"{line}{error}"))
    if mistakes:
        raise PageError(mistakes)
    return tuple(found)


def _generators(
    lattice: Lattice, table: object, lines: Mapping[str, tuple[int, int]], known: dict[Action, str]
) -> list[Generator]:
    """Return the generators of one table; InputError if one equals a known one."""
    given = converted(table, dict[str, Any], "generator")
    if isinstance(given.get("before"), str):
        found = generators_of(lattice, given, lines)
    else:
        found = [converted(given, Generator, f"generator {given.get('name')!r}")]
    for generator in found:
        for cell in generator.support:
            lattice.check(cell)
        action = generator.canonical(lattice)
        if action in known:
            raise InputError(
                f"generator {generator.name!r} equals {known[action]!r}, up to a translation"
            )
        known[action] = generator.name
    return found


def _cells(
    lattice: Lattice,
    table: Mapping[str, Any],
    chosen: str,
    lines: _Lines,
    values: Mapping[str, int],
) -> dict[str, Any]:
    """Return the cells of each key of the chosen scene; a walk is still to be made."""
    found: dict[str, Any] = {}
    for key, value, sketch in sorted(
        _entries(table, chosen, lines), key=lambda each: each[0] == "map"
    ):
        if key == "map":
            drawing = mapped(lattice, sketch)
            both = [part for part in drawing if part in found]
            if both:
                raise sketch.mistake(f"it has {both[0]!r}, which the page also has by itself")
            found |= drawing
        elif key == "goal" and isinstance(value, dict) and value.keys() - {"seed"} == {"walk"}:
            found[key] = value
        else:
            found[key] = cells_of(lattice, value, sketch, values)
    return found


def _entries(
    table: Mapping[str, Any], chosen: str, lines: _Lines
) -> Iterator[tuple[str, Any, Sketch]]:
    """Yield the keys of the chosen scene, with their values and drawings; its own come first."""
    scene = _table(_table(table, "scenes"), chosen) if chosen else {}
    stray = sorted(scene.keys() - set(_SCENE_KEYS))
    if stray:
        raise InputError(
            f"scenes.{chosen}: unknown key {stray[0]!r}, expected one of {', '.join(_SCENE_KEYS)}"
        )
    tops = {key: table[key] for key in _SCENE_KEYS[:4] if key in table}
    walls = {key: value for key, value in _table(table, "lattice").items() if key in _CELLS}
    for header, part in ((f"scenes.{chosen}", scene), ("", tops), ("lattice", walls)):
        for key, value in part.items():
            if part is scene or key not in scene:
                what = f"{header}: {key}" if part is scene else key
                text = value if isinstance(value, str) else ""
                yield key, value, Sketch(text, what, lines.get((header, 0, key), (0, 0)))


def _walk_end(
    system: LatticeSystem, cells: Mapping[str, Any], values: Mapping[str, int]
) -> list[Any]:
    """Return where a random walk from the start leads."""
    from cubepath.protocol.scenes import random_scenes  # noqa: PLC0415 - loads numpy

    walk = converted(cells["goal"], Shape, "goal")
    start = system.modules_among(sites_from_json(cells.get("start", [])))
    steps = number_of(walk.walk, values, "goal: walk")
    length = random_scenes.walk_length({"walk": str(steps)}, max(1, len(start)))
    seed = number_of(walk.seed, values, "goal: seed")
    stream = random_scenes.Stream("walk", seed)
    return [to_json(each) for each in random_scenes.walked(system, start, length or 0, stream)]
