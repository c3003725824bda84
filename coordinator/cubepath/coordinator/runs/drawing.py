"""A picture of a whole run, with some of its states and its schedule; or of a scene without a run.

Modules are followed through the moves from the start, so only the scene and the moves are needed.
matplotlib is imported when something is drawn.
"""

from __future__ import annotations

import io
import re
import textwrap
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from math import ceil
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, TypeAlias

import numpy as np

from cubepath.agents.rendering.pictures import draw_on, extent, legend_of
from cubepath.agents.rendering.style import DARK, GOAL, INK, LIGHT, PAPER, Box, Theme
from cubepath.coordinator.normal_form.array_heap import NormalForm
from cubepath.coordinator.normal_form.compiled_heap import cancellations
from cubepath.coordinator.runs.schedule_chart import draw_schedule
from cubepath.coordinator.runs.states import Snapshot, Steps, snapshots, visited
from cubepath.protocol.core.actions import Action
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.formatting import counted
from cubepath.protocol.core.output_files import written_whole
from cubepath.protocol.core.sites import Site, in_order
from cubepath.protocol.core.system import Scene

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.text import Text

PICTURE_SUFFIXES = (".png", ".svg", ".pdf")
What: TypeAlias = Literal["run", "schedule"]
"""Whose states a picture shows: those of the run, or of its normal cube path."""
_WIDE, _EDGE, _GAP = (9.0, 13.0), 0.3, 0.14
"""In inches: the possible widths of a picture, its margin, and the gap between two states."""
_TITLE, _CAPTION = 0.85, 0.2
"""In inches: the height of the title, and of the caption of a state."""
_STATES = 6
"""The number of states shown."""
_LONGER = 1.6
"""So much longer than wide states may be, if their numbers can be read then."""
_TALL = 5.5
"""In inches: a height that a state may always have, however narrow it is."""
_READABLE, _SPECK = 10.5, 5.0
"""In points: the least width of a cell with a readable number; below the second it is a speck."""
_ZOOM = 1.4
"""So much larger modules must become for each state to have a frame around its modules alone."""
_STATES_MAX = 60
"""More states than this are not shown: nobody looks at this many."""
_LINE, _LETTER = 0.165, 0.068
"""In inches: the height of a line of the caption below, and the average width of a letter."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Sheet:
    """How a picture of a run is set out.

    `states` are the numbers of the steps after which states are shown, 0 for the start; None means
    six of those in which something moves, evenly spread. `title` stands in place of the name of the
    system, `caption` below everything. `parts` says what is drawn: the states, the schedule or
    both. `zoom` says whether each state is framed around its modules, at one scale; None means
    where modules would be too small to read otherwise, and nothing but free lattice is left out.

    >>> Sheet(states=(0, 10, 20), title="A chain turns", dark=True).parts
    'both'
    """

    states: tuple[int, ...] | None = None
    title: str | None = None
    caption: str | None = None
    dark: bool = False
    parts: Literal["both", "states", "schedule"] = "both"
    zoom: bool | None = None


_PLAIN = Sheet()


def run_picture(
    scene: Scene,
    rounds: Steps,
    cubes: Steps,
    path: Path | str,
    *,
    found: NormalForm | None = None,
    step_name: str = "round",
    what: What = "run",
    sheet: Sheet = _PLAIN,
) -> None:
    """Write a picture of a run and of its normal cube path as .png, .svg or .pdf.

    `rounds` holds the actions that each round of the run executed, including rounds without a move;
    `cubes` is the normal cube path of the same moves (`cubepath.coordinator.normal_form.heap`), and
    `found` says what becomes of each move, if that is known already. `step_name` names the steps of
    a path that is not a run.
    The upper part shows some states of the run, or of the schedule if `what` says so, with modules
    coloured by number and the moves of the last step marked.
    The lower part is the schedule, with a lane for each module: in the upper half of the lane the
    rounds in which the module moved (pale, and hollow if the move cancels), in the lower half the
    cubes.

    `sheet` says which states are shown, and what else is as its reader wants it.

    InputError if the suffix is unknown, the font has not all letters of the title or caption, a
    state is asked for that there is not, a move is not
    admissible or the file cannot be written.

    >>> played = play("hex:n=4")
    >>> run_picture(played.scene, played.steps, normal_cube_path(played.path), "run.svg")
    >>> Path("run.svg").read_text().count("<svg")
    1
    """
    check_suffix(path, PICTURE_SUFFIXES)
    executed = [list(actions) for actions in rounds]
    normal = [list(actions) for actions in cubes]
    run = list(snapshots(scene, executed))
    shortest = list(snapshots(scene, normal))
    gone = cancelled_moves(executed, found)
    counts = _counts(executed, normal, step_name)
    figure = _figure(
        scene, run, shortest, counts, gone, step_name=step_name, what=what, sheet=sheet
    )
    save_figure(figure, path)


def scene_picture(scene: Scene, path: Path | str, *, sheet: Sheet = _PLAIN) -> None:
    """Write a picture of a scene without a run: its start, and beside it its goal if it has one.

    In the goal modules have their numbers and colours where labels say which is which, and the
    colour of the goal elsewhere. The states and the parts of `sheet` do not count. InputError as
    for `run_picture`.

    >>> scene_picture(scene_from_spec("hex:n=12"), "scene.svg")
    >>> Path("scene.svg").read_text().count("<svg")
    1
    """
    check_suffix(path, PICTURE_SUFFIXES)
    _check_letters(sheet)
    theme = DARK if sheet.dark else LIGHT
    states = [("start", scene, Snapshot(scene.start, {}, {}), theme)]
    if scene.goal is not None:
        own = _at_goal(scene)
        state = Snapshot(in_order(scene.goal) if own is None else own, {}, {})
        plain = replace(theme, modules=theme.of(GOAL)) if own is None else theme
        # No outlines of the goal: every module stands in one.
        states.append(("goal", replace(scene, goal=None, goals=()), state, plain))
    box = extent(scene, ())
    boxes = _frames(scene, [state for _, _, state, _ in states], box, sheet.zoom)
    width, _, wide, tall = _panels(boxes[0], len(states), one_row=True)
    legend = legend_of(scene, [(scene.start, {})], boxes[0], width - 2 * _EDGE, theme)
    caption = _wrapped(sheet.caption or "", int((width - 2 * _EDGE) / _LETTER))
    legend_top = _TITLE + _CAPTION + tall + _GAP
    caption_top = legend_top + legend.height + 0.2
    high = caption_top + (_LINE * len(caption) + 0.2 if caption else 0)
    page = Page(width, high, theme)
    page.write(_heading(scene, sheet), _EDGE, 0.2, fontsize=12.5, fontweight="bold")
    count = counted(len(scene.start), "module")
    page.write(count + ("" if scene.goal else ", no goal"), _EDGE, 0.47, fontsize=10)
    for index, (name, drawn, state, look) in enumerate(states):
        at = _EDGE + index * (wide + _GAP)
        page.write(name, at, _TITLE, fontsize=8.5)
        axes = page.axes(at, _TITLE + _CAPTION, wide, tall)
        draw_on(axes, drawn, state.sites, box=boxes[index], theme=look)
    legend.put(page.figure, _EDGE, legend_top)
    if caption:
        page.write("\n".join(caption), _EDGE, caption_top, fontsize=9, linespacing=1.3)
    save_figure(page.figure, path)


def _at_goal(scene: Scene) -> tuple[Site, ...] | None:
    """Return the site of each module at the goal; None if labels do not tell them apart."""
    label_of = scene.system.label_of
    by_label = {label_of(site): site for site in scene.goal or ()}
    if None in by_label:
        return None
    return tuple(by_label[label_of(site)] for site in scene.start)


def check_suffix(path: Path | str, known: Sequence[str]) -> None:
    """Raise InputError if a name has none of the known suffixes."""
    if Path(path).suffix.lower() not in known:
        raise InputError(f"{path}: expected a name that ends in {' or '.join(known)}")


def _counts(
    rounds: Sequence[Sequence[Action]], cubes: Sequence[Sequence[Action]], step_name: str
) -> str:
    moves, left = sum(map(len, rounds)), sum(map(len, cubes))
    largest = max(map(len, cubes), default=0)
    # In a path without rounds the steps are the moves, which are counted anyway.
    steps = "" if step_name == "move" else f"{counted(len(rounds), step_name)}, "
    return (
        f"{steps}{counted(moves, 'move')}  \N{RIGHTWARDS ARROW}  "
        f"{counted(len(cubes), 'cube')}, {counted(left, 'move')}, largest cube {largest}"
    )


def cancelled_moves(
    rounds: Iterable[Iterable[Action]], found: NormalForm | None = None
) -> set[tuple[int, Action]]:
    """Return the moves, by step and action, that are not in the normal cube path.

    A move that cancels does so with the last remaining move that equals it.
    """
    path = [(number, action) for number, actions in enumerate(rounds, 1) for action in actions]
    if found is None:
        found = cancellations(action for _, action in path)
    return {path[place] for place in np.flatnonzero(found.levels == 0).tolist()}


def _heading(scene: Scene, sheet: Sheet) -> str:
    return _title(scene.spec) if sheet.title is None else " ".join(sheet.title.split())


def _title(spec: str) -> str:
    """Return a spec without the folders of its files, cut off if it is too long."""
    short = re.sub(r"[^=,]*/", "", spec)
    return short if len(short) <= 80 else short[:77] + "..."


def _figure(
    scene: Scene,
    run: Sequence[Snapshot],
    shortest: Sequence[Snapshot],
    counts: str,
    cancelled: set[tuple[int, Action]],
    *,
    step_name: str = "round",
    what: What = "run",
    sheet: Sheet = _PLAIN,
) -> Figure:
    theme = DARK if sheet.dark else LIGHT
    states, state_name = (run, step_name) if what == "run" else (shortest, "cube")
    shown = _shown(sheet, states, state_name)
    box = extent(scene, visited(chain(run, shortest)))
    boxes = _frames(scene, [states[number] for number in shown], box, sheet.zoom)
    width, columns, wide, tall = _panels(boxes[0], len(shown))
    lanes = min(max(0.2 * len(scene.start), 0.5), 5.5) if sheet.parts != "states" else 0.0
    shots = [(states[number].sites, states[number].moved) for number in shown]
    legend = legend_of(scene, shots, boxes[0], width - 2 * _EDGE, theme)
    _check_letters(sheet)
    caption = _wrapped(sheet.caption or "", int((width - 2 * _EDGE) / _LETTER))
    legend_top = _TITLE
    if sheet.parts != "schedule":
        legend_top += ceil(len(shown) / columns) * (_CAPTION + tall + _GAP)
    chart_top = legend_top + (legend.height + 0.4 if sheet.parts != "schedule" else 0.2)
    caption_top = chart_top + lanes + 0.55 if lanes else legend_top + legend.height + 0.2
    high = caption_top + (_LINE * len(caption) + 0.2 if caption else 0)
    page = Page(width, high, theme)
    page.write(_heading(scene, sheet), _EDGE, 0.2, fontsize=12.5, fontweight="bold")
    framed = "" if boxes[0] == box else ";  each state is framed around its modules"
    page.write(counts + framed, _EDGE, 0.47, fontsize=10)
    for index, number in enumerate(shown if sheet.parts != "schedule" else ()):
        name = "start" if number == 0 else f"{state_name} {number}"
        if number == len(states) - 1 and scene.reached(states[number].sites):
            name += ", goal"
        at = _EDGE + index % columns * (wide + _GAP)
        top = _TITLE + index // columns * (_CAPTION + tall + _GAP)
        page.write(name, at, top, fontsize=8.5)
        axes = page.axes(at, top + _CAPTION, wide, tall)
        sites, moved = shots[index]
        draw_on(axes, scene, sites, moved=moved, box=boxes[index], theme=theme)
    if sheet.parts != "schedule":
        legend.put(page.figure, _EDGE, legend_top)
    if lanes:
        chart = page.axes(_EDGE + 0.3, chart_top, width - 2 * _EDGE - 0.3, lanes)
        as_given = f"{'as executed' if step_name in {'round', 'level'} else 'as given'}, "
        as_given += counted(len(run) - 1, step_name)
        draw_schedule(chart, scene, run, shortest, cancelled, as_given=as_given, theme=theme)
    if caption:
        page.write("\n".join(caption), _EDGE, caption_top, fontsize=9, linespacing=1.3)
    return page.figure


def _check_letters(sheet: Sheet) -> None:
    """Raise InputError for a letter that the font of pictures does not have."""
    from matplotlib.font_manager import FontProperties, findfont, get_font  # noqa: PLC0415

    font = get_font(findfont(FontProperties()))
    for name, words in (("title", sheet.title), ("caption", sheet.caption)):
        for letter in words or "":
            if not letter.isspace() and not font.get_char_index(ord(letter)):
                raise InputError(f"{name}: {letter!r} is not in the font {font.family_name}")


def _wrapped(words: str, width: int) -> list[str]:
    """Return words in lines of at most this many letters, and a new line where they have one."""
    return [line for each in words.splitlines() for line in textwrap.wrap(each, width) or [""]]


def _shown(sheet: Sheet, run: Sequence[Snapshot], name: str) -> list[int]:
    """Return the numbers of the states that are shown."""
    count = len(run)
    if sheet.states is None:
        new = [number for number, state in enumerate(run) if not number or state.moved]
        return [
            new[n] for n in sorted({*np.linspace(0, len(new) - 1, _STATES).round().astype(int)})
        ]
    states = list(dict.fromkeys(sheet.states))
    if len(states) > _STATES_MAX:
        raise InputError(f"{len(states)} states to show, expected at most {_STATES_MAX}")
    for number in states:
        if not 0 <= number < count:
            raise InputError(f"no {name} {number}: expected 0, the start, to {count - 1}, the last")
    return states or [0]


def _frames(
    scene: Scene,
    states: Sequence[Snapshot],
    box: Box,
    zoom: bool | None,  # noqa: FBT001
) -> list[Box]:
    """Return the frame of each state, all of one size: the same, or one around its modules."""
    together = [box] * len(states)
    if zoom is False or (zoom is None and scene.system.bounded):
        return together
    own = [
        extent(replace(scene, start=state.sites, goal=None, goals=()), state.moved.values())
        for state in states
    ]
    wide = max(right - left for left, right, _, _ in own)
    tall = max(high - low for _, _, low, high in own)
    around = [
        ((a + b - wide) / 2, (a + b + wide) / 2, (c + d - tall) / 2, (c + d + tall) / 2)
        for a, b, c, d in own
    ]
    before, after = (_panels(each[0], len(states)).scale(each[0]) for each in (together, around))
    if zoom or (before < _READABLE and after > _ZOOM * before):
        return around
    return together


class _Panels(NamedTuple):
    """The layout of states on a page: its width, its columns and the size of a state, in inches."""

    page: float
    columns: int
    wide: float
    tall: float

    def scale(self, box: Box) -> float:
        """Return the width of a cell in points."""
        left, right, low, high = box
        return 72 * min(self.wide / (right - left), self.tall / (high - low))


def _panels(box: Box, count: int, *, one_row: bool = False) -> _Panels:
    """Return the layout for a frame: on a narrow page, or a wide one if modules would be specks."""
    rows = [1] if one_row else range(1, count + 1)
    narrow, wide = (_best_panels(page, box, count, rows) for page in _WIDE)
    return narrow if narrow.scale(box) >= _SPECK else wide


def _best_panels(page: float, box: Box, count: int, rows: Iterable[int]) -> _Panels:
    """Return the layout with as many columns as leave room for numbers on modules.

    It has one of these numbers of `rows`. If none leaves room, the layout that shows modules
    largest among those that are no higher than the page is wide, and the one with the most columns.
    Where numbers can be read on a longer page alone, that is taken.
    """
    left, right, low, high = box
    fitting: list[_Panels] = []
    longer: list[_Panels] = []
    for columns in sorted({ceil(count / each) for each in rows}, reverse=True):
        wide = (page - 2 * _EDGE - (columns - 1) * _GAP) / columns
        tall = min(wide * (high - low) / (right - left), max(2 * wide, _TALL))
        length = ceil(count / columns) * (_CAPTION + tall + _GAP)
        if not fitting or length <= _LONGER * page:
            fits = not fitting or length <= page
            (fitting if fits else longer).append(_Panels(page, columns, wide, tall))
    largest = max(fitting, key=lambda found: found.scale(box))
    read = (found for found in (*fitting, *longer) if found.scale(box) >= _READABLE)
    return next(read, largest)


class Page:
    """A figure whose parts are placed in inches from its upper left corner."""

    def __init__(self, wide: float, high: float, theme: Theme, dots: int = 100) -> None:
        """Make it of this size in inches, with this many dots an inch on a screen."""
        from matplotlib.figure import Figure  # noqa: PLC0415 - only when something is drawn

        figure = Figure(figsize=(wide, high), dpi=dots, facecolor=theme.of(PAPER))
        self._ink = theme.of(INK)
        self.figure = figure
        self.wide = wide
        self.high = high

    def axes(self, left: float, top: float, wide: float, tall: float) -> Axes:
        """Return new axes."""
        bottom = self.high - top - tall
        return self.figure.add_axes(
            (left / self.wide, bottom / self.high, wide / self.wide, tall / self.high)
        )

    def write(self, text: str, left: float, top: float, **style: Any) -> Text:
        """Write a text, and return it."""
        # Words, also where they have dollars: those would make them a formula.
        style |= {"va": "top", "color": self._ink, "parse_math": False}
        return self.figure.text(left / self.wide, 1 - top / self.high, text, **style)


def save_figure(figure: Figure, path: Path | str) -> None:
    """Draw everything first and then write the file, so that no file is left half written.

    InputError if the suffix is unknown or the file cannot be written.
    """
    from matplotlib import rc_context  # noqa: PLC0415

    check_suffix(path, PICTURE_SUFFIXES)

    kind = Path(path).suffix.lower()[1:]
    # No dates and no random names, so that the same run gives the same bytes.
    undated = {"svg": {"Date": None}, "pdf": {"CreationDate": None}}.get(kind)
    buffer = io.BytesIO()
    with rc_context({"svg.hashsalt": "cubepath"}):
        figure.savefig(buffer, format=kind, dpi=150, metadata=undated)
    with written_whole(path) as stream:
        stream.write(buffer.getvalue())
