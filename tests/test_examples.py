"""What the three large faces offer is shown by an example; every example of the project holds."""

import doctest
import importlib
import inspect
import re
import shutil
from pathlib import Path
from typing import Any, cast

import pytest

from faces import FACES, ROOT, sources
from pasted import blocks

PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
ELSEWHERE = {"sb3_env": "cubepath.agents.environments.sb3"}
"""Whose examples take torch, in which modules: tests/agents/environments/test_sb3.py runs them."""


def offered() -> dict[str, object]:
    """Return the functions and classes of the three faces by their names."""
    found: dict[str, object] = {}
    for face in FACES[:3]:
        package = importlib.import_module(face)
        found |= {name: getattr(package, name) for name in package.__all__}
    return {
        name: each
        for name, each in found.items()
        if inspect.isclass(each) or inspect.isfunction(inspect.unwrap(cast("Any", each)))
    }


def documented(value: object) -> str:
    """Return the docstrings of a function, or of a class and its public methods."""
    members = vars(value).items() if inspect.isclass(value) else ()
    texts = [inspect.getdoc(each) for name, each in members if not name.startswith("_")]
    return "\n".join(text for text in [inspect.getdoc(value), *texts] if text)


def shown_on_pages() -> set[str]:
    """Return the names in blocks of Python on the pages, which `tests/test_docs.py` runs."""
    code = [block.text for page in PAGES for block in blocks(page) if block.language == "python"]
    return set(re.findall(r"\w+", "\n".join(code)))


def test_functions_are_shown() -> None:
    """By an example in the docstring, or in a block of Python on a page."""
    on_pages = shown_on_pages()
    assert [
        name
        for name, value in offered().items()
        if not inspect.isclass(value) and ">>>" not in documented(value) and name not in on_pages
    ] == []


def written() -> list[doctest.DocTest]:
    """Return the examples in all modules; they may name what the faces offer."""
    finder = doctest.DocTestFinder(exclude_empty=True)
    found: list[doctest.DocTest] = []
    for name, source in sources().items():
        if name in ELSEWHERE.values() or (count := source.path.read_text().count(">>> ")) == 0:
            continue
        module = importlib.import_module(name)
        here = finder.find(module, name, globs={**offered(), **vars(module)})
        assert sum(len(test.examples) for test in here) == count, name
        found += here
    return found


def held(test: doctest.DocTest, before: dict[str, object]) -> set[str]:
    """Return the types, and their bases, of what an example names and looks into or calls."""
    text = "\n".join(each.source for each in test.examples)
    return {
        base.__name__
        for name, value in test.globs.items()
        if before.get(name) is not value and re.search(rf"\b{name}\.\w", text)
        for base in type(value).__mro__
    }


@pytest.mark.thorough
@pytest.mark.timeout(600)  # all of them are one test
def test_examples_hold_and_show_the_classes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """All are run, in a folder with the golden recordings.

    A class is shown by an example of its own, on a page, or where an example of what makes it holds
    an instance and looks into it.
    """
    (tmp_path / "logs").mkdir()
    shutil.copytree(ROOT / "logs" / "golden", tmp_path / "logs" / "golden")
    monkeypatch.chdir(tmp_path)
    runner = doctest.DocTestRunner(optionflags=doctest.ELLIPSIS)
    told: list[str] = []
    shown = shown_on_pages()
    shown |= {name for name, value in offered().items() if ">>>" in documented(value)}
    for test in written():
        before = dict(test.globs)
        runner.run(test, out=told.append, clear_globs=False)
        shown |= held(test, before)
    assert runner.tries > 300
    assert not runner.failures, "".join(told)
    assert {name for name, each in offered().items() if inspect.isclass(each)} <= shown
