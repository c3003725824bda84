"""What must hold at every moment of a run without rounds, whatever happens to its processes.

It receives every record of every journal once that record is sure to stay, and everything that is
put on the wire. It shares no code with keepers and modules, and keeps the state of the run in plain
dictionaries, from the commits alone. Commits arrive in the order in which they are logged, which is
a legal path; each is checked against all earlier ones.
"""

from collections.abc import Iterable
from typing import TypeAlias

from cubepath.agents.keepers.journal import Committed, Decided, JoinedRecord, Prepared, Record
from cubepath.protocol.core.catalogue import Move
from cubepath.protocol.core.sites import Site
from cubepath.protocol.core.system import Scene
from cubepath.protocol.wire.free_messages import (
    Attempt,
    Commit,
    CommitLog,
    Decision,
    Entered,
    Forwards,
    FreeMessage,
    PlaceState,
    Replies,
    Requests,
    TileUpdate,
    Turn,
    Turns,
)
from cubepath.protocol.wire.keys import Tiles

Register = tuple[int, ...]


class OracleError(Exception):
    """Something does not hold: its kind, by which failures are the same, and one line."""

    def __init__(self, kind: str, detail: str) -> None:
        """Say what does not hold."""
        super().__init__(detail)
        self.kind = kind


def same(kind: str, what: str, found: object, expected: object) -> None:
    """Raise Broken if the two are not equal."""
    if found != expected:
        raise OracleError(kind, f"{what}: found {found!r}, expected {expected!r}")


