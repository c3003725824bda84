"""The binary form of moves and cubes: a table of actions and numbers into it, as one .npz file.

For each action the table lists the sites of its support, its trace and its two local states, as
numbers into one list of sites; docs/files.md describes each array. Nothing in such a file is code:
it is read without pickles, and its contents are checked before use.
"""

import struct
import zipfile
import zlib
from collections.abc import Callable, Collection, Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import msgspec
import numpy as np
from numpy.typing import NDArray

from cubepath.protocol.core.actions import Action
from cubepath.protocol.core.catalogue import GeneratorPlacement
from cubepath.protocol.core.errors import InputError, errors_at
from cubepath.protocol.core.input_files import InputFile, Source, opened
from cubepath.protocol.core.output_files import written_whole
from cubepath.protocol.core.sites import Site, site_from_json, site_hook
from cubepath.protocol.path_files.moves import NAME, CubeName, MoveName, named_action
from cubepath.protocol.path_files.numbered import NumberedCubes, NumberedPath
from cubepath.protocol.path_files.supports import (
    FIRST,
    FREE,
    SECOND,
    TRACE,
    GrowingRows,
    Supports,
    TabledActions,
)

Numbers = NDArray[np.int32]
Totals = NDArray[np.int64]
Listed = tuple[Totals, Totals]
"""Lists one after the other: where each starts, with the end of the last, and what is in them."""
_encode = msgspec.json.Encoder().encode


class StoredActions(NamedTuple):
    """The actions of a path as a file lists them: its sites, and the lists of each part by name.

    Each part is as in the file: where the list of each action starts, and the numbers of its sites.
    """

    sites: list[Site]
    parts: dict[str, tuple[Numbers, Numbers]]


def table_of(supports: Supports, names: Sequence[MoveName]) -> StoredActions:
    """Return the table of actions with these names, each list in canonical order.

    Sites are numbered in the order of the supports. The site that stands for an id is left out, and
    so are the local states of the actions that have one, since they mean nothing.
    """
    starts = supports.rows.starts
    places = supports.places_in_order
    row = np.repeat(np.arange(len(names)), np.diff(starts))
    stated = supports.rows.stated[row]
    shown = stated | (supports.rows.sites[places] != standing_for(supports, names)[row])
    row, places, stated = row[shown], places[shown], stated[shown]
    met, first = np.unique(supports.rows.sites[places], return_index=True)
    met = met[np.argsort(first)]
    number = np.zeros(len(supports.sites), dtype=np.int32)
    number[met] = np.arange(len(met))
    sites, says = number[supports.rows.sites[places]], supports.rows.says[places]
    parts: dict[str, tuple[Numbers, Numbers]] = {}
    for part, chosen in (
        ("support", np.ones(len(sites), dtype=np.bool_)),
        ("trace", says & TRACE != 0),
        ("before", stated & (says & FIRST != 0)),
        ("after", stated & (says & SECOND != 0)),
        ("free", says & FREE != 0),
    ):
        ends = np.cumsum(np.bincount(row[chosen], minlength=len(names)), dtype=np.int32)
        parts[part] = np.concatenate([_ZERO, ends]), sites[chosen]
    parts["guard"] = 2 * supports.rows.guard_starts, number[_guards_in_order(supports)].ravel()
    return StoredActions([supports.sites[site] for site in met.tolist()], parts)


_ZERO = np.zeros(1, dtype=np.int32)


def standing_for(supports: Supports, names: Sequence[MoveName]) -> Totals:
    """Return for each action the number of the site that stands for its id, -1 if none does."""
    found = np.full(len(names), -1, dtype=np.int64)
    unstated = np.flatnonzero(~supports.rows.stated).tolist()
    if unstated:
        number = {site: place for place, site in enumerate(supports.sites)}
        found[unstated] = [number.get((NAME, names[place]), -1) for place in unstated]
    return found


def _guards_in_order(supports: Supports) -> Numbers:
    guards, starts = supports.rows.guards, supports.rows.guard_starts
    if not len(guards):
        return guards
    rank = supports.order[guards]
    row = np.repeat(np.arange(len(starts) - 1), np.diff(starts))
    return guards[np.lexsort((rank[:, 1], rank[:, 0], row))]


