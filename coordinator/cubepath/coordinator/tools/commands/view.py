"""The command ``cubepath view``: a picture, a film, or a page for a browser."""

from __future__ import annotations

import argparse
import os
import re
from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from itertools import accumulate, chain, pairwise
from operator import add
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

from cubepath.coordinator.commands.console import DONE, answer, complain, progress_bar
from cubepath.coordinator.commands.files import Output, add_out, check_files, input_path
from cubepath.coordinator.commands.path_options import INPUT_HELP, add_plan_options, hints, solved
from cubepath.coordinator.commands.usage import more_options, number
from cubepath.coordinator.progress import StageProgress
from cubepath.coordinator.tools.commands.live import (
    add_connect_options,
    check_no_connect_options,
    watch_elsewhere,
)
from cubepath.protocol.core.errors import CubepathError, InputError
from cubepath.protocol.core.formatting import visible
from cubepath.protocol.core.input_files import STANDARD_INPUT, InputFile, opened
from cubepath.protocol.file_forms import PlanHints, form_of

if TYPE_CHECKING:
    from cubepath.coordinator.runs.drawing import Sheet
    from cubepath.coordinator.shortening.path_steps import PathSteps
    from cubepath.coordinator.tools.viewing.run_view import RunView
    from cubepath.protocol.core.system import Scene

Mark: TypeAlias = tuple[int, str]
"""A step, from 1, and what the time axis says of it."""
_RESULTS = ("cube", "summary")
"""Messages of the coordinator about the whole run, which belong to no round."""


def write_page(drawn: Sequence[PathSteps], path: Path) -> None:
    """Write a page that shows these, with a bar that names the part at work."""
    from cubepath.coordinator.tools.viewing.pages import run_page  # noqa: PLC0415 - only what is needed

    with progress_bar(None, "page", "") as bar:
        names = _names([each.source for each in drawn]) if len(drawn) > 1 else [""]
        marks = [_branches(each) for each in drawn]
        if len(drawn) > 1:
            bar.set_postfix_str("differences")
            marks = list(map(add, marks, _differences(drawn)))
        shown = [
            _shown(each, name, own) for each, name, own in zip(drawn, names, marks, strict=True)
        ]
        run_page(shown, path, progress=bar.set_postfix_str)


def _names(sources: Sequence[Path]) -> list[str]:
    """Return names that tell the inputs apart: short ones if these do."""
    stems = [source.stem for source in sources]
    return stems if len(set(stems)) == len(stems) else [str(source) for source in sources]


def _branches(drawn: PathSteps) -> list[Mark]:
    """Return where a what-if departs from the recording that it continues from."""
    if drawn.recording is None:
        return []
    from cubepath.coordinator.verification.parameters import spans, stages_in  # noqa: PLC0415

    stages = stages_in(drawn.recording)
    everyone = spans(range(len(drawn.scene.start)))
    found: list[Mark] = []
    for before, stage in pairwise(stages):
        rules = [
            rule if modules == everyone else f"{rule} for modules {modules}"
            for rule, modules in stage.rules.items()
        ]
        seed = "" if stage.seed == before.seed else f", seed {stage.seed}"
        found.append((stage.begins, f"what if {' and '.join(rules)}{seed}"))
    return found


