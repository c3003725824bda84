"""One module of the lockstep protocol, as a pure machine: messages in, messages out.

Room: agents. It holds what the module has been told in this round and nothing else; it opens no
session, reads no clock, and gives the same answers in whatever order messages arrive. Once in a
round: `sense`, `observation`, `claim`, `arbitrate`, then `hear` until `finished`, then `report`.
"""

from __future__ import annotations

from cubepath.agents.local.arbitration import priority
from cubepath.agents.local.observation import Note as NoteNumbers
from cubepath.agents.local.observation import Observation, observe
from cubepath.protocol.core.actions import commute
from cubepath.protocol.core.catalogue import Move
from cubepath.protocol.core.errors import CubepathError
from cubepath.protocol.core.names import GeneratorPlacement
from cubepath.protocol.core.sites import Site, in_order, site_from_json
from cubepath.protocol.core.system import System
from cubepath.protocol.wire.messages import (
    Claim,
    Heard,
    Here,
    Message,
    Note,
    Report,
    Verdict,
    kind_of,
)

_COUNTS_IN = {
    "here": ("sense",),
    "note": ("sense",),
    "claim": ("sense", "claim"),
    "verdict": ("sense", "claim", "settle"),
}
"""The phases in which a kind of message still counts; later it would be late."""


class ProtocolError(CubepathError):
    """A message came when it could no longer count: the order that barriers promise is broken."""


