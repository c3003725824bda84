"""Judging incoming messages: each is accepted, or refused with a reason.

Module processes and the coordinator judge by the same rules, from what every process knows: the
run, the system, and which modules each process has. The coordinator's gatherer also knows where
modules stand and which moves are admissible, and judges the rest.

The phases of a round are defined here: their order, and when a node asks again for what is missing.

The coordinator records its refusals without letting them fill the recording. The first message of a
round with a given sender and reason is recorded immediately, with its first bytes; the number of
further ones follows when the round ends or the wait continues.
"""

from collections import Counter
from collections.abc import Callable, Sequence
from typing import Any, Literal, NoReturn, TypeAlias

from cubepath.agents.local.observation import SILENT
from cubepath.protocol.core.errors import CubepathError, InputError
from cubepath.protocol.core.sites import Site
from cubepath.protocol.core.system import System
from cubepath.protocol.wire import messages as wire
from cubepath.protocol.wire.keys import OF_PROCESSES, belongs, key_of, topic_in_key
from cubepath.protocol.wire.nodes import Keep

Spoken: TypeAlias = Literal["sense", "claim", "settle"]
"""The phases in which modules say something to each other."""
KINDS_IN: dict[str, tuple[type[wire.Part], ...]] = {
    "sense": (wire.Presence, wire.Note),
    "claim": (wire.Claim,),
    "settle": (wire.Verdict,),
}
"""What they say in each."""
ORDER = {"sense": 0, "observe": 1, "claim": 2, "settle": 3, "join": 4, "over": 5}
"""The phases of a round in order; a process joins at the end of the round before the first."""
BEFORE: dict[str, Spoken] = {"observe": "sense", "claim": "sense", "settle": "claim"}
"""What must have been heard before a phase begins."""
ASK_S_MIN, ASK_S_MAX = 1.0, 4.0
"""Seconds after which missing messages are requested; doubled each time, up to the second."""


_SITES_MAX = 1 << 16


class RefusedError(CubepathError):
    """A message that is not taken: the reason in a word or two, and a line.

    `process` is who said what is wrong, if that is not the sender of this message.
    """

    def __init__(self, reason: wire.Reason, why: str, process: int | None = None) -> None:
        super().__init__(why)
        self.reason: wire.Reason = reason
        self.process = process


def refuse(reason: wire.Reason, why: str) -> NoReturn:
    """Refuse a message."""
    raise RefusedError(reason, why)


class Judge:
    """Judges messages of one run."""

    def __init__(self, run: str, modules_of: Sequence[Sequence[int]], system: System) -> None:
        """Know the modules of each process; notes of any length pass until `note_length` is set."""
        self.note_length: int | None = None
        self._run = run
        self._modules_of = [sorted(modules) for modules in modules_of]
        self._process_of = {
            module: process for process, modules in enumerate(modules_of) for module in modules
        }
        self._system = system
        self._checked: set[Site] = set()

    def read(self, key: str, data: bytes) -> wire.Message:
        """Return the message that was put on a key; RefusedError if it may not be there."""
        if len(data) > wire.MESSAGE_BYTES_MAX:
            refuse("too large", f"{len(data)} bytes, expected at most {wire.MESSAGE_BYTES_MAX}")
        try:
            message = wire.decode(data)
        except wire.NoMessageError as error:
            raise RefusedError("malformed", str(error)) from None
        if not belongs(self._run, key, message):
            where, due = topic_in_key(key), topic_in_key(key_of(self._run, message))
            refuse("wrong key", f"{wire.kind_of(message)} put on {where}, expected {due}")
        found: Any = message
        if type(message) in OF_PROCESSES:
            if found.process >= len(self._modules_of):
                refuse("foreign", f"this run has no process_{found.process}")
        elif not isinstance(message, wire.Go | wire.Reset):
            refuse("out of place", f"{wire.kind_of(message)} is on record, and never on the wire")
        return message

    def check(self, bundle: wire.Bundle) -> None:
        """Raise RefusedError if a bundle cannot be."""
        process, round_number, parts = bundle.process, bundle.round, bundle.parts
        kinds, process_of, checked = KINDS_IN[bundle.phase], self._process_of, self._checked
        for part in parts:
            in_phase = part.round == round_number and type(part) in kinds
            if process_of.get(part.module) != process or not in_phase:
                _refuse_part(bundle, part)
            if part.site not in checked:
                self._check_sender(part)
            if type(part) is not wire.Presence:
                self._check_content(part)
        if len(parts) > 1 and len({(type(part), part.module) for part in parts}) != len(parts):
            refuse("doubled", f"process_{bundle.process} says something twice in one message")
        if bundle.number and bundle.phase != "settle":
            refuse("out of place", f"a second message of phase {bundle.phase} to {bundle.region}")
        modules = len(self._modules_of[bundle.process])
        if bundle.number >= modules:
            # Each verdict may come in a separate bundle, and each module has one.
            refuse(
                "out of place",
                f"message {bundle.number} of {modules} modules to {bundle.region},"
                " expected one each",
            )

    def _check_content(self, part: wire.Part) -> None:
        match part:
            case wire.Note(note=note):
                self._check_note(_name(part), note)
            case wire.Claim():
                self._check_claim(part)
            case wire.Verdict(to=to):
                for place in to:
                    # A place without its label is no site of a labelled system, and still a place.
                    _check_site(part, place, self._system.check_place)
            case _:
                pass

    def _check_note(self, name: str, note: Sequence[int]) -> None:
        if self.note_length not in (None, len(note)):
            refuse("malformed", f"{name}: {len(note)} numbers, expected {self.note_length}")
        if SILENT in note:
            refuse("malformed", f"{name}: {SILENT} stands for no note, expected more")

    def _check_claim(self, claim: wire.Claim) -> None:
        try:
            move = self._system.move_named(claim.site, claim.generator, claim.at)
        except _NO_PLACE:
            move = None
        if move is None:
            where = f"{claim.generator} at {_short(claim.at)}"
            refuse("impossible", f"{_name(claim)}: {where} is no move from there")

    def _check_sender(self, part: wire.Part) -> None:
        """Check the site of a sender, once."""
        _check_site(part, part.site, self._check_module_site)
        if len(self._checked) >= _SITES_MAX:
            self._checked.clear()
        self._checked.add(part.site)

    def _check_module_site(self, site: Site) -> None:
        system = self._system
        system.check_place(system.place_of(site))
        system.code_of(site)
        if system.labels is not None:
            label = system.label_of(site)
            if label is None or not 0 <= label < system.labels:
                raise InputError("no such label")

    def check_whole(self, message: wire.Reports | wire.Observations | wire.ChosenActions) -> None:
        """Check that a message has a part of this round for each module of its process."""
        modules = [part.module for part in message.parts]
        for part in message.parts:
            if self._process_of.get(part.module) != message.process:
                refuse(
                    "foreign",
                    f"{wire.kind_of(part)} of module_{part.module}, which is not in"
                    f" process_{message.process}",
                )
            if part.round != message.round:
                refuse(
                    "out of place", f"{wire.kind_of(part)} of round {part.round} in {message.round}"
                )
            if isinstance(part, wire.ChosenAction) and part.note:
                self._check_note(f"action for module_{part.module}", part.note)
        if sorted(modules) != self._modules_of[message.process]:
            refuse(
                "malformed",
                f"{wire.kind_of(message)} of process_{message.process} for {len(modules)} modules,"
                f" expected one each for its {len(self._modules_of[message.process])}",
            )


