"""Proofs about vehicles that may follow: no timetable has so few rounds, and here is one with more.

It touches only the file that it is given. This is the format, described in docs/schedules.md, of
blocks as `proof_blocks` writes them. What a proof proves is decided by
`proof_checking` of `theory`, which shares only this module with the code that makes proofs.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal, TypeAlias

import msgspec
import numpy as np
from numpy.typing import NDArray

from cubepath.protocol.core.input_files import Source, opened
from cubepath.protocol.core.output_files import written_whole
from cubepath.protocol.path_files.optimality_proofs import Standing
from cubepath.protocol.path_files.proof_blocks import BlockReader, BlockWriter

FIRST_LINE = b"cubepath following proof 1\n"
_Number = Annotated[int, msgspec.Meta(ge=0, le=2**31 - 1)]
_WIDTH = 4
Cell: TypeAlias = tuple[int, int]


def _no_variables() -> NDArray[np.int32]:
    return np.zeros((0, _WIDTH), dtype=np.int32)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class FollowingProof:
    """The content of a file: no timetable has `refuted` rounds or fewer under `rule`; one has more.

    Vehicle a goes from ``starts[a]`` to ``ends[a]`` on a graph of `vertices`, which are cells, and
    `edges`, pairs of their positions there. `schedule` has for each round who goes where, as
    (vehicle, position of the vertex). `variables` has a row (kind, index, index, time) for each
    variable of the clauses, int32, the first of which is variable 1; `log` is a binary DRAT log, in
    pieces of any length, which is read once by `write_following_proof`. There are neither where
    some vehicle has further to go than `refuted`.
    """

    rule: Literal["mapf", "cgshop"]
    starts: Sequence[Cell]
    ends: Sequence[Cell]
    vertices: Sequence[Cell]
    edges: Sequence[tuple[int, int]]
    refuted: int
    solver: str = ""
    standing: Standing = "proved"
    variables: NDArray[np.int32] = field(default_factory=_no_variables)
    log: Iterable[bytes] = ()
    schedule: Sequence[Sequence[tuple[int, int]]]


class _Statement(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    rule: Literal["mapf", "cgshop"]
    starts: list[Cell]
    ends: list[Cell]
    refuted: _Number
    solver: str
    standing: Standing


def write_following_proof(path: Path | str, proof: FollowingProof) -> None:
    """Write a proof; the file is complete afterwards, or unchanged.

    The log is taken piece by piece, so it need not fit into memory. Raises InputError if the file
    cannot be written, CheckError if the disk is full.

    >>> write_following_proof("way.proof", FollowingProof(
    ...     rule="mapf", starts=[(0, 0)], ends=[(2, 0)], vertices=[(0, 0), (1, 0), (2, 0)],
    ...     edges=[(0, 1), (1, 2)], refuted=1, schedule=[[(0, 1)], [(0, 2)]],
    ... ))
    >>> check_fewest_rounds(read_following_proof("way.proof")).optimal
    True
    """
    with written_whole(path) as stream:
        out = BlockWriter(stream, FIRST_LINE)
        statement = _Statement(
            proof.rule,
            list(proof.starts),
            list(proof.ends),
            proof.refuted,
            proof.solver,
            proof.standing,
        )
        out.json("statement", statement)
        out.json("vertices", list(proof.vertices))
        out.json("edges", list(proof.edges))
        out.variables(proof.variables, _WIDTH)
        out.log(proof.log)
        out.json("schedule", [list(moves) for moves in proof.schedule])
        out.end()


def read_following_proof(source: Source) -> FollowingProof:
    """Read a proof whose checksums all hold.

    Whether it proves anything is not looked at, nor whether its numbers are those of vertices,
    vehicles and variables. Raises InputError if the file cannot be read or is no such proof, and
    CheckError, with the block and the byte at which it begins, if it was changed or its content is
    malformed.

    >>> write_following_proof("one.proof", FollowingProof(
    ...     rule="cgshop", starts=[(0, 0)], ends=[(1, 0)], vertices=[(0, 0), (1, 0)],
    ...     edges=[(0, 1)], refuted=0, schedule=[[(0, 1)]],
    ... ))
    >>> proof = read_following_proof("one.proof")
    >>> proof.rule, proof.ends, proof.refuted
    ('cgshop', [(1, 0)], 0)
    """
    with opened(source) as file:
        blocks = BlockReader(file, FIRST_LINE)
        said = blocks.json("statement", _Statement, keys=6)
        vertices = blocks.json("vertices", list[Cell])
        edges = blocks.json("edges", list[tuple[_Number, _Number]])
        variables = blocks.variables(_WIDTH)
        log, schedule = blocks.log_and("schedule", list[list[tuple[_Number, _Number]]])
        blocks.end()
    return FollowingProof(
        rule=said.rule,
        starts=said.starts,
        ends=said.ends,
        vertices=vertices,
        edges=edges,
        refuted=said.refuted,
        solver=said.solver,
        standing=said.standing,
        variables=variables,
        log=log,
        schedule=schedule,
    )
