"""Whether commits answer attempts, and whether keepers report the true results of attempts.

Part of `cubepath verify`. What was sensed is compared with the history at the versions at which it
was committed. It also checks that modules act in epochs in which they joined, and that epochs grow
with incarnations.
"""

from array import array
from collections.abc import Callable, Iterator

from cubepath.coordinator.verification.findings import StageFailures
from cubepath.coordinator.verification.free_history import History, ModuleVersion
from cubepath.coordinator.verification.free_transcript import (
    AttemptId,
    FreeTranscript,
    KeeperPart,
    attempt_text,
    commit_text,
)
from cubepath.coordinator.verification.free_units import NO_SITE, changed_by
from cubepath.coordinator.verification.transcript import Fail
from cubepath.protocol.core.sites import Site, site_text
from cubepath.protocol.core.system import System
from cubepath.protocol.recordings.stored_messages import Record
from cubepath.protocol.wire import free_messages as free
from cubepath.protocol.wire.keys import Tiles


class Incarnations:
    """The incarnations and epochs of modules, as keepers report them."""

    def __init__(
        self, transcript: FreeTranscript, tiles: Tiles, system: System, fail: Fail
    ) -> None:
        self._transcript, self._losses = transcript, transcript.losses
        self._tiles, self._place_of, self._fail = tiles, system.place_of, fail
        self._incarnations: dict[int, dict[int, int]] = {}
        """By module the epoch of each incarnation."""

    def _lack(self, check: str, why: str, *, excused: bool) -> None:
        self._losses.lack(self._fail, check, why, excused=excused)

    def answered(self, sent: KeeperPart, entered: free.Entered) -> None:
        """Check the answer to a module that asked where it stands."""
        occupant = entered.occupant
        if (occupant.module, entered.incarnation) not in self._transcript.entered:
            self._lack(
                "entries",
                f"{sent.where}: module_{occupant.module} did not ask where it is",
                excused=self._losses.of_module(occupant.module)
                or self._losses.before(occupant.module, occupant.epoch),
            )
        if occupant.incarnation != entered.incarnation:
            self._fail(
                "entries",
                f"{sent.where}: incarnation {occupant.incarnation} is not the one answered",
            )
        site = entered.site
        processes = self._transcript.asked_by.get(occupant.module, ())
        if sent.to not in processes:
            self._lack(
                "entries",
                f"{sent.where}: process_{sent.to} did not ask for it",
                excused=not processes and self._losses.of_module(occupant.module),
            )
        if site is not None and self._tiles.keeper_of(self._place_of(site)) != sent.keeper:
            self._fail("entries", f"{sent.where}: keeper_{sent.keeper} does not have that place")

    def take(self, where: Record, occupant: free.Occupant) -> None:
        """Note the epoch of an incarnation."""
        known = self._incarnations.setdefault(occupant.module, {0: 0})
        if known.setdefault(occupant.incarnation, occupant.epoch) != occupant.epoch:
            name = f"incarnation {occupant.incarnation} of module_{occupant.module}"
            self._fail("entries", f"{where}: {name} has epoch {occupant.epoch}, and another")

    def check(self) -> None:
        """Check all incarnations that appear, and the epochs of all attempts."""
        for module, known in sorted(self._incarnations.items()):
            incarnations = sorted(known)
            epochs = [known[incarnation] for incarnation in incarnations]
            if sorted(set(epochs)) != epochs:
                self._fail(
                    "entries", f"module_{module}: its epochs do not grow with its incarnations"
                )
            for incarnation in incarnations:
                if incarnation and (module, incarnation) not in self._transcript.entered:
                    self._lack(
                        "entries",
                        f"module_{module} has incarnation {incarnation}, for which it did not ask",
                        excused=self._losses.of_module(module)
                        or self._losses.before(module, known[incarnation]),
                    )
        for name in self._transcript.attempts:
            if name[1] not in self._incarnations.get(name[0], {}).values():
                self._lack(
                    "entries",
                    f"{attempt_text(name)}: it never entered so",
                    excused=self._losses.of_keepers(range(self._tiles.keepers))
                    or self._losses.before(name[0], name[1]),
                )


