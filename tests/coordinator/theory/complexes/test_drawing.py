"""Pictures of complexes say what their colours mean."""

from typing import Any, cast

import numpy as np
import pytest
from matplotlib.colors import to_hex

from cubepath.coordinator.theory.complexes import export as drawing


@pytest.mark.parametrize(
    ("largest", "words"),
    [
        ([2, 2], ["square in no 3-cube"]),
        ([3, 2, 3], ["square in no 3-cube", "in a 3-cube"]),
        ([4], ["in a 4-cube"]),
        ([5, 6, 7, 9], ["in a 5-cube", "in a 6-cube to 9-cube"]),
        ([], []),
    ],
)
def test_the_legend_has_the_colours_that_occur(largest: list[int], words: list[str]) -> None:
    """One entry a colour, in order of dimension, each with the colour of its squares."""
    entries = drawing._swatches(np.array(largest, dtype=np.int64))
    assert [entry.get_label() for entry in entries] == words
    shown = [to_hex(cast("Any", entry).get_facecolor()) for entry in entries]
    assert shown == list(dict.fromkeys(drawing._colour_in(k) for k in sorted(largest)))