class ModuleCore:
    """The part of a module that is the same for every rule and every transport."""

    def __init__(
        self,
        system: System,
        *,
        module: int,
        site: Site,
        goals: tuple[Site, ...],
        seed: int,
        note_length: int,
    ) -> None:
        """Put the module at its start, before the first round."""
        self.module = module
        self.site = site
        self.round = 0
        self._system = system
        self._goals = frozenset(goals)
        self._seed = seed
        self.follow(note_length)
        self._phase = "report"
        self._stash: list[Message] = []
        self._clear()

    def follow(self, note_length: int) -> None:
        """Follow another rule from the next round on, one with notes of this length."""
        self._note_length = note_length
        self._said: NoteNumbers = (0,) * note_length
        self._first_choice = self.round + 1

    def _clear(self) -> None:
        self._heard: list[Heard] = []
        self._occupants: dict[Site, Site] = {}
        self._notes: dict[Site, NoteNumbers] = {}
        self._claims: dict[int, Move] = {}
        self._verdicts: dict[int, bool] = {}
        self._mask: list[int] = [1]
        self._claim: Move | None = None
        self._granted: bool | None = None
        self._before_me: set[int] = set()
        self._takes_me: set[int] = set()
        self._wait_for_me: list[Site] = []
        self._failed: str | None = None

    @property
    def place(self) -> Site:
        """Return where the module stands."""
        return self._system.place_of(self.site)

    def sense(self, round_number: int) -> list[Message]:
        """Begin a round: say that the module is here, and what its rule said last."""
        self.round = round_number
        self._phase = "sense"
        self._clear()
        found: list[Message] = [Here(round_number, self.module, self.site)]
        # Before the rule's first choice there is nothing to say.
        if self._note_length and round_number > self._first_choice:
            found.append(Note(round_number, self.module, self.site, list(self._said)))
        stash, self._stash = self._stash, []
        for message in stash:
            self.hear(message)
        return found

    def hear(self, message: Message) -> list[Message]:
        """Take in a message; return what it makes the module say (the verdict on its claim)."""
        if not isinstance(message, Here | Note | Claim | Verdict):
            raise ProtocolError(f"module_{self.module}: {kind_of(message)} is not for a module")
        if message.round > self.round:
            self._stash.append(message)
            return []
        kind = kind_of(message)
        if message.round < self.round or self._phase not in _COUNTS_IN[kind]:
            raise ProtocolError(
                f"module_{self.module}: {kind} of module_{message.module} for round"
                f" {message.round} came late, in phase {self._phase} of round {self.round}"
            )
        sender = site_from_json(message.site)
        self._heard.append(Heard(kind, message.module, sender))
        match message:
            case Here():
                self._occupants[self._system.place_of(sender)] = sender
            case Note():
                self._notes[self._system.place_of(sender)] = tuple(message.note)
            case Claim():
                self._claims[message.module] = self._move(sender, message)
            case Verdict():
                self._verdicts[message.module] = message.granted
                if self._phase == "settle":
                    return self._decide()
        return []

    def _move(self, sender: Site, claim: Claim) -> Move:
        at = site_from_json(claim.at)
        move = self._system.move_named(sender, claim.generator, at)
        if move is None:
            raise ProtocolError(
                f"module_{self.module}: module_{claim.module} at {sender!r} claims"
                f" {claim.generator} at {at!r}, which is no move from there"
            )
        return move

    def observation(self) -> Observation:
        """Return the PettingZoo observation; from here on the round hears of no more neighbours."""
        self._phase = "claim"
        seen = observe(
            self._system,
            self.site,
            self._occupants,
            goals=self._goals,
            notes=self._notes,
            note_length=self._note_length,
        )
        self._mask = seen["action_mask"].tolist()
        return seen

    def claim(
        self, action: int, note: NoteNumbers | None, failed: str | None = None
    ) -> list[Message]:
        """Claim the move of an action of the mask; action 0 claims nothing."""
        if note:
            self._said = note
        self._failed = failed
        if not 0 <= action < len(self._mask) or not self._mask[action]:
            raise ProtocolError(f"module_{self.module}: action {action} is not in its mask")
        self._claim = self._system.moves(self.site)[action - 1] if action else None
        if self._claim is None:
            return []
        move = self._claim
        return [Claim(self.round, self.module, self.site, move.generator, move.at)]

    def arbitrate(self) -> list[Message]:
        """All claims are in: find whose verdicts count here, and decide if none is open."""
        self._phase = "settle"
        mine = priority(self._seed, self.round, self.module)
        places: set[Site] = set()
        for other, move in self._claims.items():
            if any(source == self.site for source, _ in move.motion[1:]):
                self._takes_me.add(other)
            if self._claim is None or commute(self._claim.action, move.action):
                continue
            if priority(self._seed, self.round, other) > mine:
                self._before_me.add(other)
            else:
                places.add(self._system.place_of(move.source))
        if self._claim is not None:
            places |= {self._system.place_of(source) for source, _ in self._claim.motion[1:]}
        self._wait_for_me = list(in_order(places))
        return self._decide()

    def _decide(self) -> list[Message]:
        if self._claim is None or self._granted is not None:
            return []
        known = [self._verdicts.get(other) for other in self._before_me]
        if any(known):
            self._granted = False
        elif None not in known:
            self._granted = True
        else:
            return []
        if not self._wait_for_me:
            return []
        return [Verdict(self.round, self.module, self.site, self._granted, list(self._wait_for_me))]

    @property
    def finished(self) -> bool:
        """Tell whether the claim is decided and every verdict that is due has come."""
        return (
            self._phase == "settle"
            and (self._claim is None or self._granted is not None)
            and self._before_me | self._takes_me <= self._verdicts.keys()
        )

    def report(self) -> Report:
        """Execute what was granted, to the module itself or to one that takes it along."""
        before = self.site
        move = self._claim if self._granted else None
        if move is not None:
            self.site = move.target
        for other in self._takes_me:
            if self._verdicts[other]:
                self.site = dict(self._claims[other].motion)[before]
        self._phase = "report"
        outcome = {None: "none", True: "granted", False: "lost"}[self._granted]
        return Report(
            round=self.round,
            module=self.module,
            before=before,
            site=self.site,
            claim=outcome,  # type: ignore[arg-type]
            move=None if move is None else GeneratorPlacement(move.generator, move.at),
            heard=sorted(self._heard, key=lambda heard: (heard.kind, heard.module)),
            failed=self._failed,
        )
