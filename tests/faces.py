"""What the faces of the rooms say, read from their sources without importing anything."""

from __future__ import annotations

import ast
from dataclasses import dataclass
from functools import cache
from pathlib import Path

ROOT = Path(__file__).parent.parent
LARGE = ("protocol", "agents", "coordinator")
"""The three large rooms; all others lie in one of them."""
FOR_USERS = ("cubepath.coordinator.testing",)
"""The rooms whose own faces users import from: their names would say too little on a large one."""


@dataclass(frozen=True)
class Source:
    """One module of the project."""

    path: Path
    module: str

    @property
    def is_face(self) -> bool:
        """Tell whether this is the ``__init__`` of a package."""
        return self.path.name == "__init__.py"

    @property
    def tree(self) -> ast.Module:
        """Return the syntax tree."""
        return _tree(self.path)


@cache
def _tree(path: Path) -> ast.Module:
    return ast.parse(path.read_text("utf-8"))


@cache
def sources() -> dict[str, Source]:
    """Return all modules of the project by their dotted names; a package is its face."""
    found: dict[str, Source] = {}
    for large in LARGE:
        for path in sorted((ROOT / large / "cubepath").rglob("*.py")):
            parts = path.relative_to(ROOT / large).with_suffix("").parts
            name = ".".join(parts[:-1] if parts[-1] == "__init__" else parts)
            found[name] = Source(path, name)
    return found


def large_faces() -> list[str]:
    """Return the names of the three large rooms."""
    return [f"cubepath.{large}" for large in LARGE]


@cache
def rooms() -> list[str]:
    """Return the names of the rooms inside the large ones."""
    return [
        name
        for name, source in sources().items()
        if source.is_face and name.count(".") == len(("cubepath", "large", "room")) - 1
    ]


def room_of(module: str) -> str | None:
    """Return the room that a module lies in; None for a large face and what is of no room."""
    return next((room for room in rooms() if f"{module}.".startswith(f"{room}.")), None)


@cache
def offered(face: str) -> dict[str, str]:
    """Return for each name that a face imports for type checkers the module it imports it from."""
    return {
        alias.name: statement.module or ""
        for branch in sources()[face].tree.body
        if isinstance(branch, ast.If)
        for statement in branch.body
        if isinstance(statement, ast.ImportFrom)
        for alias in statement.names
    }


def home(face: str, name: str) -> str:
    """Return the module that defines a name which a face offers, by way of the face of a room."""
    found = offered(face)[name]
    return home(found, name) if sources()[found].is_face else found