def _differences(both: Sequence[PathSteps]) -> list[list[Mark]]:
    """Return for each of two runs where they differ first, as `cubepath diff` finds it."""
    from cubepath.coordinator.tools.comparison.moves import first_other  # noqa: PLC0415
    from cubepath.coordinator.tools.comparison.run_comparison import diff  # noqa: PLC0415

    a, b = (each.recording for each in both)
    if a is None or b is None:
        place = first_other(*(list(chain.from_iterable(each.steps)) for each in both))
        return [_of_move(each, place) for each in both]
    try:
        found = diff(a, b)
    except CubepathError as error:
        complain(f"the differences are not marked: {error}")
        return [[], []]
    if found.clock == "moves":
        place = None if found.move is None else found.move.round - 1
        return [_of_move(each, place) for each in both]
    kinds: dict[tuple[int, int | None], list[str]] = {}
    message = found.message
    if message is not None and message.kind in _RESULTS:
        message = None
    for kind, each in (("choice", found.choice), ("message", message), ("move", found.move)):
        if each is not None:
            kinds.setdefault((each.round, each.module), []).append(kind)
    marks = [
        (
            step,
            f"first difference: {_listed(what)}"
            + ("" if module is None else f" of module {module}"),
        )
        for (step, module), what in kinds.items()
    ]
    return [[mark for mark in marks if mark[0] <= len(each.steps)] for each in both]


def _of_move(drawn: PathSteps, place: int | None) -> list[Mark]:
    """Return the mark of the first move that differs, by its number in the path, from 0."""
    if place is None or place >= sum(map(len, drawn.steps)):
        return []
    step = bisect_right(list(accumulate(map(len, drawn.steps))), place) + 1
    return [(step, "first difference: move")]


def _listed(words: Sequence[str]) -> str:
    return " and ".join(part for part in (", ".join(words[:-1]), words[-1]) if part)


def _shown(drawn: PathSteps, name: str, marks: Sequence[Mark]) -> RunView:
    from cubepath.coordinator.tools.viewing.run_view import RunView  # noqa: PLC0415

    return RunView(
        drawn.scene,
        drawn.steps,
        drawn.cubes,
        drawn.normal_form,
        drawn.step_name,
        name,
        drawn.recording,
        _facts(drawn),
        drawn.chain,
        marks,
    )


def _facts(drawn: PathSteps) -> tuple[tuple[str, str], ...]:
    """Return what the head of a page says: the rule and its seed, and the counts of both paths."""
    cubes = drawn.cubes
    known = {} if drawn.recording is None else drawn.recording.parameters
    facts = [(key, known[key]) for key in ("rule", "seed") if key in known]
    moves, left = sum(map(len, drawn.steps)), sum(map(len, cubes))
    given = [] if drawn.step_name == "move" else [_counted(len(drawn.steps), drawn.step_name)]
    before = ", ".join([*given, _counted(moves, "move")])
    after = f"{_counted(len(cubes), 'cube')}, {_counted(left, 'move')}"
    largest = max(map(len, cubes), default=0)
    facts.append(("", f"{before} \N{RIGHTWARDS ARROW} {after}, largest cube {largest}"))
    if drawn.chain is not None:
        facts.append(
            ("", f"proved: no schedule in the class has fewer than {_counted(len(cubes), 'cube')}")
        )
    return tuple(facts)


def _counted(count: int, what: str) -> str:
    return f"{count:,} {what}" + ("" if count == 1 else "s")


_NUMBERS = re.compile(
    r"\d{1,9}(-\d{1,9}(:[1-9]\d{0,8})?)?(,\d{1,9}(-\d{1,9}(:[1-9]\d{0,8})?)?)*", re.ASCII
)
_NUMBERS_MAX = 1000


