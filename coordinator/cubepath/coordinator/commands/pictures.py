"""The command that draws: ``cubepath view``."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from cubepath.coordinator.commands.console import answer, complain
from cubepath.coordinator.commands.files import Output, check_files, input_path, output_path
from cubepath.coordinator.commands.plan_options import (
    INPUT_HELP,
    add_plan_options,
    hints,
    solved,
)
from cubepath.coordinator.commands.progress import progress_bar
from cubepath.coordinator.commands.usage import AddCommand, number
from cubepath.protocol.core.control_characters import visible
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.input_files import STANDARD_INPUT, InputFile, opened

if TYPE_CHECKING:  # a command starts faster without them
    from cubepath.coordinator.normal_form.array_heap import NormalForm
    from cubepath.protocol.core.actions import Action
    from cubepath.protocol.core.system import Scene


def add_view_command(command: AddCommand) -> None:
    """Add the command and its options."""
    view = command("view", _view, "draw a run or another path: some states, and its schedule")
    view.add_argument("input", type=input_path, metavar="INPUT", help=f"{INPUT_HELP}; or cubes")
    view.add_argument(
        "-o",
        "--output",
        type=output_path,
        metavar="PICTURE",
        help="file to write: .png, .svg, .pdf, or .gif for a film (default: INPUT with .png)",
    )
    view.add_argument(
        "--system", metavar="SYSTEM", help="the system that the moves or cubes of a file are of"
    )
    add_plan_options(view)
    view.add_argument(
        "--what",
        choices=("run", "schedule"),
        default="run",
        help="whose states to show: those of the run, or of the moves or cubes as given (default);"
        " or of the normal cube path",
    )
    view.add_argument(
        "--fps",
        type=number("a number from 0.01 to 50", lambda rate: 0.01 <= rate <= 50),
        metavar="N",
        help="frames a second of a film, 0.01 to 50 (default 4)",
    )


def _view(options: argparse.Namespace) -> int:
    from cubepath.coordinator.runs.drawing import (  # noqa: PLC0415 - only what a command needs
        PICTURE_SUFFIXES,
        run_picture,
    )
    from cubepath.coordinator.runs.films import (  # noqa: PLC0415
        FILM_SUFFIXES,
        FRAMES_PER_SECOND,
        animate,
    )

    if options.output is None and options.input == STANDARD_INPUT:
        raise InputError("standard input: has no name for a picture, expected -o PICTURE")
    path: Path = options.output or options.input.with_suffix(".png")
    film = path.suffix.lower() in FILM_SUFFIXES
    check_files(options, [options.input], Output(path, (*PICTURE_SUFFIXES, *FILM_SUFFIXES)))
    if options.fps is not None and not film:
        raise InputError(f"{path}: a picture, expected --fps with a film (.gif) alone")
    with opened(options.input) as file:
        drawn = (_recorded if _is_recording(file) else _from_file)(options, file)
    if film:
        as_given = options.what == "run"
        with progress_bar(None, "film", " frames") as bar:

            def progress(done: int, total: int) -> None:
                bar.total = total
                bar.update(done - bar.n)

            animate(
                drawn.scene,
                drawn.steps if as_given else drawn.schedule()[0],
                path,
                step_name=drawn.step_name if as_given else "cube",
                frames_per_second=options.fps or FRAMES_PER_SECOND,
                progress=progress,
            )
    else:
        cubes, found = drawn.schedule()
        with progress_bar(None, "draw", ""):
            run_picture(
                drawn.scene,
                drawn.steps,
                cubes,
                path,
                found=found,
                step_name=drawn.step_name,
                what=options.what,
            )
    document = {"log": str(drawn.source), "picture": str(path)}
    answer(options, document, f"written to {visible(str(path))}")
    return solved(options, drawn.unsolved)


class _Drawn(NamedTuple):
    """The input of a drawing; the schedule is computed when it is asked for."""

    source: Path
    scene: Scene
    step_name: str
    steps: Sequence[Sequence[Action]]
    schedule: Callable[[], tuple[Sequence[Sequence[Action]], NormalForm]]
    unsolved: str | None = None


def _is_recording(file: InputFile) -> bool:
    from cubepath.protocol.recordings.recording import is_recording  # noqa: PLC0415

    # A recording that has lost its first bytes is still refused as a recording, by its name.
    return is_recording(file) or file.path.suffix.lower() == ".mcap"


def _recorded(options: argparse.Namespace, file: InputFile) -> _Drawn:
    from cubepath.coordinator.runs.gathering import gathered  # noqa: PLC0415
    from cubepath.protocol.recordings.recording import read_recording  # noqa: PLC0415

    if options.system is not None or options.format is not None or options.companions:
        raise InputError(
            f"{file.path}: a recording, which says itself what its system is: expected no --system,"
            " --format or --with"
        )
    with progress_bar(None, "read", ""):
        recording = read_recording(file)
    for problem in recording.problems:
        complain(f"{file.path}: {problem}; drawing what could be read")
    gatherer = gathered(recording)
    steps = [step.actions for step in gatherer.steps]
    return _Drawn(
        file.path,
        recording.scene,
        "level" if recording.clock == "free" else "round",
        steps,
        lambda: (gatherer.heap.cube_path(), gatherer.heap.normal_form()),
    )


def _from_file(options: argparse.Namespace, file: InputFile) -> _Drawn:
    from cubepath.coordinator.shortening.path_steps import read_steps  # noqa: PLC0415

    with progress_bar(None, "view", " moves") as bar:
        found = read_steps(file, options.system, hints(options), bar.update)
    return _Drawn(
        file.path,
        found.scene,
        found.step_name,
        found.steps,
        lambda: (found.cubes, found.normal_form),
        found.unsolved,
    )
