"""The formats of plans that can be read: by name, or detected from a file's content."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.formatting import did_you_mean
from cubepath.protocol.core.input_files import BYTE_ORDER_MARK, InputFile, Source, opened
from cubepath.protocol.core.parsing import Keys, all_values, given_values
from cubepath.protocol.plans.cgshop2021 import looks_like_cgshop2021, read_cgshop2021
from cubepath.protocol.plans.cgshop2026 import looks_like_cgshop2026, read_cgshop2026
from cubepath.protocol.plans.imported import ImportedPath, PlanRequest
from cubepath.protocol.plans.mapf import (
    looks_like_agents,
    looks_like_lists,
    looks_like_log,
    read_agents,
    read_lists,
    read_log,
)
from cubepath.protocol.plans.plain import looks_like_plain, read_plain


@dataclass(frozen=True, slots=True)
class PlanHints:
    """What a user says of a plan: `name` or `name:key=value,...`, and its companion files.

    >>> from pathlib import Path
    >>> _ = Path("rolls.txt").write_text("(0,0) -> (0,1) about (1,0)")
    >>> hints = PlanHints("plain")
    >>> hints.format, shorten("rolls.txt", system="hex:n=3", hints=hints).moves
    ('plain', 1)
    """

    format: str | None = None
    companions: tuple[Path, ...] = ()


NO_HINTS = PlanHints()
_HEAD = 1 << 16
"""Number of bytes that are inspected to detect a format."""
_OURS = re.compile(rb'\s*\{\s*"(generator|at|id|support|trace|before|after)"\s*:')
_INSTANCES = re.compile(rb'"(points_x|targets)"\s*:')


@dataclass(frozen=True, slots=True)
class Format:
    """A format of plans: its keys with their defaults and one line on each, and its reader."""

    name: str
    summary: str
    keys: Keys
    looks_like: Callable[[bytes], bool]
    read: Callable[[PlanRequest], ImportedPath]


_ORDER = "xy for (x, y), rc for (row, column)"
FORMATS: dict[str, Format] = {
    each.name: each
    for each in (
        Format(
            "mapf-log",
            "log of pibt2 or LaCAM, a timestep a line",
            {"order": ("", f"{_ORDER}; xy when left out")},
            looks_like_log,
            read_log,
        ),
        Format(
            "mapf-agents",
            "paths of EECBS or MAPF-LNS2, an agent a line",
            {"order": ("", f"{_ORDER}; what the scenario or map allows when left out")},
            looks_like_agents,
            read_agents,
        ),
        Format(
            "mapf-json",
            "lists of cells as JSON",
            {
                "by": ("agent", "agent for a list for each agent, step for one for each timestep"),
                "order": ("", f"{_ORDER}; xy when left out"),
            },
            looks_like_lists,
            read_lists,
        ),
        Format(
            "cgshop2021",
            "solution of CG:SHOP 2021, coordinated motion planning",
            {},
            lambda head: head.lstrip()[:1] == b"{" and looks_like_cgshop2021(head),
            read_cgshop2021,
        ),
        Format(
            "cgshop2026",
            "solution of CG:SHOP 2026, parallel flips",
            {"triangulation": ("", "number of the triangulation; 0 if it is the only one")},
            lambda head: head.lstrip()[:1] == b"{" and looks_like_cgshop2026(head),
            read_cgshop2026,
        ),
        Format(
            "plain",
            "a list of moves 'SITE -> SITE' of --system",
            {},
            looks_like_plain,
            read_plain,
        ),
    )
}


def read_plan(
    source: Source,
    spec: str | None = None,
    *,
    companions: Sequence[Path | str] = (),
    system: str | None = None,
) -> ImportedPath | None:
    """Read a plan; `spec`, as `name` or `name:key=value,...`, or else its content gives the format.

    None if there is no `spec` and the content has no known format. Raises InputError as
    `ImportedPath` says, and if `spec` is invalid.

    >>> from pathlib import Path
    >>> _ = Path("rolls.txt").write_text("(0,0) -> (0,1) about (1,0)")
    >>> plan = read_plan("rolls.txt", "plain", system="hex:n=3")
    >>> [move.name.generator for move in plan.moves]
    ['pivot-1-right']
    """
    with opened(source) as file:
        told = _looks(file) if spec is None else spec
        if told is None:
            return None
        known, values = _chosen(told)
        return known.read(PlanRequest(file, tuple(map(Path, companions)), values, system))


def _chosen(told: str) -> tuple[Format, dict[str, str]]:
    """Return the format of a spec, and the values of its keys."""
    name, _, rest = told.partition(":")
    known = FORMATS.get(name)
    if known is None:
        near = did_you_mean(name, FORMATS)
        raise InputError(f"unknown format {name!r}{near}, expected one of {', '.join(FORMATS)}")
    given = given_values(rest, known.keys, f"--format {told}")
    return known, all_values(given, known.keys)


def _looks(file: InputFile) -> str | None:
    """Return the name of the format that a file's content suggests, or None.

    Raises InputError for an instance, which has no moves.
    """
    head = file.head(_HEAD).removeprefix(BYTE_ORDER_MARK)
    if _OURS.match(head):
        return None
    if head.lstrip()[:1] == b"{":
        head = file.whole().removeprefix(BYTE_ORDER_MARK)  # keys have no order
    for known in FORMATS.values():
        if known.looks_like(head):
            return known.name
    if head.lstrip()[:1] == b"{" and _INSTANCES.search(head) and b'"goals"' not in head:
        path = file.path
        raise InputError(f"{path}: an instance without moves, expected its solution, --with {path}")
    return None
