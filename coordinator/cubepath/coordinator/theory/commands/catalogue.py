"""The commands ``cubepath system check`` and ``cubepath system show``."""

from __future__ import annotations

import argparse
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import zip_longest
from pathlib import Path
from typing import TYPE_CHECKING

from cubepath.agents.rules.registry import rule_named
from cubepath.coordinator.commands import console
from cubepath.coordinator.commands.files import Output, check_files, output_path
from cubepath.coordinator.commands.usage import whole
from cubepath.coordinator.theory.complexes.catalogue_survey import (
    FAR,
    CatalogueSurvey,
    Witness,
    catalogue_survey,
    never_admissible,
)
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.formatting import counted, visible
from cubepath.protocol.core.input_files import read_text
from cubepath.protocol.core.parsing import parsed_toml
from cubepath.protocol.scenes.drawings import DrawingError, drawing_text
from cubepath.protocol.scenes.drawn_generators import LETTERS, generator_marks
from cubepath.protocol.scenes.pages import PageError
from cubepath.protocol.scenes.specs import is_scene_file, path_and_values, scene_from_spec

if TYPE_CHECKING:
    from cubepath.protocol.core.catalogue import Catalogue, Cell, Lattice
    from cubepath.protocol.core.system import Scene

PICTURES = (".png", ".svg", ".pdf")


def add_system_check(parser: argparse.ArgumentParser) -> None:
    """Add the options of ``system check``."""
    parser.set_defaults(command=_check)
    parser.add_argument("system", metavar="SYSTEM", help=_HELP)
    parser.add_argument(
        "--modules",
        type=whole(1),
        metavar="K",
        help="try all aggregates of up to K modules (default: as many as take a moment)",
    )


def add_system_show(parser: argparse.ArgumentParser) -> None:
    """Add the options of ``system show``."""
    parser.set_defaults(command=_show)
    parser.add_argument("system", metavar="SYSTEM", help=_HELP)
    parser.add_argument(
        "-o", "--out", type=output_path, metavar="FILE", help="a picture: .png, .svg or .pdf"
    )


_HELP = console.SYSTEM_HELP.replace(" (default hex)", "")


def _check(options: argparse.Namespace) -> int:
    try:
        scenes = list(_scenes(options.system))
    except InputError as error:
        if not isinstance(error.__cause__, InputError):
            raise
        return _complain(options, _mistakes(error.__cause__))
    catalogue = _catalogue(options.system, scenes[0])
    for scene in scenes:
        if scene.rule:
            rule_named(scene.rule, scene.system)
    never = [each.name for each in catalogue.generators if never_admissible(each)]
    if never:
        what = "its guards contradict the sites that are on and off, so it is never admissible"
        return _complain(options, [InputError(f"generator {name!r}: {what}") for name in never])
    with console.progress_bar(None, "system check", ""):
        found = catalogue_survey(scenes[0].system, options.modules)
    rows = [("system", f"{options.system}: {_size(catalogue)}"), *_rows(found, scenes)]
    drawn = list(_drawn(catalogue.lattice, found))
    text = "\n".join([console.table(rows), *("\n" + each for each in drawn)])
    console.answer(options, {"mistakes": [], **dict(rows), "witnesses": drawn}, text)
    return console.DONE


def _scenes(spec: str) -> Iterator[Scene]:
    """Yield the scenes of a page, or the one that a spec names."""
    yield scene_from_spec(spec)
    path, given = path_and_values(spec)
    if is_scene_file(spec) and not re.search(r"(^|,)scene=", given):
        names = list(parsed_toml(read_text(path)).get("scenes", {}))
        for name in names[1:]:
            yield scene_from_spec(f"{path}:{given}{',' * bool(given)}scene={name}")


def _catalogue(spec: str, scene: Scene) -> Catalogue:
    if scene.system.catalogue is None:
        raise InputError(
            f"{spec}: has no generators, expected one on a lattice (complex explores any)"
        )
    return scene.system.catalogue


def _size(catalogue: Catalogue) -> str:
    return f"{counted(len(catalogue.generators), 'generator')} on {catalogue.lattice.name}"


def _mistakes(error: InputError) -> tuple[InputError, ...]:
    return error.mistakes if isinstance(error, PageError) else (error,)


def _complain(options: argparse.Namespace, mistakes: Iterable[InputError]) -> int:
    """Answer with mistakes, each with its picture if it is one of a drawing."""
    found = [
        {"text": str(each), "picture": each.picture if isinstance(each, DrawingError) else ""}
        for each in mistakes
    ]
    lines: list[str] = []
    for each in found:
        lines.append(f"{options.system}: {each['text']}")
        lines += [f"    {row}" for row in each["picture"].split("\n") if row.strip()]
    console.answer(options, {"mistakes": found}, "\n".join(map(visible, lines)))
    return console.FAILED


