"""The standard instances: scenes with the best number of cubes that is known, and what is proved.

They stand in the folder `standard` beside this file: `standard.toml` lists them, with the value of
each; there are scenes as TOML where no spec names them, and for each instance a cubes file, the
schedule that attains the best known value. tests/standards.py computes all of it.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from pathlib import Path

import msgspec

from cubepath.protocol.core.input_files import read_text
from cubepath.protocol.core.parsing import parsed_toml

FOLDER = Path(__file__).parent / "standard"


@dataclass(frozen=True, slots=True)
class StandardInstance:
    """A scene to try rules on, and how good a schedule can be.

    `system` is what `scene_from_spec` takes: a spec, or the path of a TOML file. `best` is the
    least number of cubes that is known, `moves` the number of moves of `schedule`, a cubes file
    that attains it. No schedule has fewer than `bound` cubes, whatever its homotopy class; `how`
    says in words how the two are known.

    >>> one = next(each for each in standard() if each.name == "hex-6")
    >>> one.system, one.best, one.bound, one.proved
    ('hex:n=6', 18, 18, True)
    """

    name: str
    system: str
    best: int
    moves: int
    bound: int
    how: str
    schedule: Path

    @property
    def proved(self) -> bool:
        """Return whether the best known value is proved to be the least there is."""
        return self.best == self.bound


@cache
def standard() -> tuple[StandardInstance, ...]:
    """Return the standard instances, by family and size.

    >>> [each.system for each in standard() if each.name == "hex-6"]
    ['hex:n=6']
    >>> [(each.best, each.bound, each.proved) for each in standard() if each.name == "hex-6"]
    [(18, 18, True)]
    """
    table = parsed_toml(read_text(FOLDER / "standard.toml"))
    return tuple(
        StandardInstance(
            name=row.name,
            system=str(FOLDER / row.system) if row.system.endswith(".toml") else row.system,
            best=row.best,
            moves=row.moves,
            bound=row.bound,
            how=row.how,
            schedule=FOLDER / f"{row.name}.jsonl",
        )
        for row in msgspec.convert(table, _Table).instance
    )


class _Row(msgspec.Struct, forbid_unknown_fields=True):
    name: str
    system: str
    best: int
    moves: int
    bound: int
    how: str


class _Table(msgspec.Struct, forbid_unknown_fields=True):
    instance: list[_Row]
