"""Messages on the wire, as msgspec structs in JSON; the same bytes are recorded.

In each round a module sends `presence`, optionally a `note` and a `claim`, the `verdict` on its
claim to the modules that wait for it, and its `report`. What the modules of one process send in a
phase to a region travels as one message with its parts, a `bundle`; their reports are one message,
`reports`. The coordinator paces rounds with `go`, and processes answer `ready`; both count the
messages of the phase, so that a receiver knows what it misses and asks for it with `retransmit`,
and carry nothing else.

Bytes with a field of a wrong type, a number or a text beyond its bounds, or without a required
field are no message. An unknown field belongs to a later version and is ignored.
"""

from collections.abc import Iterator, Sequence
from typing import Annotated, Any, Literal, TypeAlias, get_args

import msgspec

from cubepath.protocol.core.catalogue import GeneratorPlacement
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.sites import Site, site_hook
from cubepath.protocol.path_files.certificates import Certificate

MESSAGE_BYTES_MAX = 1 << 24
"""A message of a process is no larger; routers and nodes drop what is."""
Count: TypeAlias = Annotated[int, msgspec.Meta(ge=0, le=(1 << 53) - 1)]
"""A number of a round, module or process, or of how many there are; exact in every JSON reader."""
NoteNumber: TypeAlias = Annotated[int, msgspec.Meta(ge=-(1 << 31), le=(1 << 31) - 1)]
Name: TypeAlias = Annotated[str, msgspec.Meta(max_length=256)]
"""The name of a generator, region, phase or kind."""


class Presence(msgspec.Struct, frozen=True, tag_field="kind", tag="presence"):
    """A module stands at `site`; goes to the places from which that place is sensed."""

    round: Count
    module: Count
    site: Site


class Note(msgspec.Struct, frozen=True, tag_field="kind", tag="note"):
    """The note of a rule's last choice; goes to the places within reach of `site`."""

    round: Count
    module: Count
    site: Site
    note: list[NoteNumber]


class Claim(msgspec.Struct, frozen=True, tag_field="kind", tag="claim"):
    """The module at `site` claims the action `generator` placed at `at`; within reach of `site`."""

    round: Count
    module: Count
    site: Site
    generator: Name
    at: Site


class Verdict(msgspec.Struct, frozen=True, tag_field="kind", tag="verdict"):
    """The claim of the module at `site` is granted or lost; goes to the places `to` that wait."""

    round: Count
    module: Count
    site: Site
    granted: bool
    to: list[Site]


class Report(msgspec.Struct, frozen=True, tag_field="kind", tag="report"):
    """A module's announcement at the end of a round, one each, in any order of arrival.

    It stood at `before` and stands at `site`; `claim` is "none", "granted" or "lost", and `move` is
    what it executed. `received` is every part that it was delivered in this round: by kind the
    modules that sent it, in increasing order.
    """

    round: Count
    module: Count
    before: Site
    site: Site
    claim: Literal["none", "granted", "lost"]
    move: GeneratorPlacement | None
    received: dict[Name, list[Count]]
    failed: str | None = None

    def deliveries(self) -> Iterator[tuple[str, int]]:
        """Yield the kind and the sender of each delivery."""
        for kind, senders in self.received.items():
            for sender in senders:
                yield kind, sender


Part: TypeAlias = Presence | Note | Claim | Verdict
"""What a module says to the modules at some places."""


class Bundle(msgspec.Struct, frozen=True, tag_field="kind", tag="bundle"):
    """What the modules of one process say in a phase to the places of one region.

    `number` counts the messages of a process to a region in a phase from 0; in the phases "sense"
    and "claim" there is one at most. The parts are in the order in which they were sent.
    """

    round: Count
    phase: Literal["sense", "claim", "settle"]
    process: Count
    region: Name
    number: Count
    parts: list[Part]


class Reports(msgspec.Struct, frozen=True, tag_field="kind", tag="reports"):
    """The reports of the modules of one process at the end of a round, in increasing order."""

    round: Count
    process: Count
    parts: list[Report]


class Go(msgspec.Struct, frozen=True, omit_defaults=True, tag_field="kind", tag="go"):
    """All processes may begin a phase of a round; or, with phase "stop", end.

    `sent` counts by region the messages that were sent to it in the phase before, by all processes
    together. With phase "observe" modules that are driven from outside send their observations.
    With phase "over" the schedule that modules carried out ends with this round (0: before the
    first): from the next on they follow their rule, each from where it stands. A process that has
    answered already and is asked again repeats everything that it sent in the phase.
    """

    round: Count
    phase: Literal["sense", "observe", "claim", "settle", "over", "stop"]
    sent: dict[Name, Count] = {}


class Reset(msgspec.Struct, frozen=True, tag_field="kind", tag="reset"):
    """All modules go back to their start, with another seed; processes answer `ready` to join.

    The rounds of the wire continue counting from `round`; ranks and rules count from 1 again.
    """

    round: Count
    seed: Annotated[int, msgspec.Meta(ge=0)]


class Ready(msgspec.Struct, frozen=True, omit_defaults=True, tag_field="kind", tag="ready"):
    """A process has finished a phase of a round (join: it is connected).

    `sent` counts by region the messages that it sent in this phase. A process whose modules follow
    their own `rule` instead of that of the run names it when it joins.
    """

    round: Count
    process: Count
    phase: Literal["join", "sense", "observe", "claim", "settle", "over"]
    sent: dict[Name, Count] = {}
    rule: Name | None = None


