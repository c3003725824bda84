"""The module as a pure machine: messages in, messages out, one round at a time.

It holds only what the module received in this round; it opens no session, reads no clock, and gives
the same answers in whatever order messages arrive. Its decisions come from the functions of
`observation` and `arbitration`. In each round, call it in this order: `sense`, `observation`,
`claim`, `arbitrate`, then `hear` until `finished`, then `report`.

`LastNote` says when a module sends its rule's note. `World` uses it too.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

from cubepath.agents.local import arbitration
from cubepath.agents.local.observation import Note, Observation, chosen_move, is_legal, observe
from cubepath.protocol.core.catalogue import GeneratorPlacement, Move
from cubepath.protocol.core.errors import CubepathError
from cubepath.protocol.core.sites import Site, in_order
from cubepath.protocol.core.system import System
from cubepath.protocol.wire import messages as wire


@dataclass(frozen=True, slots=True)
class LastNote:
    """The last note of a module's rule, a fixed number of integers; none for a silent rule.

    The module sends it from its current site at the beginning of each round after the rule's first
    choice. It is zeros until the rule has chosen with a note.
    """

    numbers: Note
    first_choice: int
    """The round in which the rule chooses for the first time; until then it has sent nothing."""

    def sent_in(self, round_number: int) -> Note | None:
        """Return what the module says at the beginning of a round; None if it says nothing."""
        return self.numbers if self.numbers and round_number > self.first_choice else None

    def replaced_by(self, note: Note | None) -> LastNote:
        """Return the last note after a choice with this note; None or empty leaves it unchanged."""
        return replace(self, numbers=note) if note else self


_COUNTS_IN = {
    "presence": ("sense",),
    "note": ("sense",),
    "claim": ("sense", "claim"),
    "verdict": ("sense", "claim", "settle"),
}
"""The phases in which a kind of message is accepted; in later phases it is late."""


_HEARD = (wire.Presence, wire.Note, wire.Claim, wire.Verdict)


class ProtocolError(CubepathError):
    """A message or action that breaks the protocol: late, of no move, or not in the mask."""


class ModuleCore:
    """The part of a module that is the same for every rule and every transport."""

    def __init__(
        self,
        system: System,
        *,
        module: int,
        site: Site,
        goals: Iterable[Site],
        seed: int,
        note_length: int,
        rounds_before: int = 0,
        later_seeds: Sequence[tuple[int, int]] = (),
    ) -> None:
        """Put the module at its start, before the first round.

        `rounds_before` is the number of the last round before that, if rounds do not begin with 1;
        ranks count from there. `later_seeds` has other seeds, each with the first round whose ranks
        follow it.
        """
        self.module = module
        self.site = site
        self.round = self._rounds_before = rounds_before
        self._system = system
        self._goals = frozenset(goals)
        self._seed = seed
        self._later_seeds = later_seeds
        self.follow(note_length)
        self._phase = "report"
        self._clear()

    def follow(self, note_length: int, *, heard: bool = False) -> None:
        """Follow another rule, with notes of this length, from the next round on.

        What the rule before noted last, of the same length, is still sent if it should be `heard`.
        """
        self._note_length = note_length
        if not heard:
            self._last_note = LastNote((0,) * note_length, first_choice=self.round + 1)

    def _clear(self) -> None:
        self._heard: dict[str, list[int]] = {}
        self._occupants: dict[Site, Site] = {}
        self._notes: dict[Site, Note] = {}
        self._claims: dict[int, Move] = {}
        self._verdicts: dict[int, bool] = {}
        self._mask: list[int] = [1]
        self._claim: Move | None = None
        self._granted: bool | None = None
        self._contest = arbitration.UNCONTESTED
        self._takes_me: frozenset[int] = frozenset()
        self._wait_for_me: list[Site] = []
        self._failed: str | None = None

    @property
    def place(self) -> Site:
        """Return where the module stands."""
        return self._system.place_of(self.site)

    def sense(self, round_number: int) -> list[wire.Part]:
        """Begin a round: return the messages on where the module is and its rule's last note."""
        self.round = round_number
        self._phase = "sense"
        self._clear()
        found: list[wire.Part] = [wire.Presence(round_number, self.module, self.site)]
        note = self._last_note.sent_in(round_number)
        if note is not None:
            found.append(wire.Note(round_number, self.module, self.site, list(note)))
        return found

    def hear(self, message: wire.Message) -> list[wire.Part]:
        """Process a message; return the verdict on the module's claim if the message decides it."""
        if not isinstance(message, _HEARD):
            raise ProtocolError(
                f"module_{self.module}: {wire.kind_of(message)} is not for a module"
            )
        kind = wire.kind_of(message)
        if message.round != self.round or self._phase not in _COUNTS_IN[kind]:
            when = "early" if message.round > self.round else "late"
            raise ProtocolError(
                f"module_{self.module}: {kind} of module_{message.module} for round"
                f" {message.round} came {when}, in phase {self._phase} of round {self.round}"
            )
        self._heard.setdefault(kind, []).append(message.module)
        match message:
            case wire.Presence():
                self._occupants[self._system.place_of(message.site)] = message.site
            case wire.Note():
                self._notes[self._system.place_of(message.site)] = tuple(message.note)
            case wire.Claim():
                self._claims[message.module] = self._move(message)
            case wire.Verdict():
                self._verdicts[message.module] = message.granted
                if self._phase == "settle":
                    return self._decide()
        return []

    def _move(self, claim: wire.Claim) -> Move:
        move = self._system.move_named(claim.site, claim.generator, claim.at)
        if move is None:
            raise ProtocolError(
                f"module_{self.module}: module_{claim.module} at {claim.site!r} claims"
                f" {claim.generator} at {claim.at!r}, which is no move from there"
            )
        return move

    def observation(self) -> Observation:
        """Return the PettingZoo observation; afterwards `here` and `note` messages are late."""
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

    def may(self, action: int) -> bool:
        """Return whether an action is in the mask of the last observation."""
        return is_legal(self._mask, action)

    def claim(self, action: int, note: Note | None, failed: str | None = None) -> list[wire.Part]:
        """Claim the move of an action in the mask; action 0 claims nothing."""
        self._last_note = self._last_note.replaced_by(note)
        self._failed = failed
        if not self.may(action):
            raise ProtocolError(f"module_{self.module}: action {action} is not in its mask")
        move = self._claim = chosen_move(self._system, self.site, self._mask, action)
        if move is None:
            return []
        return [wire.Claim(self.round, self.module, self.site, move.generator, move.at)]

    def arbitrate(self) -> list[wire.Part]:
        """Begin to settle, when all claims have arrived: decide if no verdict is missing."""
        self._phase = "settle"
        self._takes_me = arbitration.taking_along(self.site, self._claims)
        if self._claim is not None:
            self._contest = arbitration.contest(
                self.module,
                self._claim,
                self._claims,
                seed=arbitration.seed_in(self.round, self._seed, self._later_seeds),
                round_number=self.round - self._rounds_before,
            )
            outranked = [self._claims[other] for other in self._contest.after]
            waiting = arbitration.waiting_for(self._claim, outranked)
            self._wait_for_me = list(in_order({self._system.place_of(site) for site in waiting}))
        return self._decide()

    def _decide(self) -> list[wire.Part]:
        if self._claim is None or self._granted is not None:
            return []
        self._granted = arbitration.verdict(self._contest.before, self._verdicts)
        if self._granted is None or not self._wait_for_me:
            return []
        return [
            wire.Verdict(self.round, self.module, self.site, self._granted, list(self._wait_for_me))
        ]

    @property
    def finished(self) -> bool:
        """Return whether the claim is decided and every expected verdict has arrived."""
        # With the verdicts of all that go before it the claim is decided as well.
        return (
            self._phase == "settle"
            and self._contest.before | self._takes_me <= self._verdicts.keys()
        )

    def report(self) -> wire.Report:
        """Execute the granted move, own or one that takes the module along; return the report."""
        before = self.site
        own = self._claim if self._granted else None
        taken = [self._claims[other] for other in self._takes_me if self._verdicts[other]]
        self.site = arbitration.site_after(before, taken if own is None else [own, *taken])
        self._phase = "report"
        return wire.Report(
            round=self.round,
            module=self.module,
            before=before,
            site=self.site,
            claim=arbitration.outcome(self._granted),
            move=None if own is None else GeneratorPlacement(own.generator, own.at),
            received={kind: sorted(self._heard[kind]) for kind in sorted(self._heard)},
            failed=self._failed,
        )