_CHECKED, _GIVEN_UP = 1, 2


class Attempts:
    """The attempts of a run, and their results.

    They are checked as they stand in the recording. `fail` is called for what is wrong with commits
    by their numbers, so that the first failure is the same however messages are ordered.
    """

    def __init__(
        self, history: History, transcript: FreeTranscript, tiles: Tiles, fail: StageFailures
    ) -> None:
        """Find which attempts were committed."""
        self._history, self._transcript, self._tiles, self._fail = history, transcript, tiles, fail
        self._system, self._losses = history.system, transcript.losses
        self._incarnations = Incarnations(transcript, tiles, history.system, fail)
        self._known = transcript.attempts
        self._committed = array("i")
        """By attempt its commit, -1 if it has none."""
        self._again: dict[int, list[int]] = {}
        """The further commits of an attempt, which only a wrong recording has."""
        self._places = array("i")
        """By commit its attempt."""
        self._seen = bytearray()
        """By attempt whether its commits were checked, 2 if they could not be."""
        self._elsewhere: set[int] = set()
        for number, name in enumerate(zip(*reversed(history.attempts), strict=True)):
            place = self._known.place(name)
            self._places.append(place)
            self._grow()
            if self._committed[place] < 0:
                self._committed[place] = number
            else:
                self._again.setdefault(place, []).append(number)
                self._fail("attempts", f"{attempt_text(name)} is committed twice")
        self._grow()

    def _grow(self) -> None:
        more = len(self._known) - len(self._committed)
        if more:
            self._committed.extend([-1] * more)
            self._seen.extend([0] * more)

    def asked(self, message: free.Requests) -> None:
        """Check what was committed of the attempts that were asked of a keeper."""
        for part in message.parts:
            if isinstance(part, free.Attempt):
                self._asked(message.keeper, part)

    def _asked(self, keeper: int, attempt: free.Attempt) -> None:
        place = self._known.place(name_of(attempt))
        self._answered(place, attempt)
        if self._committed[place] < 0 or self._seen[place] != _CHECKED:
            return
        first = self._known.chain(place)[0]
        if keeper != first and place not in self._elsewhere:
            self._elsewhere.add(place)
            for number, moved in self._commits_of(place):
                self._fail.position = (number,)
                why = f"it was asked of others than keeper_{first}"
                self._fail("attempts", f"{commit_text(moved)}: {why}")
            self._fail.position = ()

    def _answered(self, place: int, attempt: free.Attempt) -> None:
        if self._seen[place]:
            return
        self._seen[place] = _CHECKED
        for number, moved in self._commits_of(place):
            self._fail.position = (number,)
            name = commit_text(moved)
            if not self._guarded(name, "attempts", self._check_commit, moved, attempt):
                self._seen[place] = _GIVEN_UP
        self._fail.position = ()

    def _commits_of(self, place: int) -> Iterator[tuple[int, free.Commit]]:
        first = self._committed[place]
        for number in [first, *self._again.get(place, ())] if first >= 0 else ():
            yield number, self._history.commits[number]

    def take(self, where: Record, message: free.Forwards | free.Replies) -> None:
        """Check what a keeper says of attempts."""
        to = message.process if isinstance(message, free.Replies) else message.to
        for part in message.parts:
            if isinstance(part, free.Forwarded):
                place = self._known.place(name_of(part.attempt))
                if self._known.is_believed(place):
                    self._answered(place, part.attempt)
            sent = KeeperPart(where, message.keeper, to, part, isinstance(message, free.Replies))
            self._guarded(where, "decisions", self._check_sent, sent)

    def end(self) -> None:
        """Check that all commits were asked for, and all incarnations."""
        for number, place in enumerate(self._places):
            if not self._seen[place]:
                moved = self._history.commits[number]
                self._fail.position = (number,)
                self._lack(
                    "attempts",
                    f"{commit_text(moved)} answers no attempt on record",
                    excused=self._unasked(name_of(moved)),
                )
        self._fail.position = ()
        self._incarnations.check()

    def _lack(self, check: str, why: str, *, excused: bool) -> None:
        self._losses.lack(self._fail, check, why, excused=excused)

    def _unasked(self, name: AttemptId) -> bool:
        """Return whether what was asked for an attempt may be lost."""
        place = self._known.place(name)
        self._grow()
        number = self._committed[place]
        by_tail = number >= 0 and not self._transcript.commits.announced(number)
        return by_tail or self._losses.of_attempt(name)

    def _committed_as(self, place: int) -> free.Commit | None:
        number = self._committed[place]
        return None if number < 0 else self._history.commits[number]

    def _guarded(
        self, where: Record | str, check: str, do: Callable[..., None], *values: object
    ) -> bool:
        try:
            do(*values)
        except NO_SITE as error:
            self._fail(check, f"{where}: {type(error).__name__}: {error}")
            return False
        return True

    # Commits.

    def _check_commit(self, moved: free.Commit, attempt: free.Attempt) -> None:
        name = commit_text(moved)
        for key in ("turn", "generator", "at"):
            if getattr(moved, key) != getattr(attempt, key):
                self._fail("attempts", f"{name}: its {key} is not that of its attempt")
        standing = self._before(moved, moved.module)
        at = attempt.site
        if standing is not None and at != standing.site:
            # Where it only writes registers, its place is enough.
            place_of = self._system.place_of
            if at is None or moved.generator or place_of(at) != place_of(standing.site):
                self._fail("attempts", f"{name}: the attempt was made from where it does not stand")
        self._check_sensed(moved, attempt)
        self._check_registers(moved, attempt)
        chain = self._known.chain(self._known.place(name_of(moved)))
        if moved.keeper != chain[-1]:
            self._fail("attempts", f"{name}: the last keeper of its chain is keeper_{chain[-1]}")

    def _before(self, moved: free.Commit, module: int) -> ModuleVersion | None:
        """Return a module as a commit found it."""
        version = changed_by(moved).get(module)
        if version is not None:
            return self._history.module(module, version - 1)
        held = next((v for _, each, v, _ in moved.notes if each == module), None)
        return None if held is None else self._history.module(module, held)

    def _check_sensed(self, moved: free.Commit, attempt: free.Attempt) -> None:
        name = commit_text(moved)
        found = dict((*moved.read, *moved.guarded))
        found |= {unit: version for unit, version, _ in moved.written}
        recorded = dict(attempt.sensed)
        if len(recorded) != len(attempt.sensed) or recorded.keys() != found.keys():
            self._fail("attempts", f"{name} names other units than its attempt has sensed")
            return
        for unit, shown in recorded.items():
            version = found[unit]
            if unit is None:
                continue
            known, there = self._history.at_unit(unit, version)
            if known and there != shown:
                self._fail(
                    "attempts",
                    f"{name}: {site_text(unit)} was sensed as {_text(shown)}, at version {version}"
                    f" it is {_text(there)}",
                )
        counted = {unit: reads for unit, _, reads in moved.written}
        for unit, version, reads in attempt.after:
            if found.get(unit) != version or (unit in counted and counted[unit] != reads):
                self._fail("attempts", f"{name} did not wait for what its attempt names")

    def _check_registers(self, moved: free.Commit, attempt: free.Attempt) -> None:
        name = commit_text(moved)
        here: dict[Site | None, tuple[ModuleVersion | None, free.Register | None]] = {}
        for place, module, version, content in moved.notes:
            before = self._before(moved, module)
            now = self._history.module(module, version)
            if now is not None and self._system.place_of(now.site) != place:
                self._fail("registers", f"{name}: module_{module} is not at {place!r}")
            at = None if before is None else self._system.place_of(before.site)
            here[at] = before, content
        asked = {place: (shown, new) for place, shown, new in attempt.notes}
        for at, (before, content) in here.items():
            if before is None:
                continue
            if at not in asked:
                self._fail("registers", f"{name} has a register that its attempt does not name")
                continue
            shown, new = asked[at]
            if before.note != shown:
                self._fail(
                    "registers",
                    f"{name}: the register at {_text(at)} is {before.note}, {shown} was sensed",
                )
            if content != new:
                self._fail("registers", f"{name} writes {content}, its attempt has {new}")
        for at, (shown, _) in asked.items():
            if at not in here and shown:
                self._fail("registers", f"{name}: no module is at {_text(at)}, {shown} was sensed")

    # What keepers say.

    def _check_sent(self, sent: KeeperPart) -> None:
        part = sent.part
        if isinstance(part, free.Entered):
            self._check_entered(sent, part)
            return
        name = name_of(part.attempt if isinstance(part, free.Forwarded) else part)
        place = self._known.get(name)
        if place is None:
            why = f"{sent.where}: no {attempt_text(name)} is on record"
            self._lack("decisions", why, excused=self._unasked(name))
            return
        chain = self._known.chain(place)
        processes = self._transcript.asked_by.get(name[0], ())
        if sent.to not in (processes if sent.to_process else chain):
            self._lack(
                "decisions",
                f"{sent.where}: its receiver has nothing to do with it",
                excused=sent.to_process and not processes and self._unasked(name),
            )
        if sent.keeper not in chain:
            self._fail("decisions", f"{sent.where}: keeper_{sent.keeper} has nothing to do with it")
        match part:
            case free.Forwarded():
                self._check_passed(sent, part, place, chain)
            case free.Decision():
                self._check_decision(sent, part, name, place)
            case free.Settled():
                moved = self._committed_as(place)
                if moved is None or moved.keeper != sent.to:
                    self._fail("decisions", f"{sent.where}: {attempt_text(name)} is acknowledged")
            case _:
                if sent.to != chain[-1]:
                    self._fail("decisions", f"{sent.where}: keeper_{sent.to} is not the last one")

    def _check_decision(
        self, sent: KeeperPart, decision: free.Decision, name: AttemptId, place: int
    ) -> None:
        moved = self._committed_as(place)
        if decision.commit is None:
            # A module that has acknowledged a commit does not ask; a question on its way is
            # answered by a keeper that has forgotten it.
            if moved is not None and (name, sent.to) not in self._transcript.acknowledged:
                self._lack(
                    "decisions",
                    f"{sent.where}: {attempt_text(name)} was not refused",
                    excused=self._losses.of_keepers([sent.to])
                    or self._losses.before(name[0], name[1]),
                )
            if not decision.reason or decision.occupants:
                self._fail("decisions", f"{sent.where}: a refusal needs a reason and nothing else")
            return
        if moved is None or decision.commit != moved or decision.reason:
            self._lack(
                "decisions",
                f"{sent.where}: {attempt_text(name)} came to something else",
                excused=moved is None
                and not decision.reason
                and self._transcript.after_the_end(decision),
            )
            return
        changed = changed_by(moved)
        recorded = [occupant.module for _, occupant in decision.occupants]
        if sorted(recorded) != sorted(changed):
            self._fail("decisions", f"{sent.where}: it names modules other than those it changed")
        for site, occupant in decision.occupants:
            if occupant.version != changed.get(occupant.module):
                name_of_it = f"module_{occupant.module}"
                self._fail("decisions", f"{sent.where}: {name_of_it} has another version")
            self._check_occupant(sent.where, site, occupant)

    def _check_passed(
        self, sent: KeeperPart, passed: free.Forwarded, place: int, chain: list[int]
    ) -> None:
        where, history, attempt = sent.where, self._history, passed.attempt
        if not self._known.is_as(place, attempt):
            self._fail("decisions", f"{where}: another attempt than was made")
        processes = self._transcript.asked_by.get(attempt.module, ())
        if passed.process not in processes:
            self._lack(
                "decisions",
                f"{where}: process_{passed.process} did not ask for it",
                excused=not processes and self._unasked(name_of(attempt)),
            )
        if sent.keeper in chain[:-1] and sent.to != chain[chain.index(sent.keeper) + 1]:
            self._fail("decisions", f"{where}: keeper_{sent.to} is not the next one")
        moved = self._committed_as(place)
        so_far = {keeper for keeper in chain if keeper <= sent.keeper}
        if moved is not None:
            for key in ("read", "written", "guarded"):
                due = [each for each in getattr(moved, key) if self._of(each[0]) in so_far]
                if sorted(getattr(passed, key), key=repr) != sorted(due, key=repr):
                    self._fail("decisions", f"{where}: its units {key} are not those committed")
        level = self._level_of(passed, committed=moved is not None)
        if level is not None and passed.level != level:
            self._fail("decisions", f"{where}: it has level {passed.level}, derived is {level}")
        written = ((unit, version) for unit, version, _ in passed.written)
        for unit, version in (*passed.read, *written, *passed.guarded):
            if unit is None or not history.at_unit(unit, version)[0]:
                self._fail("decisions", f"{where}: {unit!r} never had version {version}")
        self._check_taken(where, passed, so_far)

    def _check_taken(self, where: Record, passed: free.Forwarded, so_far: set[int]) -> None:
        """Check the modules that are passed on, those of the motion and those of registers."""
        attempt, site = passed.attempt, passed.attempt.site
        move = None
        if attempt.generator is not None and site is not None:
            moves = (each for each in self._system.moves(site) if each is not None)
            named = (attempt.generator, attempt.at)
            move = next((each for each in moves if (each.generator, each.at) == named), None)
        motion = () if move is None else move.motion
        if len(passed.occupants) != len(motion):
            self._fail("decisions", f"{where}: it takes along {len(passed.occupants)} modules")
        for (source, _), occupant in zip(motion, passed.occupants, strict=False):
            due = self._tiles.keeper_of(self._system.place_of(source)) in so_far
            if (occupant is not None) != due:
                self._fail("decisions", f"{where}: who is at {site_text(source)} is misplaced")
            elif occupant is not None:
                self._check_occupant(where, source, occupant)
        for at, occupant in passed.noted:
            self._check_occupant(where, at, occupant)
            if at is None or self._system.place_of(at) not in {
                place for place, *_ in attempt.notes
            }:
                self._fail("decisions", f"{where}: no request was for the register at {at!r}")

    def _of(self, unit: Site) -> int:
        labelled = self._system.labels is not None
        return self._tiles.keeper_of(unit if labelled else self._system.place_of(unit))

    def _level_of(self, passed: free.Forwarded, *, committed: bool) -> int | None:
        """Return the greatest level of what it depends on so far; None if a version never was."""
        history, found = self._history, [0]
        written = [(unit, version) for unit, version, _ in passed.written]
        for unit, version in (*passed.read, *written):
            if unit is None or not history.at_unit(unit, version)[0]:
                return None
            found.append(history.levels.get(unit, [0])[version])
        if committed:
            for unit, version in written:
                if unit is not None:
                    found.append(history.read_levels.get(unit, [0])[version])
            return max(found)
        return None if written else max(found)

    def _check_occupant(self, where: Record, site: Site, occupant: free.Occupant) -> None:
        """Check what is reported of a module at one of its versions."""
        standing = self._history.module(occupant.module, occupant.version)
        name = f"module_{occupant.module} at version {occupant.version}"
        if standing is None:
            self._fail("decisions", f"{where}: there never was {name}")
            return
        if (standing.site, standing.note) != (site, occupant.note):
            self._fail("decisions", f"{where}: {name} was elsewhere, or had another register")
        if occupant.number != self._number_at(occupant):
            self._fail("decisions", f"{where}: {name} has number {occupant.number}")
        self._incarnations.take(where, occupant)

    def _number_at(self, occupant: free.Occupant) -> int:
        """Return the module's last committed attempt of this epoch that changed it, up to then."""
        moved = self._history.own_commit(occupant.module, occupant.version)
        return moved.number if moved is not None and moved.epoch == occupant.epoch else 0

    def _check_entered(self, sent: KeeperPart, entered: free.Entered) -> None:
        self._incarnations.answered(sent, entered)
        self._check_occupant(sent.where, entered.site, entered.occupant)


def name_of(
    part: free.Attempt | free.Decision | free.Commit | free.Inquiry | free.Settled,
) -> AttemptId:
    """Return which attempt this is, or is about."""
    return part.module, part.epoch, part.number


def _text(site: Site | None) -> str:
    return "nothing" if site is None else site_text(site)
