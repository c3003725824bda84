"""Rounds derived again from the start state, and compared with a recording.

Part of `cubepath verify`: it shares only the catalogue (`System.moves`), `commute` and the
neighbourhoods of the system (`sensed`, `reach`) with a run. States, ranks, winners and deliveries
are derived again, by their definitions. So are the regions to which each part of a bundle had to
go.
"""

from array import array
from collections import deque
from collections.abc import Iterable, Mapping, Sequence, Set as AbstractSet
from functools import lru_cache
from hashlib import sha256

import msgspec

from cubepath.coordinator.verification.parameters import RuleStage
from cubepath.coordinator.verification.transcript import (
    Fail,
    ModuleMessage,
    RecordedRound,
    Transcript,
    named,
)
from cubepath.protocol.core.actions import Action, commute
from cubepath.protocol.core.catalogue import GeneratorPlacement, Move
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.sites import Site, in_order, site_text
from cubepath.protocol.core.system import Scene, System
from cubepath.protocol.wire import messages as wire

_SAID_IN = {"presence": "sense", "note": "sense", "claim": "claim", "verdict": "settle"}


class Batches:
    """The batches of a run, a round at a time; `fail` is called for each violation."""

    def __init__(self, system: System, fail: Fail) -> None:
        """Begin before the first round, when no module has spoken yet."""
        self._system = system
        self._fail = fail
        self._process_of: dict[int, int] = {}
        self._regions = lru_cache(maxsize=1 << 14)(self._regions_near)

    def check(self, number: int, this: RecordedRound) -> None:
        """Check the batches of a round, which is complete."""
        numbers: dict[tuple[int, str, str], set[int]] = {}
        gone: dict[tuple[str, int], set[str]] = {}
        for batch in this.batches:
            if isinstance(batch, wire.Bundle):
                key = (batch.process, batch.phase, batch.region)
                numbers.setdefault(key, set()).add(batch.number)
            for part in batch.parts:
                self._check_process(part, batch.process)
                if isinstance(batch, wire.Bundle) and not isinstance(part, wire.Report):
                    self._check_phase(part, batch.phase)
                    gone.setdefault((wire.kind_of(part), part.module), set()).add(batch.region)
        for (process, phase, region), found in sorted(numbers.items()):
            if found != set(range(len(found))):
                self._fail(
                    "bundle",
                    f"round {number}, process_{process}: what it said to region {region} in phase"
                    f" {phase} is numbered {sorted(found)}, not from 0 on",
                )
        for sender, regions in sorted(gone.items()):
            self._check_regions(this.messages.get(sender), regions)

    def _check_process(self, part: wire.Part | wire.Report, process: int) -> None:
        if self._process_of.setdefault(part.module, process) != process:
            self._fail(
                "bundle",
                f"{named(part)} comes from process_{process}, but the module is in"
                f" process_{self._process_of[part.module]}",
            )

    def _check_phase(self, part: wire.Part, phase: str) -> None:
        due = _SAID_IN[wire.kind_of(part)]
        if phase != due:
            self._fail("bundle", f"{named(part)} was sent in phase {phase}, not in {due}")

    def _check_regions(self, part: wire.Part | None, regions: set[str]) -> None:
        due = None if part is None else self._due(part)
        if part is None or due is None:
            return  # named elsewhere: there is no such module, or no such place
        if regions - due:
            self._fail("bundle", f"{named(part)} goes to region {min(regions - due)} in vain")
        if due - regions:
            self._fail("bundle", f"{named(part)} does not go to region {min(due - regions)}")

    def _due(self, part: wire.Part) -> frozenset[str] | None:
        """Return the regions that a part is for; None if one of its sites is malformed."""
        try:
            if isinstance(part, wire.Verdict):
                if all(self._is_place(place) for place in part.to):
                    return frozenset(self._system.region(place) for place in part.to)
                return None
            place = self._system.place_of(part.site)
            if self._is_place(place):
                return self._regions(place, wire.kind_of(part) == "presence")
        except (TypeError, IndexError, ValueError, InputError):
            pass  # it is no site of this system
        return None

    def _is_place(self, place: Site | None) -> bool:
        return place is not None and self._system.has_place(place)

    def _regions_near(self, place: Site, here: bool) -> frozenset[str]:  # noqa: FBT001 - a cache key
        system = self._system
        near: Iterable[Site] = system.listeners(place) if here else system.reach(place)
        return frozenset(system.region(each) for each in near)


Moves = dict[int, Move]
"""Moves by the module that makes them."""


