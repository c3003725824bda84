"""Pictures of catalogues: each generator before and after."""

from collections.abc import Callable
from math import ceil
from pathlib import Path

from matplotlib.figure import Figure

from cubepath.agents.rendering.pictures import draw_on, extent
from cubepath.coordinator.runs.drawing import save_figure
from cubepath.protocol.core.catalogue import Catalogue, Generator
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.system import Scene
from cubepath.protocol.systems.lattice import LatticeSystem

_MOST = 120
_COLUMNS = 3
_WIDE, _HIGH, _WORDS, _GAP = 1.5, 1.2, 0.5, 0.15
"""Inches of a state, of the words above it, and between two states."""


def draw_catalogue(
    catalogue: Catalogue, title: str, path: Path, drawn: Callable[[], object]
) -> None:
    """Write a picture of all generators, each before and after; InputError if there are too many.

    `drawn` is called after each of them.

    Cells of the support that stay are walls: those that are on, and those that are off. What may
    be either is a plain cell.
    """
    count = len(catalogue.generators)
    if count > _MOST:
        raise InputError(f"{path}: {count} generators, expected at most {_MOST}")
    columns = min(_COLUMNS, count)
    pair = 2 * _WIDE + 3 * _GAP
    rows = ceil(count / columns)
    wide, high = columns * pair + _GAP, _WORDS + rows * (_HIGH + _WORDS) + _GAP
    figure = Figure(figsize=(wide, high), facecolor="white")
    figure.text(_GAP / wide, 1 - 0.12 / high, title, va="top", fontsize=12, fontweight="bold")
    legend = "coloured: moves;  dark: a module must be there;  grey: none may;  pale: either way"
    figure.text(_GAP / wide, 1 - 0.36 / high, legend, va="top", fontsize=8.5)
    for number, generator in enumerate(catalogue.generators):
        left = _GAP + number % columns * pair
        top = _WORDS + number // columns * (_HIGH + _WORDS)
        name = f"{generator.name}: before, after"
        figure.text(left / wide, 1 - (top + 0.15) / high, name, va="top", fontsize=8.5)
        scene = _scene(catalogue, generator)
        sources, targets = zip(*generator.motion, strict=True)
        box = extent(scene, targets)
        for side, sites in enumerate((sources, targets)):
            at = left + side * (_WIDE + _GAP)
            bottom = high - top - _WORDS - _HIGH + 0.1
            axes = figure.add_axes((at / wide, bottom / high, _WIDE / wide, _HIGH / high))
            moved = dict(enumerate(sources)) if side else {}
            draw_on(axes, scene, sites, moved=moved, box=box)
        drawn()
    save_figure(figure, path)


def _scene(catalogue: Catalogue, generator: Generator) -> Scene:
    """Return the modules of a generator among the cells of its support."""
    still = set(generator.support) - set(generator.trace)
    system = LatticeSystem(
        Catalogue(catalogue.lattice, (generator,)),
        workspace=generator.support,
        filled=still & set(generator.before),
        empty=still - set(generator.before) - set(generator.free),
    )
    return Scene(generator.name, "", system, tuple(source for source, _ in generator.motion))
