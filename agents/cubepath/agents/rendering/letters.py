"""Letters at fixed places: words and assemblies, as text and on axes.

It draws only what it is given.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from cubepath.agents.rendering import style
from cubepath.protocol.core.sites import Site, in_order
from cubepath.protocol.core.system import Scene, System

_ROW = 40
"""Number of places without positions that lie in one row."""
_COLUMNS_MAX = 200
_MARGIN = 0.6
_SMALL, _CORNER, _READABLE = 0.36, 0.28, 2
"""The size of a small box, for the previous or the goal letter, how far its middle is from that of
its place, and the longest word in it."""
_NOTHING: tuple[str, ...] = ("_", "open")
"""Letters that stand for nothing, and are drawn pale."""
_PALE: style.Colour = (0.91, 0.92, 0.93)


def _text(scene: Scene, sites: Sequence[Site]) -> str:
    """Return the letters row by row, each followed by ``*`` if it is the goal's."""
    system = scene.system
    spots = _spots(system)
    goal = scene.goal or frozenset()
    columns = sorted({x for x, _ in spots.values()})
    unit = min((right - left for left, right in pairwise(columns)), default=1.0)
    unit = max(unit, (columns[-1] - columns[0]) / _COLUMNS_MAX)
    wide = max(len(letter) for letter in system.letters or ("o",)) + 2
    # Half steps, as between bricks, take half a word.
    step = wide if unit >= 1 else (wide + 1) // 2
    rows: dict[float, list[tuple[int, str]]] = {}
    for site in sites:
        x, y = spots[system.place_of(site)]
        word = letter_of(system, site) + ("*" if site in goal else "")
        rows.setdefault(y, []).append((round((x - columns[0]) / unit), word))
    lines = []
    for y in sorted(rows, reverse=True):
        line = ""
        for column, word in sorted(rows[y]):
            line = line.ljust(column * step) + word
        lines.append(line)
    return "\n".join(lines)


def letter_of(system: System, site: Site) -> str:
    """Return the letter of a site; for a place without letters, ``o``."""
    place = system.place_of(site)
    return site[1] if isinstance(site, tuple) and place != site else "o"