def add_view(view: argparse.ArgumentParser) -> None:
    """Add the options of ``view``."""
    view.set_defaults(command=_view)
    view.add_argument(
        "input",
        type=input_path,
        nargs="?",
        metavar="INPUT",
        help=f"{INPUT_HELP}; or cubes, or a certificate with --of; or a system such as hex:n=12 or"
        " FILE.toml, of which start and goal are drawn",
    )
    view.add_argument(
        "other",
        type=input_path,
        nargs="?",
        metavar="OTHER",
        help="another run or path, to show next to the first in a browser (.html)",
    )
    add_out(
        view,
        "PICTURE",
        "file to write: .png, .svg, .pdf, .gif for a film, or .html to play it in a browser"
        " (default: INPUT with .png)",
    )
    view.add_argument(
        "--system", metavar="SYSTEM", help="the system that the moves or cubes of a file are of"
    )
    view.add_argument(
        "--of",
        type=input_path,
        metavar="INPUT",
        help="the path that a certificate is of: it names moves by their numbers there",
    )
    view.add_argument(
        "--what",
        choices=("run", "schedule", "both"),
        default="run",
        help="whose states to show: those of the run, or of the moves or cubes as given (default);"
        " of the normal cube path; or, in a film, both side by side",
    )
    view.add_argument(
        "--rounds",
        type=_numbers,
        dest="states",
        metavar="0,4,10-20:5",
        help="of a picture: the rounds, levels or cubes after which states are shown; 0 is the"
        " start, and A-B:C every C-th of A to B (default: six, evenly spread)",
    )
    view.add_argument("--dark", action="store_true", help="draw on dark ground")
    view.add_argument("--title", help="of a picture: in place of the name of the system")
    more = more_options(view)
    add_connect_options(view, more)
    more.add_argument("--caption", help="of a picture: text below it")
    more.add_argument(
        "--parts",
        choices=("both", "states", "schedule"),
        help="of a picture: the states alone, the schedule alone, or both (default)",
    )
    more.add_argument(
        "--zoom",
        action="store_true",
        default=None,
        help="of a picture: frame each state around its modules, all at one scale (default: where"
        " modules on an endless lattice would be too small to read)",
    )
    more.add_argument(
        "--rate",
        type=number("a number from 0.01 to 50", lambda rate: 0.01 <= rate <= 50),
        metavar="R",
        help="of a film: R rounds, moves or cubes a second, 0.01 to 50 (default 4)",
    )
    add_plan_options(more)


def _numbers(text: str) -> tuple[int, ...]:
    """Return the numbers that a list of numbers and ranges stands for, in its order."""
    if not _NUMBERS.fullmatch(text):
        raise argparse.ArgumentTypeError(
            f"{text!r}: expected numbers and ranges, such as 0,4,10-20 or 0-100:20"
        )
    found: list[int] = []
    for part in text.split(","):
        ends, _, step = part.partition(":")
        first, _, last = ends.partition("-")
        every = range(int(first), int(last or first) + 1, int(step or 1))
        if not every or len(found) + len(every) > _NUMBERS_MAX:
            raise argparse.ArgumentTypeError(
                f"{part!r}: stands for {len(every)} numbers, expected 1 or more, and"
                f" {_NUMBERS_MAX} in all at most"
            )
        found += every
    return tuple(found)


_FOR = {
    "rate": "film",
    "other": "page",
    **dict.fromkeys(("states", "title", "caption", "parts", "zoom"), "picture"),
}
"""The options that only one kind of output has, each with that kind."""


def _check_kind(options: argparse.Namespace, path: Path, kind: str) -> None:
    """Refuse what a film, a page or a picture does not have; InputError."""
    for name, due in _FOR.items():
        if getattr(options, name) is not None and kind != due:
            option = {"states": "--rounds", "other": "OTHER"}.get(name, f"--{name}")
            raise InputError(f"{path}: a {kind}, expected {option} with a {due} alone")
    if options.what == "both" and kind != "film":
        raise InputError(f"{path}: a {kind}, expected --what both with a film alone")
    if options.dark and kind == "page":
        raise InputError(
            f"{path}: a page, which is dark where its reader prefers that: expected no --dark"
        )


def _sheet(options: argparse.Namespace) -> Sheet:
    """Return how a picture is set out."""
    from cubepath.coordinator.runs.drawing import Sheet  # noqa: PLC0415

    return Sheet(
        states=options.states,
        title=options.title,
        caption=options.caption,
        dark=options.dark,
        parts=options.parts or "both",
        zoom=options.zoom,
    )


def _view(options: argparse.Namespace) -> int:
    if options.connect is not None:
        return watch_elsewhere(options)
    check_no_connect_options(options)
    if options.input is None:
        raise InputError("the following arguments are required: INPUT, or --connect ENDPOINT")
    scene = _scene_in(options.input)
    return _view_path(options) if scene is None else _view_scene(options, scene)


