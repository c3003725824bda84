"""Pictures on dark ground can be read as well as those on light ground."""

import pytest
from matplotlib.colors import to_rgb

from cubepath.agents.rendering.style import (
    DARK,
    GHOST,
    GOAL,
    INK,
    LIGHT,
    LINE,
    PALE_GOAL,
    PAPER,
    TILE,
    WALL,
    Theme,
    palette,
)


def _light(colour: str | tuple[float, float, float]) -> float:
    """Return the relative luminance (WCAG 2.2)."""
    red, green, blue = (
        part / 12.92 if part <= 0.04045 else ((part + 0.055) / 1.055) ** 2.4
        for part in to_rgb(colour)
    )
    return 0.2126 * red + 0.7152 * green + 0.0722 * blue


def _contrast(one: str | tuple[float, float, float], other: str) -> float:
    low, high = sorted((_light(one), _light(other)))
    return (high + 0.05) / (low + 0.05)


@pytest.mark.parametrize("theme", [LIGHT, DARK], ids=["light", "dark"])
def test_marks_stand_out_from_the_ground(theme: Theme) -> None:
    """Words by 7, outlines of goals and walls by 3, what is quiet by less and in its order."""
    ground = theme.of(PAPER)
    found = {name: _contrast(theme.of(name), ground) for name in (INK, GOAL, WALL, LINE, TILE)}
    assert found[INK] > 7
    assert min(found[GOAL], found[WALL]) > 3
    assert found[INK] > found[WALL] > found[LINE] > found[TILE] > 1.05
    assert 1.2 < _contrast(theme.of(GHOST), ground) < 3
    assert 1.2 < _contrast(theme.of(PALE_GOAL), ground) < 3


def test_every_module_is_seen_on_dark_ground() -> None:
    """By its colour, or else by the rim around it."""
    ground, tile = DARK.of(PAPER), DARK.of(TILE)
    assert min(_contrast(DARK.rim, ground), _contrast(DARK.rim, tile)) > 5
    assert max(_contrast(colour, ground) for colour in palette(27)) > 5


def test_what_has_no_other_colour_stays() -> None:
    """Colours of modules are the same in both."""
    assert DARK.style({"facecolors": "none", "linewidths": 2, "colors": ["x"]}) == {
        "facecolors": "none",
        "linewidths": 2,
        "colors": ["x"],
    }
    assert LIGHT.of(INK) == INK
