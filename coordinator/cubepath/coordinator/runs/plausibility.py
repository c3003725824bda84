"""Whether what modules say and report can be, given where all of them stand.

Room: coordinator. It knows the state at the beginning of the round and the claims made in it. A
report is plausible if it begins where the module was, and its move is the one claimed, admissible,
and commutes with those reported before. When all have reported, the state goes on.
"""

from __future__ import annotations

from collections.abc import Mapping

import msgspec

from cubepath.agents.processes.judge import refuse
from cubepath.protocol.core.actions import Action, apply_in_place, commute
from cubepath.protocol.core.catalogue import Move
from cubepath.protocol.core.errors import CheckError, InputError
from cubepath.protocol.core.names import GeneratorPlacement
from cubepath.protocol.core.sites import Site, site_from_json
from cubepath.protocol.core.system import Scene
from cubepath.protocol.wire.messages import Claim, Message, Report, Reports, Said, kind_of

_encode = msgspec.json.Encoder().encode


class Plausibility:
    """The state of a run at the beginning of a round, and what was claimed and reported in it."""

    def __init__(self, scene: Scene) -> None:
        """Begin at the start of the scene."""
        self.sites: list[Site] = list(scene.start)
        self._system = scene.system
        self._state = set(scene.start_state)
        self._spelled = [_encode(site) for site in scene.start]
        self._spelled_before = self._spelled
        self._round = 1
        self._begin()

    def _begin(self) -> None:
        self._claims: dict[int, Move] = {}
        self._moves: dict[tuple[int, bytes], Move | None] = {}
        self._reported: dict[int, Move] = {}
        self._reads: dict[Site, list[Action]] = {}
        self._writes: dict[Site, Action] = {}

    def check(self, message: Message) -> None:
        """Check that a message of this round can be; RefusedError if not. It is not taken yet."""
        match message:
            case Said(parts=parts):
                # All may have reported a round before all that was said in it has arrived.
                over = message.round < self._round
                spelled = self._spelled_before if over else self._spelled
                for part in parts:
                    if spelled[part.module] != _encode(part.site):
                        refuse("impossible", self._elsewhere(kind_of(part), part.module, part.site))
            case Reports(parts=reports):
                for report in reports:
                    self._check_report(report)
            case _:
                pass

    def take(self, message: Message) -> None:
        """Take a message that can be."""
        match message:
            case Said(phase="claim", parts=parts):
                for part in parts:
                    if isinstance(part, Claim) and part.module not in self._claims:
                        move = self._move(part.module, GeneratorPlacement(part.generator, part.at))
                        if move is not None:
                            self._claims[part.module] = move
            case Reports(parts=reports):
                for report in reports:
                    if report.move is not None and report.module not in self._reported:
                        self._take_move(report.module, report.move)
            case _:
                pass

    def _elsewhere(self, kind: str, module: int, site: object) -> str:
        return f"{kind} of module_{module} from {site!r}: it is at {self.sites[module]!r}"

    def _move(self, module: int, placed: GeneratorPlacement) -> Move | None:
        """Return the move of a module by its name, None if there is none."""
        key = module, _encode(placed)
        if key not in self._moves:
            try:
                self._moves[key] = self._found(self.sites[module], placed)
            except (InputError, TypeError):
                self._moves[key] = None
        return self._moves[key]

    def _found(self, site: Site, placed: GeneratorPlacement) -> Move | None:
        at = site_from_json(placed.at)
        move = self._system.move_named(site, placed.generator, at)
        if move is not None:
            return move
        action = self._system.action(placed.generator, at)  # it may have other names
        return next((move for move in self._system.moves_at(site) if move.action == action), None)

    def _take_move(self, module: int, placed: GeneratorPlacement) -> None:
        move = self._move(module, placed)
        if move is not None:
            self._reported[module] = move
            for site in move.action.support:
                self._reads.setdefault(site, []).append(move.action)
            for site in move.action.trace:
                self._writes[site] = move.action

    def _check_report(self, report: Report) -> None:
        module = report.module
        name = f"report of module_{module}"
        if self._spelled[module] != _encode(report.before):
            refuse("impossible", self._elsewhere("report", module, report.before))
        if (report.move is not None) != (report.claim == "granted"):
            refuse(
                "impossible", f"{name}: a claim that is {report.claim}, and a move {report.move}"
            )
        if report.move is not None:
            self._check_move(f"{name}: {report.move.generator} at {report.move.at!r}", report)
        elif _encode(report.site) not in self._taken_to(module):
            refuse("impossible", f"{name}: it ends at {report.site!r}, where nothing takes it")

    def _check_move(self, name: str, report: Report) -> None:
        module = report.module
        move = None if report.move is None else self._move(module, report.move)
        if move is None:
            refuse("impossible", f"{name} is no move from {self.sites[module]!r}")
        if _encode(report.site) != _encode(move.target):
            refuse("impossible", f"{name} does not end at {report.site!r}")
        if self._claims.get(module) != move and self._is_heard(module):
            refuse("impossible", f"{name} was not claimed")
        if not move.possible(self._state):
            refuse("impossible", f"{name} is not admissible")
        if not self._commutes(move.action):
            refuse("impossible", f"{name} does not commute with a move reported before")

    def _taken_to(self, module: int) -> set[bytes]:
        """Return where a module that made no move may be: it stays, or another takes it along."""
        return {self._spelled[module]} | {
            _encode(target)
            for other, move in self._claims.items()
            for source, target in move.motion[1:]
            if source == self.sites[module] and other != module
        }

    def _is_heard(self, module: int) -> bool:
        """Return whether a claim of a module goes to any place, and so comes here."""
        return bool(self._system.reach(self._system.place_of(self.sites[module])))

    def _commutes(self, action: Action) -> bool:
        """Return whether an action commutes with those reported so far."""
        rivals = [self._writes[site] for site in action.support if site in self._writes]
        for site in action.trace:
            rivals += self._reads.get(site, ())
        return all(commute(action, rival) for rival in rivals)

    def carry_out(self, reports: Mapping[int, Report]) -> None:
        """End the round: make the moves reported; CheckError names a report that cannot be.

        The claims of modules need not be known.
        """
        after = dict(enumerate(self.sites))
        for module, report in reports.items():
            if _encode(report.before) != self._spelled[module]:
                raise CheckError(self._elsewhere("report", module, report.before))
            if report.move is None:
                continue
            move = self._move(module, report.move)
            where = f"report of module_{module}: {report.move.generator} at {report.move.at!r}"
            if move is None:
                raise CheckError(f"{where} is no move from {self.sites[module]!r}")
            if not move.possible(self._state):
                raise CheckError(f"{where} is not admissible")
            self._reported[module] = move
        self._make(after)
        self._spelled_before = self._spelled
        self._spelled = [_encode(after[module]) for module in range(len(self.sites))]
        for module, report in reports.items():
            if self._spelled[module] != _encode(report.site):
                raise CheckError(
                    f"report of module_{module}: it ends at {report.site!r}, and the moves take it"
                    f" to {after[module]!r}"
                )
        self.sites = [after[module] for module in range(len(self.sites))]
        self._round += 1
        self._begin()

    def _make(self, after: dict[int, Site]) -> None:
        standing = {site: module for module, site in after.items()}
        for module, move in self._reported.items():
            try:
                apply_in_place(move.action, self._state)
            except InputError as error:
                raise CheckError(f"report of module_{module}: {error}") from None
            for source, target in move.motion:
                if source in standing:
                    after[standing[source]] = target
