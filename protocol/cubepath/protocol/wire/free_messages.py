"""Messages of a run without rounds: what modules ask of keepers, and what keepers answer and show.

A *keeper* holds the units of some tiles. A *unit* is a site, or in a system with labels a place,
which shows the site that is on there: two moves may conflict over it. An *attempt* of a module
passes through the keepers of its units in increasing order; the last one commits it, and that is
the move. Until then any of them may refuse it. docs/free-clock.md has the protocol.

What a node sends in one step to one receiver travels as one message with its parts. Bounds and
unknown fields are as in `messages`.

Each incarnation of a sender numbers its `requests` and `turns` (a process), or its `forwards`,
`replies` and `tile` messages (a keeper), from 1 without gap: `sequence` is the number, 0 if the
message is not numbered. `halted` and `commits` carry the last number instead. Commits are numbered
by `serial`.
"""

from typing import Annotated, Any, TypeAlias, cast, get_args

import msgspec

from cubepath.protocol.core.sites import Site, site_hook
from cubepath.protocol.wire.credentials import keeper_name, process_name
from cubepath.protocol.wire.messages import (
    KINDS,
    MESSAGE_BYTES_MAX,
    Certified,
    Count,
    Cube,
    Edges,
    Go,
    Name,
    NoMessageError,
    NoteNumber,
    Refused,
    Summary,
)

Register: TypeAlias = list[NoteNumber]
"""The note of a module as its keeper holds it: empty before it has sent anything."""
_Line = Annotated[str, msgspec.Meta(max_length=4096)]


class Attempt(msgspec.Struct, frozen=True, omit_defaults=True, tag_field="kind", tag="attempt"):
    """A module at `site` asks for a change, all of it or nothing, if what it sensed still holds.

    It is the `number`-th attempt of the module's `epoch`; the next one begins when the outcome of
    this one is known. `turn` counts the choices of its rule in this epoch. With a `generator` it is
    that move, placed at `at`.

    `sensed` pairs units with the site that was on there, null for none: the units of the move's
    support that can ever change, and the guards of the rule, which hold but are not read. `notes`
    has triples: a place, the register that was sensed there, and its new content, null for a
    register that must only hold. `after` has triples: a unit, the version that it must have, and
    how often that must have been read, null if that does not matter; so moves of a schedule wait
    for those before them.
    """

    module: Count
    epoch: Count
    number: Count
    turn: Count
    site: Site
    generator: Name | None = None
    at: Site | None = None
    sensed: list[tuple[Site, Site | None]] = []
    notes: list[tuple[Site, Register, Register | None]] = []
    after: list[tuple[Site, Count, Count | None]] = []


class EnterRequest(msgspec.Struct, frozen=True, tag_field="kind", tag="enter"):
    """The process of a module asks where it stands; earlier incarnations are fenced off.

    A process that is started again has a greater incarnation. Asked again with the same
    incarnation, a keeper gives the same answer.
    """

    module: Count
    incarnation: Count


class TileQuery(msgspec.Struct, frozen=True, tag_field="kind", tag="tile_query"):
    """A process asks for all of a tile, unless `serial` is that of its last change."""

    tile: Name
    serial: int


class Occupant(msgspec.Struct, frozen=True):
    """A module as the keeper of its place holds it: its fence, and its register.

    `version` counts the commits that moved it or wrote its register.
    """

    module: Count
    incarnation: Count
    epoch: Count
    number: Count
    note: Register
    version: Count


class Commit(msgspec.Struct, frozen=True, omit_defaults=True, tag_field="kind", tag="commit"):
    """What was committed, as the last keeper of its chain has logged it.

    It is the keeper's commit number `serial`, from 1. A move has a `generator`, and a `level`: one
    more than the greatest level of the moves that it depends on. `read` pairs units with the
    version read. `written` has for each unit the version overwritten, and how many moves had read
    that version. `guarded` pairs the guards with the version at which they held. `motion` lists for
    each module that was taken along, the mover first: its number, where from, where to, and its
    version from now on. `notes` lists registers: the place where the module now is, the module, its
    version from now on, and the content, null if it was not written and only had to hold. Without a
    generator only registers were written, at level 0.
    """

    keeper: Count
    serial: Count
    module: Count
    epoch: Count
    number: Count
    turn: Count
    level: Count
    generator: Name | None = None
    at: Site | None = None
    read: list[tuple[Site, Count]] = []
    written: list[tuple[Site, Count, Count]] = []
    guarded: list[tuple[Site, Count]] = []
    motion: list[tuple[Count, Site, Site, Count]] = []
    notes: list[tuple[Site, Count, Count, Register | None]] = []


class Forwarded(msgspec.Struct, frozen=True, tag_field="kind", tag="forwarded"):
    """A keeper has prepared an attempt, and passes it on to the next one of its chain.

    `process` is who asked. The rest is what the keepers so far have found for `Commit`; `occupants`
    are the modules of the motion, null where a later keeper has them, and `noted` those whose
    registers are written or have to hold, by their places.
    """

    attempt: Attempt
    process: Count
    level: Count
    read: list[tuple[Site, Count]]
    written: list[tuple[Site, Count, Count]]
    guarded: list[tuple[Site, Count]]
    occupants: list[Occupant | None]
    noted: list[tuple[Site, Occupant]]


