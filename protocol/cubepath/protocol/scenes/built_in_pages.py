"""The pages that come with the project, in the folder ``catalogues``: catalogues, and families."""

from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

from cubepath.protocol.core.catalogue import Catalogue, lattice_named
from cubepath.protocol.core.input_files import read_text
from cubepath.protocol.core.parsing import parsed_toml
from cubepath.protocol.core.system import Scene
from cubepath.protocol.scenes.page_keys import as_keys, page_keys
from cubepath.protocol.scenes.pages import page_generators
from cubepath.protocol.scenes.registry import Family, Values
from cubepath.protocol.systems.lattice import LatticeSystem

_FOLDER = Path(__file__).parent / "catalogues"


@cache
def page_catalogue(name: str) -> Catalogue:
    """Return the catalogue of the page of this name.

    >>> len(page_catalogue("hexagons-3").generators)
    12
    """
    table = _table(name)["lattice"]
    lattice = lattice_named(table["name"])
    return Catalogue(lattice, page_generators(lattice, table["generators"], {}))


def page_family(name: str) -> Family:
    """Return the family of the page of this name, whose first line is what its scenes are."""
    table, first = _table(name), _text(name).partition("\n")[0]
    return Family(
        name,
        first.removeprefix("# ").rstrip("."),
        as_keys(page_keys(table.get("keys", {})), table.get("scenes", {})),
        _built,
        LatticeSystem,
        table.get("rule", "metropolis"),
    )


def _built(name: str, values: Values) -> Scene:
    from cubepath.protocol.scenes.toml import scene_from_toml  # noqa: PLC0415 - it knows families

    given = ",".join(f"{key}={value}" for key, value in values.items())
    return replace(scene_from_toml(_text(name), name, given), spec=name, family=name)


@cache
def _text(name: str) -> str:
    return read_text(_FOLDER / f"{name}.toml")


@cache
def _table(name: str) -> dict[str, Any]:
    return parsed_toml(_text(name))
