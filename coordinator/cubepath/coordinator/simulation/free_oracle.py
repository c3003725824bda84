"""What must hold at every moment of a run without rounds, whatever happens to its processes.

It is shown every record of every journal, as soon as that is sure to stay, and everything that is
put on the wire; it shares no code with keepers and modules.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import TypeAlias

from cubepath.agents.keepers.journal import Born, Committed, Decided, Prepared, Record
from cubepath.coordinator.simulation.free_state import Broken, FreeState, same
from cubepath.protocol.core.sites import site_from_json, to_json
from cubepath.protocol.core.system import Scene
from cubepath.protocol.wire.free_messages import (
    Asks,
    Attempt,
    Decision,
    Entered,
    FreeMessage,
    Held,
    Moved,
    Passes,
    Shown,
    Shows,
    Tail,
    Tells,
    Turn,
    Turns,
)
from cubepath.protocol.wire.tiles import Tiles

Name: TypeAlias = tuple[int, int, int]
"""Which attempt: module, epoch, number."""


def _name(about: Attempt | Decision) -> Name:
    return about.module, about.epoch, about.number


def _what(name: Name) -> str:
    return f"attempt {name[2]} of module_{name[0]} in epoch {name[1]}"


class Oracle:
    """Raises Broken when something does not hold."""

    def __init__(self, scene: Scene, keepers: int) -> None:
        """Begin at the start of the scene."""
        self.state = FreeState(scene)
        self.commits: dict[int, list[Moved]] = {keeper: [] for keeper in range(keepers)}
        self._tiles = Tiles(scene.system, keepers)
        self._asked: dict[Name, Attempt] = {}
        self._committed: dict[Name, Decision] = {}
        self._learned: dict[Name, set[int]] = {}
        """Who else has logged what was committed."""
        self._refused: dict[Name, dict[int, str]] = {}
        """Refused attempts, with what each keeper has logged."""

    # What is logged.

    def logged(self, keeper: int, records: Iterable[Record]) -> None:
        """Take records of a keeper's journal, in their order."""
        for record in records:
            match record:
                case Prepared(passed=passed):
                    self._current(passed.attempt)
                case Committed(passed=passed, decision=decision):
                    self._commit(keeper, passed.attempt, decision)
                case Decided(decision=decision):
                    self._decide(keeper, decision)
                case Born(enter=enter):
                    at = self.state.system.place_of(self.state.site[enter.module])
                    what = f"keeper of module_{enter.module}, which enters"
                    same("birth", what, keeper, self._tiles.keeper_of(at))
                    self.state.born(enter.module, enter.birth)
                case _:
                    pass

    def _current(self, attempt: Attempt) -> None:
        name = _name(attempt)
        same("name", f"what {_what(name)} asks for", attempt, self._asked.get(name))
        if name in self._committed:
            raise Broken("again", f"{_what(name)} is prepared after it was committed")

    def _commit(self, keeper: int, attempt: Attempt, decision: Decision) -> None:
        name, moved = _name(attempt), decision.moved
        self._current(attempt)
        if name in self._refused:
            why = next(iter(self._refused[name].values()))
            raise Broken("refused", f"{_what(name)} is committed, and was refused: {why}")
        if moved is None:
            raise Broken("commit", f"{_what(name)} is committed without a move")
        mine = self.commits[keeper]
        same("serial", f"{_what(name)}", (moved.keeper, moved.serial), (keeper, len(mine) + 1))
        same("name", f"the commit of {_what(name)}", _name_of(moved), (*name, attempt.turn))
        same("name", "decision", _name(decision), name)
        what = moved.generator, moved.at
        same("name", f"the move of {_what(name)}", what, (attempt.generator, attempt.at))
        self.state.commit(attempt, moved)
        mine.append(moved)
        self._committed[name] = decision

    def _decide(self, keeper: int, decision: Decision) -> None:
        name = _name(decision)
        if decision.moved is not None:
            same("decided", f"{_what(name)}", decision, self._committed.get(name))
            self._learned.setdefault(name, set()).add(keeper)
        elif name in self._committed:
            raise Broken("refused", f"{_what(name)} was committed, and is refused: {decision.why}")
        else:
            self._refused.setdefault(name, {})[keeper] = decision.why

    # What is said.

    def said(self, message: FreeMessage) -> None:  # noqa: C901, PLR0912 - a case for each kind
        """Take what is put on the wire."""
        match message:
            case Asks(parts=parts):
                for part in parts:
                    if isinstance(part, Attempt):
                        asked = self._asked.setdefault(_name(part), part)
                        same("name", f"what {_what(_name(part))} asks for", part, asked)
            case Turns(parts=turns):
                for turn in turns:
                    self._turn(turn)
            case Tells():
                self._told(message)
            case Passes(to=to, parts=passed):
                for said in passed:
                    if isinstance(said, Decision):
                        self._passed(to, said)
            case Shows():
                self._shown(message.parts)
            case Moved(keeper=keeper, serial=serial):
                same("moved", f"commit {serial}", message, self.commits[keeper][serial - 1])
            case Tail():
                self._tail(message)
            case _:
                pass

    def _told(self, tells: Tells) -> None:
        for part in tells.parts:
            match part:
                case Entered():
                    self._entered(part)
                case Decision():
                    self._decision(tells.keeper, part)
                case Held(parts=shown):
                    self._shown(shown)

    def _turn(self, turn: Turn) -> None:
        if turn.failed is not None:
            raise Broken("rule", f"module_{turn.module}: {turn.failed}")
        where = self.state.sites.get((turn.module, turn.version))
        what = f"module_{turn.module} in version {turn.version} believes to be at"
        same("turn", what, site_from_json(turn.site), where)
        if turn.number is not None and turn.number > 1:
            before = turn.module, turn.epoch, turn.number - 1
            if before not in self._committed and before not in self._refused:
                raise Broken("next", f"attempt {turn.number} follows, but {_what(before)} is open")

    def _entered(self, entered: Entered) -> None:
        state, held = self.state, entered.occupant
        module = held.module
        same(
            "entered",
            f"what module_{module} is told",
            (site_from_json(entered.site), held.birth, held.epoch, held.version, tuple(held.note)),
            (
                state.site[module],
                state.birth[module],
                state.epoch[module],
                state.version[module],
                state.note[module],
            ),
        )

    def _decision(self, keeper: int, decision: Decision) -> None:
        """Check what a module is told against what was logged; of a dead epoch it may be less."""
        name = _name(decision)
        if decision.moved is not None:
            same("told", _what(name), decision, self._committed.get(name))
        elif decision.epoch < self.state.epoch[decision.module]:
            pass
        elif keeper in self._refused.get(name, {}):
            same("told", _what(name), decision.why, self._refused[name][keeper])
        else:
            why = f"{_what(name)} is told by keeper_{keeper} to be refused: {decision.why}"
            raise Broken("told", f"{why}; its log does not say so")

    def _passed(self, keeper: int, decision: Decision) -> None:
        """Check what a keeper is told; who knows better takes no note."""
        name = _name(decision)
        if decision.moved is not None:
            same("passed", _what(name), decision, self._committed.get(name))
        elif name in self._committed and keeper not in self._learned.get(name, ()):
            raise Broken("passed", f"{_what(name)} was committed, and is passed on as refused")

    def _shown(self, parts: Iterable[Shown]) -> None:
        for part in parts:
            place = site_from_json(part.place)
            found = self.state.shown.get((place, part.version, part.module_version))
            if found is None and not part.version and not part.module_version:
                found = None, None, ()  # nobody has been there
            site = None if part.site is None else site_from_json(part.site)
            same(
                "shown", f"what is shown of {place!r}", (site, part.module, tuple(part.note)), found
            )

    def _tail(self, tail: Tail) -> None:
        mine = self.commits[tail.keeper]
        last = tail.serial
        if last > len(mine):
            raise Broken(
                "tail", f"keeper_{tail.keeper} tells of {last} commits, {len(mine)} are logged"
            )
        if tail.parts:
            first = tail.parts[0].serial
            same("tail", "commits", tail.parts, mine[first - 1 : first - 1 + len(tail.parts)])

    def unlike(self, tail: Tail) -> str | None:
        """Return how what a keeper tells of its units differs from what they are, if it does."""
        place_of, tiles = self.state.system.place_of, self._tiles
        labels = self.state.system.labels is not None
        expected = {
            unit: (version, level, reads, to_json(self.state.shows(unit)))
            for unit, (version, level, reads, _) in self.state.units.items()
            if tiles.keeper_of(unit if labels else place_of(unit)) == tail.keeper
        }
        found = {site_from_json(unit): tuple(rest) for unit, *rest in tail.units}
        if (tail.serial, found) == (len(self.commits[tail.keeper]), expected):
            return None
        what = f"keeper_{tail.keeper} tells of {tail.serial} commits, and units {found!r}"
        return f"{what}, expected {len(self.commits[tail.keeper])} and {expected!r}"


def _name_of(moved: Moved) -> tuple[int, int, int, int]:
    return moved.module, moved.epoch, moved.number, moved.turn
