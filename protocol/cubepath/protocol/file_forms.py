"""The forms of files: one table of how each is recognised, and of what reads it.

The first bytes or keys of a file decide its form, else its name; any other file is a moves file.
The code that reads a form is imported when a file of that form is read.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec

from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.formatting import did_you_mean
from cubepath.protocol.core.input_files import BYTE_ORDER_MARK, InputFile, Source, opened
from cubepath.protocol.core.parsing import Keys, all_values, given_values

if TYPE_CHECKING:
    from cubepath.protocol.plans.imported import ImportedPath

_HEAD = 1 << 16
"""Number of bytes that are inspected."""
_MCAP = b"\x89MCAP0\r\n"
_ZIP = b"PK\x03\x04"
_MOVE = re.compile(rb'\s*\{\s*"(generator|at|id|support|trace|before|after)"\s*:')
_MOVES = re.compile(rb'\s*\{\s*"moves"\s*:')
_STARTS = re.compile(rb'"starts"\s*:')
_CERTIFICATE = re.compile(rb'"format"\s*:\s*"cubepath-certificate-1"')
_LISTS = re.compile(rb"\s*\[\s*(\[|\]\s*$)")
_SOLUTION = re.compile(rb"^solution=", re.MULTILINE)
_INSTANCE = re.compile(rb'"(points_x|targets)"\s*:')
_NOT_EMPTY = {".json": "JSON", ".mcap": "an MCAP recording", ".npz": "arrays of numpy"}
"""What files with these suffixes hold, which are never empty."""


class _Beginning:
    """The beginning of a file, and as much more of it as a form has to see."""

    def __init__(self, file: InputFile) -> None:
        self.file = file
        self.head = file.head(_HEAD).removeprefix(BYTE_ORDER_MARK)
        self.is_object = self.head.lstrip()[:1] == b"{"

    @cached_property
    def text(self) -> bytes:
        """The head; of an object all of it, since keys have no order."""
        return self.file.whole().removeprefix(BYTE_ORDER_MARK) if self.is_object else self.head

    @cached_property
    def line(self) -> bytes:
        """The first line that is not blank."""
        return next((line for _, line in self.file.numbered_lines()), b"")

    @cached_property
    def keys(self) -> set[str] | None:
        """The keys of the object on the first line, None if the line is no object."""
        try:
            found = msgspec.json.decode(self.line)
        except (msgspec.DecodeError, UnicodeDecodeError, RecursionError):
            return None
        return set(found) if isinstance(found, dict) else None

    @property
    def has_starts(self) -> bool:
        """Whether this is an object with "starts", on one line or on many."""
        if _STARTS.search(self.line):
            return True
        # An object over several lines is no moves file, but may be a scenario.
        return self.is_object and self.keys is None and _STARTS.search(self.text) is not None


@dataclass(frozen=True, slots=True)
class FileForm:
    """A form of files.

    `what` names such a file in messages, and `recognised` tells whether a file is one. `reader` is
    the function that reads it, as MODULE:NAME. A file with this `suffix` and no known content
    counts as this form, so that its reader says what is wrong. `unfit` says of a file that is no
    path what is expected instead. The reader of a `plan` takes a `PlanRequest`; `keys` are what
    ``--format`` may say of such a plan.
    """

    name: str
    what: str
    recognised: Callable[[_Beginning], bool]
    reader: str
    suffix: str = ""
    unfit: str = ""
    plan: bool = False
    keys: Keys = field(default_factory=dict[str, tuple[str, str]])

    def holds(self, file: InputFile) -> bool:
        """Return whether the content of a file is of this form."""
        return self.recognised(_Beginning(file))

    def read(self, *arguments: Any) -> Any:
        """Return what the reader of this form returns."""
        return _loaded(self.reader)(*arguments)

    def check_path(self, path: Path) -> None:
        """Raise InputError if a file of this form holds no path."""
        if self.unfit:
            raise InputError(f"{path}: {self.what}{self.unfit}")


def form_of(source: Source) -> FileForm:
    """Return the form of a file; InputError if it cannot be read, or is empty and should not be.

    >>> form_of("logs/golden/hex-5.mcap").name
    'recording'
    """
    with opened(source) as file:
        given, suffix = _Beginning(file), file.path.suffix.lower()
        if suffix in _NOT_EMPTY and not given.head:
            raise InputError(f"{file.path}: empty file, expected {_NOT_EMPTY[suffix]}")
        for form in FORMS.values():
            if form.recognised(given):
                return form
    named = (form for form in FORMS.values() if form.suffix and form.suffix == suffix)
    return next(named, FORMS["moves"])


@dataclass(frozen=True, slots=True)
class PlanHints:
    """What a user says of a plan: `name` or `name:key=value,...`, and its companion files."""

    format: str | None = None
    companions: tuple[Path, ...] = ()


NO_HINTS = PlanHints()


def read_plan(
    source: Source,
    spec: str | None = None,
    *,
    companions: Sequence[Path | str] = (),
    system: str | None = None,
) -> ImportedPath:
    """Read a plan; `spec`, as `name` or `name:key=value,...`, or else its content gives the format.

    Raises InputError as `ImportedPath` says, if `spec` is invalid, and if there is no `spec` and
    the content is no plan.

    >>> from pathlib import Path
    >>> _ = Path("rolls.txt").write_text("(0,0) -> (0,1) about (1,0)")
    >>> plan = read_plan("rolls.txt", "plain", system="hex:n=3")
    >>> [move.name.generator for move in plan.moves]
    ['pivot-1-right']
    """
    from cubepath.protocol.plans.imported import PlanRequest  # noqa: PLC0415 - as its reader

    with opened(source) as file:
        form, values = _chosen(file, spec)
        found: ImportedPath = form.read(
            PlanRequest(file, tuple(map(Path, companions)), values, system)
        )
        return found


def _chosen(file: InputFile, spec: str | None) -> tuple[FileForm, dict[str, str]]:
    """Return the form of a plan, and the values of its keys."""
    if spec is None:
        form = form_of(file)
        if not form.plan:
            raise InputError(f"{file.path}: {form.what}{form.unfit or ', expected a plan'}")
        return form, all_values({}, form.keys)
    name, _, rest = spec.partition(":")
    plans = [form.name for form in FORMS.values() if form.plan]
    if name not in plans:
        near = did_you_mean(name, plans)
        raise InputError(f"unknown format {name!r}{near}, expected one of {', '.join(plans)}")
    form = FORMS[name]
    return form, all_values(given_values(rest, form.keys, f"--format {spec}"), form.keys)


def _loaded(place: str) -> Any:
    """Return a function of the protocol, as MODULE:NAME."""
    module, _, name = place.partition(":")
    return getattr(import_module(f"{__package__}.{module}"), name)


def _first_bytes(magic: bytes) -> Callable[[_Beginning], bool]:
    return lambda given: given.head.startswith(magic)


def _first_text(pattern: bytes) -> Callable[[_Beginning], bool]:
    found = re.compile(pattern)
    return lambda given: found.match(given.head) is not None


def _object_with(*keys: bytes) -> Callable[[_Beginning], bool]:
    return lambda given: given.is_object and all(b'"%b"' % key in given.text for key in keys)


def _is_recording(given: _Beginning) -> bool:
    """Return whether a file begins like a recording, or is cut off within its first bytes."""
    return bool(given.head) and _MCAP.startswith(given.head[: len(_MCAP)])


def _is_binary_cubes(given: _Beginning) -> bool:
    return given.head.startswith(_ZIP) and bool(_loaded("path_files.npz:holds_cubes")(given.file))


def _is_certificate(given: _Beginning) -> bool:
    # A moves file may be too large to be looked through for that.
    text = given.text if given.file.path.suffix.lower() == ".json" else given.head
    return given.is_object and _CERTIFICATE.search(text) is not None


def _is_move(given: _Beginning) -> bool:
    return _MOVE.match(given.head) is not None and not given.has_starts


def _is_cubes(given: _Beginning) -> bool:
    return _MOVES.match(given.head) is not None and given.keys == {"moves"}


def _is_list(given: _Beginning) -> bool:
    """Return whether a text begins like a list of lists, or is an empty list."""
    return _LISTS.match(given.head) is not None and b"->" not in given.head


def _is_plain(given: _Beginning) -> bool:
    """Return whether the first line that is not a comment has an arrow between two sites."""
    for line in given.head.splitlines():
        words = line.partition(b"#")[0].strip()
        if words:
            return b"->" in words and not words.startswith(b"{") and b":" not in words
    return False


def _is_instance(given: _Beginning) -> bool:
    return (
        given.is_object
        and _INSTANCE.search(given.text) is not None
        and b'"goals"' not in given.text
    )


_OF_A_PATH = ", expected the path that it is of"
_PROVED = ", expected a path; 'cubepath verify' checks proofs"
_ORDER = "xy for (x, y), rc for (row, column)"
FORMS = {
    form.name: form
    for form in (
        FileForm(
            "recording",
            "a recording",
            _is_recording,
            "recordings.recording:read_undamaged",
            ".mcap",
        ),
        FileForm(
            "binary cubes",
            "a cubes file",
            _is_binary_cubes,
            "path_files.npz:read_cubes_npz",
            unfit=_OF_A_PATH,
        ),
        FileForm(
            "binary moves",
            "a binary moves file",
            _first_bytes(_ZIP),
            "path_files.npz:read_moves_npz",
            ".npz",
        ),
        FileForm(
            "following timetable",
            "a timetable of vehicles that follow one another",
            _first_text(rb'\s*\{"format":[^\n]*"cubepath-following-1"'),
            "path_files.following:read_following",
            unfit=", whose moves do not commute: expected the path that it is of",
        ),
        FileForm(
            "proof",
            "a proof of optimality",
            _first_bytes(b"cubepath proof 1\n"),
            "path_files.optimality_proofs:read_proof",
            ".proof",
            _PROVED,
        ),
        FileForm(
            "following proof",
            "a proof of optimality",
            _first_bytes(b"cubepath following proof 1\n"),
            "path_files.following:read_following_proof",
            unfit=_PROVED,
        ),
        FileForm(
            "certificate",
            "a certificate",
            _is_certificate,
            "path_files.certificates:read_certificate",
            unfit=_OF_A_PATH,
        ),
        FileForm("moves", "a moves file", _is_move, "path_files.moves:read_moves"),
        FileForm(
            "cubes", "a cubes file", _is_cubes, "path_files.moves:read_cubes", unfit=_OF_A_PATH
        ),
        FileForm(
            "mapf-log",
            "a log of pibt2 or LaCAM",
            lambda given: _SOLUTION.search(given.head) is not None,
            "plans.mapf:read_log",
            plan=True,
            keys={"order": ("", f"{_ORDER}; xy when left out")},
        ),
        FileForm(
            "mapf-agents",
            "paths of EECBS or MAPF-LNS2",
            _first_text(rb"\s*[Aa]gent\s+[0-9]+\s*:"),
            "plans.mapf:read_agents",
            plan=True,
            keys={"order": ("", f"{_ORDER}; what the scenario or map allows when left out")},
        ),
        FileForm(
            "mapf-json",
            "lists of cells",
            _is_list,
            "plans.mapf:read_lists",
            plan=True,
            keys={
                "by": ("agent", "agent for a list for each agent, step for one for each timestep"),
                "order": ("", f"{_ORDER}; xy when left out"),
            },
        ),
        FileForm(
            "cgshop2021",
            "a solution of CG:SHOP 2021",
            _object_with(b"steps", b"instance"),
            "plans.cgshop2021:read_cgshop2021",
            plan=True,
        ),
        FileForm(
            "cgshop2026",
            "a solution of CG:SHOP 2026",
            _object_with(b"flips", b"instance_uid"),
            "plans.cgshop2026:read_cgshop2026",
            plan=True,
            keys={"triangulation": ("", "number of the triangulation; 0 if it is the only one")},
        ),
        FileForm(
            "plain",
            "a list of moves 'SITE -> SITE'",
            _is_plain,
            "plans.plain:read_plain",
            plan=True,
        ),
        FileForm(
            "instance",
            "an instance without moves",
            _is_instance,
            "",
            unfit=", expected its solution, and this file as --with",
        ),
        FileForm(
            "scenario",
            "a scenario",
            lambda given: given.has_starts,
            "plans.scenario:read_scenario",
            plan=True,
        ),
    )
}
"""The forms by name, in the order in which they are tried; what is none of them is moves."""