def is_admissible(action: Action, state: AbstractSet[Site]) -> bool:
    """Return whether the action is admissible at the state.

    Definition: in the fixed part of the support exactly one of the two local states is on, and
    wherever a guarded site is on, so is its neighbour.
    """
    on = action.support & state
    if (on - action.free if action.free else on) not in action.ends:
        return False
    return not action.guards or all(
        neighbour in on for site, neighbour in action.guards if site in on
    )


def why_not(action: Action, state: AbstractSet[Site]) -> str | None:
    """Return in one line why the action is not admissible at the state, None if it is."""
    if is_admissible(action, state):
        return None
    on = action.support & state
    if on - action.free not in action.ends:
        there = site_text(tuple(in_order(on)))
        return f"{action.label}: {there} of its support are on, which is neither end"
    site, neighbour = next(
        (site, neighbour) for site, neighbour in action.guards if site in on and neighbour not in on
    )
    return f"{action.label}: {site_text(site)} is on, and {site_text(neighbour)} is not"


def make(action: Action, state: set[Site]) -> None:
    """Change the state by an admissible action, which replaces one local state by the other."""
    one, other = action.ends
    on = frozenset(site for site in action.support - action.free if site in state)
    gone, come = (one, other) if on == one else (other, one)
    state -= gone
    state |= come


NOTE_MIN, NOTE_MAX = -(2**31) + 1, 2**31 - 1
"""The numbers of a note are int32; the least int32 stands where no note was heard."""
_NO_EDGES = "no edges on record"