def _spots(system: System) -> dict[Site, style.Spot]:
    """Return the middles of the places, in cells."""
    places = [place for place in system.places if place not in system.filled]
    return {
        place: style.spot_of(system, place) or (float(number % _ROW), -1.2 * (number // _ROW))
        for number, place in enumerate(places)
    }


def _frame(scene: Scene, _also: Iterable[Site]) -> style.Box:
    return style.frame_around(_spots(scene.system).values(), _MARGIN)


def _draw(
    pen: style.Pen,
    scene: Scene,
    sites: Sequence[Site],
    moved: Mapping[int, Site],
    words: bool | None,  # noqa: FBT001 - as `Style.draw` has it
) -> None:
    """Draw a box for each place in the colour of its letter, with the letter in it if `words`.

    A box with the goal's letter has a red outline; otherwise the goal's letter is in the lower
    right corner. If the letter has just changed, the box has a dark outline, and the previous
    letter is in the upper left corner.
    """
    system, written = scene.system, style.readable(pen, words)
    spots = _spots(system)
    goal = scene.goal or frozenset()
    colours = _by_letter(system)

    def colour(site: Site) -> style.Colour:
        return colours.get(letter_of(system, site), _PALE)

    boxes = [_box(1.0, spots[system.place_of(site)]) for site in sites]
    width = pen.line(0.06)
    hues = [colour(site) for site in sites]
    pen.shapes(boxes, facecolors=hues, edgecolors=style.LINE, linewidths=0.5 * width)
    there = [box for box, site in zip(boxes, sites, strict=True) if site in goal]
    pen.shapes(there, facecolors="none", edgecolors=style.GOAL, linewidths=width)
    stirred = [boxes[number] for number in moved]
    pen.shapes(stirred, facecolors="none", edgecolors=style.INK, linewidths=2 * width)
    if written:
        for site in sites:
            word = letter_of(system, site)
            pen.write(spots[system.place_of(site)], word, colour(site))
    _small(pen, system, moved.values(), (-_CORNER, _CORNER), written=written, linewidths=0)
    _aims(pen, scene, goal - {*sites}, written=written)


def _small(
    pen: style.Pen,
    system: System,
    sites: Iterable[Site],
    corner: style.Spot,
    *,
    written: bool,
    **paint: Any,
) -> None:
    """Draw small boxes with the letters of these sites in a corner of their places."""
    spots, colours = _spots(system), _by_letter(system)
    found = {system.place_of(site): letter_of(system, site) for site in sites}
    at = {place: (spots[place][0] + corner[0], spots[place][1] + corner[1]) for place in found}
    hues = {place: colours.get(letter, _PALE) for place, letter in found.items()}
    boxes = [_box(_SMALL, spot) for spot in at.values()]
    pen.shapes(boxes, facecolors=list(hues.values()), **paint)
    for place, letter in found.items():
        if written and len(letter) <= _READABLE:
            pen.write(at[place], letter, hues[place], size=_SMALL)


def _aims(pen: style.Pen, scene: Scene, sites: Iterable[Site], *, written: bool) -> None:
    """Draw letters of the goal in the lower right corners."""
    width = 0.7 * pen.line(0.06)
    _small(
        pen,
        scene.system,
        sites,
        (_CORNER, -_CORNER),
        written=written,
        edgecolors=style.GOAL,
        linewidths=width,
    )


def _before(pen: style.Pen, scene: Scene) -> None:
    _aims(pen, scene, in_order(scene.goal or ()), written=True)


def _body(scene: Scene, site: Site) -> style.Body:
    system = scene.system
    at = _spots(system)[system.place_of(site)]
    letter = letter_of(system, site)
    return style.Body("box", at, at, _by_letter(system).get(letter, _PALE), letter)


def _by_letter(system: System) -> dict[str, style.Colour]:
    colours = dict(zip(system.letters, style.palette(len(system.letters)), strict=True))
    return colours | dict.fromkeys(_NOTHING, _PALE)


def _colours(system: System, sites: Sequence[Site]) -> list[style.Colour]:
    """Return the colours of the letters that are on."""
    known = _by_letter(system)
    return [known.get(letter_of(system, site), _PALE) for site in sites]


def _marks(scene: Scene, shots: Sequence[style.Shot], _box: style.Box) -> Iterator[style.Mark]:
    goal = scene.goal or frozenset()
    if any(not goal.isdisjoint(sites) for sites, _ in shots):
        yield style.Mark("has the letter of the goal", edge=style.GOAL)
    if any(not goal.issubset(sites) for sites, _ in shots):
        yield style.Mark("lower right: letter of the goal", face="white", edge=style.GOAL)
    if any(moved for _, moved in shots):
        yield style.Mark("has just changed", edge=style.INK)
        yield style.Mark("upper left: letter before", face=style.GHOST)


def _box(size: float, middle: style.Spot) -> style.Points:
    """Return a square with rounded corners."""
    half, corner = 0.44 * size, 0.12 * size
    inner = half - corner
    about = [(inner, inner), (-inner, inner), (-inner, -inner), (inner, -inner)]
    return np.add(style.arcs(about, corner), middle)


def _solid(system: System, site: Site) -> style.Solid | None:
    spot = _spots(system).get(system.place_of(site))
    return None if spot is None else style.box_at(spot, letter_of(system, site))


LETTERS = style.Style(
    text=_text,
    frame=_frame,
    extent=_frame,
    draw=_draw,
    marks=_marks,
    moving=style.MovingPart(_body, before=_before, outline=_box(1.0, (0.0, 0.0))),
    solid=_solid,
    colours=_colours,
)
