"""The families of scenes that come with the project, in the order in which they are listed.

A family and the class of its systems are imported when they are asked for. The entry point
``cubepath`` of the group ``cubepath.systems`` names all of them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from importlib import import_module
from typing import Any, TypeVar

from cubepath.protocol.core.system import System
from cubepath.protocol.scenes.family import Family

_T = TypeVar("_T")


class _OnDemand(Mapping[str, _T]):
    """Objects by name, each loaded from its home when it is first asked for."""

    def __init__(self, homes: Mapping[str, str], load: Callable[[str, str], _T]) -> None:
        self._homes = homes
        self._load = load
        self._loaded: dict[str, _T] = {}

    def __getitem__(self, name: str) -> _T:
        if name not in self._loaded:
            self._loaded[name] = self._load(name, self._homes[name])
        return self._loaded[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._homes)

    def __len__(self) -> int:
        return len(self._homes)

    def __contains__(self, name: object) -> bool:
        return name in self._homes


def _family(name: str, module: str) -> Family:
    families: tuple[Family, ...] = import_module(f"{__package__}.{module}").FAMILIES
    return next(family for family in families if family.name == name)


def _kind(_table: str, place: str) -> type[System]:
    module, _, name = place.partition(":")
    found: type[System] = getattr(import_module(f"cubepath.protocol.systems.{module}"), name)
    return found


OWN_FAMILIES: Mapping[str, Family] = _OnDemand(
    {
        "hex": "hexagons",
        "hex-open": "hexagons",
        "hex-connected": "connected_hexagons",
        "hex-tunnel": "tunnel",
        "sliding": "sliding",
        "hex-shapes": "shapes",
        "sliding-shapes": "shapes",
        "agv": "vehicles",
        "agv-labelled": "vehicles",
        "arm": "arm",
        "arm-free": "free_arm",
        "arms": "arms",
        "polygon": "triangulations",
        "triangulation": "triangulations",
        "words": "words",
        "assembly": "assembly",
    },
    _family,
)
OWN_KINDS: Mapping[str, type[System]] = _OnDemand(
    {
        "lattice": "lattice:LatticeSystem",
        "graph": "graph:GraphSystem",
        "listed": "listed:TabledSystem",
        "triangulation": "flips:FlipSystem",
    },
    _kind,
)
"""The project's own classes of systems, by the name of their TOML table."""


def __getattr__(name: str) -> Any:
    if name == "FAMILIES":
        return tuple(OWN_FAMILIES.values())
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