def _rows(found: CatalogueSurvey, scenes: Sequence[Scene]) -> Iterator[tuple[str, object]]:
    system = scenes[0].system
    names = [f"{each.spec} ({counted(len(each.start), 'module')})" for each in scenes]
    yield "scenes", ", ".join(names)
    still = [each.spec for each in scenes if not each.can_begin()]
    if still:
        yield "start", f"no module can move in {', '.join(still)}"
    stuck = sorted({name for scene in scenes for name in _stuck(scene)})
    if stuck:
        yield "fits nowhere", ", ".join(stuck)
    far = counted(found.farthest, "step") + " or more" * (found.farthest == FAR)
    yield "pairs", f"{found.meeting} of moves that meet, {found.commuting} commute"
    yield "senses", f"{counted(found.sensed, 'place')}, to {far} away"
    yield "tried", f"all {found.aggregates} connected aggregates of up to {found.size} modules"
    tried = found.size > 1  # there is nothing to see in a single module
    if system.local and tried:
        yield "connected", "all stay so" if found.splits is None else "some come apart"
    if system.dimension == system.site_size == 2 and tried:
        yield "holes", "none comes or goes" if found.holes is None else "some come or go"
    if system.local:
        yield "local", "yes: each module sees whether it can move"
    else:
        yield "local", "no: no module sees whether the aggregate stays connected"


def _stuck(scene: Scene) -> set[str]:
    """Return the generators that fit nowhere in the workspace of a scene."""
    system = scene.system
    if not system.bounded or system.catalogue is None:
        return set()
    placed = {
        move.generator
        for place in system.places
        for move in system.moves(place)
        if move is not None
    }
    return system.catalogue.by_name.keys() - placed


def _drawn(lattice: Lattice, found: CatalogueSurvey) -> Iterator[str]:
    """Yield the witnesses, drawn."""
    if found.splits is not None and found.unseen is None:
        yield _witness(lattice, "comes apart", found.splits)
    if found.holes is not None:
        yield _witness(lattice, "a hole comes or goes", found.holes)
    if found.unseen is not None:
        one, other = found.unseen
        yield _witness(lattice, "may move: the aggregate stays connected", one)
        yield _witness(lattice, "sees the same and may not", other)


def _witness(lattice: Lattice, what: str, found: Witness) -> str:
    move = found.move
    moving = [(lattice.check(one), lattice.check(other)) for one, other in move.motion]
    before = dict.fromkeys(found.before | found.after, ".") | dict.fromkeys(found.before, "#")
    after = dict.fromkeys(found.before | found.after, ".") | dict.fromkeys(found.after, "#")
    for letter, (source, target) in zip(LETTERS, moving, strict=False):
        before[source] = after[target] = letter
    return "\n".join([f"{move.generator}: {what}", *_side_by_side(lattice, before, after)])


def _side_by_side(
    lattice: Lattice, before: Mapping[Cell, str], after: Mapping[Cell, str]
) -> list[str]:
    one, other = (drawing_text(lattice, marks).split("\n") for marks in (before, after))
    wide = max(map(len, one)) + 4
    arrow = (len(one) - 1) // 2
    rows = zip_longest(one, other, fillvalue="")
    return [
        f"    {left:{wide}}{'->' if row == arrow else '  '}    {right}".rstrip()
        for row, (left, right) in enumerate(rows)
    ]


def _show(options: argparse.Namespace) -> int:
    output: Path | None = options.out
    check_files(options, [], Output(output, PICTURES))
    catalogue = _catalogue(options.system, scene_from_spec(options.system))
    lattice = catalogue.lattice
    document: list[dict[str, object]] = []
    lines = [f"{options.system}: {_size(catalogue)}"]
    for each in catalogue.generators:
        before, after = generator_marks(lattice, each)
        names = {"before": drawing_text(lattice, before), "after": drawing_text(lattice, after)}
        document.append({"name": each.name, **names})
        lines += ["", each.name, *_side_by_side(lattice, before, after)]
    if output is not None:
        from cubepath.coordinator.theory.commands import catalogue_picture  # noqa: PLC0415

        with console.progress_bar(len(catalogue.generators), "draw", " generators") as bar:
            catalogue_picture.draw_catalogue(catalogue, options.system, output, bar.update)
        lines = [f"written to {output}"]
    console.answer(options, document, "\n".join(map(visible, lines)))
    return console.DONE
