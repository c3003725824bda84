"""What never changes in a picture that moves."""

import pytest

from cubepath.agents.rendering.pictures import still
from cubepath.protocol.core.sites import Site
from cubepath.protocol.core.system import System
from cubepath.protocol.scenes.specs import scene_from_spec


def test_words_on_a_colour_are_the_same_on_dark_ground() -> None:
    """They are dark on what is pale and white on what is dark, and no roles of a theme."""
    faces = {op["face"] for op in still(scene_from_spec("words")).before.ops if op["op"] == "word"}
    assert faces == {"#22252aff", "#ffffffff"}
    chords = still(scene_from_spec("polygon:n=6"))
    names = [op for op in (*chords.behind.ops, *chords.before.ops) if op["op"] == "word"]
    assert {op["face"] for op in names} == {"ink"}


@pytest.mark.parametrize(("count", "drawn"), [(12, True), (1000, False)])
def test_cells_that_are_too_many_to_be_drawn_are_not_looked_for(
    count: int, drawn: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The ground of a line of a thousand modules has half a million cells."""
    scene = scene_from_spec(f"hex:n={count}")
    asked: list[object] = []
    has_place = type(scene.system).has_place

    def ask(system: System, place: Site) -> bool:
        asked.append(place)
        return has_place(system, place)

    monkeypatch.setattr(type(scene.system), "has_place", ask)
    ground = still(scene).behind.ops
    assert any(op["face"] == "tile" for op in ground if op["op"] == "fill") == drawn
    assert len(asked) < 10_000