def actions_of(
    sites: list[Site], parts: Mapping[str, Listed], names: Sequence[MoveName], stated: list[bool]
) -> tuple[TabledActions, NDArray[np.bool_]] | None:
    """Return the actions of a table without building one; None if that takes a closer look.

    With them comes for each whether its `before` is its second local state.
    `parts` are the lists of `support`, `trace`, `before` and `after`. A closer look is needed for
    what is no action, for one action twice, and for some sites that stand for ids.
    """
    if any(isinstance(site, tuple) and site[:1] == (NAME,) for site in sites):
        return None
    rows, everything = GrowingRows(), list(sites)
    lists = [_rows(range(len(sites)), parts[part]) for part in _BARE]
    for place, (support, trace, before, after) in enumerate(zip(*lists, strict=True)):
        if not stated[place]:
            if before or after or not trace or isinstance(names[place], GeneratorPlacement):
                return None
            for sites_of in (support, trace, after):
                sites_of.append(len(everything))
            everything.append((NAME, names[place]))
        if rows.add(support, trace, before, after) != (place, 0):
            return None
    if len(everything) > len(set(everything)):
        return None
    supports, turned = rows.supports(everything, stated)
    return TabledActions(supports, lambda number: _encode(names[number]).decode()), turned


_BARE = ("support", "trace", "before", "after")
_MOVES = "cubepath-moves-1"
_CUBES = "cubepath-cubes-1"
_T = TypeVar("_T")
_names = msgspec.json.Decoder(list[str | int | GeneratorPlacement], dec_hook=site_hook).decode
_values = msgspec.json.Decoder(list[Any]).decode
Arrays = Mapping[str, NDArray[Any]]


def write_moves_npz(target: Path, path: NumberedPath) -> None:
    """Write a path; the file is complete or unchanged. InputError if it cannot be written."""
    _write(target, _path_arrays(_MOVES, path))


def write_cubes_npz(target: Path, path: NumberedPath, cubes: NumberedCubes) -> None:
    """Write the cubes of a path, with the moves that remain; as `write_moves_npz`."""
    left = NumberedPath(
        path.actions,
        path.action_names,
        path.stated,
        path.numbers[cubes.moves],
        # In a cube a move is not always made from the same local state as in the path.
        np.full(len(cubes.moves), -1, dtype=np.int8),
        None if path.names is None else [path.names[move] for move in cubes.moves.tolist()],
        path.supports,
    )
    places = {"cube_starts": cubes.starts, "places": cubes.moves}
    _write(target, {**_path_arrays(_CUBES, left), **places})


def read_moves_npz(source: Source) -> NumberedPath:
    """Return the path in a file; whether its moves are admissible is not checked.

    Raises InputError, as ``FILE: ARRAY: what was found, what was expected``, if the file is damaged
    or its arrays do not fit together.
    """
    with opened(source) as file:
        arrays = _read(file, _MOVES)
    with errors_at(str(file.path)):
        return _path(arrays)


def read_cubes_npz(source: Source) -> tuple[tuple[CubeName, ...], ...]:
    """Return the cubes in a file as the names of their moves; errors as in `read_moves_npz`."""
    with opened(source) as file:
        arrays = _read(file, _CUBES)
    with errors_at(str(file.path)):
        path = _path(arrays)
        starts = _starts(arrays, "cube_starts", len(path.numbers), least=1).tolist()
        count = len(path.numbers)
        places = _integers(arrays, "places", 0, 1 << 62, size=count).astype(np.int64)
        names = path.cube_names(np.arange(count), places)
        return tuple(tuple(names[begin:end]) for begin, end in pairwise(starts))


def holds_cubes(source: Source) -> bool:
    """Return whether a file has cubes rather than moves; InputError if it does not say."""
    with opened(source) as file:
        return _format(file, _load(file, ["format"])) == _CUBES


