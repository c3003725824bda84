"""The command that draws: ``cubepath view``."""

from __future__ import annotations

import argparse
from pathlib import Path

from cubepath.coordinator.commands.complexes import AddCommand
from cubepath.coordinator.commands.console import DONE, answer, complain, progress_bar
from cubepath.protocol.core.errors import InputError


def add_view_command(command: AddCommand) -> None:
    """Add the command and its options."""
    view = command("view", _view, "draw a recording: states of the run, and its schedule")
    view.add_argument("log", type=Path, metavar="LOG")
    view.add_argument(
        "-o",
        "--output",
        type=Path,
        metavar="PICTURE",
        help="file to write: .png, .svg, .pdf, or .gif for a film (default: LOG with .png)",
    )
    view.add_argument(
        "--what",
        choices=("run", "schedule"),
        default="run",
        help="whose states to show: those of the run (default), or of the schedule, cube by cube",
    )
    view.add_argument(
        "--fps",
        type=float,
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
        check_frame_rate,
    )
    from cubepath.coordinator.runs.gatherer import gathered  # noqa: PLC0415
    from cubepath.protocol.recordings.recording import read_recording  # noqa: PLC0415

    path: Path = options.output or options.log.with_suffix(".png")
    film = path.suffix.lower() in FILM_SUFFIXES
    if not film and path.suffix.lower() not in PICTURE_SUFFIXES:
        known = ", ".join((*PICTURE_SUFFIXES, *FILM_SUFFIXES))
        raise InputError(f"{path}: expected a name that ends in one of {known}")
    if options.fps is not None:
        if not film:
            raise InputError(f"{path}: a picture, expected --fps with a film (.gif) alone")
        check_frame_rate(options.fps)
    recording = read_recording(options.log)
    for problem in recording.problems:
        complain(f"{options.log}: {problem}; drawing what could be read")
    gatherer = gathered(recording)
    rounds = [step.actions for step in gatherer.steps]
    if film:
        as_run = options.what == "run"
        with progress_bar(None, "film", " frames") as bar:

            def progress(done: int, total: int) -> None:
                bar.total = total
                bar.update(done - bar.n)

            animate(
                recording.scene,
                rounds if as_run else gatherer.heap.cube_path(),
                path,
                step_name="round" if as_run else "cube",
                frames_per_second=options.fps or FRAMES_PER_SECOND,
                progress=progress,
            )
    else:
        heap = gatherer.heap
        found = heap.normal_form()
        run_picture(recording.scene, rounds, heap.cube_path(), path, found=found, what=options.what)
    answer(options, {"log": str(options.log), "picture": str(path)}, f"written to {path}")
    return DONE
