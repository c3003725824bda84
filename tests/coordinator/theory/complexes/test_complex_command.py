"""`cubepath complex`: what it says, in which form, with which exit code."""

import json
import sys
from pathlib import Path

import networkx as nx
import pytest

from cubepath.coordinator.commands.main import main
from cubepath.coordinator.theory.complexes.exploration import explore
from cubepath.coordinator.theory.complexes.export import VERTICES_MAX, to_networkx
from cubepath.coordinator.theory.complexes.report import complex_report
from cubepath.coordinator.theory.complexes.shape_complexes import shape_complex
from cubepath.coordinator.theory.complexes.state_complexes import state_complex
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.scenes.specs import scene_from_spec

Capture = pytest.CaptureFixture[str]


def answer(capture: Capture, *arguments: str, code: int = 0) -> dict[str, object]:
    assert main(["complex", *arguments, "--json"]) == code
    document: dict[str, object] = json.loads(capture.readouterr().out)
    return document


def test_all_that_is_asked_for_is_answered(capsys: Capture) -> None:
    """Counts, homology, links, contractibility of the arm with five segments."""
    found = answer(capsys, "arm:n=5", "--homology", "--link")
    assert found["states"] == 32
    assert found["f_vector"] == [32, 48, 18, 1]
    assert found["euler"] == 1
    assert found["betti"] == [1, 0, 0, 0]
    assert found["torsion"] == [[], [], [], []]
    assert found["betti_z2"] == [1, 0, 0, 0]
    assert found["npc"] is True
    assert found["links_checked"] == 32
    assert found["contractible"] is True


def test_what_is_not_asked_for_is_null(capsys: Capture) -> None:
    """Counts alone, and no claims about the rest."""
    found = answer(capsys, "agv:graph=K5,n=2")
    assert found["f_vector"] == [10, 30, 15]
    assert [found[key] for key in ("betti", "npc", "links_checked", "contractible")] == [None] * 4


def test_torsion_is_found(capsys: Capture) -> None:
    """A closed non-orientable surface has torsion 2, and one Betti number more mod 2."""
    found = answer(capsys, "agv:graph=K5,n=2", "--homology")
    assert found["torsion"] == [[], [2], []]
    assert found["betti_z2"] == [1, 7, 1]
    assert found["contractible"] is False
    assert found["surface"] == "closed non-orientable surface, Euler characteristic -5"


def test_the_shape_complex(capsys: Capture) -> None:
    """States up to translation."""
    found = answer(capsys, "hex:n=3", "--shape", "--link")
    assert found["complex"] == "shape complex"
    assert found["f_vector"] == [11, 24, 9]
    assert found["npc"] is True


def test_at_the_limit_it_stops_with_a_line(capsys: Capture) -> None:
    """Exit code 1; nothing is said of the complex but how many states were seen."""
    assert main(["complex", "hex:n=5", "--max-states", "50", "--homology", "--json"]) == 1
    seen = capsys.readouterr()
    found = json.loads(seen.out)
    assert found["complete"] is False
    assert found["f_vector"] is None
    assert found["betti"] is None
    assert seen.err.startswith("cubepath: hex:n=5: stopped at ")
    assert "raise --max-states" in seen.err


@pytest.mark.slow
def test_failing_links_are_told_with_the_moves(capsys: Capture) -> None:
    """A non-local system, only partly explored: three moves, any two of which span a square."""
    found = answer(capsys, "hex-connected:scene=ring", "--link", "--max-states", "1", code=1)
    assert found["local"] is False
    assert found["npc"] is False
    (first, *_) = found["witnesses"]  # type: ignore[misc]
    assert first.startswith("state 0: pivot-")  # type: ignore[has-type]
    assert main(["complex", "hex-connected:scene=ring", "--link", "--max-states", "1"]) == 1
    text = capsys.readouterr().out
    assert "(not a local system)" in text
    assert "non-positive curvature  no" in text


def test_a_whole_non_local_complex_is_built_from_legal_corners(capsys: Capture) -> None:
    """Small chains have links without gaps, and the system is still said not to be local."""
    found = answer(capsys, "hex-connected:n=3", "--link", "--homology")
    assert found["local"] is False
    assert found["complete"] is True
    assert found["npc"] is True


def test_a_complex_goes_to_json(tmp_path: Path, capsys: Capture) -> None:
    """States, actions, cubes by base and actions, and the faces."""
    path = tmp_path / "arm.json"
    answer(capsys, "arm:n=3", "-o", str(path))
    found = json.loads(path.read_text())
    assert found["format"] == "cubepath-complex-1"
    assert len(found["states"]) == 8
    assert [len(cubes) for cubes in found["cubes"]] == [8, 1]
    square = found["cubes"][1][0]
    labels = [found["actions"][action]["label"] for action in square["actions"]]
    assert len(set(labels)) == 2
    assert len(found["faces"][1][0]) == 2


