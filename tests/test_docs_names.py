"""Every name in backticks in the docs is one of the program; none is left of what was renamed."""

import re
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
NOT_OURS = frozenset(
    [
        "braced",
        "breakpoint",
        "concurrent",
        "crawl",
        "crossing",
        "direct",
        "Disabled",
        "dock",
        "f9c",
        "futures",
        "git",
        "grid24x24",
        "ipywidgets",
        "lambda",
        "NextStep",
        "pyutils",
        "references",
        "SameStep",
        "set_num_threads",
        "SourceInfo",
        "ssh",
        "stroll",
        "support_sites",
        "support_starts",
        "unwrapped",
        "viewed",
        "xxyx",
        "zenohd",
    ]
)
"""Of gymnasium, torch, MCAP and other programs; and examples of values and files."""
_PLACEHOLDER = re.compile(r"[A-Z_]+|\w+_([A-Z]+|\d+)|\w+_|xNN")


def words(text: str) -> list[str]:
    """Return what may be names in a text, of three letters or more."""
    return re.findall(r"[A-Za-z_]\w\w+", text)


_PROSE = re.compile(r'^ *r?"""(?:(?!""").)*"""|#[^\n]*', re.DOTALL | re.MULTILINE)


def names_in(path: Path) -> list[str]:
    """Return the words of a file of Python that stand neither in docstrings nor in comments."""
    return words(_PROSE.sub("", path.read_text()))


@cache
def known() -> frozenset[str]:
    """Return all names of the program, of its pages and of the examples in the docs."""
    found = set(NOT_OURS)
    for folder in ("protocol", "agents", "coordinator", "docs", "tests"):
        for path in (ROOT / folder).rglob("*"):
            found.update(words(str(path.relative_to(ROOT))))
            if path.suffix == ".py" and folder != "tests":
                found.update(names_in(path))
            elif path.suffix in {".js", ".html", ".toml", ".json"} and path.is_file():
                found.update(words(path.read_text()))
    found.update(words((ROOT / "pyproject.toml").read_text()))
    return frozenset(found)


@pytest.mark.parametrize("page", PAGES, ids=[page.stem for page in PAGES])
def test_every_name_of_a_page_is_one_of_the_program(page: Path) -> None:
    """In backticks within a line; blocks of code are run by another test."""
    text = re.sub(r"```.*?```", "", page.read_text(), flags=re.DOTALL)
    spans = re.findall(r"`([^`\n]+)`", text)
    named = {word for span in spans for word in words(span) if not _PLACEHOLDER.fullmatch(word)}
    assert named - known() == set()