class Decision(msgspec.Struct, frozen=True, omit_defaults=True, tag_field="kind", tag="decision"):
    """The result of an attempt: with `commit` it was committed, otherwise refused, and `reason`.

    `occupants` are the modules that it changed as they are from now on, each with its site, for the
    keepers of the chain.
    """

    module: Count
    epoch: Count
    number: Count
    reason: _Line = ""
    commit: Commit | None = None
    occupants: list[tuple[Site, Occupant]] = []


class Inquiry(msgspec.Struct, frozen=True, tag_field="kind", tag="inquiry"):
    """A keeper that has prepared an attempt asks the last one of its chain for the result."""

    module: Count
    epoch: Count
    number: Count


class Settled(msgspec.Struct, frozen=True, tag_field="kind", tag="settled"):
    """A keeper has taken note of a commit: the last one of the chain need not remember it."""

    module: Count
    epoch: Count
    number: Count


class PlaceState(msgspec.Struct, frozen=True, omit_defaults=True, tag_field="kind", tag="place"):
    """What is at a place: the site that is on, with its module, or nothing.

    `version` counts the moves that wrote the place, and `module_version` is that of the module.
    With a schedule `reads` tells how often units of the place were read: the unit, its version, and
    how many moves have read that.
    """

    place: Site
    version: Count
    site: Site | None = None
    module: Count | None = None
    note: Register = []
    module_version: Count = 0
    reads: list[tuple[Site, Count, Count]] = []


class Entered(msgspec.Struct, frozen=True, tag_field="kind", tag="entered"):
    """The answer to `EnterRequest`: where the module stands, and the epoch in which it may act."""

    incarnation: Count
    site: Site
    occupant: Occupant


class Requests(msgspec.Struct, frozen=True, omit_defaults=True, tag_field="kind", tag="requests"):
    """What the modules of a process ask of a keeper."""

    process: Count
    keeper: Count
    parts: list[Attempt | EnterRequest | TileQuery]
    incarnation: Count = 0
    sequence: Count = 0


class Forwards(msgspec.Struct, frozen=True, omit_defaults=True, tag_field="kind", tag="forwards"):
    """What a keeper says to another one."""

    keeper: Count
    to: Count
    parts: list[Forwarded | Decision | Inquiry | Settled]
    incarnation: Count = 0
    sequence: Count = 0


class Replies(msgspec.Struct, frozen=True, omit_defaults=True, tag_field="kind", tag="replies"):
    """What a keeper answers a process."""

    keeper: Count
    process: Count
    parts: list[Decision | Entered]
    incarnation: Count = 0
    sequence: Count = 0


class TileUpdate(msgspec.Struct, frozen=True, omit_defaults=True, tag_field="kind", tag="tile"):
    """What a keeper shows of a tile to the modules near enough to sense it.

    `serial` counts the changes of the tile. `parts` are the places that the last one changed; if
    the tile is shown `whole`, all places where something is or ever was.
    """

    keeper: Count
    tile: Name
    serial: Count
    parts: list[PlaceState]
    whole: bool = False
    incarnation: Count = 0
    sequence: Count = 0


class Turn(msgspec.Struct, frozen=True, omit_defaults=True, tag_field="kind", tag="turn"):
    """A module's rule was called: what it was shown, and what it chose.

    It stood at `site`; `version` is that of the module. `sensed` has for each slot of the module's
    sensed places the version that was shown, -1 for an empty slot; `received`, if the rule has
    notes, for each place within reach the version of the place and that of its module. `action`
    and `note` are the rule's; `number` is the attempt that follows, if one does.
    """

    module: Count
    epoch: Count
    turn: Count
    site: Site
    version: Count
    sensed: list[int]
    action: Count
    received: list[tuple[int, int]] = []
    note: Register | None = None
    guards: list[Site] = []
    heeds: list[Site] = []
    exchanges: list[tuple[Site, Register]] = []
    number: Count | None = None
    failed: _Line | None = None


class Turns(msgspec.Struct, frozen=True, omit_defaults=True, tag_field="kind", tag="turns"):
    """Turns of the modules of a process, in their order."""

    process: Count
    parts: list[Turn]
    incarnation: Count = 0
    sequence: Count = 0


class Halted(msgspec.Struct, frozen=True, omit_defaults=True, tag_field="kind", tag="halted"):
    """The modules of a process have halted after an order, and wait for nothing any more."""

    process: Count
    order: Count = 0
    incarnation: Count = 0
    sequence: Count = 0


class CommitQuery(msgspec.Struct, frozen=True, tag_field="kind", tag="fetch"):
    """The coordinator asks a keeper for its commits after `serial`, some at a time.

    Those up to `recorded` are in the file of the recording, so the keeper may forget them.
    """

    keeper: Count
    serial: Count
    recorded: Count = 0


