"""Faces: packages that offer names of their modules, each loaded on first access.

The face of a package is its ``__init__``. It imports the names for type checkers only; at run time
it has the two functions of PEP 562 that are made here. So importing a package costs nothing, and
accessing a name loads only what that name needs: a module process never loads PettingZoo, nor a
shortening matplotlib.

A name added to a face is written in three places: where type checkers look, where Python looks, and
in ``__all__``. tests/test_faces.py checks that the three agree.

Room: protocol, outside its inner rooms: every face of every room imports it. It imports nothing.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from importlib import import_module
from typing import Any


def lazy_face(
    package: str, homes: Mapping[str, str]
) -> tuple[Callable[[str], Any], Callable[[], list[str]]]:
    """Return the ``__getattr__`` and the ``__dir__`` of a package that offers names.

    Args:
        package: the ``__name__`` of the package.
        homes: for each module, by its name inside the package, the names that it offers,
            separated by spaces. No name may equal that of a module of the package, which would
            take its place once imported.

    Returns:
        The two module functions of PEP 562. The first raises AttributeError for a name that is not
        offered. A name that was loaded becomes a plain attribute of the package.

    >>> import cubepath.protocol.core
    >>> get, names = lazy_face("cubepath.protocol.core", {"actions": "Action commute"})
    >>> get("commute").__module__
    'cubepath.protocol.core.actions'
    """
    home_of = {
        name: f"{package}.{module}" for module, names in homes.items() for name in names.split()
    }

    def load(name: str) -> Any:
        face = sys.modules[package]
        if name not in home_of:
            message = f"module {package!r} has no attribute {name!r}"
            raise AttributeError(message, name=name, obj=face)
        found = getattr(import_module(home_of[name]), name)
        setattr(face, name, found)
        return found

    def names() -> list[str]:
        return sorted({*vars(sys.modules[package]), *home_of})

    return load, names
