"""The families of scenes that come with the project, each loaded when it is first looked up.

The entry point ``cubepath`` of the group ``cubepath.systems`` names them, as `FAMILIES`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from functools import partial
from importlib import import_module
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from cubepath.protocol.core.system import System

if TYPE_CHECKING:  # it imports this module
    from cubepath.protocol.scenes.registry import Family

_FAMILIES = {
    "hexagons": ("hex", "hex-open", "hex-tunnel"),
    "shapes": ("sliding", "hex-shapes", "sliding-shapes"),
    "vehicles": ("agv", "agv-labelled"),
    "arms": ("arm", "arm-free", "arms"),
    "triangulations": ("polygon", "triangulation"),
    "words": ("words",),
    "assembly": ("assembly",),
    "compression": ("compression",),
}
"""The names of families by module, in the order in which they are listed."""
_PAGES = (
    "hex-connected",
    "sliding-cubes",
    "sliding-cubes-connected",
    "pivoting-cubes",
    "rolling-dodecahedra",
)
"""The names of families that are pages, in the folder ``catalogues``."""
_KINDS = {
    "lattice": ("lattice", "LatticeSystem"),
    "graph": ("graph", "GraphSystem"),
    "listed": ("listed", "TabledSystem"),
    "triangulation": ("flips", "FlipSystem"),
}
"""The module and the name of each class of systems, by the name of its TOML table."""
_Value = TypeVar("_Value")


class OnDemand(Mapping[str, _Value], Generic[_Value]):
    """Values by name, each loaded when it is first looked up."""

    def __init__(self, loaders: Mapping[str, Callable[[], _Value]]) -> None:
        """Load nothing yet."""
        self._loaders = loaders
        self._loaded: dict[str, _Value] = {}

    def __getitem__(self, name: str) -> _Value:
        """Return the value of this name."""
        if name not in self._loaded:
            self._loaded[name] = self._loaders[name]()
        return self._loaded[name]

    def __contains__(self, name: object) -> bool:
        """Return whether there is a value of this name, without loading it."""
        return name in self._loaders

    def __iter__(self) -> Iterator[str]:
        """Return the names."""
        return iter(self._loaders)

    def __len__(self) -> int:
        """Return the number of names."""
        return len(self._loaders)


def _family(module: str, name: str) -> Family:
    families: tuple[Family, ...] = import_module(f"{__package__}.{module}").FAMILIES
    return next(family for family in families if family.name == name)


def _page(name: str) -> Family:
    pages = import_module("cubepath.protocol.scenes.built_in_pages")
    family: Family = pages.page_family(name)
    return family


def _kind(module: str, name: str) -> type[System]:
    found: type[System] = getattr(import_module(f"cubepath.protocol.systems.{module}"), name)
    return found


OWN_FAMILIES: OnDemand[Family] = OnDemand(
    {name: partial(_family, module, name) for module, names in _FAMILIES.items() for name in names}
    | {name: partial(_page, name) for name in _PAGES}
)
OWN_KINDS = OnDemand[type[System]](
    {table: partial(_kind, *where) for table, where in _KINDS.items()}
)
"""The project's own classes of systems, by the name of their TOML table."""


def __getattr__(name: str) -> Any:
    if name != "FAMILIES":
        message = f"module {__name__!r} has no attribute {name!r}"
        raise AttributeError(message, name=name)
    return tuple(OWN_FAMILIES.values())
