"""A run without rounds as its versions tell it: commits with what they depend on, and turns.

Room: coordinator. Of what was said only commits, turns and births are kept. Which commit depends on
which follows from the versions that they name, never from the order of arrival.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TypeAlias

from cubepath.coordinator.comparison.reading import ODD_MAX, action_text
from cubepath.coordinator.verification.free_history import NO_SITE, History
from cubepath.coordinator.verification.free_units import changed_by, held_by
from cubepath.coordinator.verification.transcript import site_in
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.sites import Site, site_text
from cubepath.protocol.recordings.recording import Recording
from cubepath.protocol.wire.free_messages import (
    Entered,
    Moved,
    Register,
    Turn,
    decode_free,
)
from cubepath.protocol.wire.messages import Summary, encode

CommitId: TypeAlias = tuple[int, int]
"""A commit by its module and how many of that module come before it, from 1."""
_KINDS = frozenset({"moved", "tail", "turns", "tell", "summary"})


@dataclass(frozen=True)
class Commit:
    """A commit, with all that it is in another run too if that is equal up to commuting."""

    id: CommitId
    moved: Moved
    content: tuple[object, ...]
    """The move, and what was written into registers."""
    before: frozenset[CommitId]
    """What it depends on: who wrote what it found, and who read what it overwrites."""

    @property
    def place(self) -> tuple[int, int, int]:
        """Return where it comes among others that do not depend on each other."""
        return self.moved.level, *self.id

    def text(self) -> str:
        """Return it in words."""
        moved = self.moved
        told = []
        if moved.generator is not None:
            told.append(action_text(moved.generator, moved.at))
        told += [
            f"module_{module} notes {list(note)}"
            for _, module, _, note in moved.notes
            if note is not None
        ]
        return ", ".join(told) or "holds registers"


class FreeRun:
    """A recording of a run without rounds."""

    def __init__(self, recording: Recording) -> None:
        """Read it, and derive what was where at which version."""
        self.recording = recording
        self.odd: list[str] = []
        self.summary: Summary | None = None
        self.turns: dict[int, dict[tuple[int, int], Turn]] = {}
        """By module, then by epoch and turn."""
        self._entered: dict[tuple[int, int], Site] = {}
        self._commits: dict[int, dict[int, Moved]] = {}
        self._read()
        ordered = (
            self._commits[keeper][serial]
            for keeper in sorted(self._commits)
            for serial in sorted(self._commits[keeper])
        )
        self._missing()
        self.history = History(recording.scene, ordered, self._fail)
        self.commits = self._linked()

    def _fail(self, _check: str, why: str) -> None:
        if len(self.odd) < ODD_MAX:
            self.odd.append(why)

    def _read(self) -> None:
        for record in self.recording.written(_KINDS):
            try:
                message = decode_free(record.data)
            except InputError as error:
                self._fail("messages", f"message {record.sequence} ({record.topic}): {error}")
                continue
            if isinstance(message, Summary):
                self.summary = message
            # A commit is its own part.
            for part in getattr(message, "parts", (message,)):
                self._take(part)

    def _take(self, part: object) -> None:
        if isinstance(part, Turn):
            self.turns.setdefault(part.module, {}).setdefault((part.epoch, part.turn), part)
        elif isinstance(part, Moved):
            self._moved(part)
        elif isinstance(part, Entered):
            site = site_in(part.site)
            if site is not None:
                self._entered.setdefault((part.occupant.module, part.occupant.epoch), site)

    def _moved(self, moved: Moved) -> None:
        known = self._commits.setdefault(moved.keeper, {}).setdefault(moved.serial, moved)
        if known != moved:
            # Whichever comes first, the same one is taken.
            self._commits[moved.keeper][moved.serial] = min(known, moved, key=encode)
            name = f"commit {moved.serial} of keeper_{moved.keeper}"
            self._fail("serials", f"{name} comes twice, and differs")

    def _missing(self) -> None:
        for keeper, commits in sorted(self._commits.items()):
            absent = max(commits) - len(commits)
            if absent:
                self._fail("serials", f"{absent} commits of keeper_{keeper} are not on record")

    def _linked(self) -> dict[CommitId, Commit]:
        """Return all commits in an order in which they can have happened."""
        history = self.history
        ids: dict[int, CommitId] = {}
        counts: dict[int, int] = {}
        by_module = sorted(
            range(len(history.commits)),
            key=lambda n: (history.commits[n].module, history.commits[n].epoch,
                           history.commits[n].number),
        )  # fmt: skip
        for number in by_module:
            module = history.commits[number].module
            counts[module] = counts.get(module, 0) + 1
            ids[number] = module, counts[module]
        links = _Links()
        found: dict[CommitId, Commit] = {}
        for number in sorted(history.order, key=history.order.__getitem__):
            moved = history.commits[number]
            before = frozenset(links.before(ids[number], moved))
            found[ids[number]] = Commit(ids[number], moved, _content(moved), before)
        return found

    # What a module was shown.

    def turns_to(self, commit: Commit) -> Iterator[tuple[Turn, bool, Site]]:
        """Yield the turns of a module up to the one that led to a commit.

        Each comes with whether its process began anew, and where it then stood.
        """
        moved = commit.moved
        epoch = None
        for name, turn in sorted(self.turns.get(moved.module, {}).items()):
            if name > (moved.epoch, moved.turn):
                return
            site = site_in(turn.site)
            born = self._entered.get((turn.module, turn.epoch), site)
            if born is not None:
                yield turn, turn.epoch != epoch, born
            epoch = turn.epoch

    def shown(self, turn: Turn) -> Shown | None:
        """Return what a rule was shown in a turn, None if its versions are not on record."""
        history, system = self.history, self.history.system
        site = site_in(turn.site)
        standing = history.module(turn.module, turn.version)
        if site is None or standing is None:
            return None
        try:
            place = system.place_of(site)
            found = Shown(site, standing.note, {place: site}, {}, {}, {}, {})
            for near, version in zip(system.sensed(place), turn.sensed, strict=False):
                if near is None:
                    continue
                there = history.at_place(near, version)
                if there is None:
                    return None
                found.versions[site_text(near)] = version
                found.who[site_text(near)] = "empty"
                if there.site is not None:
                    found.standing[near] = there.site
                    found.who[site_text(near)] = f"module_{there.module}"
            for near, (version, own) in zip(system.reach(place), turn.heard, strict=False):
                there = history.at_place(near, version)
                if there is None:
                    return None
                other = None if there.module is None else history.module(there.module, own)
                if other is not None and other.note:
                    found.notes[near] = other.note
                    found.told[f"module_{there.module} at {site_text(near)}"] = list(other.note)
        except NO_SITE:
            return None
        return found


@dataclass(frozen=True)
class Shown:
    """What a rule was shown in a turn; in words `who` is where, and `told` who says what."""

    site: Site
    register: Register
    standing: dict[Site, Site]
    notes: dict[Site, Register]
    who: dict[str, str]
    told: dict[str, list[int]]
    versions: dict[str, int]

    @property
    def text(self) -> str:
        """Where it stood, in words."""
        return site_text(self.site)


class _Links:
    """Who wrote and read which version so far."""

    def __init__(self) -> None:
        self._wrote: dict[tuple[object, int], CommitId] = {}
        self._read: dict[tuple[object, int], list[CommitId]] = {}

    def before(self, name: CommitId, moved: Moved) -> set[CommitId]:
        """Return what a commit depends on, and take note of what it does."""
        found: set[CommitId | None] = set()
        for value, version in (*moved.read, *moved.guarded):
            found.add(self._wrote.get((site_in(value), version)))
        for value, version in moved.read:
            self._read.setdefault((site_in(value), version), []).append(name)
        for value, version, _ in moved.written:
            unit = site_in(value)
            found.add(self._wrote.get((unit, version)))
            found.update(self._read.get((unit, version), ()))
            self._wrote[unit, version + 1] = name
        for module, version in held_by(moved).items():
            found.add(self._wrote.get((("module", module), version)))
        for module, version in changed_by(moved).items():
            key = "module", module
            found.add(self._wrote.get((key, version - 1)))
            self._wrote[key, version] = name
        return {each for each in found if each is not None and each != name}


def _content(moved: Moved) -> tuple[object, ...]:
    notes = tuple((module, tuple(note)) for _, module, _, note in moved.notes if note is not None)
    at = None if moved.generator is None else site_in(moved.at)
    return moved.generator, at, notes
