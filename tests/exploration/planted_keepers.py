"""Keepers with a bug each, which the simulator must find."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace

from cubepath.agents.keepers.attempts import AttemptPlan
from cubepath.agents.keepers.journal import Journal, Prepared, Record
from cubepath.agents.keepers.keeper import ABORTED, Keeper, _Pending
from cubepath.protocol.core.system import Scene
from cubepath.protocol.wire.free_messages import Commit, Decision, Inquiry
from cubepath.protocol.wire.keys import Tiles
from exploration.planted import WRONG


class ForgetsRefusals(Keeper):
    """Takes up again what it has refused, when it comes a second time."""

    def _refuse(self, pending: _Pending, why: str) -> None:
        before = self._last.get(pending.passed.attempt.module)
        super()._refuse(pending, why)
        if not WRONG.acts():
            return
        del self._last[pending.passed.attempt.module]
        if before is not None:
            self._last[pending.passed.attempt.module] = before


class LocksNoGuards(Keeper):
    """Lets what an attempt relies on change while that is under way."""

    def _take(self, pending: _Pending) -> None:
        shares = dict(pending.plan.shares)
        mine = shares[self.me]
        guards = mine.shared & {(False, unit) for unit in mine.guards}
        if not guards or not WRONG.acts():
            super()._take(pending)
            return
        shares[self.me] = replace(mine, shared=mine.shared - guards)
        plan = replace(pending.plan, shares=shares)
        super()._take(_Pending(pending.passed, plan, shares[self.me]))


class LocksNoReads(Keeper):
    """Lets what an attempt has found in its support change while that is under way."""

    def _take(self, pending: _Pending) -> None:
        shares = dict(pending.plan.shares)
        if not shares[self.me].shared or not WRONG.acts():
            super()._take(pending)
            return
        shares[self.me] = replace(shares[self.me], shared=frozenset())
        plan = replace(pending.plan, shares=shares)
        super()._take(_Pending(pending.passed, plan, shares[self.me]))


class DecidesAlone(Keeper):
    """Gives up an attempt that has waited too long, without asking what came of it."""

    def _inquire(self, pending: _Pending) -> None:
        if not WRONG.acts():
            super()._inquire(pending)
            return
        attempt = pending.passed.attempt
        given_up = Decision(attempt.module, attempt.epoch, attempt.number, reason=ABORTED)
        self._out.passes.setdefault(self.me, []).append(given_up)

    def tick(self) -> None:
        super().tick()
        for part in self._out.passes.pop(self.me, []):
            if isinstance(part, Decision):
                self.hear(self.me, part)


class ForgetsFences(Keeper):
    """Lets modules act in epochs that are over."""

    def _fenced_off(self, plan: AttemptPlan) -> str | None:
        why = super()._fenced_off(plan)
        return None if why is not None and "fenced" in why and WRONG.acts() else why


class AnswersNoInquiry(Keeper):
    """Does not say what came of an attempt whose outcome was lost."""

    def _answer(self, keeper: int, inquiry: Inquiry) -> None:
        if not WRONG.acts():
            super()._answer(keeper, inquiry)


class CountsNoReads(Keeper):
    """Forgets when a unit was read, and so what level a later move of it has."""

    def _apply(self, decision: Decision, plan: AttemptPlan) -> None:
        super()._apply(decision, plan)
        for unit in plan.shares[self.me].reads:
            known = self.units.units.get(unit)
            if known is not None and known.read_level and WRONG.acts():
                known.read_level = 0


class _Forgetful:
    """A journal that keeps nothing of what is prepared."""

    def __init__(self, journal: Journal) -> None:
        self._journal = journal

    def append(self, record: Record) -> None:
        if not isinstance(record, Prepared) or not WRONG.acts():
            self._journal.append(record)

    def records(self) -> Iterator[Record]:
        return self._journal.records()

    def commit(self, serial: int) -> Commit:
        return self._journal.commit(serial)

    @property
    def grown(self) -> bool:
        return self._journal.grown

    def compact(self, records: Iterable[Record]) -> None:
        self._journal.compact(records)


class LogsNoPromise(Keeper):
    """Comes back without what it had prepared."""

    def __init__(self, me: int, scene: Scene, tiles: Tiles, journal: Journal) -> None:
        super().__init__(me, scene, tiles, _Forgetful(journal))


PLANTED: dict[str, Callable[[int, Scene, Tiles, Journal], Keeper]] = {
    "forgets refusals": ForgetsRefusals,
    "locks no guards": LocksNoGuards,
    "locks no reads": LocksNoReads,
    "decides alone": DecidesAlone,
    "forgets fences": ForgetsFences,
    "answers no inquiry": AnswersNoInquiry,
    "counts no reads": CountsNoReads,
    "logs no promise": LogsNoPromise,
}
