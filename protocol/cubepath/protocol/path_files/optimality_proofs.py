"""Proofs of optimality: a schedule, and the refutation of every schedule with fewer rounds.

This is the format, described in docs/proofs.md, of blocks as `proof_blocks` writes them.
`proof_checking` of `theory` decides what a proof proves; it shares only this module with the code
that makes proofs.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple, TypeAlias

import msgspec
import numpy as np
from numpy.typing import NDArray

from cubepath.protocol.core.actions import Action, ActionContents, contents_of
from cubepath.protocol.core.catalogue import GeneratorPlacement
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.input_files import Source, opened
from cubepath.protocol.core.output_files import written_whole
from cubepath.protocol.core.parsing import check_keys
from cubepath.protocol.core.sites import Site
from cubepath.protocol.path_files.proof_blocks import BlockReader, BlockWriter

FIRST_LINE = b"cubepath proof 1\n"
LadderKind: TypeAlias = Literal["on", "off", "stay"]
GroupKind: TypeAlias = Literal["at most one", "exactly one"]
_Number = Annotated[int, msgspec.Meta(ge=0, le=2**31 - 1)]


class Ladder(NamedTuple):
    """At most one of these moves: an order of move variables that prefix variables count along.

    All are of one round, and `site`, an index, is in the trace of each. They turn it on, turn it
    off, or hold it in their trace ("stay"). `members` are numbers of variables, from 1.
    """

    site: int
    round: int
    kind: LadderKind
    members: Sequence[int]


class Group(NamedTuple):
    """Sites, by index, of which at most one or exactly one is on in every state."""

    kind: GroupKind
    sites: Sequence[int]


def _no_variables() -> NDArray[np.int32]:
    return np.zeros((0, 3), dtype=np.int32)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class OptimalityProof:
    """The content of a proof file: no schedule has `refuted` rounds or fewer; one has `cubes`.

    `system` is the scene as TOML, or None, in which case `moves` are the actions themselves instead
    of their names. `start` and `goal` are complete states. Actions and sites have their positions
    in `moves` and `sites` as numbers. `variables` has a row (kind, index, time) for each variable
    of the clauses, int32, the first of which is variable 1. `log` is a binary DRAT log, in pieces
    of any length; it is read once by `write_proof`. What was read from a file can be read again.
    Where the windows alone refute this many rounds there are no variables, ladders, groups and log.
    """

    system: str | None
    start: Sequence[Site]
    goal: Sequence[Site]
    refuted: int
    cubes: int
    solver: str = ""
    moves: Sequence[GeneratorPlacement] | Sequence[Action]
    sites: Sequence[Site] = ()
    variables: NDArray[np.int32] = field(default_factory=_no_variables)
    ladders: Sequence[Ladder] = ()
    groups: Sequence[Group] = ()
    log: Iterable[bytes] = ()
    schedule: Sequence[Sequence[int]]


class _Statement(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    system: str | None
    start: tuple[Site, ...]
    goal: tuple[Site, ...]
    refuted: _Number
    cubes: _Number
    solver: str
    standing: Literal["proved"] = "proved"


def write_proof(path: Path | str, proof: OptimalityProof) -> None:
    """Write a proof; the file is complete afterwards, or unchanged.

    The log is taken piece by piece, so it need not fit into memory. Raises InputError if the file
    cannot be written, CheckError if the disk is full.

    >>> left, right = Action([1, 2], [1, 2], [1], [2]), Action([2, 3], [2, 3], [2], [3])
    >>> write_proof("two.proof", OptimalityProof(
    ...     system=None, start=[1], goal=[3], refuted=1, cubes=2,
    ...     moves=[left, right], schedule=[[0], [1]],
    ... ))
    >>> check_optimality(read_proof("two.proof")).optimal
    True
    """
    with written_whole(path) as stream:
        out = BlockWriter(stream, FIRST_LINE)
        out.statement(proof, _Statement)
        out.json("moves", [_move_to_json(move) for move in proof.moves])
        out.json("sites", list(proof.sites))
        out.variables(proof.variables, 3)
        ladders = [[*each[:3], [int(move) for move in each.members]] for each in proof.ladders]
        out.json("ladders", ladders)
        out.json("groups", [[each.kind, [int(at) for at in each.sites]] for each in proof.groups])
        out.log(proof.log)
        out.json("schedule", [[int(action) for action in cube] for cube in proof.schedule])
        out.end()


def _move_to_json(move: GeneratorPlacement | Action) -> Any:
    if isinstance(move, GeneratorPlacement):
        return [move.generator, move.at]
    return contents_of(move)


def read_proof(source: Source) -> OptimalityProof:
    """Read a proof whose checksums all hold.

    Whether it proves anything is not looked at, nor whether its numbers are those of sites, moves
    and variables. Raises InputError if the file cannot be read or is no proof, and CheckError, with
    the block and the byte at which it begins, if it was changed or its content is malformed.

    >>> step = Action([1, 2], [1, 2], [1], [2])
    >>> write_proof("one.proof", OptimalityProof(
    ...     system=None, start=[1], goal=[2], refuted=0, cubes=1, moves=[step], schedule=[[0]],
    ... ))
    >>> proof = read_proof("one.proof")
    >>> proof.start, proof.goal, proof.refuted
    ((1,), (2,), 0)
    """
    with opened(source) as file:
        blocks = BlockReader(file, FIRST_LINE)
        statement = blocks.json("statement", _Statement, keys=7)
        moves = _moves(blocks, named=statement.system is not None)
        sites = blocks.json("sites", tuple[Site, ...])
        variables = blocks.variables(3)
        ladders = blocks.json("ladders", list[tuple[_Number, _Number, LadderKind, list[_Number]]])
        groups = blocks.json("groups", list[tuple[GroupKind, list[_Number]]])
        log, schedule = blocks.log_and("schedule", list[list[_Number]])
        blocks.end()
    fields = msgspec.structs.asdict(statement)
    del fields["standing"]  # a proof has no other
    return OptimalityProof(
        **fields,
        moves=moves,
        sites=sites,
        variables=variables,
        ladders=[Ladder(*each) for each in ladders],
        groups=[Group(*each) for each in groups],
        log=log,
        schedule=schedule,
    )


def _moves(blocks: BlockReader, *, named: bool) -> Sequence[GeneratorPlacement] | Sequence[Action]:
    content = blocks.block("moves")
    if named:
        pairs = blocks.decode(list[tuple[str, Site]], content)
        return [GeneratorPlacement(*pair) for pair in pairs]
    own = blocks.decode(list[ActionContents], content)
    try:
        check_keys(content, 4 * len(own))
        return [move.action(f"move {number}") for number, move in enumerate(own)]
    except InputError as error:
        raise blocks.error(str(error)) from None