def _view_path(options: argparse.Namespace) -> int:
    from cubepath.coordinator.runs.drawing import PICTURE_SUFFIXES, run_picture  # noqa: PLC0415 - only what a command needs
    from cubepath.coordinator.runs.films import FILM_SUFFIXES  # noqa: PLC0415
    from cubepath.coordinator.tools.viewing.pages import PAGE_SUFFIXES  # noqa: PLC0415

    if options.out is None and options.input == STANDARD_INPUT:
        raise InputError("standard input: has no name for a picture, expected -o PICTURE")
    path: Path = options.out or options.input.with_suffix(".png")
    suffix = path.suffix.lower()
    kind = "film" if suffix in FILM_SUFFIXES else "page" if suffix in PAGE_SUFFIXES else "picture"
    suffixes = (*PICTURE_SUFFIXES, *FILM_SUFFIXES, *PAGE_SUFFIXES)
    check_files(options, [options.input, options.other, options.of], Output(path, suffixes))
    _check_kind(options, path, kind)
    both = _inputs(options)
    drawn = both[0]
    if kind == "page":
        write_page(both, path)
        return _written(options, both, path, "page")
    if kind == "film":
        _film(options, drawn, path)
    else:
        with progress_bar(None, "draw", ""):
            run_picture(
                drawn.scene,
                drawn.steps,
                drawn.cubes,
                path,
                found=drawn.normal_form,
                step_name=drawn.step_name,
                what="schedule" if options.what == "schedule" else "run",
                sheet=_sheet(options),
            )
    return _written(options, [drawn], path, "picture")


def _scene_in(path: Path) -> Scene | None:
    """Return the scene that an input names or holds; None if it is something else."""
    from cubepath.protocol.scenes.registry import sound_family  # noqa: PLC0415
    from cubepath.protocol.scenes.specs import scene_from_spec  # noqa: PLC0415

    spec = str(path)
    name = spec.partition(":")[0]
    # Families of other distributions are not loaded for what is a file.
    there = os.path.exists(spec)  # noqa: PTH110 - never raises
    named = spec.endswith(".toml") or (
        not there and (name.endswith(".toml") or sound_family(name) is not None)
    )
    return scene_from_spec(spec) if named else None


def _view_scene(options: argparse.Namespace, scene: Scene) -> int:
    """Draw the start of a scene, and beside it its goal."""
    from cubepath.coordinator.runs.drawing import PICTURE_SUFFIXES, scene_picture  # noqa: PLC0415

    source: Path = options.input
    given = {"OTHER": options.other, "--system": options.system, "--of": options.of}
    given |= {"--format": options.format, "--with": options.companions, "--rate": options.rate}
    given |= {"--rounds": options.states, "--parts": options.parts}
    given["--what"] = None if options.what == "run" else options.what
    for name, value in given.items():
        if value:
            raise InputError(f"{source}: a scene without a run, expected no {name}")
    if options.out is None and source.suffix != ".toml":
        raise InputError(f"{source}: no file, expected -o PICTURE")
    path: Path = options.out or source.with_suffix(".png")
    if path.suffix.lower() not in PICTURE_SUFFIXES:
        suffixes = ", ".join(PICTURE_SUFFIXES)
        raise InputError(f"{path}: {source} is a scene without a run, expected {suffixes}")
    check_files(argparse.Namespace(system=str(source)), [], Output(path, PICTURE_SUFFIXES))
    with progress_bar(None, "draw", ""):
        scene_picture(scene, path, sheet=_sheet(options))
    answer(
        options, {"system": scene.spec, "picture": str(path)}, f"written to {visible(str(path))}"
    )
    return DONE


