"""A keeper as a pure machine: parts of messages and ticks in, parts of messages out.

An attempt passes through the keepers concerned in increasing order. Each checks what was sensed,
locks, logs and forwards; the last one commits, and that is the move. An attempt that conflicts with
another waits for it, first come, first served. An attempt that waits at a keeper holds locks only
at lower keepers, so there is no cycle of waiting. docs/free-clock.md has the argument.

A keeper repeats an answer when it is asked again. It decides nothing: it only compares what was
sensed with the present state.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from itertools import pairwise, takewhile
from typing import TypeAlias

from msgspec.structs import replace

from cubepath.agents.keepers import attempts
from cubepath.agents.keepers.journal import (
    Acknowledged,
    Committed,
    Compacted,
    Decided,
    JoinedRecord,
    Journal,
    KeptCommit,
    Prepared,
    Record,
)
from cubepath.agents.keepers.units import Units, start_of
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.sites import Site
from cubepath.protocol.core.system import Scene
from cubepath.protocol.wire.free_messages import (
    Attempt,
    Commit,
    CommitLog,
    Decision,
    Entered,
    EnterRequest,
    Forwarded,
    Forwards,
    FreeMessage,
    Inquiry,
    Occupant,
    Register,
    Replies,
    Settled,
    TileQuery,
    TileUpdate,
)
from cubepath.protocol.wire.keys import Tiles

LEASE_TICKS, LEASE_TICKS_MAX = 6, 200
"""After this many ticks a keeper asks what became of an attempt, and then ever more rarely. It
waits longer from the start for a module whose last attempt was aborted so: links may be slow."""
ABORTED = "aborted: it did not come through in time"
REMIND_TICKS = 40
"""After this many ticks a keeper tells a commit again to those who have not acknowledged it."""
SETTLE_TICKS = 10
"""After this many ticks at most a keeper acknowledges commits."""
FETCH_MAX = 200
"""Commits in one answer to `Fetch`."""
WAITING_MAX = 4096
"""Attempts that wait at a keeper at most; each module has one."""

Name: TypeAlias = tuple[int, int, int]
"""Which attempt: module, epoch, number."""


@dataclass(slots=True)
class _Pending:
    """An attempt that is prepared here, or waits to be."""

    passed: Forwarded
    plan: attempts.AttemptPlan
    share: attempts.Share
    age: int = 0
    due: int = LEASE_TICKS


@dataclass(slots=True)
class _Unsettled:
    """A commit of this keeper, and who has not acknowledged it."""

    decision: Decision
    owing: dict[int, None]
    age: int = 0


@dataclass(slots=True)
class _Last:
    """The last attempt of a module that was seen here; without a decision it is under way."""

    epoch: int
    number: int
    decision: Decision | None = None

    @property
    def id(self) -> tuple[int, int]:
        return self.epoch, self.number


@dataclass(slots=True)
class _Out:
    """Outgoing parts, by receiver."""

    passes: dict[int, list[Forwarded | Decision | Inquiry | Settled]] = field(default_factory=dict)
    tells: dict[int, list[Decision | Entered]] = field(default_factory=dict)
    rest: list[FreeMessage] = field(default_factory=list)


def name_of(attempt: Attempt | Decision | Inquiry | Settled) -> Name:
    """Return which attempt this is, or is about."""
    return attempt.module, attempt.epoch, attempt.number


class Keeper:
    """The keeper of some tiles."""

    def __init__(
        self, me: int, scene: Scene, tiles: Tiles, journal: Journal, *, tell_reads: bool = False
    ) -> None:
        """Begin at the start of the scene, and go through the journal."""
        self.me = me
        self._system = scene.system
        self._tiles = tiles
        self._journal = journal
        self.units = Units(
            scene.system,
            tiles,
            start_of(scene.system, tiles, me, scene.start),
            tell_reads=tell_reads,
        )
        self._out = _Out()
        self._last: dict[int, _Last] = {}
        self._prepared: dict[int, _Pending] = {}
        self._waiting: dict[int, _Pending] = {}
        """By module, in the order in which they came."""
        self._exclusive: dict[attempts.Lock, int] = {}
        self._shared: dict[attempts.Lock, dict[int, None]] = {}
        self._leases: dict[int, int] = {}
        """Of modules whose last attempt was aborted."""
        self._unsettled: dict[Name, _Unsettled] = {}
        self._settled: dict[tuple[int, int], tuple[int, int]] = {}
        """By keeper and module the last commit that it has acknowledged: epoch and number."""
        self._entered: dict[int, int] = {}
        """By module how often it has entered here."""
        self._owed: dict[int, list[Settled]] = {}
        self._owed_age = 0
        self.commits = 0
        self._forgotten = 0
        """How many of them are no longer in the journal."""
        self.refused = 0
        """Messages that were none."""
        self._come_back()

    # What comes in.

    def ask(self, process: int, part: Attempt | EnterRequest | TileQuery) -> None:
        """Take what a process asks."""
        match part:
            case Attempt():
                self._attempt(Forwarded(part, process, 0, [], [], [], [], []), None)
            case EnterRequest():
                self._enter(process, part)
            case TileQuery():
                self._look(part)

    def hear(self, keeper: int, part: Forwarded | Decision | Inquiry | Settled) -> None:
        """Take what another keeper says."""
        match part:
            case Forwarded():
                self._attempt(part, keeper)
            case Decision():
                self._learn(keeper, part)
            case Inquiry():
                self._answer(keeper, part)
            case Settled():
                self._acknowledged(keeper, part)

    def fetch(self, serial: int, recorded: int) -> None:
        """Tell the coordinator the commits after a serial number.

        Those that are in the file of its recording are forgotten when the journal is compacted.
        """
        if self._journal.grown:
            recorded = max(self._forgotten, min(recorded, self.commits))
            self._journal.compact(self._compacted(recorded))
            self._forgotten = recorded
        serial = max(serial, self._forgotten)
        last = min(self.commits, serial + FETCH_MAX)
        parts = [self._journal.commit(number) for number in range(serial + 1, last + 1)]
        units = self.units.touched() if last == self.commits else []
        self._out.rest.append(
            CommitLog(self.me, self.commits, parts, units, self.refused, len(self._prepared))
        )

    def tick(self) -> None:
        """Note that some time has gone by: ask what is due."""
        for pending in self._prepared.values():
            pending.age += 1
            if pending.age >= pending.due:
                self._inquire(pending)
        self._remind()
        if self._owed:
            self._owed_age += 1
            if self._owed_age >= SETTLE_TICKS:
                for keeper in list(self._owed):
                    self._settle(keeper)

    def _remind(self) -> None:
        for unsettled in self._unsettled.values():
            unsettled.age += 1
            if unsettled.age % REMIND_TICKS == 0:
                for keeper in unsettled.owing:
                    self._pass(keeper, unsettled.decision)

    @property
    def busy(self) -> bool:
        """Return whether anything is due at some time."""
        return bool(self._prepared or self._unsettled or self._owed)

    @property
    def state(self) -> str:
        """Return what it has to do: with attempts, else with their results, or ``idle``."""
        if self._waiting:
            return "waiting"
        if self._prepared:
            return "prepared"
        return "settling" if self.busy else "idle"

    def outgoing(self) -> list[FreeMessage]:
        """Return the outgoing parts since the last call."""
        out, self._out = self._out, _Out()
        for keeper in list(out.passes):
            if keeper in self._owed:
                out.passes[keeper] += self._owed.pop(keeper)
        if not self._owed:
            self._owed_age = 0
        return [
            *(Forwards(self.me, keeper, parts) for keeper, parts in out.passes.items()),
            *(Replies(self.me, process, parts) for process, parts in out.tells.items()),
            *out.rest,
        ]

    # Attempts.

    def _attempt(self, passed: Forwarded, sender: int | None) -> None:
        attempt = passed.attempt
        last = self._last.get(attempt.module)
        mine = attempt.epoch, attempt.number
        if last is not None and mine <= last.id:
            self._again(passed, last, sender)
            return
        waiting = self._waiting.get(attempt.module)
        if waiting is not None and mine <= name_of(waiting.passed.attempt)[1:]:
            return
        try:
            plan = attempts.planned(self._system, self._tiles, attempt)
        except attempts.NotAnAttempt:
            self.refused += 1
            return
        if (sender, self.me) not in pairwise((None, *plan.chain)):
            self.refused += 1
            return
        pending = _Pending(passed, plan, plan.shares[self.me])
        if attempt.module in self._prepared:
            # The module knows what became of its attempt before, and this keeper does not yet.
            self._inquire(self._prepared[attempt.module])
        replaced = self._waiting.pop(attempt.module, None)
        if not self._must_wait(pending):
            self._take(pending)
        elif len(self._waiting) < WAITING_MAX:
            self._waiting[attempt.module] = pending
        if replaced is not None:
            self._go_on()  # some may have waited for that alone

    def _again(self, passed: Forwarded, last: _Last, sender: int | None) -> None:
        """Repeat the result of an attempt that was seen before, or forward it again."""
        attempt = passed.attempt
        if attempt.epoch < last.epoch:
            if sender is None:
                self._tell(passed.process, _refusal(attempt, "fenced off: a later epoch has begun"))
            return
        if (attempt.epoch, attempt.number) != last.id:
            return
        if last.decision is None:
            self._pass_on(self._prepared[attempt.module])
        elif sender is None:
            self._tell(passed.process, last.decision)
        else:
            self._pass(sender, last.decision)

    def _must_wait(self, pending: _Pending) -> bool:
        """Return whether it conflicts with what is prepared, or came before it."""
        module, share = pending.passed.attempt.module, pending.share
        earlier = takewhile(lambda other: other != module, self._waiting)
        return (
            module in self._prepared
            or self._is_locked(share)
            or any(share.conflicts(self._waiting[other].share) for other in earlier)
        )

    def _is_locked(self, share: attempts.Share) -> bool:
        return any(
            lock in self._exclusive or lock in self._shared for lock in share.exclusive
        ) or any(lock in self._exclusive for lock in share.shared)

    def _take(self, pending: _Pending) -> None:
        """Check an attempt that nothing is in the way of; refuse, prepare or commit it."""
        passed, plan = pending.passed, pending.plan
        share = plan.shares[self.me]
        why = self._fenced_off(plan) or self.units.why_not(share)
        if why is not None:
            self._refuse(pending, why)
            return
        occupants = self._gathered(passed, plan)
        passed = replace(
            passed,
            level=max(passed.level, self.units.level(share)),
            read=[*passed.read, *self._versions(share.reads)],
            written=[
                *passed.written,
                *(
                    (unit, known.version, known.reads)
                    for unit in share.writes
                    for known in (self.units.unit(unit),)
                ),
            ],
            guarded=[*passed.guarded, *self._versions(share.guards)],
            occupants=occupants,
            noted=[*passed.noted, *self._noted(plan)],
        )
        if plan.chain[-1] == self.me:
            self._commit(passed, plan)
            return
        pending = _Pending(passed, plan, share)
        self._journal.append(Prepared(passed))
        self._prepare(pending)
        self._pass_on(pending)

    def _versions(self, units: Iterable[Site]) -> list[tuple[Site, int]]:
        return [(unit, self.units.unit(unit).version) for unit in units]

    def _fenced_off(self, plan: attempts.AttemptPlan) -> str | None:
        """Return why the module may not act, if its place is here and its fence says so."""
        attempt, place = plan.attempt, self._system.place_of(plan.site)
        if self._tiles.keeper_of(place) != self.me:
            return None
        occupant = self.units.occupant(place)
        if occupant is None or occupant.module != attempt.module:
            return f"module_{attempt.module} is not at {place!r}"
        if occupant.epoch != attempt.epoch:
            return f"fenced off: module_{attempt.module} is in epoch {occupant.epoch}"
        return None

    def _gathered(self, passed: Forwarded, plan: attempts.AttemptPlan) -> list[Occupant | None]:
        found = list(passed.occupants) or [None] * len(plan.motion)
        for number, (source, _) in enumerate(plan.motion):
            place = self._system.place_of(source)
            if self._tiles.keeper_of(place) == self.me:
                found[number] = self.units.occupant(place)
        return found

    def _noted(self, plan: attempts.AttemptPlan) -> list[tuple[Site, Occupant]]:
        found = []
        for place, _, _ in plan.shares[self.me].notes:
            occupant = self.units.occupant(place)
            if occupant is not None:
                found.append(self.units.module(occupant.module))
        return found

    def _prepare(self, pending: _Pending) -> None:
        attempt = pending.passed.attempt
        pending.due = self._leases.get(attempt.module, LEASE_TICKS)
        self._prepared[attempt.module] = pending
        self._last[attempt.module] = _Last(attempt.epoch, attempt.number)
        for lock in pending.share.exclusive:
            self._exclusive[lock] = attempt.module
        for lock in pending.share.shared:
            self._shared.setdefault(lock, {})[attempt.module] = None

    def _pass_on(self, pending: _Pending) -> None:
        chain = pending.plan.chain
        self._pass(chain[chain.index(self.me) + 1], pending.passed)

    def _refuse(self, pending: _Pending, why: str) -> None:
        """Refuse an attempt permanently: it is remembered, so that no late double is granted."""
        passed, chain = pending.passed, pending.plan.chain
        decision = _refusal(passed.attempt, why)
        self._journal.append(Decided(decision))
        self._last[decision.module] = _Last(decision.epoch, decision.number, decision)
        self._tell(passed.process, decision)
        for keeper in chain[: chain.index(self.me)]:
            self._pass(keeper, decision)

    def _commit(self, passed: Forwarded, plan: attempts.AttemptPlan) -> None:
        attempt = passed.attempt
        moved, occupants = self._outcome(passed, plan)
        decision = Decision(
            attempt.module, attempt.epoch, attempt.number, commit=moved, occupants=list(occupants)
        )
        self._journal.append(Committed(passed, decision))
        self._carry_out_commit(passed, decision, plan)
        self._tell(passed.process, decision)
        for keeper in plan.chain[:-1]:
            self._pass(keeper, decision)
        self._out.rest.append(moved)
        self._show_changes()

    def _carry_out_commit(
        self, passed: Forwarded, decision: Decision, plan: attempts.AttemptPlan
    ) -> None:
        self.commits += 1
        if len(plan.chain) > 1:
            owing = dict.fromkeys(plan.chain[:-1])
            self._unsettled[name_of(passed.attempt)] = _Unsettled(decision, owing)
        self._last[decision.module] = _Last(decision.epoch, decision.number, decision)
        self._apply(decision, plan)

    def _apply(self, decision: Decision, plan: attempts.AttemptPlan) -> None:
        if decision.commit is not None:
            self.units.apply(decision.commit, plan.shares[self.me], decision.occupants)

    def _outcome(
        self, passed: Forwarded, plan: attempts.AttemptPlan
    ) -> tuple[Commit, list[tuple[Site, Occupant]]]:
        """Return what is committed, and the modules that it changes as they are from now on."""
        attempt = passed.attempt
        notes: dict[int, Register | None] = {}
        modules: dict[int, tuple[Site, Occupant]] = {}
        written = {
            place: None if new is None else list(new)
            for share in plan.shares.values()
            for place, _, new in share.notes
        }
        for site, occupant in passed.noted:
            notes[occupant.module] = written[self._system.place_of(site)]
            modules[occupant.module] = site, occupant
        motion: list[tuple[int, Site, Site, int]] = []
        for (source, target), taken in zip(plan.motion, passed.occupants, strict=True):
            if taken is None:
                raise AssertionError(f"no module is carried from {source!r}")
            motion.append((taken.module, source, target, taken.version + 1))
            modules[taken.module] = target, taken
        moved_along = {module for module, *_ in motion}
        changed: list[tuple[Site, Occupant]] = []
        listed: list[tuple[Site, int, int, Register | None]] = []
        for module, (at, occupant) in modules.items():
            note = notes.get(module)
            counts = module in moved_along or note is not None
            new = replace(
                occupant,
                number=attempt.number if module == attempt.module else occupant.number,
                note=occupant.note if note is None else note,
                version=occupant.version + counts,
            )
            if module in notes:
                listed.append((self._system.place_of(at), module, new.version, note))
            if counts:
                changed.append((at, new))
        return (
            Commit(
                keeper=self.me,
                serial=self.commits + 1,
                module=attempt.module,
                epoch=attempt.epoch,
                number=attempt.number,
                turn=attempt.turn,
                level=0 if plan.move is None else passed.level + 1,
                generator=attempt.generator,
                at=attempt.at,
                read=passed.read,
                written=passed.written,
                guarded=passed.guarded,
                motion=motion,
                notes=listed,
            ),
            changed,
        )

    def _show_changes(self) -> None:
        for tile, places in sorted(self.units.last_change.items()):
            parts = [self.units.shown(place) for place in places]
            self._out.rest.append(TileUpdate(self.me, tile, self.units.serials[tile], parts))

    # Decisions of other keepers.

    def _learn(self, keeper: int, decision: Decision) -> None:
        pending = self._prepared.get(decision.module)
        if pending is not None and name_of(pending.passed.attempt) == name_of(decision):
            self._journal.append(Decided(decision))
            self._decide(pending, decision)
            if decision.commit is not None:
                self._show_changes()
            elif pending.plan.chain[0] == self.me:
                self._tell(pending.passed.process, decision)
        if decision.commit is not None and decision.commit.keeper == keeper:
            self._owed.setdefault(keeper, []).append(Settled(*name_of(decision)))
        self._go_on()

    def _decide(self, pending: _Pending, decision: Decision) -> None:
        """Carry out a decision, and free what was locked for it."""
        module, share = decision.module, pending.share
        if decision.reason == ABORTED:
            self._leases[module] = min(2 * pending.due, LEASE_TICKS_MAX)
        else:
            self._leases.pop(module, None)
        self._last[module] = _Last(decision.epoch, decision.number, decision)
        del self._prepared[module]
        for lock in share.exclusive:
            del self._exclusive[lock]
        for lock in share.shared:
            self._shared[lock].pop(module)
            if not self._shared[lock]:
                del self._shared[lock]
        self._apply(decision, pending.plan)

    def _go_on(self) -> None:
        """Take up those who waited, in the order in which they came."""
        for module, pending in list(self._waiting.items()):
            if self._must_wait(pending):
                continue
            del self._waiting[module]
            last = self._last.get(module)
            if last is None or name_of(pending.passed.attempt)[1:] > last.id:
                self._take(pending)

    def _inquire(self, pending: _Pending) -> None:
        pending.age, pending.due = 0, min(2 * pending.due, LEASE_TICKS_MAX)
        self._pass(pending.plan.chain[-1], Inquiry(*name_of(pending.passed.attempt)))

    def _answer(self, keeper: int, inquiry: Inquiry) -> None:
        """Send the result of an attempt that another keeper prepared; if none yet, forbid it.

        From then on it is refused here, and so everywhere: an expired lease.
        """
        name = name_of(inquiry)
        unsettled = self._unsettled.get(name)
        if unsettled is not None:
            self._pass(keeper, unsettled.decision)
            return
        waiting = self._waiting.get(inquiry.module)
        if waiting is not None and name_of(waiting.passed.attempt) == name:
            return
        last = self._last.get(inquiry.module)
        decided = last.decision if last is not None and last.id == name[1:] else None
        if decided is not None:
            self._pass(keeper, decided)
            return
        decision = Decision(*name, reason=ABORTED)
        if last is None or last.id < name[1:]:
            self._journal.append(Decided(decision))
            self._last[inquiry.module] = _Last(inquiry.epoch, inquiry.number, decision)
        self._pass(keeper, decision)

    def _acknowledged(self, keeper: int, settled: Settled) -> None:
        unsettled = self._unsettled.get(name_of(settled))
        if unsettled is not None and keeper in unsettled.owing:
            self._journal.append(Acknowledged(keeper, *name_of(settled)))
            self._forget(keeper, name_of(settled))

    def _forget(self, keeper: int, name: Name) -> None:
        module, epoch, number = name
        before = self._settled.get((keeper, module), (epoch, number))
        self._settled[keeper, module] = max(before, (epoch, number))
        unsettled = self._unsettled.get(name)
        if unsettled is not None:
            unsettled.owing.pop(keeper, None)
            if not unsettled.owing:
                del self._unsettled[name]

    def _settle(self, keeper: int) -> None:
        for settled in self._owed.pop(keeper):
            self._pass(keeper, settled)

    # Modules that enter, and processes that look.

    def _enter(self, process: int, enter: EnterRequest) -> None:
        if enter.module not in self.units.place_of:
            return
        _, occupant = self.units.module(enter.module)
        if enter.incarnation < occupant.incarnation:
            return
        lock = True, self.units.place_of[enter.module]
        for pending in self._prepared.values():
            if lock in pending.share.exclusive or lock in pending.share.shared:
                # It may be about to move: what became of that comes first.
                self._inquire(pending)
                return
        if enter.incarnation > occupant.incarnation:
            self._journal.append(JoinedRecord(enter))
            self._be_born(enter)
        self._tell(process, Entered(enter.incarnation, *self.units.module(enter.module)))

    def _be_born(self, enter: EnterRequest) -> None:
        self._entered[enter.module] = self._entered.get(enter.module, 0) + 1
        _, occupant = self.units.module(enter.module)
        self.units.replace(
            replace(occupant, incarnation=enter.incarnation, epoch=occupant.epoch + 1, number=0)
        )

    def _look(self, look: TileQuery) -> None:
        if not Tiles.is_name(look.tile) or self._tiles.keeper_of_tile(look.tile) != self.me:
            self.refused += 1
            return
        serial = self.units.serials.get(look.tile, 0)
        if look.serial != serial:
            parts = self.units.tile(look.tile)
            self._out.rest.append(TileUpdate(self.me, look.tile, serial, parts, whole=True))

    # Coming back.

    def _come_back(self) -> None:
        for record in self._journal.records():
            try:
                self._do_again(record)
            except attempts.NO_PLACE as error:
                raise InputError(
                    f"{str(record)[:100]}... in the log of keeper_{self.me} cannot follow the"
                    f" records before it ({type(error).__name__}), expected those of this run"
                ) from None

    def _do_again(self, record: Record) -> None:
        match record:
            case Prepared(passed=passed):
                plan = attempts.planned(self._system, self._tiles, passed.attempt)
                self._prepare(_Pending(passed, plan, plan.shares[self.me]))
            case Committed(passed=passed, decision=decision):
                plan = attempts.planned(self._system, self._tiles, passed.attempt)
                self._carry_out_commit(passed, decision, plan)
            case Decided(decision=decision):
                self._decided_before(decision)
            case JoinedRecord(enter=enter):
                self._be_born(enter)
            case Acknowledged():
                self._forget(record.keeper, (record.module, record.epoch, record.number))
            case Compacted():
                self._take_up(record)
            case KeptCommit(commit=moved):
                self.commits = moved.serial

    def _compacted(self, recorded: int) -> Iterator[Record]:
        """Yield records of which a keeper comes back that knows what this one does.

        What is not logged is left out, and how long leases have become.
        """
        unsettled = [(each.decision, list(each.owing)) for each in self._unsettled.values()]
        yield Compacted(recorded, self.units.state(), self._entered, unsettled)
        for serial in range(recorded + 1, self.commits + 1):
            yield KeptCommit(self._journal.commit(serial))
        for last in self._last.values():
            if last.decision is not None:
                yield Decided(last.decision)
        for (keeper, module), number in self._settled.items():
            yield Acknowledged(keeper, module, *number)
        for pending in self._prepared.values():
            yield Prepared(pending.passed)

    def _take_up(self, compacted: Compacted) -> None:
        self.commits = self._forgotten = compacted.commits
        self.units.restore(compacted.units)
        self._entered = dict(compacted.entered)
        self._unsettled = {
            name_of(decision): _Unsettled(decision, dict.fromkeys(owing))
            for decision, owing in compacted.unsettled
        }

    def _decided_before(self, decision: Decision) -> None:
        pending = self._prepared.get(decision.module)
        if pending is not None and name_of(pending.passed.attempt) == name_of(decision):
            self._decide(pending, decision)
        else:
            self._last[decision.module] = _Last(decision.epoch, decision.number, decision)

    def _tell(self, process: int, part: Decision | Entered) -> None:
        self._out.tells.setdefault(process, []).append(part)

    def _pass(self, keeper: int, part: Forwarded | Decision | Inquiry | Settled) -> None:
        self._out.passes.setdefault(keeper, []).append(part)


def _refusal(attempt: Attempt, why: str) -> Decision:
    return Decision(attempt.module, attempt.epoch, attempt.number, reason=why)
