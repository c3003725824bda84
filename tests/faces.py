"""What the faces offer and which modules there are, read without importing anything."""

import ast
from dataclasses import dataclass
from functools import cache
from pathlib import Path

ROOT = Path(__file__).parent.parent
LARGE = ("protocol", "agents", "coordinator")
"""The three folders of sources."""
FACES = (*(f"cubepath.{large}" for large in LARGE), "cubepath.coordinator.testing")
"""The packages that users import from."""


@dataclass(frozen=True)
class Source:
    """One module of the project."""

    path: Path
    module: str

    @property
    def tree(self) -> ast.Module:
        """Return the syntax tree."""
        return _tree(self.path)


@cache
def _tree(path: Path) -> ast.Module:
    return ast.parse(path.read_text("utf-8"))


@cache
def sources() -> dict[str, Source]:
    """Return all modules of the project by their dotted names."""
    found: dict[str, Source] = {}
    for large in LARGE:
        for path in sorted((ROOT / large / "cubepath").rglob("*.py")):
            parts = path.relative_to(ROOT / large).with_suffix("").parts
            name = ".".join(parts[:-1] if parts[-1] == "__init__" else parts)
            found[name] = Source(path, name)
    return found


def packages() -> list[str]:
    """Return the packages directly inside the three folders."""
    return [
        name
        for name, source in sources().items()
        if source.path.name == "__init__.py" and name.count(".") == len(("large", "package"))
    ]


@cache
def offered(face: str) -> dict[str, str]:
    """Return for each name in the stub of a face the module that it comes from."""
    return {
        alias.name: statement.module or ""
        for statement in _tree(sources()[face].path.with_suffix(".pyi")).body
        if isinstance(statement, ast.ImportFrom)
        for alias in statement.names
    }