class FreeState:
    """Where everything is, and what every unit has seen."""

    def __init__(self, scene: Scene) -> None:
        """Begin at the start of the scene."""
        self.system = scene.system
        self.site: dict[int, Site] = dict(enumerate(scene.start))
        self.at: dict[Site, int] = {
            scene.system.place_of(site): module for module, site in self.site.items()
        }
        self.version: dict[int, int] = dict.fromkeys(self.site, 0)
        self.note: dict[int, Register] = dict.fromkeys(self.site, ())
        self.epoch: dict[int, int] = dict.fromkeys(self.site, 0)
        self.incarnation: dict[int, int] = dict.fromkeys(self.site, 0)
        self.places: dict[Site, int] = {}
        """How many moves have written a place."""
        self.units: dict[Site, tuple[int, int, int, int]] = {}
        """By unit its version and level, how often that was read, and by what level at most."""
        self.sites: dict[tuple[int, int], Site] = {
            (module, 0): site for module, site in self.site.items()
        }
        """Where a module was in each of its versions."""
        self.shown: dict[tuple[Site, int, int], tuple[Site | None, int | None, Register]] = {}
        """What was at a place, by its version and that of its module."""
        self.moves = 0
        for place in self.at:
            self._show(place)

    def _show(self, place: Site) -> None:
        module = self.at.get(place)
        if module is None:
            self.shown[place, self.places.get(place, 0), 0] = None, None, ()
        else:
            key = place, self.places.get(place, 0), self.version[module]
            self.shown[key] = self.site[module], module, self.note[module]

    @property
    def on(self) -> set[Site]:
        """Return the sites that are on."""
        return {*self.site.values(), *self.system.filled}

    def unit(self, unit: Site) -> tuple[int, int, int, int]:
        """Return version, level, reads and the level of these."""
        return self.units.get(unit, (0, 0, 0, 0))

    def shows(self, unit: Site) -> Site | None:
        """Return the site that is on at a unit."""
        place = unit if self.system.labels is not None else self.system.place_of(unit)
        module = self.at.get(place)
        site = None if module is None else self.site[module]
        return site if self.system.labels is not None or site == unit else None

    def born(self, module: int, incarnation: int) -> None:
        """Begin a module's next epoch."""
        if incarnation <= self.incarnation[module]:
            raise OracleError(
                "incarnation", f"module_{module} is born again with incarnation {incarnation}"
            )
        self.incarnation[module] = incarnation
        self.epoch[module] += 1

    def commit(self, attempt: Attempt, moved: Commit) -> None:
        """Check a commit against everything before it, and carry it out."""
        module = attempt.module
        name = f"attempt {attempt.number} of module_{module} in epoch {attempt.epoch}"
        same("epoch", f"{name} is committed, epoch", attempt.epoch, self.epoch[module])
        same("place", f"{name}, site", attempt.site, self.site[module])
        for at, on in attempt.sensed:
            same("sensed", f"{name}, what is on at {at!r}", self.shows(at), on)
        for place, expected, _ in attempt.notes:
            here = self.at.get(place)
            held = () if here is None else self.note[here]
            same("register", f"{name}, register at {place!r}", held, tuple(expected))
        for unit, version, reads in attempt.after:
            found = self.unit(unit)
            same("after", f"{name}, {unit!r}", (found[0], found[2]), (version, reads))
        move = None
        if attempt.generator is not None:
            move = self._move(attempt, name)
            self._touch(attempt, moved, move, name)
        else:
            same("level", f"{name}, level", moved.level, 0)
            same(
                "versions", f"{name}, units", (moved.read, moved.written, moved.guarded), ([],) * 3
            )
        self._change(attempt, moved, move, name)

    def _move(self, attempt: Attempt, name: str) -> Move:
        site, at = self.site[attempt.module], attempt.at
        for move in self.system.moves_at(site):
            if move.generator == attempt.generator and move.at == at:
                if not move.possible(self.on):
                    raise OracleError("admissible", f"{name}: {move.generator} at {at!r} is not")
                return move
        raise OracleError("admissible", f"{name}: there is no {attempt.generator} at {at!r}")

    def _touch(self, attempt: Attempt, moved: Commit, move: Move, name: str) -> None:
        system, action = self.system, move.action
        labels = system.labels is not None

        def units(sites: frozenset[Site]) -> set[Site]:
            there = (site for site in sites if system.has_place(system.place_of(site)))
            return {system.place_of(site) for site in there} if labels else {*there}

        writes = units(action.trace)
        reads = units(action.support) - writes
        guards = {unit for unit, _ in attempt.sensed} - reads - writes
        known = {unit: self.unit(unit) for unit in (*reads, *writes, *guards)}
        found = dict(moved.read)
        same("versions", f"{name}, reads", found, {unit: known[unit][0] for unit in reads})
        found = dict(moved.guarded)
        same("guards", f"{name}, guards", found, {unit: known[unit][0] for unit in guards})
        wrote = {unit: (version, n) for unit, version, n in moved.written}
        expected = {unit: (known[unit][0], known[unit][2]) for unit in writes}
        same("versions", f"{name}, writes", wrote, expected)
        before = [known[unit][1] for unit in (*reads, *writes)]
        level = 1 + max([0, *before, *(known[unit][3] for unit in writes)])
        same("level", f"{name}, level", moved.level, level)
        for unit in reads:
            version, old, count, read = known[unit]
            self.units[unit] = version, old, count + 1, max(read, level)
        for unit in writes:
            self.units[unit] = known[unit][0] + 1, level, 0, 0
        self.moves += 1
        for place in writes if labels else {system.place_of(site) for site in writes}:
            self.places[place] = self.places.get(place, 0) + 1

    def _change(self, attempt: Attempt, moved: Commit, move: Move | None, name: str) -> None:
        """Move what is taken along, and write registers; what is recorded of both must agree."""
        place_of = self.system.place_of
        written = {
            self.at[place]: tuple(new)
            for at, _, new in attempt.notes
            for place in (at,)
            if new is not None and place in self.at
        }
        noted = [self.at.get(at) for at, _, _ in attempt.notes]
        taken = [] if move is None else [(self.at[place_of(a)], a, b) for a, b in move.motion]
        for module in {*written, *(module for module, _, _ in taken)}:
            self.version[module] += 1
        expected = [(module, a, b, self.version[module]) for module, a, b in taken]
        same("motion", f"{name}, motion", moved.motion, expected)
        gone = {place_of(a) for _, a, _ in taken}
        for place in gone:
            del self.at[place]
        for module, _, target in taken:
            if place_of(target) in self.at:
                raise OracleError("place", f"{name}: two modules at {target!r}")
            self.at[place_of(target)] = module
            self.site[module] = target
        self.note.update(written)
        registers = {
            module: (at, version, None if new is None else tuple(new))
            for at, module, version, new in moved.notes
        }
        same(
            "register",
            f"{name}, registers",
            registers,
            {
                module: (place_of(self.site[module]), self.version[module], written.get(module))
                for module in noted
                if module is not None
            },
        )
        for module in {*written, *(module for module, _, _ in taken)}:
            self.sites[module, self.version[module]] = self.site[module]
            gone.add(place_of(self.site[module]))
        for place in gone:
            self._show(place)


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
        self.commits: dict[int, list[Commit]] = {keeper: [] for keeper in range(keepers)}
        self._tiles = Tiles(scene.system, keepers)
        self._asked: dict[Name, Attempt] = {}
        self._committed: dict[Name, Decision] = {}
        self._learned: dict[Name, set[int]] = {}
        """Whether other keepers have logged what was committed."""
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
                case JoinedRecord(enter=enter):
                    at = self.state.system.place_of(self.state.site[enter.module])
                    what = f"keeper of module_{enter.module}, which enters"
                    same("incarnation", what, keeper, self._tiles.keeper_of(at))
                    self.state.born(enter.module, enter.incarnation)
                case _:
                    pass

    def _current(self, attempt: Attempt) -> None:
        name = _name(attempt)
        same("name", f"what {_what(name)} asks for", attempt, self._asked.get(name))
        if name in self._committed:
            raise OracleError("again", f"{_what(name)} is prepared after it was committed")

    def _commit(self, keeper: int, attempt: Attempt, decision: Decision) -> None:
        name, moved = _name(attempt), decision.commit
        self._current(attempt)
        if name in self._refused:
            why = next(iter(self._refused[name].values()))
            raise OracleError("refused", f"{_what(name)} is committed, and was refused: {why}")
        if moved is None:
            raise OracleError("commit", f"{_what(name)} is committed without a move")
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
        if decision.commit is not None:
            same("decided", f"{_what(name)}", decision, self._committed.get(name))
            self._learned.setdefault(name, set()).add(keeper)
        elif name in self._committed:
            raise OracleError(
                "refused", f"{_what(name)} was committed, and is refused: {decision.reason}"
            )
        else:
            self._refused.setdefault(name, {})[keeper] = decision.reason

    # Outgoing messages.

    def take(self, message: FreeMessage) -> None:  # noqa: C901, PLR0912 - a case for each kind
        """Take what is put on the wire."""
        match message:
            case Requests(parts=parts):
                for part in parts:
                    if isinstance(part, Attempt):
                        asked = self._asked.setdefault(_name(part), part)
                        same("name", f"what {_what(_name(part))} asks for", part, asked)
            case Turns(parts=turns):
                for turn in turns:
                    self._turn(turn)
            case Replies():
                self._take_replies(message)
            case Forwards(to=to, parts=passed):
                for each in passed:
                    if isinstance(each, Decision):
                        self._passed(to, each)
            case TileUpdate():
                self._shown(message.parts)
            case Commit(keeper=keeper, serial=serial):
                same("moved", f"commit {serial}", message, self.commits[keeper][serial - 1])
            case CommitLog():
                self._tail(message)
            case _:
                pass

    def _take_replies(self, tells: Replies) -> None:
        for part in tells.parts:
            match part:
                case Entered():
                    self._entered(part)
                case Decision():
                    self._decision(tells.keeper, part)

    def _turn(self, turn: Turn) -> None:
        if turn.failed is not None:
            raise OracleError("rule", f"module_{turn.module}: {turn.failed}")
        where = self.state.sites.get((turn.module, turn.version))
        what = f"module_{turn.module} in version {turn.version} believes to be at"
        same("turn", what, turn.site, where)
        if turn.number is not None and turn.number > 1:
            before = turn.module, turn.epoch, turn.number - 1
            if before not in self._committed and before not in self._refused:
                raise OracleError(
                    "next", f"attempt {turn.number} follows, but {_what(before)} is open"
                )

    def _entered(self, entered: Entered) -> None:
        state, held = self.state, entered.occupant
        module = held.module
        same(
            "entered",
            f"what module_{module} is told",
            (entered.site, held.incarnation, held.epoch, held.version, tuple(held.note)),
            (
                state.site[module],
                state.incarnation[module],
                state.epoch[module],
                state.version[module],
                state.note[module],
            ),
        )

    def _decision(self, keeper: int, decision: Decision) -> None:
        """Check what a module receives against what was logged; of a dead epoch it may be less."""
        name = _name(decision)
        if decision.commit is not None:
            same("told", _what(name), decision, self._committed.get(name))
        elif decision.epoch < self.state.epoch[decision.module]:
            pass
        elif keeper in self._refused.get(name, {}):
            same("told", _what(name), decision.reason, self._refused[name][keeper])
        else:
            why = f"{_what(name)} is told by keeper_{keeper} to be refused: {decision.reason}"
            raise OracleError("told", f"{why}; its log does not say so")

    def _passed(self, keeper: int, decision: Decision) -> None:
        """Check what a keeper receives; who knows better takes no note."""
        name = _name(decision)
        if decision.commit is not None:
            same("passed", _what(name), decision, self._committed.get(name))
        elif name in self._committed and keeper not in self._learned.get(name, ()):
            raise OracleError(
                "forwarded", f"{_what(name)} was committed, and is passed on as refused"
            )

    def _shown(self, parts: Iterable[PlaceState]) -> None:
        for part in parts:
            place = part.place
            found = self.state.shown.get((place, part.version, part.module_version))
            if found is None and not part.version and not part.module_version:
                found = None, None, ()  # nobody has been there
            site = part.site
            same(
                "shown", f"what is shown of {place!r}", (site, part.module, tuple(part.note)), found
            )

    def _tail(self, tail: CommitLog) -> None:
        mine = self.commits[tail.keeper]
        last = tail.serial
        if last > len(mine):
            raise OracleError(
                "commits", f"keeper_{tail.keeper} tells of {last} commits, {len(mine)} are logged"
            )
        if tail.parts:
            first = tail.parts[0].serial
            same("tail", "commits", tail.parts, mine[first - 1 : first - 1 + len(tail.parts)])

    def unlike(self, tail: CommitLog) -> str | None:
        """Return how what a keeper tells of its units differs from what they are, if it does."""
        place_of, tiles = self.state.system.place_of, self._tiles
        labels = self.state.system.labels is not None
        expected = {
            unit: (version, level, reads, self.state.shows(unit))
            for unit, (version, level, reads, _) in self.state.units.items()
            if tiles.keeper_of(unit if labels else place_of(unit)) == tail.keeper
        }
        found = {unit: tuple(rest) for unit, *rest in tail.units}
        if (tail.serial, found) == (len(self.commits[tail.keeper]), expected):
            return None
        what = f"keeper_{tail.keeper} tells of {tail.serial} commits, and units {found!r}"
        return f"{what}, expected {len(self.commits[tail.keeper])} and {expected!r}"


def _name_of(moved: Commit) -> tuple[int, int, int, int]:
    return moved.module, moved.epoch, moved.number, moved.turn
