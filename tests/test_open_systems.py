"""Nobody outside a system's own file asks which class, kind or name a system is."""

import ast
import re
from collections.abc import Iterator
from functools import cache

import pytest

from faces import ROOT, sources

OWN = (
    "protocol/cubepath/protocol/systems",
    "protocol/cubepath/protocol/scenes/families",
    "protocol/cubepath/protocol/scenes/registry.py",
)
"""The files of the systems, of the families whose systems they are, and the door for all."""
NAMES = {"drawing", "family", "spec", "table"}
"""What a system or its scene is called."""


@cache
def systems() -> set[str]:
    """Return the names of the kinds of systems, found by their bases; `System` itself is none."""
    classes = re.compile(r"^ *class (\w+)\(([^)]*)\)", re.MULTILINE)
    bases = {
        name: set(re.findall(r"[\w.]+", above))
        for source in sources().values()
        for name, above in classes.findall(source.path.read_text())
    }
    found = {"System"}
    while more := {name for name, above in bases.items() if above & found} - found:
        found |= more
    return found - {"System"}


def asked(tree: ast.AST, classes: set[str]) -> Iterator[tuple[int, str]]:
    """Yield line and text of each question for the class or the name of a system."""
    for node in ast.walk(tree):
        match node:
            case ast.Call(func=ast.Name(id="isinstance" | "issubclass"), args=[_, of]):
                known = {name.id for name in ast.walk(of) if isinstance(name, ast.Name)}
                known |= {name.attr for name in ast.walk(of) if isinstance(name, ast.Attribute)}
                wrong = bool(known & classes)
            case ast.Call(func=ast.Name(id="hasattr")):
                wrong = True
            case ast.Call(func=ast.Name(id="getattr"), args=[of, *_]):
                wrong = ast.unparse(of).rpartition(".")[2] == "system"
            case ast.Call(func=ast.Name(id="type"), args=[of]):
                wrong = ast.unparse(of).rpartition(".")[2] == "system"
            case ast.MatchClass(cls=of):
                wrong = ast.unparse(of).rpartition(".")[2] in classes
            case ast.Compare(left=left, comparators=others):
                sides = [left, *others]
                attributes = {side.attr for side in sides if isinstance(side, ast.Attribute)}
                texts = any(
                    isinstance(part, ast.Constant) and isinstance(part.value, str)
                    for side in sides
                    for part in ast.walk(side)
                )
                wrong = bool(attributes & NAMES) and texts
            case ast.Match(subject=ast.Attribute(attr=name)):
                wrong = name in NAMES
            case _:
                wrong = False
        if wrong:
            yield getattr(node, "lineno", 0), ast.unparse(node).partition("\n")[0]


def test_nobody_asks() -> None:
    """No isinstance, no match on a class, no hasattr, no comparison of a name, in any file."""
    classes = systems()
    assert {"LatticeSystem", "GraphSystem", "TabledSystem", "FlipSystem"} <= classes
    found = [
        f"{path}:{line}: {text}"
        for source in sources().values()
        if not (path := source.path.relative_to(ROOT).as_posix()).startswith(OWN)
        for line, text in asked(source.tree, classes)
    ]
    assert found == []


@pytest.mark.few(4)
@pytest.mark.parametrize(
    "source",
    [
        "isinstance(system, GraphSystem)",
        "isinstance(scene.system, (int, systems.LatticeSystem))",
        "issubclass(kind, TabledSystem)",
        "match system:\n    case FlipSystem():\n        pass",
        "hasattr(anything, 'catalogue')",
        "getattr(scene.system, 'plane', None)",
        "type(scene.system).__name__",
        "scene.family == 'arm'",
        "scene.system.drawing in ('edges', 'graph')",
        "match scene.family:\n    case 'arm':\n        pass",
    ],
)
def test_each_way_of_asking_is_seen(source: str) -> None:
    """The test above would find it."""
    assert list(asked(ast.parse(source), systems()))


def test_what_is_not_asking_is_left_alone() -> None:
    """A system may be built, and asked for what it says itself."""
    source = "GraphSystem(vertices, edges).graph is not None and isinstance(found, dict)"
    assert not list(asked(ast.parse(source), systems()))