def _path_arrays(form: str, path: NumberedPath) -> dict[str, NDArray[Any]]:
    table = table_of(path.supports, path.action_names)
    arrays: dict[str, NDArray[Any]] = {
        "format": np.array(form),
        "sites": _json(table.sites),
        "names": _json(path.action_names),
    }
    for part, (starts, sites) in table.parts.items():
        if part in {"free", "guard"} and not len(sites):
            continue
        arrays[f"{part}_starts"], arrays[f"{part}_sites"] = starts, sites
    if not all(path.stated):
        arrays["stated"] = np.array(path.stated, dtype=np.bool_)
    arrays["moves"] = path.numbers
    if (path.ends >= 0).any():
        arrays["ends"] = path.ends
    if path.names is not None and any(
        name != path.action_names[number]
        for name, number in zip(path.names, path.numbers.tolist(), strict=True)
    ):
        arrays["move_names"] = _json(path.names)
    return arrays


def _json(value: object) -> NDArray[np.uint8]:
    return np.frombuffer(_encode(value), dtype=np.uint8)


def _write(target: Path, arrays: Arrays) -> None:
    with written_whole(target) as stream:
        np.savez(stream, allow_pickle=False, **arrays)


def _load(file: InputFile, only: Collection[str] | None = None) -> Arrays:
    """Return the arrays of a file, or only those with these names, if present."""
    try:
        with np.load(file.from_start(), allow_pickle=False) as found:
            return {name: found[name] for name in found.files if only is None or name in only}
    except OSError as error:
        raise InputError(f"{file.path}: {error.strerror or error}") from None
    except (ValueError, EOFError, KeyError, zipfile.BadZipFile, zlib.error, struct.error) as error:
        raise InputError(f"{file.path}: damaged, or no .npz file: {error}") from None


def _read(file: InputFile, form: str) -> Arrays:
    arrays = _load(file)
    found = _format(file, arrays)
    if found != form:
        raise InputError(f"{file.path}: format: found {found!r}, expected {form!r}")
    return arrays


def _format(file: InputFile, arrays: Arrays) -> str:
    found = arrays.get("format")
    if found is None or found.ndim or found.dtype.kind != "U":
        raise InputError(f"{file.path}: no array 'format' with a text, expected a file of cubepath")
    return str(found)


def _path(arrays: Arrays) -> NumberedPath:
    sites = [site_from_json(value) for value in _decoded(arrays, "sites", _values)]
    if len(set(sites)) != len(sites):
        raise InputError("sites: a site is there twice, expected each once")
    names = _decoded(arrays, "names", _names)
    count = len(names)
    stated = _flags(arrays, count)
    lists = {
        part: _lists(arrays, part, len(sites), count, optional=part in {"free", "guard"})
        for part in ("support", "trace", "before", "after", "free", "guard")
    }
    bare = not any(len(lists[part][1]) for part in ("free", "guard"))
    tabled = actions_of(sites, lists, names, stated) if bare else None
    actions, turned = _one_by_one(sites, lists, names, stated) if tabled is None else tabled
    numbers = _integers(arrays, "moves", 0, count)
    ends = np.full(len(numbers), -1, dtype=np.int8)
    if "ends" in arrays:
        ends = _integers(arrays, "ends", -1, 2, size=len(numbers)).astype(np.int8)
        # The file counts from `before`; an action has its local states in its own order.
        ends = np.where(ends >= 0, ends ^ turned[numbers], ends)
    given = None
    if "move_names" in arrays:
        given = _decoded(arrays, "move_names", _names)
        if len(given) != len(numbers):
            raise InputError(f"move_names: found {len(given)}, expected {len(numbers)}")
    table = actions.supports if isinstance(actions, TabledActions) else None
    return NumberedPath(actions, names, stated, numbers.astype(np.int32), ends, given, table)


def _one_by_one(
    sites: Sequence[Site],
    lists: Mapping[str, Listed],
    names: Sequence[MoveName],
    stated: Sequence[bool],
) -> tuple[Sequence[Action], NDArray[np.bool_]]:
    """Return the actions, and for each whether its `before` is its second local state."""
    rows = {part: _rows(sites, found) for part, found in lists.items()}
    actions = [
        _action(number, name, stated[number], {part: rows[part][number] for part in rows})
        for number, name in enumerate(names)
    ]
    if len(set(actions)) != len(actions):
        raise InputError("actions: two are equal, expected each once")
    turned = [
        told and action.ends[0] != frozenset(before)
        for action, told, before in zip(actions, stated, rows["before"], strict=True)
    ]
    return actions, np.array(turned, dtype=np.bool_)