class RetransmitRange(msgspec.Struct, frozen=True, tag_field="kind", tag="retransmit_range"):
    """The coordinator asks a sender to say its messages after a number again, up to another one.

    `to` is its name. A keeper that has forgotten them, or was restarted, does not answer.
    """

    to: Name
    incarnation: Count
    after: Count
    upto: Count


class CommitLog(msgspec.Struct, frozen=True, omit_defaults=True, tag_field="kind", tag="commits"):
    """A keeper's answer to `CommitQuery`: commits in their order, and how many there are in all.

    `units` has, when no more commits follow, the units that were ever written or read, each with
    its version, its level, how often that version was read, and the site that is on there, null for
    none. `refused` counts the messages that the keeper took for none, and `prepared` the attempts
    that wait for their outcome.
    """

    keeper: Count
    serial: Count
    parts: list[Commit]
    units: list[tuple[Site, Count, Count, Count, Site | None]]
    refused: Count
    prepared: Count
    incarnation: Count = 0
    sequence: Count = 0


FreeMessage: TypeAlias = (
    Requests
    | Forwards
    | Replies
    | TileUpdate
    | Commit
    | Turns
    | Halted
    | CommitQuery
    | RetransmitRange
    | CommitLog
    | Go
    | Refused
    | Edges
    | Cube
    | Certified
    | Summary
)
"""Any message of a run without rounds, on the wire or in its recording."""
FREE_KINDS: dict[str, type[msgspec.Struct]] = {
    kind.__struct_config__.tag: kind for kind in get_args(FreeMessage) if kind not in KINDS.values()
}
"""The kinds that a run with rounds does not have."""

Numbered: TypeAlias = Requests | Forwards | Replies | TileUpdate | Turns
"""The messages that their senders number."""

_OF_PROCESSES = frozenset((Requests, Turns, Halted))
_OF_KEEPERS = frozenset((Forwards, Replies, TileUpdate, Commit, CommitLog))
_ADDRESSEES: dict[type, str] = {
    Requests: "keeper",
    Forwards: "to",
    Replies: "process",
    TileUpdate: "tile",
    CommitQuery: "keeper",
    RetransmitRange: "to",
}
"""The field with the part of a key that says to whom, of the kinds that have one."""

_decoder: msgspec.json.Decoder[FreeMessage] = msgspec.json.Decoder(FreeMessage, dec_hook=site_hook)


def decode_free(data: bytes) -> FreeMessage:
    """Return the message that the bytes hold; NoMessageError if they hold none."""
    try:
        return _decoder.decode(data)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise NoMessageError(f"not a cubepath message: {error}") from None


def free_sender(message: FreeMessage) -> str:
    """Return the name of a message's sender."""
    kind, said = type(message), cast("Any", message)
    if kind in _OF_KEEPERS:
        return keeper_name(said.keeper)
    return process_name(said.process) if kind in _OF_PROCESSES else "coordinator"


def free_kind(message: FreeMessage) -> str:
    """Return the name of a message's kind."""
    return str(message.__struct_config__.tag)


def free_topic(message: FreeMessage) -> str:
    """Return kind and sender, the topic in recordings."""
    return f"{free_kind(message)}/{free_sender(message)}"


def free_key(run: str, message: FreeMessage) -> str:
    """Return the key that a message is put on; it ends with who puts."""
    field = _ADDRESSEES.get(type(message))
    to = "" if field is None else f"{getattr(message, field)}/"
    return f"cubepath/{run}/{free_kind(message)}/{to}{free_sender(message)}"


def read_free(run: str, key: str, data: bytes) -> FreeMessage | None:
    """Return the message that was put on a key; None if there is none, or none that belongs there.

    Only a message that is not too large, and stands on its own key, belongs there.
    """
    if len(data) > MESSAGE_BYTES_MAX:
        return None
    try:
        message = decode_free(data)
    except NoMessageError:
        return None
    return message if key == free_key(run, message) else None


def heard_by_keeper(run: str, keeper: int) -> tuple[str, ...]:
    """Return the key expressions that a keeper listens to."""
    return (
        f"cubepath/{run}/requests/{keeper}/**",
        f"cubepath/{run}/forwards/{keeper}/**",
        f"cubepath/{run}/fetch/{keeper}/**",
        f"cubepath/{run}/retransmit_range/{keeper_name(keeper)}/**",
        f"cubepath/{run}/go/**",
    )


def heard_by_process(run: str, process: int) -> tuple[str, ...]:
    """Return the key expressions that a module process listens to, tiles apart."""
    return (
        f"cubepath/{run}/replies/{process}/**",
        f"cubepath/{run}/retransmit_range/{process_name(process)}/**",
        f"cubepath/{run}/go/**",
    )


def heard_of_tile(run: str, tile: str) -> str:
    """Return the key expression of what is shown of a tile."""
    return f"cubepath/{run}/tile/{tile}/**"


def level_of(message: FreeMessage) -> int:
    """Return the greatest level that a message carries itself, or 0."""
    match message:
        case Commit(level=level):
            return level
        case CommitLog(parts=parts):
            return max((moved.level for moved in parts), default=0)
        case _:
            return 0
