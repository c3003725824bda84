"""What notebooks show: figures and pictures of each class, and something of whatever is wrong."""

import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from random import Random
from types import SimpleNamespace
from typing import Any

import pytest

from cubepath.agents.environments.rollouts import play, play_free
from cubepath.coordinator.experiments.report import write_report
from cubepath.coordinator.experiments.sweeping import SweepResults, sweep
from cubepath.coordinator.runs.outcome import Outcome
from cubepath.coordinator.runs.run import run
from cubepath.coordinator.shortening.normal_path import shorten
from cubepath.coordinator.testing.log import RunLog
from cubepath.coordinator.theory.complexes.exploration import explore
from cubepath.coordinator.theory.complexes.shape_complexes import shape_complex
from cubepath.coordinator.theory.complexes.state_complexes import StateComplex, state_complex
from cubepath.coordinator.tools.notebooks import DISPLAYS, MOVES_MAX, RUNS_MAX, html_of, text_of
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.path_files.moves import read_moves
from cubepath.protocol.recordings.cutting import filter_recording, split_recording
from cubepath.protocol.recordings.description import KEYS_FORMAT
from cubepath.protocol.recordings.recording import Recording, read_recording
from cubepath.protocol.scenes.specs import scene_from_spec
from processes.command_line import GOLDEN, here
from samples.recordings import new_path, recorded

HEX = GOLDEN / "hex-5.mcap"


def the_complex() -> StateComplex:
    return state_complex(explore(scene_from_spec("agv:graph=K4,n=2")))


def the_outcome(**options: Any) -> Outcome:
    plan: Any = {"processes": 0, "log": str(new_path()), **options}
    return run("hex:n=3", **plan)


VALUES: dict[str, tuple[Callable[[], object], str]] = {
    "FreeRollout": (lambda: play_free("hex:n=3", seed=1), "turns"),
    "Outcome": (the_outcome, "hex:n=3, rule chain, seed 0"),
    "Recording": (lambda: read_recording(HEX), "chain, seed 13, hesitate 0.3"),
    "Rollout": (lambda: play("hex:n=3"), "rounds"),
    "RunLog": (lambda: RunLog.read(HEX), "the goal was reached"),
    "Scene": (lambda: scene_from_spec("hex:n=3"), "3 sites"),
    "ShapeComplex": (lambda: shape_complex(scene_from_spec("hex:n=3")), "hex:n=3"),
    "Shortened": (lambda: shorten(play("hex:n=3")), "reduced moves"),
    "StateComplex": (the_complex, "Euler characteristic"),
    "SweepResults": (lambda: sweep("hex:n=3", seeds=2), "runs"),
    "SweepReport": (lambda: write_report(swept().folder or ""), "report.html"),
}
"""A value of each class that shows itself, and what its figures say."""


def swept() -> SweepResults:
    return sweep("hex:n=3", seeds=2, out=new_path(""))


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(DISPLAYS))
def test_each_class_shows_its_figures_and_a_picture(name: str) -> None:
    """As HTML in a notebook, and the figures as text elsewhere."""
    make, says = VALUES[name]
    value: Any = make()
    assert type(value).__name__ == name
    html = value._repr_html_()
    assert html.startswith("<table>")
    assert says in html
    assert '<img style="max-width:' in html
    assert "no picture" not in html
    assert says in text_of(value)


def test_the_figures_of_a_run_are_those_that_the_command_prints() -> None:
    """Line by line, but for the time that it took and the name of its log."""
    printed = here("run", "hex:n=3", "--processes", "0", "--log", str(new_path())).stdout
    shown = text_of(the_outcome())
    lines = [
        [each for each in text.splitlines() if not each.startswith(("time", "log"))]
        for text in (printed, shown)
    ]
    assert lines[0] == lines[1]


def test_what_failed_is_shown_with_its_reason() -> None:
    """A run that failed has its error among the figures."""
    failed = replace(the_outcome(), error="module_0: <lost>", moves=MOVES_MAX + 1)
    assert "module_0: &lt;lost&gt;" in html_of(failed)


@pytest.mark.slow
def test_a_run_without_rounds_has_a_picture_too() -> None:
    """Its steps are levels."""
    assert "<img" in html_of(the_outcome(clock="free", processes=1))