def _action(number: int, name: MoveName, stated: bool, parts: dict[str, list[Site]]) -> Action:  # noqa: FBT001 - a flag of the file
    guards = parts["guard"]
    wrong = ""
    if not parts["trace"]:
        wrong = "the trace is empty, a move changes something"
    elif len(guards) % 2:
        wrong = f"guards of {len(guards)} sites, expected pairs"
    elif not stated and isinstance(name, GeneratorPlacement):
        wrong = "a generator and no local states, expected an id"
    if wrong:
        raise InputError(f"action {number}: {wrong}")
    try:
        if not stated and not isinstance(name, GeneratorPlacement):
            return named_action(name, parts["support"], parts["trace"])
        return Action(
            parts["support"],
            parts["trace"],
            parts["before"],
            parts["after"],
            free=parts["free"],
            guards=zip(guards[::2], guards[1::2], strict=True),
            label=_encode(name).decode(),
        )
    except InputError as error:
        raise InputError(f"action {number}: {error}") from None


def _flags(arrays: Arrays, count: int) -> list[bool]:
    if "stated" not in arrays:
        return [True] * count
    found = arrays["stated"]
    if found.shape != (count,) or found.dtype != np.bool_:
        raise InputError(f"stated: found {_kind(found)}, expected {count} booleans")
    return [bool(each) for each in found]


def _lists(arrays: Arrays, part: str, sites: int, count: int, *, optional: bool) -> Listed:
    if optional and f"{part}_starts" not in arrays:
        return np.zeros(count + 1, dtype=np.int64), np.zeros(0, dtype=np.int64)
    numbers = _integers(arrays, f"{part}_sites", 0, sites)
    return _starts(arrays, f"{part}_starts", len(numbers), size=count + 1), numbers


def _rows(sites: Sequence[_T], lists: Listed) -> list[list[_T]]:
    starts, numbers = lists
    found = [sites[number] for number in numbers.tolist()]
    return [found[begin:end] for begin, end in pairwise(starts.tolist())]


def _starts(
    arrays: Arrays, name: str, total: int, *, size: int | None = None, least: int = 0
) -> NDArray[np.int64]:
    found = _integers(arrays, name, 0, total + 1, size=size)
    if not len(found) or found[0] != 0 or found[-1] != total or (np.diff(found) < least).any():
        raise InputError(f"{name}: expected numbers that rise from 0 to {total}")
    return found


def _integers(
    arrays: Arrays, name: str, low: int, stop: int, *, size: int | None = None
) -> NDArray[np.int64]:
    found = arrays.get(name)
    if found is None:
        raise InputError(f"no array {name!r}, expected one of integers")
    if found.ndim != 1 or found.dtype.kind not in "iu" or size not in {None, len(found)}:
        expected = "integers" if size is None else f"{size} integers"
        raise InputError(f"{name}: found {_kind(found)}, expected {expected}")
    wrong = np.flatnonzero((found < low) | (found >= stop))
    if len(wrong):
        where = int(wrong[0])
        raise InputError(f"{name}[{where}]: found {found[where]}, expected {low} to {stop - 1}")
    return found.astype(np.int64)


def _kind(found: NDArray[Any]) -> str:
    return f"an array of shape {found.shape} and type {found.dtype}"


def _decoded(arrays: Arrays, name: str, decode: Callable[[bytes], list[_T]]) -> list[_T]:
    found = arrays.get(name)
    if found is None or found.ndim != 1 or found.dtype != np.uint8:
        what = "no such array" if found is None else _kind(found)
        raise InputError(f"{name}: {what}, expected JSON text as bytes (uint8)")
    try:
        return decode(found.tobytes())
    except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError) as error:
        raise InputError(f"{name}: {error}, expected a JSON list") from None