class Rederivation:
    """The edge path, derived a round at a time; `fail` is called for each violation."""

    def __init__(
        self, scene: Scene, seed: int | None, fail: Fail, stages: Iterable[RuleStage] = ()
    ) -> None:
        """Begin at the start; without a seed it is not known which claims outrank which.

        With `stages` it is the seed of the stage.
        """
        self.state: set[Site] = set(scene.start) | scene.system.filled
        self.sites: list[Site] = list(scene.start)
        self.actions: list[Action] = []
        self.ends = array("q")
        """How many actions there are up to the end of each round."""
        self.moves = 0
        """The number of moves as reported."""
        self._digest = sha256()
        self._odd_edges: list[tuple[int, str]] = []
        self._scene = scene
        self._system = scene.system
        self._seed = seed
        self._note_length = 0
        """The length of notes: of the rules of a stage one talks at most, or all alike."""
        self._stages = deque(stages)
        self._batches = Batches(scene.system, fail)
        self._fail = fail

    def round(self, number: int, recorded: RecordedRound) -> None:
        """Derive a round and check everything sent and reported in it."""
        where = f"round {number}"
        while self._stages and self._stages[0].begins <= number:
            stage = self._stages.popleft()
            self._seed = stage.seed
            if not stage.heard:
                self._note_length = 0
        moves = self._moves(where, recorded.reports)
        self._check_commuting(where, moves)
        self._check_messages(where, recorded)
        self._batches.check(number, recorded)
        self._check_claims(number, recorded)
        self._check_hearing(recorded)
        before = list(self.sites)
        self._execute(where, moves)
        self._check_sites(recorded.reports, before)
        executed = [
            wire.Executed(module, report.move.generator, report.move.at)
            for module, report in recorded.reports.items()
            if report.move is not None
        ]
        self.moves += len(executed)
        for move in executed:
            line = [number, move.module, move.generator, move.at]
            self._digest.update(msgspec.json.encode(line) + b"\n")
        if recorded.edges is None:
            self._odd_edges.append((number, _NO_EDGES))
        elif recorded.edges.moves != executed:
            self._odd_edges.append((number, "the edges are not the moves reported"))

    @property
    def digest(self) -> str:
        """Return the SHA-256 over one line ``[round, module, generator, at]`` per move."""
        return self._digest.hexdigest()

    def check_edges(self, transcript: Transcript) -> None:
        """Check that the coordinator's edges are the moves that modules reported."""
        last = transcript.complete_rounds
        for number in transcript.stray_edges:
            self._fail("edges", f"round {number}: edges, but not every module has reported")
        for number, why in self._odd_edges:
            # A run that was killed may have had no time to write the edges of its last round.
            if why != _NO_EDGES or number < last or transcript.summary is not None:
                self._fail("edges", f"round {number}: {why}")

    def _move(self, module: int, generator: str, at: Site) -> Move | None:
        """Return the move of that name that the module can propose from its place, or None."""
        for move in self._system.moves(self.sites[module]):
            if move is not None and move.generator == generator and move.at == at:
                return move
        return None

    def _moves(self, where: str, reports: Mapping[int, wire.Report]) -> Moves:
        moves: Moves = {}
        for module, report in reports.items():
            placed = report.move
            if placed is None:
                continue
            move = self._move(module, placed.generator, placed.at)
            if move is None:
                why: str | None = f"{_text(placed)} is no move from {self.sites[module]!r}"
            else:
                moves[module] = move
                why = why_not(move.action, self.state)
            if why is not None:
                self._fail("admissible", f"{where}, module_{module}: {why}")
        return moves

    def _check_commuting(self, where: str, moves: Moves) -> None:
        for module, other in _conflicts({m: move.action for m, move in moves.items()}):
            self._fail(
                "commuting",
                f"{where}: the moves of module_{module} and module_{other} do not commute",
            )

    def _execute(self, where: str, moves: Moves) -> None:
        motion: dict[Site, Site] = {}
        for module, move in moves.items():
            # If the moves of a round commute, none makes another inadmissible.
            why = why_not(move.action, self.state)
            if why is not None:
                self._fail("admissible", f"{where}, module_{module}: {why}")
                continue
            make(move.action, self.state)
            self.actions.append(move.action)
            motion.update(move.motion)
        self.ends.append(len(self.actions))
        self.sites = [motion.get(site, site) for site in self.sites]
        if set(self.sites) | self._system.filled != self.state:
            self._fail("sites", f"{where}: where modules are is not what is on")

    def _check_sites(self, reports: Mapping[int, wire.Report], before: list[Site]) -> None:
        for module, report in reports.items():
            for what, reported, true in (
                ("stood", report.before, before[module]),
                ("stands", report.site, self.sites[module]),
            ):
                if reported != true:
                    self._fail(
                        "sites", f"{named(report)} says it {what} at {reported}, not at {true!r}"
                    )

    def _check_messages(self, where: str, recorded: RecordedRound) -> None:
        for message in recorded.messages.values():
            if isinstance(message, wire.Note):
                self._check_note(message)
            if message.site != self.sites[message.module]:
                self._fail(
                    "bundle",
                    f"{named(message)} is from {message.site}, but it stood at"
                    f" {self.sites[message.module]!r}",
                )
        for module, site in enumerate(self.sites):
            if ("presence", module) not in recorded.messages and self._system.listeners(
                self._place(site)
            ):
                self._fail("bundle", f"{where}, module_{module}: no presence")

    def _check_note(self, message: wire.Note) -> None:
        """Check the form of a note; `choices` has its content, where the rule is known."""
        length = self._note_length = self._note_length or len(message.note)
        if not is_note(message.note, length) or not length:
            self._fail(
                "bundle",
                f"{named(message)} has {_odd(message.note)}, expected {length} numbers of 32 bits",
            )

    def _place(self, site: Site) -> Site:
        return self._system.place_of(site)

    def _check_claims(self, number: int, recorded: RecordedRound) -> None:
        claims: Moves = {}
        for message in recorded.messages.values():
            if not isinstance(message, wire.Claim):
                continue
            move = self._move(message.module, message.generator, message.at)
            if move is None:
                self._fail("claims", f"{named(message)} is for no move from where it stands")
                continue
            why = why_not(move.action, self.state)
            if why is not None:
                self._fail(
                    "claims", f"{named(message)} is for a move that is not admissible: {why}"
                )
            claims[message.module] = move
        if self._seed is None:
            return
        rivals = _rivals(claims)
        granted: dict[int, bool] = {}
        ranked = sorted(claims, key=lambda module: self._rank(number, module), reverse=True)
        for module in ranked:
            # A claim is executed iff every claim that outranks it and conflicts with it is lost.
            granted[module] = not any(granted.get(rival) for rival in rivals[module])
        for module, report in recorded.reports.items():
            self._check_outcome(report, claims.get(module), granted.get(module))
            # Rivals that it outranks, and modules that it takes along, wait for its verdict.
            waiting = {
                claims[rival].source
                for rival in rivals.get(module, ())
                if self._rank(number, rival) < self._rank(number, module)
            }
            if module in claims:
                waiting |= {source for source, _ in claims[module].motion[1:]}
            self._check_verdict(
                f"round {number}, module_{module}: verdict",
                recorded.messages.get(("verdict", module)),
                granted.get(module),
                {self._place(site) for site in waiting},
            )

    def _rank(self, number: int, module: int) -> tuple[int, int]:
        return rank(self._seed or 0, number, module)

    def _check_outcome(self, report: wire.Report, claim: Move | None, granted: bool | None) -> None:  # noqa: FBT001
        expected = {None: "none", True: "granted", False: "lost"}[granted]
        if report.claim != expected:
            self._fail(
                "claims", f"{named(report)} says claim {report.claim}, by rank it is {expected}"
            )
        due = (claim.generator, claim.at) if claim is not None and granted else None
        made = report.move and (report.move.generator, report.move.at)
        if made != due:
            self._fail("claims", f"{named(report)}: its move is not the claim that it was granted")

    def _check_verdict(
        self,
        where: str,
        verdict: ModuleMessage | None,
        granted: bool | None,  # noqa: FBT001
        waiting: set[Site],
    ) -> None:
        if not isinstance(verdict, wire.Verdict):
            if waiting:
                self._fail("claims", f"{where}: there is none, and others wait for it")
            return
        if granted is None:
            self._fail("claims", f"{where}: it claimed nothing")
        elif verdict.granted != granted:
            self._fail("claims", f"{where}: granted is {verdict.granted}, by rank it is {granted}")
        if set(verdict.to) != waiting:
            self._fail("claims", f"{where}: it goes to modules other than those that wait for it")

    def _check_hearing(self, recorded: RecordedRound) -> None:
        standing = {self._place(site): module for module, site in enumerate(self.sites)}
        for module, report in recorded.reports.items():
            place = self._place(self.sites[module])
            near = {standing[other] for other in self._system.sensed(place) if other in standing}
            within = {standing[other] for other in self._system.reach(place) if other in standing}
            due: dict[tuple[str, int], ModuleMessage] = {}
            for kind, speakers in (
                ("presence", near),
                ("note", within),
                ("claim", within),
                ("verdict", within),
            ):
                for speaker in speakers - {module}:
                    message = recorded.messages.get((kind, speaker))
                    if message is not None and _addressed(message, place):
                        due[kind, speaker] = message
            self._compare(report, due, recorded)

    def _compare(
        self,
        report: wire.Report,
        due: Mapping[tuple[str, int], ModuleMessage],
        recorded: RecordedRound,
    ) -> None:
        heard: set[tuple[str, int]] = set()
        for kind, speaker in report.deliveries():
            key = (kind, speaker)
            if key in heard or key not in due:
                what = f"{named(report)} says it heard {kind} of module_{speaker}"
                if key in heard:
                    self._fail("deliveries", f"{what} twice")
                elif key not in recorded.messages:
                    self._fail("deliveries", f"{what}, which was not said")
                else:
                    stood = recorded.messages[key].site
                    self._fail("deliveries", f"{what}, which stood at {stood}: out of earshot")
            heard.add(key)
        for kind, speaker in sorted(due.keys() - heard):
            self._fail("hearing", f"{named(report)}: it missed {kind} of module_{speaker}")


