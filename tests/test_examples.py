"""What the three large faces offer is shown by an example, and each example holds."""

from __future__ import annotations

import doctest
import importlib
import inspect
import re
import shutil
import sys
from pathlib import Path

import pytest

from faces import ROOT, large_faces
from pasted import blocks

PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
ELSEWHERE = {"sb3_env"}
"""Whose examples take torch: tests/agents/environments/test_sb3.py."""
UNSHOWN = """
    Beyond Bound Catalogue Certificate CheckError Checked Claim Collapsed Converted CubepathEnv
    CubepathError CubepathVectorEnv CubicalComplex Durations ExcludedError Explored Family
    FaultRates Finding FlipSystem FreeEnv FreePlayed FreeRule Gatherer Generator
    GeneratorPlacement GraphSystem Homology Improved Lattice Lift Links Macro Move Optimum
    Overheard PathInput PathMove Plan PlanHints Played PlayedMany Record RecordingWriter
    Recovered Replayed Report Row RuleError Running Scene ShapeComplex Shortened
    StandardInstance StateComplex Status Surface Sweep SweepResults TabledSystem Tap Task
    TimedLine Timetable Transitions VectorActors VehicleGraph Verification Ways all_claims
    animate audit beyond check_certificate check_rule collapse complex_from_faces compute_claims
    contractibility convert draw_complex draw_pixels durations_of observe only_class optimum
    raw_env read_certificate read_durations read_plan read_scene read_timetable recover replay
    run_picture shape_complex surface task_of timetable_schema unfilled verify write_certificate
    write_complex write_cubes write_moves write_report write_timetable
"""
"""Functions and classes without an example as yet: whoever writes one takes the name out."""


def offered() -> dict[str, object]:
    """Return the functions and classes of the three faces by their names."""
    found: dict[str, object] = {}
    for face in large_faces():
        package = importlib.import_module(face)
        found |= {name: getattr(package, name) for name in package.__all__}
    return {
        name: each
        for name, each in found.items()
        if inspect.isclass(each) or inspect.isfunction(each)
    }


def documented(value: object) -> str:
    """Return the docstrings of a function, or of a class and its public methods."""
    members = vars(value).items() if inspect.isclass(value) else ()
    texts = [inspect.getdoc(each) for name, each in members if not name.startswith("_")]
    return "\n".join(text for text in [inspect.getdoc(value), *texts] if text)


def test_what_is_offered_is_shown() -> None:
    """By an example in its docstring, or in a block of Python on a page; the rest are known."""
    code = "\n".join(
        block.text for page in PAGES for block in blocks(page) if block.language == "python"
    )
    missing = {
        name
        for name, value in offered().items()
        if ">>>" not in documented(value) and not re.search(rf"\b{name}\b", code)
    }
    assert missing == set(UNSHOWN.split())


@pytest.mark.slow
def test_examples_of_docstrings_hold(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """In an empty folder with the golden recordings; all of them are run."""
    (tmp_path / "logs").mkdir()
    shutil.copytree(ROOT / "logs" / "golden", tmp_path / "logs" / "golden")
    monkeypatch.chdir(tmp_path)
    finder, runner = doctest.DocTestFinder(), doctest.DocTestRunner(optionflags=doctest.ELLIPSIS)
    told: list[str] = []
    for name, value in offered().items():
        if name in ELSEWHERE or ">>>" not in documented(value):
            continue
        module = sys.modules[value.__module__]
        for test in finder.find(value, name, module, {**offered(), **vars(module)}):
            runner.run(test, out=told.append, clear_globs=False)
    assert runner.tries > 40
    assert not runner.failures, "".join(told)
