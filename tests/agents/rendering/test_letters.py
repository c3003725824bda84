"""Letters in text and in pixels: every place shows its letter, and which the goal wants."""

import numpy as np
from matplotlib.figure import Figure

from cubepath.agents.rendering.pictures import draw_on, draw_pixels, draw_text, style_of
from cubepath.agents.rendering.style import palette
from cubepath.protocol.core.catalogue import Move
from cubepath.protocol.core.sites import Site
from cubepath.protocol.core.system import Scene
from cubepath.protocol.scenes.families.words import word_moves
from cubepath.protocol.scenes.specs import scene_from_spec
from cubepath.protocol.systems.listed import TabledSystem


def test_a_word_in_text() -> None:
    """Letters in a row, starred where they are those of the goal."""
    scene = scene_from_spec("words:word=abacba,goal=cbcabc")
    assert draw_text(scene, scene.start).split() == ["a", "b*", "a", "c", "b*", "a"]


def test_an_assembly_in_text() -> None:
    """Rows from top to bottom, shifted as the parts lie."""
    scene = scene_from_spec("assembly:n=2,until=placed")
    sites: list[Site] = [((0, 0), "placed"), ((1, 0), "open"), ((0, 1), "open")]
    assert draw_text(scene, sites).splitlines() == ["    open", "placed* open"]


def test_long_words_take_several_rows() -> None:
    """Forty letters a row, in text and in pictures."""
    scene = scene_from_spec("words:word=" + "abacba" * 15)
    lines = draw_text(scene, scene.start).splitlines()
    assert [len(line.split()) for line in lines] == [40, 40, 10]
    left, right, low, high = style_of(scene).frame(scene, ())
    assert right - left > 10 * (high - low)


def test_boxes_have_the_colours_of_their_letters() -> None:
    """Beside its letter, each box shows the colour of the letter; blanks are pale."""
    scene = scene_from_spec("words:presentation=free2,word=ab_B,goal=____")
    shown = draw_pixels(scene, scene.start)
    left, right, _, _ = style_of(scene).frame(scene, ())
    cell = shown.shape[1] / (right - left)
    system = scene.system
    assert isinstance(system, TabledSystem)
    colours = dict(zip(system.letters, palette(len(system.letters)), strict=True))
    colours["_"] = (0.91, 0.92, 0.93)
    for place, letter in enumerate("ab_B"):
        x = round((place - 0.3 - left) * cell)
        found = shown[round(shown.shape[0] / 2 - 0.3 * cell), x]
        assert np.abs(found - 255 * np.array(colours[letter])).max() < 3


def test_many_letters_are_few_artists_without_words() -> None:
    """Boxes are collections: their number does not decide the number of artists."""
    counts = []
    for word in ("abacba", "abacba" * 8):
        axes = Figure(figsize=(6, 2)).add_axes((0, 0, 1, 1))
        scene = scene_from_spec(f"words:word={word}")
        draw_on(axes, scene, scene.start, numbers=False)
        counts.append(len(axes.get_children()))
    assert counts[0] == counts[1]


def test_a_list_drawn_as_a_graph() -> None:
    """Any list of moves can be drawn as discs: at its positions, or on a circle."""
    moves: list[Move] = list(word_moves(3, [("ab", "ba")]))
    pictures = []
    for positions in ({}, {0: (0.0, 0.0), 1: (2.0, 0.0), 2: (2.0, 2.0)}):
        known: dict[Site, tuple[float, float]] = dict(positions.items())
        system = TabledSystem(moves, letters=["a", "b"], drawing="graph", positions=known)
        scene = Scene("own", "", system, ((0, "a"), (1, "b"), (2, "a")))
        pictures.append(draw_pixels(scene, scene.start))
        assert len(draw_text(scene, scene.start).splitlines()) == 3
    assert all((picture != 255).any() for picture in pictures)
