"""The link condition: checked from the cubes, with witnesses where it fails."""

import pytest

from cubepath.coordinator.theory.complexes.cubical_complex import CubicalComplex, complex_from_faces
from cubepath.coordinator.theory.complexes.exploration import explore
from cubepath.coordinator.theory.complexes.links import (
    actions_at,
    check_links,
    spans_cube,
    unfilled,
)
from cubepath.coordinator.theory.complexes.state_complexes import StateComplex, state_complex
from cubepath.protocol.scenes.specs import scene_from_spec


def built(spec: str) -> StateComplex:
    return state_complex(explore(scene_from_spec(spec)))


@pytest.mark.parametrize(
    "spec",
    ["arm:n=6", "agv:graph=K5,n=2", "agv-labelled:graph=C4,n=2", "polygon:n=6", "sliding:p=1,q=2"],
)
def test_it_holds_for_local_systems(spec: str) -> None:
    """The paper's theorem: every state complex of a local system is non-positively curved."""
    links = check_links(built(spec).complex)
    assert links.npc
    assert links.checked == built(spec).complex.f_vector[0]


def test_a_cube_without_its_inside_is_curved() -> None:
    """Taking the 3-cube out of the arm's complex makes its eight corners fail."""
    faces = built("arm:n=5").complex.faces
    links = check_links(CubicalComplex(faces[:3]))
    assert links.failures == 8
    assert all(failing.simplices == 0 and len(failing.ends) == 3 for failing in links.failing)


def test_three_squares_round_a_corner_are_curved() -> None:
    """Three edges at a vertex, any two of which span a square, and no cube."""
    # Vertex 0 with neighbours 1, 2, 3, and 4, 5, 6 across the three squares.
    edges = [[0, 1], [0, 2], [0, 3], [1, 4], [2, 4], [2, 5], [3, 5], [1, 6], [3, 6]]
    squares = [
        [[1, 3], [0, 4]],  # 0 1 2 4: direction 0 is fixed in edges 02 and 14
        [[2, 5], [1, 6]],
        [[2, 7], [0, 8]],
    ]
    complex_ = complex_from_faces([7, [[edge] for edge in edges], squares])
    complex_.check()
    links = check_links(complex_)
    assert links.failures == 1
    assert links.failing[0].vertex == 0
    assert [edge for edge, _ in links.failing[0].ends] == [0, 1, 2]
    assert "vertex 0: edges 0, 1, 2 bound no simplex" in str(links.failing[0])


def test_two_squares_on_the_same_edges_are_curved() -> None:
    """A pillow: four corners at each of which two edges bound two simplices."""
    edges = [[[0, 1]], [[2, 3]], [[0, 2]], [[1, 3]]]
    square = [[2, 3], [0, 1]]
    links = check_links(complex_from_faces([4, edges, [square, square]]))
    assert links.failures == 4
    assert links.failing[0].simplices == 2


def test_a_square_glued_to_a_cone_is_curved() -> None:
    """A simplex of the link that has a vertex twice is none."""
    # Both directions of the square leave its base along the same edge, a loop.
    links = check_links(complex_from_faces([1, [[[0, 0]]], [[[0, 0], [0, 0]]]]))
    assert not links.npc


def test_a_torus_from_one_square_is_flat() -> None:
    """A cube glued to itself, both edges loops: the link is a circle of four edges."""
    links = check_links(complex_from_faces([1, [[[0, 0]], [[0, 0]]], [[[0, 0], [1, 1]]]]))
    assert links.npc
    assert links.checked == 1


def test_it_fails_where_the_whole_has_a_say() -> None:
    """At the start of the non-local ring the definition and the minimal sets agree on a witness."""
    scene = scene_from_spec("hex-connected:scene=ring")
    missing = unfilled(scene, scene.start_state)
    assert missing
    for actions in missing:
        assert set(actions) <= set(actions_at(scene, scene.start_state))
        assert not spans_cube(scene, scene.start_state, actions)
        for action in actions:
            rest = [other for other in actions if other != action]
            assert spans_cube(scene, scene.start_state, rest)


@pytest.mark.parametrize("spec", ["arm:n=5", "agv:graph=C6,n=3", "polygon:n=7"])
def test_local_states_have_nothing_missing(spec: str) -> None:
    """The link of every state by the definition alone: any commuting set is a cube."""
    scene = scene_from_spec(spec)
    explored = explore(scene)
    for number in range(len(explored.states)):
        assert unfilled(scene, explored.state(number)) == []
