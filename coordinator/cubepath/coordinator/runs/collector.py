"""A node that collects the messages of a run without rounds, and asks for those it lacks.

It decides nothing, and nothing waits for it. It may start late, or leave and come back, since
keepers have logged everything that was committed. Other messages are sent again as long as their
senders have them. By the senders' numbers it knows which messages have arrived, and which are lost.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Literal, TypeAlias

from cubepath.agents.processes.judge import Refusals, RefusedError
from cubepath.coordinator.runs.free_gatherer import FreeGatherer
from cubepath.protocol.core.errors import CheckError
from cubepath.protocol.wire.free_messages import (
    Commit,
    CommitLog,
    CommitQuery,
    Forwards,
    FreeMessage,
    Halted,
    Replies,
    Requests,
    RetransmitRange,
    TileQuery,
    TileUpdate,
    Turns,
    decode_free,
    free_key,
    free_kind,
    free_sender,
)
from cubepath.protocol.wire.keys import everything, topic_in_key
from cubepath.protocol.wire.messages import MESSAGE_BYTES_MAX, Go, NoMessageError, Refused, encode
from cubepath.protocol.wire.nodes import Effect, Keep, Listen, Node, Put, Timer

ASKS_MAX = 12
"""How often it is asked for the same messages; then they are given up."""


@dataclass(slots=True)
class _Incarnation:
    """What has arrived from one incarnation of a sender."""

    incarnation: int
    upto: int = 0
    """All messages up to this number have come, or were given up."""
    beyond: set[int] = field(default_factory=set)
    last: int = 0
    """The greatest number that is known to have been given."""
    left: int = 0
    """How many messages are still lacking since it was last asked."""
    asks: int = 0

    def take(self, number: int, *, own: bool) -> None:
        self.last = max(self.last, number)
        if own and number > self.upto:
            self.beyond.add(number)
            self._close()

    def _close(self) -> None:
        while self.upto + 1 in self.beyond:
            self.upto += 1
            self.beyond.remove(self.upto)

    @property
    def lacking(self) -> int:
        return self.last - self.upto - len(self.beyond)

    def give_up(self) -> None:
        self.upto, self.asks = min(self.beyond, default=self.last + 1) - 1, 0
        self._close()


class SequenceTracker:
    """The messages received from each sender in its last incarnation."""

    def __init__(self) -> None:
        self._incarnations: dict[str, _Incarnation] = {}

    def take(self, message: FreeMessage) -> bool:
        """Note a message; return whether no later incarnation of its sender has been heard."""
        number = getattr(message, "sequence", 0)
        incarnation = getattr(message, "incarnation", 0)
        sender = free_sender(message)
        known = self._incarnations.get(sender)
        if number and (known is None or known.incarnation < incarnation):
            known = self._incarnations[sender] = _Incarnation(incarnation)
        if number and known is not None and known.incarnation == incarnation:
            known.take(number, own=not isinstance(message, Halted | CommitLog))
        return known is None or known.incarnation <= incarnation

    @property
    def lacking(self) -> int:
        """Return how many messages are known to be missing and were not given up."""
        return sum(known.lacking for known in self._incarnations.values())

    def asks(self) -> Iterator[RetransmitRange]:
        """Yield what to ask of whom; what does not come after many times is given up."""
        for sender, known in sorted(self._incarnations.items()):
            lacking = known.lacking
            if not lacking:
                continue
            known.asks = known.asks + 1 if lacking == known.left else 1
            known.left = lacking
            if known.asks > ASKS_MAX:
                known.give_up()
            elif known.asks > 1:  # what has just been said may be on its way
                before = min(known.beyond, default=known.last + 1)
                yield RetransmitRange(sender, known.incarnation, known.upto, before - 1)


LOOK_S = 0.25
"""How often it looks for what it lacks."""
TAIL_LOOKS = 8
"""After this many looks without anything new it asks keepers whether there is more."""


RECORDED_STEP = 1000
"""After this many commits a keeper is told that they are in the file of the recording."""


class Collector(Node):
    """Hears everything in a run, and passes it on to the gatherer and to the record."""

    def __init__(
        self, run: str, gatherer: FreeGatherer, keepers: int, modules_of: Sequence[Sequence[int]]
    ) -> None:
        """Gather a run of this many keepers; each process speaks for its own modules."""
        self.gatherer = gatherer
        self.level = 0
        """The greatest level heard of."""
        self.moves = 0
        """How many moves and exchanges were heard of; some may come twice."""
        self.tails: dict[int, CommitLog] = {}
        """The last answer of each keeper, since these were last cleared."""
        self.resting: set[int] = set()
        """Processes that have answered the last order to halt."""
        self.contradiction: CheckError | None = None
        """What was wrong with the first message that contradicts others, or cannot be."""
        self._order = Go(0, "sense")
        self._run = run
        self._modules_of = [frozenset(modules) for modules in modules_of]
        self._keepers = keepers
        self._refusals = Refusals()
        self._heard = SequenceTracker()
        self._quiet = 0
        self._recorded = [0] * keepers
        """How many commits of each keeper are in the file of the recording, and perhaps more."""
        self._unanswered = [0] * keepers
        """How often each keeper was asked since it last answered."""

    def start(self) -> list[Effect]:
        """Listen, and ask keepers what there was before."""
        return [Listen((everything(self._run),)), *self.fetch(), Timer(LOOK_S)]

    def receive(self, key: str, data: bytes) -> list[Effect]:
        """Take a message, which goes in the recording even if it is a `contradiction`."""
        try:
            message = _read(self._run, key, data)
            self._check_speaker(message)
        except RefusedError as error:
            return list(self._refusals.add(self.level, key, data, error))
        more: list[Effect] = []
        latest = self._heard.take(message)
        match message:
            case Commit():
                self._quiet = 0
                self._heard_of(message)
            case CommitLog():
                for moved in message.parts:
                    self._heard_of(moved)
                self.tails[message.keeper] = message
                if message.keeper < self._keepers:
                    self._unanswered[message.keeper] = 0
                if message.parts and message.parts[-1].serial < message.serial:
                    more = self._fetch(message.keeper, message.parts[-1].serial)
            case Halted(process=process, order=order):
                # An answer to an earlier order may come late, and a process that was replaced
                # answers too when it wakes.
                if order == self._order.round and latest:
                    self.resting.add(process)
            case _:
                pass
        try:
            self.gatherer.take(message)
        except CheckError as error:
            self.contradiction = self.contradiction or error
        return [Keep(data, message), *more]

    def forget(self, name: str) -> None:
        """Forget that a process rests, which has died and may have been started again."""
        kind, _, number = name.partition("_")
        if kind == "process":
            self.resting.discard(int(number))

    def _check_speaker(self, message: _Said) -> None:
        """Check that a process speaks for its own modules; or RefusedError."""
        if not isinstance(message, Requests | Turns | Halted):
            return
        process = message.process
        if process >= len(self._modules_of):
            raise RefusedError("foreign", f"this run has no process_{process}")
        for part in () if isinstance(message, Halted) else message.parts:
            module = None if isinstance(part, TileQuery) else part.module
            if module is not None and module not in self._modules_of[process]:
                raise RefusedError("foreign", f"module_{module} is not in process_{process}")

    def _heard_of(self, moved: Commit) -> None:
        self.moves += 1
        self.level = max(self.level, moved.level)

    def tick(self) -> list[Effect]:
        """Ask for messages that are missing; when all is quiet, ask whether there are any."""
        self._quiet += 1
        effects: list[Effect] = list(self._refusals.new_refusals())
        for asked in self._heard.asks():
            effects += self.say(asked)
        missing = self.gatherer.missing()
        if missing:
            for keeper, serial in missing.items():
                effects += self._fetch(keeper, serial)
        elif self._quiet >= TAIL_LOOKS:
            self._quiet = 0
            effects += self.fetch()
        return [*effects, Timer(LOOK_S)]

    def fetch(self) -> list[Effect]:
        """Ask every keeper for what was committed after what is known of it."""
        return [
            effect
            for keeper in range(self._keepers)
            for effect in self._fetch(keeper, self.gatherer.known(keeper))
        ]

    @property
    def silent(self) -> list[int]:
        """Return the keepers that were asked twice or more, and have not answered."""
        return [keeper for keeper, times in enumerate(self._unanswered) if times > 1]

    def record(self, flush: Callable[[], object]) -> list[Effect]:
        """Tell keepers of what many commits need not be kept any more, once they are flushed."""
        known = [self.gatherer.known(keeper) for keeper in range(self._keepers)]
        due = [n for n, serial in enumerate(known) if serial >= self._recorded[n] + RECORDED_STEP]
        if due:
            flush()
            self._recorded = known
        return [effect for keeper in due for effect in self._fetch(keeper, known[keeper])]

    def _fetch(self, keeper: int, serial: int) -> list[Effect]:
        self._unanswered[keeper] += 1
        return self.say(CommitQuery(keeper, serial, self._recorded[keeper]))

    def halt(self) -> list[Effect]:
        """Tell all modules to halt, and their processes to say when they rest."""
        return self._give_order("over")

    def resume(self) -> list[Effect]:
        """Tell all modules to continue."""
        return self._give_order("sense")

    def _give_order(self, phase: Literal["over", "sense"]) -> list[Effect]:
        self.resting.clear()
        self._order = Go(self._order.round + 1, phase)
        return self.repeat_order()

    def repeat_order(self) -> list[Effect]:
        """Give the last order once more."""
        return self.say(self._order)

    def say(self, message: CommitQuery | RetransmitRange | Go) -> list[Effect]:
        """Return how a message of the coordinator is put."""
        return [Put(free_key(self._run, message), encode(message))]

    @property
    def lacking(self) -> int:
        """Return how many messages are missing by their numbers, and were not given up."""
        return self._heard.lacking

    @property
    def settled(self) -> bool:
        """Return whether every keeper has answered, and nothing is under way or lacking."""
        tails = self.tails.values()
        return (
            len(self.tails) == self._keepers
            and all(tail.prepared == 0 for tail in tails)
            and self.gatherer.unfinished is None
            and not self.lacking
        )


_Said: TypeAlias = Requests | Forwards | Replies | TileUpdate | Commit | Turns | Halted | CommitLog


def _read(run: str, key: str, data: bytes) -> _Said:
    if len(data) > MESSAGE_BYTES_MAX:
        raise RefusedError("too large", f"{len(data)} bytes, expected at most {MESSAGE_BYTES_MAX}")
    try:
        message = decode_free(data)
    except NoMessageError as error:
        raise RefusedError("malformed", str(error)) from None
    if key != free_key(run, message):
        where, due = topic_in_key(key), topic_in_key(free_key(run, message))
        raise RefusedError("wrong key", f"{free_kind(message)} put on {where}, expected {due}")
    if isinstance(
        message, Requests | Forwards | Replies | TileUpdate | Commit | Turns | Halted | CommitLog
    ):
        return message
    raise RefusedError("out of place", f"{free_kind(message)} is the coordinator's own")


def refusals_in(kept: Keep[FreeMessage]) -> int:
    """Return how many refused messages a recorded message reports."""
    return kept.message.count if isinstance(kept.message, Refused) else 0