def _inputs(options: argparse.Namespace) -> list[PathSteps]:
    from cubepath.coordinator.shortening.path_input import hints_for_each  # noqa: PLC0415

    sources = [each for each in (options.input, options.other) if each is not None]
    for source in sources:
        if _scene_in(source) is not None:
            raise InputError(f"{source}: a scene without a run, expected a run or another path")
    given = options.system, hints(options)
    each_given = [given] if len(sources) == 1 else hints_for_each(sources, *given)
    found = [
        _read(source, options.of, *said) for source, said in zip(sources, each_given, strict=True)
    ]
    if options.of is not None and all(each.chain is None for each in found):
        raise InputError(f"{found[0].source}: no certificate, expected no --of")
    return found


def _written(options: argparse.Namespace, drawn: Sequence[PathSteps], path: Path, kind: str) -> int:
    """Say what was written, and of what."""
    document = {"log": str(drawn[0].source), kind: str(path)}
    if len(drawn) > 1:
        document["other"] = str(drawn[1].source)
    answer(options, document, f"written to {visible(str(path))}")
    return max(solved(options, each.unsolved) for each in drawn)


def _film(options: argparse.Namespace, drawn: PathSteps, path: Path) -> None:
    """Draw a film of the run, of its schedule, or of both side by side."""
    from cubepath.coordinator.runs.films import FRAMES_PER_SECOND, animate, animate_beside  # noqa: PLC0415

    rate: float = options.rate or FRAMES_PER_SECOND
    with progress_bar(None, "film", " frames") as bar:
        progress = partial(StageProgress(bar).tick, "film")
        if options.what == "both":
            animate_beside(
                drawn.scene,
                drawn.steps,
                drawn.cubes,
                path,
                found=drawn.normal_form,
                step_name=drawn.step_name,
                frames_per_second=rate,
                dark=options.dark,
                progress=progress,
            )
            return
        as_given = options.what == "run"
        animate(
            drawn.scene,
            drawn.steps if as_given else drawn.cubes,
            path,
            step_name=drawn.step_name if as_given else "cube",
            frames_per_second=rate,
            dark=options.dark,
            progress=progress,
        )


def _read(source: Path, of: Path | None, system: str | None, plan_hints: PlanHints) -> PathSteps:
    with opened(source) as file:
        if form_of(file).name != "recording":
            return _from_file(file, of, system, plan_hints)
        if system is not None or plan_hints != PlanHints():
            raise InputError(
                f"{source}: a recording, which says itself what its system is: expected no"
                " --system, --format or --with"
            )
        return _recorded(file)


def _recorded(file: InputFile) -> PathSteps:
    from cubepath.coordinator.runs.gathering import gathered_in_full  # noqa: PLC0415
    from cubepath.coordinator.shortening.path_steps import steps_gathered  # noqa: PLC0415
    from cubepath.protocol.recordings.recording import read_recording  # noqa: PLC0415

    with progress_bar(None, "read", "") as bar:
        recording = read_recording(file)
        bar.clear()
        for problem in recording.problems:
            complain(f"{file.path}: {problem}; drawing what could be read")
        gatherer = gathered_in_full(recording)
    if recording.problems and gatherer.unfinished is not None:
        complain(f"{file.path}: {gatherer.unfinished}; nothing is drawn from there on")
    found = steps_gathered(file.path, gatherer, free=recording.clock == "free")
    return replace(found, recording=recording)


def _from_file(
    file: InputFile, of: Path | None, system: str | None, plan_hints: PlanHints
) -> PathSteps:
    from cubepath.coordinator.shortening.path_steps import certified_steps, read_steps  # noqa: PLC0415

    with progress_bar(None, "view", " moves") as bar:
        if form_of(file).name == "certificate":
            if of is None:
                raise InputError(
                    f"{file.path}: a certificate, which has the numbers of moves alone: expected"
                    " --of INPUT"
                )
            return certified_steps(file, of, system, plan_hints, bar.update)
        return read_steps(file, system, plan_hints, bar.update)
