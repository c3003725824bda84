"""A run without rounds as its versions describe it: commits, their dependencies, and turns.

Of the messages only commits, turns and incarnations are kept. The versions that commits name say
which commit depends on which, never the order of arrival.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TypeAlias

from cubepath.coordinator.tools.comparison.moves import ODD_MAX, action_text, cut_text
from cubepath.coordinator.verification.free_history import History
from cubepath.coordinator.verification.free_units import NO_SITE, changed_by, held_by
from cubepath.coordinator.verification.transcript import is_cut_off
from cubepath.protocol.core.actions import Action
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.sites import Site, site_text
from cubepath.protocol.recordings.recording import Recording
from cubepath.protocol.wire.free_messages import Commit, Entered, Register, Turn, decode_free
from cubepath.protocol.wire.messages import Summary, encode

CommitId: TypeAlias = tuple[int, int]
"""A commit by its module and how many of that module come before it, from 1."""
_OF_MESSAGES = frozenset({"messages", "serials"})
"""What is odd with messages, before anything is derived."""
_KINDS = frozenset({"commit", "commits", "turns", "replies", "summary"})


@dataclass(frozen=True)
class CommitNode:
    """A commit, with all that it is in another run too if that is equal up to commuting."""

    id: CommitId
    moved: Commit
    content: tuple[object, ...]
    """The move, and what was written into registers."""
    before: frozenset[CommitId]
    """What it depends on: who wrote what it found, and who read what it overwrites."""

    @property
    def name(self) -> tuple[int, int]:
        """Return by what its own run calls it: its keeper, and which commit of that it is."""
        return self.moved.keeper, self.moved.serial

    @property
    def place(self) -> tuple[int, int, int]:
        """Return where it comes among others that do not depend on each other."""
        return self.moved.level, *self.id

    @property
    def move(self) -> str | None:
        """Return its move in words; None if it only writes or holds registers."""
        moved = self.moved
        return None if moved.generator is None else action_text(moved.generator, moved.at)

    def text(self) -> str:
        """Return it in words."""
        moved, parts = self.moved, [self.move] if self.move is not None else []
        parts += [
            f"module_{module} notes {list(note)}"
            for _, module, _, note in moved.notes
            if note is not None
        ]
        return ", ".join(parts) or "holds registers"


class CommitGraph:
    """A recording of a run without rounds."""

    def __init__(self, recording: Recording) -> None:
        """Read it, and derive what was where at which version."""
        self.recording = recording
        self.cut = cut_text(recording)
        """What it was cut from, in words; None if it was not cut."""
        self.missing = 0
        """How many commits are not recorded, by their numbers."""
        self._odd: list[tuple[str, str]] = []
        self.summary: Summary | None = None
        self.turns: dict[int, dict[tuple[int, int], Turn]] = {}
        """By module, then by epoch and turn."""
        self.loose = 0
        """How many commits follow on some that are not recorded."""
        self._entered: dict[tuple[int, int], Site] = {}
        self._commits: dict[int, dict[int, Commit]] = {}
        self._read()
        ordered = [
            self._commits[keeper][serial]
            for keeper in sorted(self._commits)
            for serial in sorted(self._commits[keeper])
        ]
        self._count_missing()
        self.history = History(recording.scene, ordered, self._fail)
        self.commits = self._linked()

    @property
    def partial(self) -> bool:
        """Whether commits can be missing that the run had."""
        recording = self.recording
        cut = self.cut is not None or is_cut_off(recording) or bool(recording.problems)
        return cut or self.summary is None or bool(self.missing)

    @property
    def odd(self) -> list[str]:
        """What is odd, the first lines; but for what follows from commits that are missing."""
        kept = _OF_MESSAGES if self.missing and self.partial else None
        return [why for check, why in self._odd if kept is None or check in kept][:ODD_MAX]

    def _fail(self, check: str, why: str) -> None:
        # One kind must not keep out the other.
        if (
            sum((known in _OF_MESSAGES) == (check in _OF_MESSAGES) for known, _ in self._odd)
            < ODD_MAX
        ):
            self._odd.append((check, why))

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
        elif isinstance(part, Commit):
            self._moved(part)
        elif isinstance(part, Entered):
            site = part.site
            if site is not None:
                self._entered.setdefault((part.occupant.module, part.occupant.epoch), site)

    def _moved(self, moved: Commit) -> None:
        known = self._commits.setdefault(moved.keeper, {}).setdefault(moved.serial, moved)
        if known != moved:
            # Whichever comes first, the same one is taken.
            self._commits[moved.keeper][moved.serial] = min(known, moved, key=encode)
            name = f"commit {moved.serial} of keeper_{moved.keeper}"
            self._fail("serials", f"{name} comes twice, and differs")

    def _count_missing(self) -> None:
        for commits in self._commits.values():
            self.missing += max(commits) - len(commits)

    def _linked(self) -> dict[CommitId, CommitNode]:
        """Return all commits in an order in which they can have happened.

        Those that follow on others which are not recorded are left out, and counted: which of its
        module's commits such a one is, nobody knows.
        """
        history = self.history
        links = _Links()
        before: dict[int, set[int]] = {}
        for number in history.order:
            found = links.before(number, history.commits[number])
            if found is None or not found <= before.keys():
                self.loose += 1
            else:
                before[number] = found
        ids: dict[int, CommitId] = {}
        counts: dict[int, int] = {}
        by_module = sorted(
            before,
            key=lambda n: (history.commits[n].module, history.commits[n].epoch,
                           history.commits[n].number),
        )  # fmt: skip
        for number in by_module:
            module = history.commits[number].module
            counts[module] = counts.get(module, 0) + 1
            ids[number] = module, counts[module]
        return {
            ids[number]: CommitNode(
                ids[number],
                history.commits[number],
                _content(history.commits[number]),
                frozenset(ids[each] for each in found),
            )
            for number, found in before.items()
        }

    def moves(self) -> Iterator[tuple[Commit, Action]]:
        """Yield the moves in canonical order."""
        path = self.history.path()
        for number, action in zip(path.commits.tolist(), path.actions, strict=True):
            yield self.history.commits[number], action

    # What a module was shown.

    def turns_to(self, commit: CommitNode) -> Iterator[tuple[Turn, bool, Site]]:
        """Yield the turns of a module up to the one that led to a commit.

        Each comes with whether its process began anew, and where it then stood.
        """
        moved = commit.moved
        epoch = None
        for name, turn in sorted(self.turns.get(moved.module, {}).items()):
            if name > (moved.epoch, moved.turn):
                return
            site = turn.site
            born = self._entered.get((turn.module, turn.epoch), site)
            if born is not None:
                yield turn, turn.epoch != epoch, born
            epoch = turn.epoch

    def shown(self, turn: Turn) -> ShownInTurn | None:
        """Return what a rule was shown in a turn, None if its versions are not recorded."""
        history, system = self.history, self.history.system
        site = turn.site
        standing = history.module(turn.module, turn.version)
        if site is None or standing is None:
            return None
        try:
            place = system.place_of(site)
            found = ShownInTurn(site, standing.note, {place: site}, {}, {}, {}, {})
            for near, version in zip(system.sensed(place), turn.sensed, strict=False):
                if near is None:
                    continue
                there = history.at_place(near, version)
                if there is None:
                    return None
                found.versions[site_text(near)] = version
                found.occupants[site_text(near)] = "empty"
                if there.site is not None:
                    found.standing[near] = there.site
                    found.occupants[site_text(near)] = f"module_{there.module}"
            for near, (version, own) in zip(system.reach(place), turn.received, strict=False):
                there = history.at_place(near, version)
                if there is None:
                    return None
                other = None if there.module is None else history.module(there.module, own)
                if other is not None and other.note:
                    found.notes[near] = other.note
                    found.received[f"module_{there.module} at {site_text(near)}"] = list(other.note)
        except NO_SITE:
            return None
        return found


@dataclass(frozen=True)
class ShownInTurn:
    """What a rule was shown in a turn; in words, `occupants` of places and notes `received`."""

    site: Site
    register: Register
    standing: dict[Site, Site]
    notes: dict[Site, Register]
    occupants: dict[str, str]
    received: dict[str, list[int]]
    versions: dict[str, int]

    @property
    def text(self) -> str:
        """Where it stood, in words."""
        return site_text(self.site)


class _Links:
    """Which modules wrote and read which version so far."""

    def __init__(self) -> None:
        self._wrote: dict[tuple[object, int], int] = {}
        self._read: dict[tuple[object, int], list[int]] = {}

    def before(self, name: int, moved: Commit) -> set[int] | None:
        """Return what a commit depends on, and note what it does.

        None if it finds a version that no recorded commit wrote.
        """
        finds: list[tuple[object, int]] = []
        found: set[int] = set()
        for value, version in (*moved.read, *moved.guarded):
            finds.append((value, version))
        for unit, version, _ in moved.written:
            finds.append((unit, version))
            found.update(self._read.get((unit, version), ()))
        for module, version in held_by(moved).items():
            finds.append((("module", module), version))
        for module, version in changed_by(moved).items():
            finds.append((("module", module), version - 1))
        known = all(version <= 0 or (what, version) in self._wrote for what, version in finds)
        found.update(self._wrote[each] for each in finds if each in self._wrote)
        for value, version in moved.read:
            self._read.setdefault((value, version), []).append(name)
        for value, version, _ in moved.written:
            self._wrote[value, version + 1] = name
        for module, version in changed_by(moved).items():
            self._wrote[("module", module), version] = name
        return found - {name} if known else None


def _content(moved: Commit) -> tuple[object, ...]:
    notes = tuple((module, tuple(note)) for _, module, _, note in moved.notes if note is not None)
    at = None if moved.generator is None else moved.at
    return moved.generator, at, notes
