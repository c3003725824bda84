"""The documentation site: ``sphinx-build -W docs site`` writes it to the folder ``site``.

Its pages are the Markdown files in this folder, as they stand. Three lines in them are replaced
when the site is built: ``<!-- commands -->`` and ``<!-- names -->`` by references that are read off
the program, and ``<!-- gallery -->`` by the pictures that `gallery` draws.
"""

import argparse
import ast
import inspect
import re
import sys
from collections.abc import Iterator
from functools import cache
from importlib import import_module, metadata
from pathlib import Path

from pygments.lexers.data import JsonLexer
from sphinx.application import Sphinx
from sphinx.pycode import ModuleAnalyzer

from cubepath.coordinator.commands.usage import Parser
from cubepath.coordinator.plugins import COMMANDS, add_options_of

sys.path.insert(0, str(Path(__file__).parent))
import gallery

project = "cubepath"
author = "The cubepath developers"
release = version = metadata.version("cubepath")
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "sphinx_copybutton"]
exclude_patterns = ["examples", "studies"]
html_theme = "furo"
html_title = f"cubepath {release}"
html_show_sourcelink = False
myst_enable_extensions = ["deflist"]
myst_heading_anchors = 3
# A single backtick is code in docstrings, as in Markdown.
default_role = "code"
# "--seed" in a help text must stay as you type it.
smartquotes = False
autodoc_typehints = "signature"
autodoc_member_order = "bysource"
copybutton_prompt_text = "$ "

_FACES = (
    "cubepath.agents",
    "cubepath.coordinator",
    "cubepath.coordinator.testing",
    "cubepath.protocol",
)

_LINK = re.compile(r"(?<!!)\[([^]]+)\]\((?!https?:|#)([^)#]+)(?:#[^)]*)?\)")
"""A link to a file."""


def _options_of(command: str) -> Iterator[str]:
    """Yield a command's arguments and options as a definition list in Markdown."""
    parser = Parser(prog=f"cubepath {command}")
    add_options_of(command)(parser)
    shown = [action for action in parser._actions if action.help != argparse.SUPPRESS]
    for action in shown:
        if action.dest == "help":
            continue
        value = action.metavar or (action.dest.upper() if action.nargs != 0 else "")
        if action.choices:
            value = "{" + ",".join(map(str, action.choices)) + "}"
        names = [f"{name} {value}".strip() for name in action.option_strings] or [str(value)]
        yield ", ".join(f"`{name}`" for name in names)
        words = parser._get_formatter()._expand_help(action) if action.help else ""
        yield f": {words}\n"


def commands() -> str:
    """Return the reference of the command line, read off its parsers."""
    lines = list[str]()
    for name, (_, summary) in COMMANDS.items():
        lines += [f"## {name}", f"`cubepath {name}`: {summary}.\n", *_options_of(name)]
    return "\n".join(lines)


def names() -> str:
    """Return the reference of the public names, read off the four packages."""
    lines = list[str]()
    for package in _FACES:
        module = import_module(package)
        lines += [f"## {package}", f"{inspect.getdoc(module)}\n", "```{eval-rst}"]
        for name in sorted(module.__all__):
            lines += [*_entry(package, name), ""]
        lines.append("```\n")
    return "\n".join(lines)


def _entry(package: str, name: str) -> list[str]:
    """Return the directives that document a name, in reStructuredText."""
    found = getattr(import_module(package), name)
    comments = ModuleAnalyzer.for_module(_homes(package)[name]).find_attr_docs()
    if comment := comments.get(("", name)):
        return [f".. py:data:: {package}.{name}", "", *(f"   {line}" for line in comment)]
    if inspect.isclass(found):
        return [f".. autoclass:: {package}.{name}", "   :members:"]
    return [f".. autofunction:: {package}.{name}"]


@cache
def _homes(package: str) -> dict[str, str]:
    """Return the module that defines each name of a package, from the package's stub."""
    stub = Path(str(import_module(package).__file__)).with_suffix(".pyi")
    return {
        alias.name: str(statement.module)
        for statement in ast.parse(stub.read_text("utf-8")).body
        if isinstance(statement, ast.ImportFrom)
        for alias in statement.names
    }


def _link_in_site(link: re.Match[str], pages: Path) -> str:
    """Return a link to a page as it is, and of one to a file of the repository only the text."""
    text, target = link.groups()
    return link[0] if (pages / target).parent == pages and target.endswith(".md") else text


def _fill(app: Sphinx, _page: str, source: list[str]) -> None:
    pages = Path(app.srcdir)
    source[0] = _LINK.sub(lambda link: _link_in_site(link, pages), source[0])
    for line, made in (("commands", commands), ("names", names)):
        if (mark := f"<!-- {line} -->") in source[0]:
            source[0] = source[0].replace(mark, made())
    if (mark := "<!-- gallery -->") in source[0]:
        source[0] = source[0].replace(mark, gallery.grid(Path(app.outdir)))


def setup(app: Sphinx) -> None:
    """Have the marked lines filled before a page is read."""
    app.add_lexer("jsonl", JsonLexer)
    app.connect("source-read", _fill)