@pytest.mark.slow
def test_of_what_is_large_the_figures_alone_are_shown() -> None:
    """A picture of a million moves would take minutes."""
    outcome = replace(the_outcome(), moves=10**6)
    html = html_of(outcome)
    assert "<img" not in html
    assert "none: over 2000 moves or 100 modules" in html
    many = scene_from_spec("agv:graph=grid20x20,n=150")
    assert "<img" not in html_of(many)
    vertices = state_complex(explore(scene_from_spec("agv:graph=grid4x4,n=4")))
    assert "no picture: 1820 vertices to draw, expected at most 1500" in html_of(vertices)
    runs = SweepResults(sweep("hex:n=2", seeds=1).rows * (RUNS_MAX + 1))
    assert "<img" not in html_of(runs)


@pytest.mark.slow
def test_nothing_is_html_that_comes_from_an_input() -> None:
    """Names of systems, paths and parameters are escaped, and control characters shown."""
    bad = "<script>\x1b[0m"
    scene = replace(scene_from_spec("hex:n=2"), spec=bad)
    recording = read_recording(HEX)
    parameters = {**recording.parameters, "rule": bad, bad: bad}
    problem = replace(recording, parameters=parameters, problems=(bad,), path=Path(bad))
    rows = sweep("hex:n=2", seeds=1).rows
    runs = SweepResults(tuple(row | {"system": bad, "rule": bad} for row in rows))
    for value in (scene, problem, runs):
        html = html_of(value)
        assert "<script" not in html
        assert "&lt;script&gt;" in html
        assert value is runs or "\x1b" not in html


def parts() -> list[Recording]:
    """Return recordings that are not whole: a part of one, one without reports, one on any keys."""
    recording = recorded("hex:n=4")
    folder = new_path("")
    split_recording(recording.path, folder, parts=3)
    filter_recording(recording.path, filtered := new_path(), topics=["go"])
    return [
        *map(read_recording, sorted(folder.glob("*.mcap"))),
        read_recording(filtered),
        replace(recording, stored_scene=None, format=KEYS_FORMAT),
        replace(recording, stored_scene=None),
    ]


@pytest.mark.slow
def test_a_recording_that_is_not_whole_is_shown_as_far_as_it_goes() -> None:
    """Of the first part there is a picture, of others a line on why there is none."""
    shown = [html_of(each) for each in parts()]
    assert ["<img" in each for each in shown] == [True, *[False] * 5]
    assert "no picture: " in shown[1]
    assert "expected a recording from the start" in shown[1]
    assert all(each.startswith("<table>") for each in shown)


def test_a_subclass_is_shown_as_its_class_is() -> None:
    """Tests extend `RunLog`."""

    class OwnLog(RunLog):
        pass

    assert "the goal was reached" in text_of(OwnLog.read(HEX))


def test_a_recording_whose_file_is_gone_says_so() -> None:
    """Messages are read when they are asked for."""
    path = new_path()
    path.write_bytes(HEX.read_bytes())
    recording = read_recording(path)
    path.write_bytes(b"")
    assert html_of(recording).startswith("<table>")


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(6))
def test_a_damaged_recording_is_shown(seed: int) -> None:
    """Some bytes are others, or its end is missing; whatever can be opened is shown."""
    random = Random(seed)  # noqa: S311 - nothing secret
    data = bytearray(HEX.read_bytes())
    for _ in range(random.randint(1, 8)):
        data[random.randrange(len(data))] = random.randrange(256)
    path = new_path()
    path.write_bytes(data[: random.choice([len(data), random.randrange(len(data))])])
    try:
        recording = read_recording(path)
    except InputError:
        return
    assert html_of(recording).startswith("<table>")
    assert text_of(recording)


def test_a_path_without_sites_says_why_it_has_no_picture(tmp_path: Path) -> None:
    """Moves may name supports and traces alone."""
    path = tmp_path / "moves.jsonl"
    path.write_text('{"id": "a", "support": [[0, 0]], "trace": [[0, 0]]}\n')
    assert len(list(read_moves(path))) == 1
    assert "no picture: " in html_of(shorten(path))


def test_in_a_list_a_value_is_shown_by_its_repr() -> None:
    """A table would tear the list apart."""
    printed: list[str] = []
    scene = scene_from_spec("hex:n=2")
    for depth in (1, 2):
        printer = SimpleNamespace(stack=[0] * depth, text=printed.append)
        scene._repr_pretty_(printer, False)
    assert printed == [text_of(scene), repr(scene)]


@pytest.mark.slow
def test_matplotlib_is_loaded_only_for_a_picture() -> None:
    """Figures as text, and those of what is large, need none."""
    code = (
        "import sys; from cubepath.protocol import scene_from_spec\n"
        "from cubepath.coordinator.tools.notebooks import text_of\n"
        "text_of(scene_from_spec('hex:n=3')); scene_from_spec('hex:n=300')._repr_html_()\n"
        "assert 'matplotlib' not in sys.modules"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
