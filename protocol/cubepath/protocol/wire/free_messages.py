"""Messages of a run without rounds: what modules ask of keepers, and what keepers answer and show.

A *keeper* holds the units of some tiles. A *unit* is a site, or in a system with labels a place,
which shows the site that is on there: what two moves may conflict over. An *attempt* of a module
passes through the keepers of its units in increasing order; the last one commits it, and that is
the move. Until then any of them may refuse it. docs/free-clock.md has the protocol.

What is said in one step to one receiver travels as one message with its parts. Bounds and unknown
fields are as in `messages`.

`ask` and `turns` of a process, `pass`, `tell` and `shows` of a keeper are numbered by their sender
in each `birth` of it, from 1 without gap: `said` is the number, 0 if it does not number them.
`rest` and `tail` have none of their own, and tell the last one. Commits are numbered by `serial`.
"""

from __future__ import annotations

from typing import Annotated, TypeAlias

import msgspec

from cubepath.protocol.core.catalogue import Json
from cubepath.protocol.wire.credentials import keeper_name, process_name
from cubepath.protocol.wire.messages import (
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

HOLD_TICKS_MAX = 200
"""So long at most a keeper holds places for a module that thinks."""
Register: TypeAlias = list[NoteNumber]
"""The note of a module as its keeper holds it: empty before it has said anything."""
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
    site: Json
    generator: Name | None = None
    at: Json | None = None
    sensed: list[tuple[Json, Json]] = []
    notes: list[tuple[Json, Register, Register | None]] = []
    after: list[tuple[Json, Count, Count | None]] = []


class Enter(msgspec.Struct, frozen=True, tag_field="kind", tag="enter"):
    """The process of a module asks where the module stands; all before this `birth` are fenced off.

    A process that is started again has a greater birth. Asked again with the same birth, a keeper
    gives the same answer.
    """

    module: Count
    birth: Count


class Hold(msgspec.Struct, frozen=True, tag_field="kind", tag="hold"):
    """A module that was refused time and again asks that some places stay as they are for a while.

    They are places of one keeper that it senses. For `ticks` of the keeper, or until its next
    attempt there is decided, nobody else changes or relies on them; 0 gives them up. It has a
    `number` of its own in each epoch.
    """

    module: Count
    epoch: Count
    number: Count
    places: list[Json]
    ticks: Annotated[int, msgspec.Meta(ge=0, le=HOLD_TICKS_MAX)]


class Look(msgspec.Struct, frozen=True, tag_field="kind", tag="look"):
    """A process asks for all of a tile, unless `serial` is that of its last change."""

    tile: Name
    serial: int


class Occupant(msgspec.Struct, frozen=True):
    """A module as the keeper of its place holds it: its fence, and its register.

    `version` counts the commits that moved it or wrote its register.
    """

    module: Count
    birth: Count
    epoch: Count
    number: Count
    note: Register
    version: Count


class Moved(msgspec.Struct, frozen=True, omit_defaults=True, tag_field="kind", tag="moved"):
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
    at: Json | None = None
    read: list[tuple[Json, Count]] = []
    written: list[tuple[Json, Count, Count]] = []
    guarded: list[tuple[Json, Count]] = []
    motion: list[tuple[Count, Json, Json, Count]] = []
    notes: list[tuple[Json, Count, Count, Register | None]] = []


class Passed(msgspec.Struct, frozen=True, tag_field="kind", tag="passed"):
    """A keeper has prepared an attempt, and passes it on to the next one of its chain.

    `process` is who asked. The rest is what the keepers so far have found for `Moved`; `occupants`
    are the modules of the motion, null where a later keeper has them, and `noted` those whose
    registers are written or have to hold, by their places.
    """

    attempt: Attempt
    process: Count
    level: Count
    read: list[tuple[Json, Count]]
    written: list[tuple[Json, Count, Count]]
    guarded: list[tuple[Json, Count]]
    occupants: list[Occupant | None]
    noted: list[tuple[Json, Occupant]]


class Decision(msgspec.Struct, frozen=True, omit_defaults=True, tag_field="kind", tag="decision"):
    """What came of an attempt: with `moved` it was committed, otherwise refused, and `why`.

    `occupants` are the modules that it changed as they are from now on, each with its site, for the
    keepers of the chain.
    """

    module: Count
    epoch: Count
    number: Count
    why: _Line = ""
    moved: Moved | None = None
    occupants: list[tuple[Json, Occupant]] = []


class Inquiry(msgspec.Struct, frozen=True, tag_field="kind", tag="inquiry"):
    """A keeper that has prepared an attempt asks the last one of its chain what came of it."""

    module: Count
    epoch: Count
    number: Count


class Settled(msgspec.Struct, frozen=True, tag_field="kind", tag="settled"):
    """A keeper has taken note of a commit: the last one of the chain need not remember it."""

    module: Count
    epoch: Count
    number: Count


class Shown(msgspec.Struct, frozen=True, omit_defaults=True, tag_field="kind", tag="shown"):
    """What is at a place: the site that is on, with its module, or nothing.

    `version` counts the moves that wrote the place, and `module_version` is that of the module.
    With a schedule `reads` tells how often units of the place were read: the unit, its version, and
    how many moves have read that.
    """

    place: Json
    version: Count
    site: Json | None = None
    module: Count | None = None
    note: Register = []
    module_version: Count = 0
    reads: list[tuple[Json, Count, Count]] = []


class Entered(msgspec.Struct, frozen=True, tag_field="kind", tag="entered"):
    """The answer to `Enter`: where the module stands, and the epoch in which it may now act."""

    birth: Count
    site: Json
    occupant: Occupant


class Held(msgspec.Struct, frozen=True, tag_field="kind", tag="held"):
    """The places that a module asked for are held for it from now on, and show this."""

    module: Count
    epoch: Count
    number: Count
    parts: list[Shown]


class Asks(msgspec.Struct, frozen=True, omit_defaults=True, tag_field="kind", tag="ask"):
    """What the modules of a process ask of a keeper."""

    process: Count
    keeper: Count
    parts: list[Attempt | Enter | Hold | Look]
    birth: Count = 0
    said: Count = 0


class Passes(msgspec.Struct, frozen=True, omit_defaults=True, tag_field="kind", tag="pass"):
    """What a keeper says to another one."""

    keeper: Count
    to: Count
    parts: list[Passed | Decision | Inquiry | Settled]
    birth: Count = 0
    said: Count = 0


class Tells(msgspec.Struct, frozen=True, omit_defaults=True, tag_field="kind", tag="tell"):
    """What a keeper answers a process."""

    keeper: Count
    process: Count
    parts: list[Decision | Entered | Held]
    birth: Count = 0
    said: Count = 0


class Shows(msgspec.Struct, frozen=True, omit_defaults=True, tag_field="kind", tag="shows"):
    """What a keeper shows of a tile, to whoever is near enough to sense it.

    `serial` counts the changes of the tile. `parts` are the places that the last one changed; if
    the tile is shown `whole`, all places where something is or ever was.
    """

    keeper: Count
    tile: Name
    serial: Count
    parts: list[Shown]
    whole: bool = False
    birth: Count = 0
    said: Count = 0


class Turn(msgspec.Struct, frozen=True, omit_defaults=True, tag_field="kind", tag="turn"):
    """A module's rule was called: what it was shown, and what it chose.

    It stood at `site`; `version` is that of the module. `sensed` has for each slot of the module's
    sensed places the version that was shown, -1 for an empty slot; `heard`, if the rule has notes,
    for each place within reach the version of the place and that of its module. `action` and `note`
    are the rule's; `number` is the attempt that follows, if one does.
    """

    module: Count
    epoch: Count
    turn: Count
    site: Json
    version: Count
    sensed: list[int]
    action: Count
    heard: list[tuple[int, int]] = []
    note: Register | None = None
    guards: list[Json] = []
    heeds: list[Json] = []
    exchanges: list[tuple[Json, Register]] = []
    number: Count | None = None
    failed: _Line | None = None


class Turns(msgspec.Struct, frozen=True, omit_defaults=True, tag_field="kind", tag="turns"):
    """Turns of the modules of a process, in their order."""

    process: Count
    parts: list[Turn]
    birth: Count = 0
    said: Count = 0


class Rest(msgspec.Struct, frozen=True, omit_defaults=True, tag_field="kind", tag="rest"):
    """The modules of a process were told to halt by an order, and wait for nothing any more."""

    process: Count
    order: Count = 0
    birth: Count = 0
    said: Count = 0


class Fetch(msgspec.Struct, frozen=True, tag_field="kind", tag="fetch"):
    """The coordinator asks a keeper for its commits after `serial`, some at a time."""

    keeper: Count
    serial: Count


class Repeat(msgspec.Struct, frozen=True, tag_field="kind", tag="repeat"):
    """The coordinator asks a sender to say its messages after a number again, up to another one.

    `to` is its name. Who has forgotten them, or was born again, says nothing.
    """

    to: Name
    birth: Count
    after: Count
    upto: Count


class Tail(msgspec.Struct, frozen=True, omit_defaults=True, tag_field="kind", tag="tail"):
    """A keeper's answer to `Fetch`: commits in their order, and how many there are in all.

    `units` has, when no more commits follow, the units that were ever written or read, each with
    its version, its level, how often that version was read, and the site that is on there, null for
    none. `refused` counts the messages that the keeper took for none, and `prepared` the attempts
    that wait for their outcome.
    """

    keeper: Count
    serial: Count
    parts: list[Moved]
    units: list[tuple[Json, Count, Count, Count, Json]]
    refused: Count
    prepared: Count
    birth: Count = 0
    said: Count = 0


FreeMessage: TypeAlias = (
    Asks
    | Passes
    | Tells
    | Shows
    | Moved
    | Turns
    | Rest
    | Fetch
    | Repeat
    | Tail
    | Go
    | Refused
    | Edges
    | Cube
    | Certified
    | Summary
)
"""Any message of a run without rounds, on the wire or in its recording."""
FREE_KINDS: dict[str, type[msgspec.Struct]] = {
    "ask": Asks,
    "pass": Passes,
    "tell": Tells,
    "shows": Shows,
    "moved": Moved,
    "turns": Turns,
    "rest": Rest,
    "fetch": Fetch,
    "repeat": Repeat,
    "tail": Tail,
}
"""The kinds that a run with rounds does not have."""

Numbered: TypeAlias = Asks | Passes | Tells | Shows | Turns
"""The messages that their senders number."""

_decoder: msgspec.json.Decoder[FreeMessage] = msgspec.json.Decoder(FreeMessage)


def decode_free(data: bytes) -> FreeMessage:
    """Return the message that the bytes hold; NoMessageError if they hold none."""
    try:
        return _decoder.decode(data)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise NoMessageError(f"not a cubepath message: {error}") from None


def free_sender(message: FreeMessage) -> str:
    """Return the name of a message's sender."""
    match message:
        case Asks(process=process) | Turns(process=process) | Rest(process=process):
            return process_name(process)
        case (
            Passes(keeper=keeper)
            | Tells(keeper=keeper)
            | Shows(keeper=keeper)
            | Moved(keeper=keeper)
            | Tail(keeper=keeper)
        ):
            return keeper_name(keeper)
        case _:
            return "coordinator"


def free_kind(message: FreeMessage) -> str:
    """Return the name of a message's kind."""
    return str(message.__struct_config__.tag)


def free_topic(message: FreeMessage) -> str:
    """Return kind and sender, the topic in recordings."""
    return f"{free_kind(message)}/{free_sender(message)}"


def free_key(run: str, message: FreeMessage) -> str:
    """Return the key that a message is put on; it ends with who puts."""
    kind, who = free_kind(message), free_sender(message)
    match message:
        case Asks(keeper=keeper) | Fetch(keeper=keeper):
            return f"cubepath/{run}/{kind}/{keeper}/{who}"
        case Passes(to=keeper):
            return f"cubepath/{run}/{kind}/{keeper}/{who}"
        case Tells(process=process):
            return f"cubepath/{run}/{kind}/{process}/{who}"
        case Repeat(to=name):
            return f"cubepath/{run}/{kind}/{name}/{who}"
        case Shows(tile=tile):
            return f"cubepath/{run}/{kind}/{tile}/{who}"
        case _:
            return f"cubepath/{run}/{kind}/{who}"


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
        f"cubepath/{run}/ask/{keeper}/**",
        f"cubepath/{run}/pass/{keeper}/**",
        f"cubepath/{run}/fetch/{keeper}/**",
        f"cubepath/{run}/repeat/{keeper_name(keeper)}/**",
        f"cubepath/{run}/go/**",
    )


def heard_by_process(run: str, process: int) -> tuple[str, ...]:
    """Return the key expressions that a module process listens to, tiles apart."""
    return (
        f"cubepath/{run}/tell/{process}/**",
        f"cubepath/{run}/repeat/{process_name(process)}/**",
        f"cubepath/{run}/go/**",
    )


def heard_of_tile(run: str, tile: str) -> str:
    """Return the key expression of what is shown of a tile."""
    return f"cubepath/{run}/shows/{tile}/**"


def level_of(message: FreeMessage) -> int:
    """Return the greatest level that a message tells of for itself, or 0."""
    match message:
        case Moved(level=level):
            return level
        case Tail(parts=parts):
            return max((moved.level for moved in parts), default=0)
        case _:
            return 0
