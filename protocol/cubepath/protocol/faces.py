"""Faces: the four packages that users import from, with names loaded on first access.

The names of a face are listed once, in the stub ``__init__.pyi`` beside its ``__init__.py``, where
type checkers and Python both read them. So importing a face costs nothing, and accessing a name
loads only what that name needs: a module process never loads PettingZoo, nor shortening matplotlib.
"""

import ast
import sys
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any


def lazy_face(package: str) -> tuple[Callable[[str], Any], Callable[[], list[str]], list[str]]:
    """Return the ``__getattr__``, the ``__dir__`` and the ``__all__`` of a package.

    Args:
        package: the ``__name__`` of a package with a stub, which imports each name that it offers
            from the module that defines it. No name may equal that of a module of the package,
            which would take its place once imported.

    Returns:
        The two module functions of PEP 562, and the names in the order of the stub. The first
        function raises AttributeError for a name that is not offered. A name that was loaded
        becomes a plain attribute of the package.

    >>> import cubepath.agents
    >>> get, _, names = lazy_face("cubepath.agents")
    >>> "observe" in names, get("observe").__module__
    (True, 'cubepath.agents.local.observation')
    """
    face = sys.modules[package]
    stub = Path(str(face.__file__)).with_suffix(".pyi")
    home_of = {
        alias.name: statement.module
        for statement in ast.parse(stub.read_text("utf-8")).body
        if isinstance(statement, ast.ImportFrom) and statement.module
        for alias in statement.names
    }

    def load(name: str) -> Any:
        if name not in home_of:
            message = f"module {package!r} has no attribute {name!r}"
            raise AttributeError(message, name=name, obj=face)
        found = getattr(import_module(home_of[name]), name)
        setattr(face, name, found)
        return found

    def names() -> list[str]:
        return sorted({*vars(face), *home_of})

    return load, names, list(home_of)
