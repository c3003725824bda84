"""Converting a path from one form of file to another, and comparing two files.

The input is checked as for shortening. Two files are the same if they hold equal paths, whatever
their forms.
"""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from cubepath.coordinator.shortening.path_input import hints_for_each, read_input, starts_to_compare
from cubepath.coordinator.verification.dependencies import difference
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.input_files import opened
from cubepath.protocol.core.output_files import same_file
from cubepath.protocol.file_forms import NO_HINTS, PlanHints, form_of
from cubepath.protocol.path_files.moves import write_cubes
from cubepath.protocol.path_files.npz import read_cubes_npz, write_moves_npz
from cubepath.protocol.path_files.numbered import Progress
from cubepath.protocol.path_files.path_lines import write_path


@dataclass(frozen=True, slots=True)
class ConversionResult:
    """What was written: "moves" or "cubes", and how many of them.

    `unsolved` is one line on how a plan's end differs from what its instance asks for, or None.
    """

    what: str
    count: int
    unsolved: str | None = None


def convert(
    source: Path | str,
    target: Path | str,
    *,
    system: str | None = None,
    progress: Progress | None = None,
    hints: PlanHints = NO_HINTS,
) -> ConversionResult:
    """Write a path, or the cubes of a binary cubes file, in the form given by the target's name.

    ``.npz`` is the binary form, anything else JSON Lines. Moves named by generator keep their
    names. InputError if the source is neither a path nor binary cubes, is malformed, or if the
    target cannot be written.

    >>> done = convert("logs/golden/hex-5.mcap", "run.jsonl")
    >>> done.what, done.count, shorten("run.jsonl", system="hex:n=5").cubes
    ('moves', 28, 19)
    """
    target = Path(target)
    if same_file(source, target):
        raise InputError(f"{target}: is the input, expected another file")
    binary = target.suffix.lower() == ".npz"
    with opened(source) as file:
        if form_of(file).name == "binary cubes":
            if binary:
                raise InputError(
                    f"{file.path}: holds cubes already as .npz, expected another name than"
                    f" {target} for JSON Lines"
                )
            cubes = read_cubes_npz(file)
            write_cubes(target, cubes)
            return ConversionResult("cubes", len(cubes))
        given = read_input(file, system, hints, progress)
    path = given.numbered
    if binary:
        write_moves_npz(target, path)
    else:
        write_path(target, path)
    return ConversionResult("moves", len(path.numbers), given.unsolved)


def difference_of(
    paths: tuple[Path, Path],
    system: str | None = None,
    hints: PlanHints = NO_HINTS,
    progress: Callable[[int], object] | None = None,
    *,
    homotopic: bool = False,
) -> str | None:
    """Return the first difference between two paths in one line, None if there is none.

    They are equal up to swapping commuting moves, or with `homotopic` have one normal cube path.
    `system` and `hints` are for the one that needs them. Errors are as for `read_input`.
    """
    said = hints_for_each(paths, system, hints)
    one, other = (read_input(path, *each, progress) for path, each in zip(paths, said, strict=True))
    return difference(
        one.actions, other.actions, starts_to_compare(one, other), homotopic=homotopic
    )