class Retransmit(msgspec.Struct, frozen=True, tag_field="kind", tag="retransmit"):
    """A process misses messages of a phase to a region: their senders repeat them."""

    round: Count
    process: Count
    phase: Literal["sense", "claim", "settle"]
    region: Name


class Waiting(msgspec.Struct, frozen=True, tag_field="kind", tag="waiting"):
    """A process that was asked again is there, but cannot finish the phase without others."""

    round: Count
    process: Count
    phase: Name


class ModuleObservation(msgspec.Struct, frozen=True, tag_field="kind", tag="observation"):
    """A module driven from outside sends its PettingZoo observation, as flat lists."""

    round: Count
    module: Count
    observation: list[int]
    action_mask: list[int]
    notes: list[list[int]]


class ChosenAction(msgspec.Struct, frozen=True, tag_field="kind", tag="action"):
    """The action for a module driven from outside."""

    round: Count
    module: Count
    action: Count
    note: list[NoteNumber]


class Observations(msgspec.Struct, frozen=True, tag_field="kind", tag="observations"):
    """The observations of the modules of one process, which are driven from outside."""

    round: Count
    process: Count
    parts: list[ModuleObservation]


class ChosenActions(msgspec.Struct, frozen=True, tag_field="kind", tag="actions"):
    """The actions for all modules of one process."""

    round: Count
    process: Count
    parts: list[ChosenAction]


Reason: TypeAlias = Literal[
    "too large",
    "malformed",
    "wrong key",
    "foreign",
    "out of place",
    "stale",
    "doubled",
    "contradicts",
    "impossible",
    "too many",
]
"""Why a message is refused, in a word or two."""


class Refused(msgspec.Struct, frozen=True, tag_field="kind", tag="refused"):
    """Messages that the coordinator refused in a round; they had no effect and are not recorded.

    `key` is what followed the run in the key of the first of them, and `sender` the sender that it
    names. Of those in a round with the same sender and reason the first is recorded at once, with
    how it begins in `sample`; how many more there were stands in the `count` of a second message.
    """

    round: Count
    key: str
    sender: Name
    reason: Reason
    detail: str
    count: Count
    sample: str = ""


class Executed(msgspec.Struct, frozen=True):
    """One move of the edge path: who was the mover, and the action."""

    module: Count
    generator: Name
    at: Site


class Edges(msgspec.Struct, frozen=True, tag_field="kind", tag="edges"):
    """The coordinator's edge path, a round at a time, in increasing order of modules."""

    round: Count
    moves: list[Executed]


class Cube(msgspec.Struct, frozen=True, tag_field="kind", tag="cube"):
    """One cube of the normal cube path of the whole run; `index` counts from 1."""

    round: Count
    index: Count
    moves: list[GeneratorPlacement]


class Certified(msgspec.Struct, frozen=True, tag_field="kind", tag="certificate"):
    """Proof that no schedule in the homotopy class of the run has fewer cubes than its own."""

    round: Count
    certificate: Certificate


class Stopped(msgspec.Struct, frozen=True):
    """Where a schedule stopped: a cube that did not apply, and what was wrong with it.

    `module` is who could not make its `move` in that round; None where no module was there to do
    it, so that this round of the schedule was not begun.
    """

    round: Count
    module: Count | None
    move: GeneratorPlacement
    reason: str


class Summary(msgspec.Struct, frozen=True, omit_defaults=True, tag_field="kind", tag="summary"):
    """How a run ended and its results.

    `ended` is "goal", "max-rounds", "failed" (a rule gave up, a schedule stopped, or a process
    died) or "interrupted". Of a run that carried out a schedule it tells how many cubes that had,
    and where it stopped, if it did. `refused` counts the messages that the coordinator refused.
    """

    round: Count
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
    refused: Count = 0


Message: TypeAlias = (
    Presence
    | Note
    | Claim
    | Verdict
    | Report
    | ModuleObservation
    | ChosenAction
    | Bundle
    | Reports
    | Observations
    | ChosenActions
    | Go
    | Reset
    | Ready
    | Retransmit
    | Waiting
    | Refused
    | Edges
    | Cube
    | Certified
    | Summary
)
"""Any message on the wire or in a recording."""
KINDS: dict[str, type[Message]] = {kind.__struct_config__.tag: kind for kind in get_args(Message)}

_BATCHES = frozenset((Bundle, Reports, Observations, ChosenActions))
_decoder: msgspec.json.Decoder[Message] = msgspec.json.Decoder(Message, dec_hook=site_hook)
encode = msgspec.json.Encoder().encode


class NoMessageError(InputError):
    """Bytes that are no message."""


def decode(data: bytes) -> Message:
    """Return the message that the bytes hold; NoMessageError if they hold none."""
    try:
        return _decoder.decode(data)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise NoMessageError(f"not a cubepath message: {error}") from None


def parts_of(message: Message) -> Sequence[Message]:
    """Return the messages of modules that a message brings; any other message is its own part."""
    if type(message) not in _BATCHES:
        return (message,)
    batch: Any = message
    parts: list[Message] = batch.parts
    return parts


def kind_of(message: Message) -> str:
    """Return the name of a message's kind, under either clock."""
    return str(message.__struct_config__.tag)