_NO_PLACE = (InputError, TypeError, ValueError, IndexError, KeyError, AttributeError, OverflowError)
"""What systems raise for a value that is none of their sites: their functions take sites only."""
_SHORT_MAX = 80


def _name(part: wire.Part) -> str:
    return f"{wire.kind_of(part)} of module_{part.module}"


def _refuse_part(bundle: wire.Bundle, part: wire.Part) -> NoReturn:
    """Refuse what a process says for a module of another, or at another time."""
    when = f"round {part.round}, said in phase {bundle.phase} of round {bundle.round}"
    if part.round != bundle.round or type(part) not in KINDS_IN[bundle.phase]:
        refuse("out of place", f"{_name(part)} of {when}")
    refuse("foreign", f"{_name(part)}, which is not in process_{bundle.process}")


def _check_site(part: wire.Part, site: Site, check: Callable[[Site], None]) -> None:
    """Refuse a part that names a site which does not pass a check."""
    try:
        check(site)
    except _NO_PLACE:
        refuse("impossible", f"{_name(part)}: {_short(site)} is no place of a module")


def _short(value: object) -> str:
    text = repr(value)
    return text if len(text) <= _SHORT_MAX else f"{text[:_SHORT_MAX]}..."


_KINDS_MAX = 32
"""The number of different senders and reasons that are counted in a round."""
_OTHERS = "others"
_NAME_MAX, _KEY_MAX, _WHY_MAX, _SAMPLE_MAX = 64, 200, 400, 200


class Refusals:
    """The messages that were refused in a run."""

    def __init__(self) -> None:
        """Begin with none."""
        self.count = 0
        """How many there were so far."""
        self.last: wire.Refused | None = None
        """The last that was recorded in full."""
        self._known: dict[tuple[str, wire.Reason], wire.Refused] = {}
        self._more: Counter[tuple[str, wire.Reason]] = Counter()
        self._round = -1

    def add(
        self, round_number: int, key: str, data: bytes, error: RefusedError
    ) -> list[Keep[wire.Refused]]:
        """Count a message that was refused; return what there is to tell of it now."""
        effects = [] if round_number == self._round else self._begin(round_number)
        self.count += 1
        topic = topic_in_key(key)
        sender = topic.rpartition("/")[2][:_NAME_MAX]
        if (sender, error.reason) not in self._known and len(self._known) >= _KINDS_MAX:
            sender = _OTHERS
        kind = sender, error.reason
        if kind in self._known:
            self._more[kind] += 1
            return effects
        self._known[kind] = self.last = wire.Refused(
            round=round_number,
            key=topic[:_KEY_MAX],
            sender=sender,
            reason=error.reason,
            detail=str(error)[:_WHY_MAX],
            count=1,
            sample=data[:_SAMPLE_MAX].decode(errors="replace"),
        )
        return [*effects, _keep(self.last)]

    def new_refusals(self) -> list[Keep[wire.Refused]]:
        """Return how many more there were of each kind since this was asked."""
        found = []
        for kind, more in self._more.items():
            first = self._known[kind]
            found.append(
                _keep(
                    wire.Refused(
                        first.round, first.key, first.sender, first.reason, first.detail, more
                    )
                )
            )
        self._more.clear()
        return found

    def _begin(self, round_number: int) -> list[Keep[wire.Refused]]:
        found = self.new_refusals()
        self._known.clear()
        self._round = round_number
        return found


def _keep(refused: wire.Refused) -> Keep[wire.Refused]:
    return Keep(wire.encode(refused), refused)
