"""What comparing two runs finds, as data.

Whatever has two sides has them as `a` and `b`, in the order of the arguments.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeAlias

from cubepath.protocol.core.catalogue import Json

Cause: TypeAlias = Literal["rule", "seed", "hesitate", "inputs", "together", "record", "unknown"]
"""Why two choices differ.

Where both rules could be asked again, ``rule``, ``seed``, ``hesitate`` or ``inputs`` is what makes
the module of `a` choose as that of `b` did, when it alone is exchanged; ``together`` if only all
that differs does. ``record``: a choice on record is not what the installed rule chooses.
``unknown``: nothing that is known tells why.
"""


NAMES = ("a", "b")
"""What the two runs are called."""


NO_ROUNDS = "no rounds"
"""What was compared of runs of which one has no round."""


@dataclass(frozen=True, slots=True)
class MessageDifference:
    """The first message that differs, in the order of the run: round, phase, kind, module.

    `a` and `b` are its fields, None in the run that does not have it; `fields` names those that
    differ. `around` has the messages before and after it, if they were asked for: for each the
    line in `a` and the line in `b`, empty where it is missing. Without rounds `round` is a level.
    """

    round: int
    kind: str
    module: int | None
    a: dict[str, Json] | None
    b: dict[str, Json] | None
    fields: tuple[str, ...]
    around: tuple[tuple[str, str], ...] = ()


@dataclass(frozen=True, slots=True)
class ChoiceContext:
    """What a module sensed, was told, drew and chose in one of the runs.

    `sensed` says of each place that it senses what is there: a module, ``empty``, ``closed``
    (outside the workspace) or ``filled`` (an obstacle); `told` is what modules within reach said in
    their notes. `drew` are the numbers that its rule drew from its random stream in this choice, 64
    bits each, as fractions from 0 to 1; `doubt` is the one that is compared with how often it
    hesitates. Both are None if the rule could not be asked again. `by_rule` is what the installed
    rule chooses. `picture` draws the places that it senses, in lines; None where places are no
    cells of the plane. `versions`, without rounds, are those of what it was shown, and `level` is
    that of the commit, None if that has no move.
    """

    site: str
    sensed: dict[str, str]
    told: dict[str, list[int]]
    chose: str
    by_rule: str | None = None
    drew: tuple[float, ...] | None = None
    doubt: float | None = None
    versions: dict[str, int] | None = None
    picture: str | None = None
    level: int | None = None


@dataclass(frozen=True, slots=True)
class ChoiceDifference:
    """The first choice that differs: of which module, in which round, and why.

    `also` are the modules that chose something else in the same round. `causes` says why in words
    for machines, and `why` in lines for people. Without rounds `round` is the least level of the
    commit in either run, and `number` says which of the module's commits that is, from 1.
    """

    round: int
    module: int
    a: ChoiceContext
    b: ChoiceContext
    causes: tuple[Cause, ...]
    why: tuple[str, ...]
    also: tuple[int, ...] = ()
    number: int | None = None


@dataclass(frozen=True, slots=True)
class OutcomeDifference:
    """The first claim that was made in both runs, and granted in one of them alone."""

    round: int
    module: int
    claim: str
    a: str
    b: str
    why: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class MoveDifference:
    """The first move that differs; None in the run in which the module makes none there.

    Without rounds it is the first of a module's commits with a move, and `round` its least level.
    """

    round: int
    module: int | None
    a: str | None
    b: str | None


@dataclass(frozen=True, slots=True)
class PathComparison:
    """The two edge paths as a whole; None where a path is not known.

    `same` is None if they are equal up to swapping moves that commute, and otherwise one line on
    the first difference; `homotopic` likewise, with moves that are undone taken out.
    """

    moves: tuple[int, int]
    cubes: tuple[int, int]
    identical: bool
    """Whether both have the same moves in the same rounds, so the same digest."""
    same: str | None
    homotopic: str | None
    end: str | None
    """One line on how the states at the end differ; None if they do not, or if it is not known."""
    end_unknown: str | None = None
    """One line on why it is not known whether they differ, None if it is."""


@dataclass(frozen=True, slots=True)
class DifferingRounds:
    """From the end of which round to the end of which the states differ.

    `end` is None if they still do at the end of the last round that is compared.
    """

    begin: int
    end: int | None


@dataclass(frozen=True, slots=True)
class Differences:
    """Where two runs part, and why."""

    a: str
    b: str
    clock: str
    """"lockstep", "free", or "moves" if only the moves can be compared."""
    same: bool
    """Whether nothing differs that modules said and did, and nothing is missing in one alone or
    between rounds that were compared."""
    identical: bool
    """Whether both files have the same bytes."""
    parameters: dict[str, tuple[str | None, str | None]]
    """The parameters that differ; None where one is missing."""
    scene: str | None
    """One line on the first difference of the scenes, None if they are equal."""
    compared: str
    """What was compared, in one line."""
    notes: tuple[str, ...]
    """What is odd with a recording, and what was not compared."""
    message: MessageDifference | None = None
    choice: ChoiceDifference | None = None
    outcome: OutcomeDifference | None = None
    move: MoveDifference | None = None
    parted: dict[int, int] | None = None
    """By module the first round in which it chose otherwise."""
    states: tuple[DifferingRounds, ...] = ()
    rounds: tuple[tuple[int, int, int, int], ...] = ()
    """For each round with other moves: its number, the moves in `a`, in `b`, and in both."""
    beginning: str | None = None
    """The run, "a" or "b", that is the beginning of the other: that goes on where it ends."""
    limited: bool = False
    """Whether this is a part of the runs: rounds were asked for, or both begin later, or the end of
    one is not on record."""
    ends: tuple[str, str] | None = None
    """How each run ended, if they ended otherwise; of runs of two families also how far it went."""
    paths: PathComparison | None = None