def rank(seed: int, number: int, module: int) -> tuple[int, int]:
    """Return the rank of a module's claim in a round by its definition; the greater outranks."""
    key = _splitmix(_splitmix(0, 3), seed % 2**64)
    while seed := seed >> 64:
        key = _splitmix(key, seed % 2**64)
    return _splitmix(_splitmix(key, number), module), module


def _splitmix(key: int, index: int) -> int:
    found = (key + (index + 1) * 0x9E3779B97F4A7C15) % 2**64
    found = (found ^ found >> 30) * 0xBF58476D1CE4E5B9 % 2**64
    found = (found ^ found >> 27) * 0x94D049BB133111EB % 2**64
    return found ^ found >> 31


def _addressed(message: ModuleMessage, place: Site) -> bool:
    return not isinstance(message, wire.Verdict) or place in message.to


def is_note(numbers: Sequence[int], note_length: int) -> bool:
    """Return whether these are a note of that length."""
    return len(numbers) == note_length and all(NOTE_MIN <= each <= NOTE_MAX for each in numbers)


def _odd(numbers: Sequence[int]) -> str:
    wrong = [each for each in numbers if not NOTE_MIN <= each <= NOTE_MAX]
    return str(wrong[0]) if wrong else f"{len(numbers)} numbers"


def _text(placed: GeneratorPlacement) -> str:
    return f"{placed.generator} at {placed.at}"


def _conflicts(actions: Mapping[int, Action]) -> Iterable[tuple[int, int]]:
    """Yield the pairs that do not commute, each once; only pairs that share a site can conflict."""
    over: dict[Site, list[int]] = {}
    for module, action in actions.items():
        met = {other for site in action.support for other in over.get(site, ())}
        for other in sorted(met):
            if not commute(action, actions[other]):
                yield other, module
        for site in action.support:
            over.setdefault(site, []).append(module)


def _rivals(claims: Moves) -> dict[int, set[int]]:
    """Return for each claim the modules whose claims do not commute with it."""
    rivals: dict[int, set[int]] = {module: set() for module in claims}
    for one, other in _conflicts({module: move.action for module, move in claims.items()}):
        rivals[one].add(other)
        rivals[other].add(one)
    return rivals
