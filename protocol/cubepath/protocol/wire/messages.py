"""Messages on the wire, as msgspec structs in JSON; the same bytes are recorded.

In each round a module sends `here`, optionally a `note` and a `claim`, the `verdict` on its claim
to the modules that wait for it, and its `report`. The coordinator paces rounds with `go`, and
processes answer `ready`; neither message carries any state.
"""

from __future__ import annotations

from typing import Any, Literal, TypeAlias

import msgspec

from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.names import GeneratorPlacement, Json, schema_with_definitions
from cubepath.protocol.path_files.certificates import Certificate


class Here(msgspec.Struct, frozen=True, tag_field="kind", tag="here"):
    """A module stands at `site`; goes to the places from which that place is sensed."""

    round: int
    module: int
    site: Json


class Note(msgspec.Struct, frozen=True, tag_field="kind", tag="note"):
    """What a rule said in its last choice; goes to the places within reach of `site`."""

    round: int
    module: int
    site: Json
    note: list[int]


class Claim(msgspec.Struct, frozen=True, tag_field="kind", tag="claim"):
    """The module at `site` claims the action `generator` placed at `at`; within reach of `site`."""

    round: int
    module: int
    site: Json
    generator: str
    at: Json


class Verdict(msgspec.Struct, frozen=True, tag_field="kind", tag="verdict"):
    """The claim of the module at `site` is granted or lost; goes to the places `to` that wait."""

    round: int
    module: int
    site: Json
    granted: bool
    to: list[Json]


class Heard(msgspec.Struct, frozen=True):
    """One delivery to a module: the kind of message, its sender and where the sender stood."""

    kind: str
    module: int
    site: Json


class Report(msgspec.Struct, frozen=True, tag_field="kind", tag="report"):
    """A module's announcement at the end of a round, one each, in any order of arrival.

    It stood at `before` and stands at `site`; `claim` is "none", "granted" or "lost", and `move`
    is what it executed. `heard` is every message that it was delivered in this round.
    """

    round: int
    module: int
    before: Json
    site: Json
    claim: Literal["none", "granted", "lost"]
    move: GeneratorPlacement | None
    heard: list[Heard]
    failed: str | None = None


class Go(msgspec.Struct, frozen=True, tag_field="kind", tag="go"):
    """All processes may begin a phase of a round; or, with phase "stop", end.

    With phase "over" the schedule that modules carried out ends with this round (0: before the
    first): from the next on they follow their rule, each from where it stands.
    """

    round: int
    phase: Literal["sense", "claim", "settle", "over", "stop"]


class Reset(msgspec.Struct, frozen=True, tag_field="kind", tag="reset"):
    """All modules go back to their start, with another seed; processes answer `ready` to join."""

    round: int
    seed: int


class Ready(msgspec.Struct, frozen=True, tag_field="kind", tag="ready"):
    """A process has finished a phase of a round (round 0: it is connected); nothing more."""

    round: int
    process: int
    phase: Literal["join", "sense", "claim", "settle"]


class Observed(msgspec.Struct, frozen=True, tag_field="kind", tag="observed"):
    """A module driven from outside sends its PettingZoo observation, as flat lists."""

    round: int
    module: int
    observation: list[int]
    action_mask: list[int]
    notes: list[list[int]]


class Act(msgspec.Struct, frozen=True, tag_field="kind", tag="act"):
    """The action for a module driven from outside."""

    round: int
    module: int
    action: int
    note: list[int]


class Executed(msgspec.Struct, frozen=True):
    """One move of the edge path: who was the mover, and the action."""

    module: int
    generator: str
    at: Json


class Edges(msgspec.Struct, frozen=True, tag_field="kind", tag="edges"):
    """The coordinator's edge path, a round at a time, in increasing order of modules."""

    round: int
    moves: list[Executed]


class Cube(msgspec.Struct, frozen=True, tag_field="kind", tag="cube"):
    """One cube of the normal cube path of the whole run; `index` counts from 1."""

    round: int
    index: int
    moves: list[GeneratorPlacement]


class Certified(msgspec.Struct, frozen=True, tag_field="kind", tag="certificate"):
    """Proof that no schedule in the homotopy class of the run has fewer cubes than its own."""

    round: int
    certificate: Certificate


class Stopped(msgspec.Struct, frozen=True):
    """Where a schedule stopped: a cube that did not apply, and what was wrong with it.

    `module` is who could not make its `move` in that round; None where no module was there to do
    it, so that this round of the schedule was not begun.
    """

    round: int
    module: int | None
    move: GeneratorPlacement
    reason: str


class Summary(msgspec.Struct, frozen=True, omit_defaults=True, tag_field="kind", tag="summary"):
    """How a run ended and what came of it.

    `ended` is "goal", "max-rounds", "failed" (a rule gave up, a schedule stopped, or a process
    died) or "interrupted". Of a run that carried out a schedule it tells how many cubes that had,
    and where it stopped, if it did.
    """

    round: int
    ended: Literal["goal", "max-rounds", "failed", "interrupted"]
    error: str | None
    rounds: int
    moves: int
    reduced_moves: int
    cubes: int
    max_cube_dimension: int
    goal_reached: bool
    path_digest: str
    schedule_cubes: int | None = None
    schedule_stopped: Stopped | None = None


Message: TypeAlias = (
    Here
    | Note
    | Claim
    | Verdict
    | Report
    | Go
    | Reset
    | Ready
    | Observed
    | Act
    | Edges
    | Cube
    | Certified
    | Summary
)
"""Any message on the wire or in a recording."""
KINDS: dict[str, type[Message]] = {
    "here": Here,
    "note": Note,
    "claim": Claim,
    "verdict": Verdict,
    "report": Report,
    "go": Go,
    "reset": Reset,
    "ready": Ready,
    "observed": Observed,
    "act": Act,
    "edges": Edges,
    "cube": Cube,
    "certificate": Certified,
    "summary": Summary,
}

_decoder: msgspec.json.Decoder[Message] = msgspec.json.Decoder(Message)
encode = msgspec.json.Encoder().encode


def decode(data: bytes) -> Message:
    """Return the message that the bytes hold; InputError if they hold none."""
    try:
        return _decoder.decode(data)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise InputError(f"not a cubepath message: {error}") from None


def kind_of(message: Message) -> str:
    """Return the name of a message's kind."""
    tag = message.__struct_config__.tag
    return str(tag)


def schema_of(kind: str) -> dict[str, Any]:
    """Return the JSON Schema (2020-12) of a kind of message, as recordings hold it."""
    # Viewers want the top object itself, not a reference to it.
    top, definitions = schema_with_definitions(KINDS[kind])
    return {**top, "$defs": definitions} if definitions else top
