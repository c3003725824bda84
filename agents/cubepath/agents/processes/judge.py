"""Judging what comes in: a message is taken, or refused with a reason; nothing is raised elsewhere.

Module processes and the coordinator judge alike, by what every process knows: the run, the system,
and which modules each process has. What is left to judge, where modules stand and which moves are
admissible, the coordinator's gatherer knows.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NoReturn

import msgspec

from cubepath.agents.local.observation import SILENT
from cubepath.agents.processes.phases import KINDS_IN
from cubepath.protocol.core.errors import CubepathError, InputError
from cubepath.protocol.core.sites import Site, site_from_json
from cubepath.protocol.core.system import System
from cubepath.protocol.wire.keys import belongs, key_of, topic_in_key
from cubepath.protocol.wire.messages import (
    MESSAGE_BYTES_MAX,
    Act,
    Acts,
    Again,
    Claim,
    Go,
    Here,
    Message,
    NoMessageError,
    Note,
    Observations,
    Part,
    Ready,
    Reason,
    Reports,
    Reset,
    Said,
    Verdict,
    Waiting,
    decode,
    encode,
    kind_of,
)

_SITES_MAX = 1 << 16


class RefusedError(CubepathError):
    """A message that is not taken: the reason in a word or two, and a line.

    `process` is who said what is wrong, if that is not the sender of this message.
    """

    def __init__(self, reason: Reason, why: str, process: int | None = None) -> None:
        super().__init__(why)
        self.reason: Reason = reason
        self.process = process


def refuse(reason: Reason, why: str) -> NoReturn:
    """Refuse a message."""
    raise RefusedError(reason, why)


class Heard(msgspec.Struct, frozen=True):
    """What was said, with the sites from which its parts were said."""

    said: Said
    senders: tuple[Site, ...]


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
        self._sites: dict[bytes, Site] = {}

    def read(self, key: str, data: bytes) -> Message:
        """Return the message that was put on a key; RefusedError if it may not be there."""
        if len(data) > MESSAGE_BYTES_MAX:
            refuse("too large", f"{len(data)} bytes, expected at most {MESSAGE_BYTES_MAX}")
        try:
            message = decode(data)
        except NoMessageError as error:
            raise RefusedError("malformed", str(error)) from None
        if not belongs(self._run, key, message):
            where, due = topic_in_key(key), topic_in_key(key_of(self._run, message))
            refuse("wrong key", f"{kind_of(message)} put on {where}, expected {due}")
        match message:
            case Ready() | Said() | Reports() | Observations() | Acts() | Again() | Waiting():
                if message.process >= len(self._modules_of):
                    refuse("foreign", f"this run has no process_{message.process}")
            case Go() | Reset():
                pass
            case _:
                refuse("out of place", f"{kind_of(message)} is on record, and never on the wire")
        return message

    def heard(self, said: Said) -> Heard:
        """Return what was said with the sites of its speakers; RefusedError if it cannot be."""
        process, round_number = said.process, said.round
        kinds, process_of, sites = KINDS_IN[said.phase], self._process_of, self._sites
        senders: list[Site] = []
        for part in said.parts:
            in_phase = part.round == round_number and type(part) in kinds
            if process_of.get(part.module) != process or not in_phase:
                _refuse_part(said, part)
            sender = sites.get(encode(part.site))
            if sender is None:
                sender = self._read_site(part)
            if type(part) is not Here:
                self._check_content(part, sender)
            senders.append(sender)
        if len({(type(part), part.module) for part in said.parts}) != len(said.parts):
            refuse("doubled", f"process_{said.process} says something twice in one message")
        if said.number and said.phase != "settle":
            refuse("out of place", f"a second message of phase {said.phase} to {said.region}")
        modules = len(self._modules_of[said.process])
        if said.number >= modules:
            # Verdicts are said one by one at most, and each module has one.
            refuse(
                "out of place",
                f"message {said.number} of {modules} modules to {said.region}, expected one each",
            )
        return Heard(said, tuple(senders))

    def _check_content(self, part: Part, sender: Site) -> None:
        match part:
            case Note(note=note):
                self._check_note(_name(part), note)
            case Claim():
                self._check_claim(part, sender)
            case Verdict(to=to):
                for place in to:
                    # A place without its label is no site of a labelled system, and still a place.
                    _known(part, place, self._system.check_place)
            case _:
                pass

    def _check_note(self, name: str, note: Sequence[int]) -> None:
        if self.note_length not in (None, len(note)):
            refuse("malformed", f"{name}: {len(note)} numbers, expected {self.note_length}")
        if SILENT in note:
            refuse("malformed", f"{name}: {SILENT} stands for no note, expected more")

    def _check_claim(self, claim: Claim, sender: Site) -> None:
        try:
            move = self._system.move_named(sender, claim.generator, site_from_json(claim.at))
        except _NO_PLACE:
            move = None
        if move is None:
            where = f"{claim.generator} at {_short(claim.at)}"
            refuse("impossible", f"{_name(claim)}: {where} is no move from there")

    def _read_site(self, part: Part) -> Site:
        """Return the site of a speaker, and know it by its spelling from now on."""
        site = _known(part, part.site, self._checked_site)
        if len(self._sites) >= _SITES_MAX:
            self._sites.clear()
        self._sites[encode(part.site)] = site
        return site

    def _checked_site(self, site: Site) -> None:
        system = self._system
        system.check_place(system.place_of(site))
        system.code_of(site)
        if system.labels is not None:
            label = system.label_of(site)
            if label is None or not 0 <= label < system.labels:
                raise InputError("no such label")

    def check_whole(self, message: Reports | Observations | Acts) -> None:
        """Check that a message has a part of this round for each module of its process."""
        modules = [part.module for part in message.parts]
        for part in message.parts:
            if self._process_of.get(part.module) != message.process:
                refuse(
                    "foreign",
                    f"{kind_of(part)} of module_{part.module}, who is not in"
                    f" process_{message.process}",
                )
            if part.round != message.round:
                refuse("out of place", f"{kind_of(part)} of round {part.round} in {message.round}")
            if isinstance(part, Act) and part.note:
                self._check_note(f"action for module_{part.module}", part.note)
        if sorted(modules) != self._modules_of[message.process]:
            refuse(
                "malformed",
                f"{kind_of(message)} of process_{message.process} for {len(modules)} modules,"
                f" expected one each for its {len(self._modules_of[message.process])}",
            )


_NO_PLACE = (InputError, TypeError, ValueError, IndexError, KeyError, AttributeError, OverflowError)
"""What systems raise for a value that is none of their sites: their functions take sites only."""
_SHORT_MAX = 80


def _name(part: Part) -> str:
    return f"{kind_of(part)} of module_{part.module}"


def _refuse_part(said: Said, part: Part) -> NoReturn:
    """Refuse what a process says for a module of another, or at another time."""
    when = f"round {part.round}, said in phase {said.phase} of round {said.round}"
    if part.round != said.round or type(part) not in KINDS_IN[said.phase]:
        refuse("out of place", f"{_name(part)} of {when}")
    refuse("foreign", f"{_name(part)}, who is not in process_{said.process}")


def _known(part: Part, value: object, check: Callable[[Any], None]) -> Site:
    """Return a site that a part names, if it passes a check."""
    try:
        found = site_from_json(value)
        check(found)
    except _NO_PLACE:
        refuse("impossible", f"{_name(part)}: {_short(value)} is no place of a module")
    return found


def _short(value: object) -> str:
    text = repr(value)
    return text if len(text) <= _SHORT_MAX else f"{text[:_SHORT_MAX]}..."
