"""The files that a command names: the meaning of `-`, and that no output overwrites an input.

All checks happen before the work begins, since that may take long.
"""

import argparse
import os
from collections.abc import Generator, Iterable, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.input_files import STANDARD_INPUT, Source, opened
from cubepath.protocol.core.output_files import STANDARD_OUTPUT, check_output, is_special, same_file
from cubepath.protocol.file_forms import FORMS

PATH_SUFFIXES = (".jsonl", ".npz")
"""The suffixes of files of moves and cubes: JSON Lines, and the binary form."""


def input_path(text: str) -> Path:
    """Return the path of an input; ``-`` is standard input."""
    return STANDARD_INPUT if text in {"-", "/dev/fd/0", "/proc/self/fd/0"} else _path(text)


def output_path(text: str) -> Path:
    """Return the path of an output; ``-`` is standard output."""
    return STANDARD_OUTPUT if text in {"-", "/dev/fd/1", "/proc/self/fd/1"} else _path(text)


def _path(text: str) -> Path:
    if not text:  # as a path it would be the current folder
        raise argparse.ArgumentTypeError("expected a file, found ''")
    return Path(text)


def add_out(parser: Any, metavar: str, what: str, *, folder: bool = False, **more: Any) -> None:
    """Add ``--out``, which names `what` is written; `more` are arguments of argparse."""
    kind = Path if folder else output_path
    parser.add_argument("-o", "--out", type=kind, metavar=metavar, help=what, **more)


def file_name(path: Path) -> str:
    """Return the name of a file in an answer."""
    return {STANDARD_INPUT: "standard input", STANDARD_OUTPUT: "standard output"}.get(
        path, str(path)
    )


def none_written(path: Path, why: str) -> str:
    """Return why a file was not written, and what is there if something is."""
    return f"none: {why}" + (f"; {file_name(path)} is left as it was" if path.is_file() else "")


@contextmanager
def opened_once(paths: Sequence[Path]) -> Generator[Sequence[Source]]:
    """Yield what to read for files whose first bytes say what they are.

    Standard input or a pipe can be read only once, so it is open for the length of the block where
    it comes alone. Any other file stays a path, for its reader to say what is wrong with it.
    """
    if len(paths) == 1 and (paths[0] == STANDARD_INPUT or is_special(paths[0])):
        with opened(paths[0]) as file:
            yield [file]
    else:
        yield paths


@dataclass(frozen=True, slots=True)
class Output:
    """A file to write: its path, None if none is asked for, and the suffixes that it may have.

    With `stream` it can also be standard output, or a pipe or device of any name.
    """

    path: Path | None
    suffixes: Sequence[str] = ()
    stream: bool = False


def check_files(
    options: argparse.Namespace, inputs: Iterable[Path | None], *outputs: Output
) -> None:
    """Check that no file is both read and written, or written twice; InputError if one is.

    The files of ``--system``, ``--with`` and SYSTEM count as inputs too. Every output must be
    writable, must have a suffix that fits its content, and must not be an existing recording.
    """
    read = [path for path in inputs if path is not None]
    read += getattr(options, "companions", [])
    read += _files_of(getattr(options, "system", None))
    if read.count(STANDARD_INPUT) > 1:
        raise InputError("standard input: named twice, expected one input from there")
    written: list[Path] = []
    for output in outputs:
        path = output.path
        if path is None:
            continue
        if path == STANDARD_OUTPUT:
            _check_stream(options, output)
        if any(same_file(path, other) for other in read):
            raise InputError(f"{path}: is an input, expected another file to write")
        if any(same_file(path, other) for other in written):
            raise InputError(f"{path}: is to be written twice, expected two files")
        written.append(path)
    for output in outputs:
        if output.path is not None:
            check_output(output.path)
            _check_no_recording(output.path)
            _check_suffix(output.path, output)


def _files_of(system: str | None) -> list[Path]:
    """Return the files that a system's name may refer to: itself, and the values of its keys.

    Only the families know which keys name a file; here every value that is an existing path counts.
    """
    if system is None:
        return []
    values = [part.partition("=")[2] for part in system.partition(":")[2].split(",")]
    return [Path(each) for each in (system, *values) if each and os.path.exists(each)]  # noqa: PTH110 - never raises


def _check_suffix(path: Path, output: Output) -> None:
    if output.stream and (path == STANDARD_OUTPUT or is_special(path)):
        return
    if output.suffixes and path.suffix.lower() not in output.suffixes:
        found = f"the suffix {path.suffix}" if path.suffix else "no suffix"
        raise InputError(f"{path}: found {found}, expected one of {', '.join(output.suffixes)}")


def _check_stream(options: argparse.Namespace, output: Output) -> None:
    if not output.stream:
        raise InputError("standard output: takes moves and cubes alone, expected a file to write")
    if options.json:
        raise InputError(
            "--json: standard output has the cubes or moves of '-', expected a file for them or no"
            " --json"
        )


def _check_no_recording(path: Path) -> None:
    if is_special(path) or not path.is_file():
        return
    with opened(path) as file:
        if FORMS["recording"].holds(file):
            raise InputError(f"{path}: is a recording, which is kept: expected another file")