def test_every_edge_can_be_made_again_from_the_file(tmp_path: Path, capsys: Capture) -> None:
    """The state at an edge's base shows end 0 but for free sites, and end 1 makes the other."""
    path = tmp_path / "slides.json"
    answer(capsys, "sliding:p=1,q=2", "-o", str(path))
    found = json.loads(path.read_text())
    states = [{json.dumps(site) for site in state} for state in found["states"]]
    for cube, faces in zip(found["cubes"][0], found["faces"][0], strict=True):
        action = found["actions"][cube["actions"][0]]
        support, free = ({json.dumps(site) for site in action[key]} for key in ("support", "free"))
        ends = [{json.dumps(site) for site in end} for end in action["ends"]]
        state = states[cube["base"]]
        assert state & (support - free) == ends[0]
        assert all(
            json.dumps(a) not in state or json.dumps(b) in state for a, b in action["guards"]
        )
        assert faces[0] == [cube["base"], states.index(state - ends[0] | ends[1])]


def test_where_nothing_can_be_written_nothing_is_computed(tmp_path: Path, capsys: Capture) -> None:
    """A folder that is not there is told before the work begins; a part is not written."""
    assert main(["complex", "arm:n=4", "-o", str(tmp_path / "no" / "arm.json")]) == 2
    seen = capsys.readouterr()
    assert seen.out == ""
    assert "there is no folder" in seen.err
    path = tmp_path / "part.json"
    assert main(["complex", "hex:n=4", "--max-states", "9", "-o", str(path)]) == 1
    assert "part.json was not written" in capsys.readouterr().err
    assert not path.exists()


def test_an_endless_lattice_is_told_as_such(capsys: Capture) -> None:
    """No limit would do: the advice is another complex, or something to hold on to."""
    assert main(["complex", "hex:n=3", "--max-states", "50"]) == 1
    assert "take --shape, or a scene with a base" in capsys.readouterr().err
    assert main(["complex", "arm:n=6", "--max-states", "50"]) == 1
    assert main(["complex", "agv:graph=K5,n=2", "--max-states", "3"]) == 1
    assert "take a smaller system" in capsys.readouterr().err


def test_too_many_shapes_are_told_as_too_many_states(capsys: Capture) -> None:
    """One JSON document all the same."""
    found = answer(capsys, "hex:n=5", "--shape", "--max-states", "20", code=1)
    assert found["complete"] is False
    assert found["complex"] == "shape complex"


@pytest.mark.parametrize("spec", ["arm:n=4", "agv:graph=P4,n=1", "agv:graph=grid2x2,n=4"])
@pytest.mark.parametrize("suffix", [".png", ".svg"])
def test_a_complex_is_drawn(spec: str, suffix: str, tmp_path: Path, capsys: Capture) -> None:
    """In the plane and in space, and a single point too."""
    path = tmp_path / f"picture{suffix}"
    answer(capsys, spec, "-o", str(path))
    assert path.stat().st_size > 1000


def test_what_is_too_large_is_not_drawn(tmp_path: Path, capsys: Capture) -> None:
    """Nobody could see anything."""
    assert main(["complex", "arm:n=12", "-o", str(tmp_path / "arm.png")]) == 2
    assert f"expected at most {VERTICES_MAX}" in capsys.readouterr().err


def test_the_skeleton_goes_to_networkx() -> None:
    """Nodes with their sites, edges with their moves; connected, as it was found from one state."""
    graph = to_networkx(state_complex(explore(scene_from_spec("arm:n=5"))))
    assert (graph.number_of_nodes(), graph.number_of_edges()) == (32, 48)
    assert nx.is_connected(graph)
    assert nx.diameter(graph) == 15  # from all up to all right: 5 + 4 + 3 + 2 + 1
    assert all("move" in data for _, _, data in graph.edges(data=True))
    shapes = to_networkx(shape_complex(scene_from_spec("hex:n=2")))
    assert (shapes.number_of_nodes(), shapes.number_of_edges()) == (3, 6)


def test_without_networkx_it_is_said_how_to_get_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """It is an extra: the message names it."""
    built = state_complex(explore(scene_from_spec("arm:n=2")))
    monkeypatch.setitem(sys.modules, "networkx", None)
    with pytest.raises(InputError, match=r"pip install 'cubepath\[networkx\]'"):
        to_networkx(built)


def test_progress_is_told_step_by_step() -> None:
    """States, links, homology, collapse, in this order."""
    told: list[str] = []
    complex_report(
        scene_from_spec("arm:n=5"),
        with_homology=True,
        with_links=True,
        progress=lambda what, _done, _total: told.append(what),
    )
    assert list(dict.fromkeys(told)) == ["states", "links", "homology", "collapse"]


@pytest.mark.parametrize(
    ("spec", "found"),
    [("agv:graph=P3,n=2", True), ("agv-labelled:graph=P3,n=2", False), ("compression:n=2", None)],
)
def test_whether_the_goal_is_among_the_states(spec: str, found: bool | None) -> None:
    """Labelled vehicles on a path cannot change places; some scenes have no goal."""
    report = complex_report(scene_from_spec(spec), max_states=50)
    assert report.goal is found


def test_a_goal_that_was_not_found_in_time_may_still_be_reached() -> None:
    """Until all states are known, nothing is said; unless it has been found."""
    assert complex_report(scene_from_spec("hex:n=4"), max_states=20).goal is None
    assert complex_report(scene_from_spec("agv:graph=P9,n=1"), max_states=4).goal is None
