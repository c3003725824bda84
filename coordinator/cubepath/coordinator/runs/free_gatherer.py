"""Gathering a run without rounds: from commits of keepers, in any order, to its edge path.

A commit names the version of each unit that it read and overwrote, and how often what it overwrote
had been read. It is released when the units are as it found them. So the result depends on no clock
and no order of arrival, and what is released at any time is a state the run could have been in. The
path is ordered by level, and within a level by generator and place: moves of one level commute.

The commits of each keeper are counted by their numbers, so missing ones are known.
"""

from __future__ import annotations

from array import array
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from hashlib import blake2b
from typing import TYPE_CHECKING, TypeAlias

import msgspec
import numpy as np

from cubepath.agents.keepers.attempts import support_units
from cubepath.coordinator.normal_form.compiled_heap import FastHeap
from cubepath.coordinator.runs.edge_path import EdgePath, Gathered, PathDigest
from cubepath.protocol.core.actions import apply_in_place
from cubepath.protocol.core.catalogue import GeneratorPlacement, Move
from cubepath.protocol.core.errors import CheckError, InputError
from cubepath.protocol.core.sites import Site, site_text
from cubepath.protocol.core.system import Scene
from cubepath.protocol.wire.free_messages import Commit, CommitLog, FreeMessage, Turns
from cubepath.protocol.wire.keys import Tiles

if TYPE_CHECKING:
    from cubepath.protocol.recordings.recording import Recording

_encode = msgspec.json.Encoder().encode


def named(moved: Commit) -> str:
    """Return the name of a commit in error messages."""
    return f"commit {moved.serial} of keeper_{moved.keeper} (module_{moved.module})"


class Commits:
    """Which commits of a keeper have come, each with a digest; those in order take 8 bytes each."""

    def __init__(self) -> None:
        """Begin with none."""
        self.in_order = array("Q")
        self._ahead: dict[int, int] = {}
        self.serial_max = 0
        """How many there are at least."""

    def is_new(self, moved: Commit) -> bool:
        """Note a commit; CheckError if another came under its number."""
        if moved.serial < 1:
            raise CheckError(f"{named(moved)}: commits count from 1")
        digest = int.from_bytes(blake2b(_encode(moved), digest_size=8).digest(), "big")
        self.serial_max = max(self.serial_max, moved.serial)
        known: int | None = None
        if moved.serial <= len(self.in_order):
            known = self.in_order[moved.serial - 1]
        else:
            known = self._ahead.get(moved.serial)
        if known is not None:
            if known != digest:
                raise CheckError(f"{named(moved)} comes twice, and differs")
            return False
        self._ahead[moved.serial] = digest
        while len(self.in_order) + 1 in self._ahead:
            self.in_order.append(self._ahead.pop(len(self.in_order) + 1))
        return True

    @property
    def gap(self) -> bool:
        """Return whether one is missing that is known to be there."""
        return self.serial_max > len(self.in_order)


_Awaited: TypeAlias = tuple[str, Site]
"""What a commit waits for: a unit, or a module."""
_NO_SITE = (InputError, TypeError, ValueError, IndexError, KeyError, AttributeError, OverflowError)
"""What systems raise for a value that is none of their sites."""


@dataclass(slots=True)
class _Unit:
    version: int = 0
    level: int = 0
    reads: int = 0
    read_level: int = 0


class FreeGatherer(Gathered):
    """Gathers commits into the edge path; each is passed to `watch` as it is released."""

    def __init__(
        self, scene: Scene, keepers: int, watch: Callable[[Commit], None] | None = None
    ) -> None:
        """Begin at the start of the scene, whose units this many keepers have."""
        self.scene = scene
        self.sites = list(scene.start)
        self._system = scene.system
        self._tiles = Tiles(scene.system, keepers)
        self._watch = watch
        self._state = set(scene.start_state)
        self._units: dict[Site, _Unit] = {}
        self._module_versions = [0] * len(scene.start)
        self._commits = [Commits() for _ in range(keepers)]
        self._tails: dict[int, CommitLog] = {}
        self._waiting: dict[_Awaited, list[Commit]] = {}
        self._given_up: dict[int, str] = {}
        self._raw = EdgePath(scene)
        self._levels = array("i")
        self._top = 0
        """The greatest level of a move so far."""
        self._live = FastHeap()
        self._sorted: tuple[EdgePath, FastHeap, str] | None = None

    # What was gathered.

    @property
    def _canonical(self) -> tuple[EdgePath, FastHeap, str]:
        """Return the path in canonical order, with its heap and its digest."""
        if self._sorted is None or len(self._sorted[0].names) != len(self._levels):
            path, digest = self._in_order(), PathDigest()
            for place in range(len(path.ends)):
                digest.add(place + 1, path.step(place).executed)
            heap = FastHeap(telling=True)
            heap.extend(path.actions[name] for name in path.names)
            self._sorted = path, heap, digest.text()
        return self._sorted

    def _in_order(self) -> EdgePath:
        raw = self._raw
        keys = [(each.generator, _encode(each.at)) for each in raw.placed]
        rank = np.zeros(len(keys), np.int64)
        rank[sorted(range(len(keys)), key=keys.__getitem__)] = np.arange(len(keys))
        levels = np.array(self._levels, np.int64)
        order = np.lexsort((rank[np.array(raw.names, np.int64)], levels))
        return raw.ordered(order, np.bincount(levels)[1:] if len(levels) else levels)

    @property
    def _edges(self) -> EdgePath:
        return self._canonical[0]

    @property
    def heap(self) -> FastHeap:
        """Return the heap of the moves so far, in the canonical order of the path."""
        return self._canonical[1]

    @property
    def live(self) -> FastHeap:
        """Return a heap of the moves so far in the order of their release.

        Its cubes are those of `heap`; it costs only what was released since it was last asked for.
        """
        names, actions = self._raw.names, self._raw.actions
        self._live.extend(actions[names[place]] for place in range(self._live.moves, len(names)))
        return self._live

    @property
    def digest(self) -> str:
        """Return the digest of the edge path so far."""
        return self._canonical[2]

    @property
    def rounds(self) -> int:
        """Return the greatest level of a move released so far."""
        return self._top

    @property
    def moves(self) -> int:
        """Return the number of moves released so far."""
        return len(self._levels)

    def released(self, begin: int, count: int) -> list[tuple[int, str, Site]]:
        """Return the moves from a place on in the order of their release, with their levels.

        They are `count` at most. In any thread: what was released stays as it is.
        """
        levels, raw = self._levels, self._raw
        end = min(begin + count, len(levels), len(raw.names))
        placed = (raw.placed[raw.names[place]] for place in range(begin, end))
        return [
            (levels[place], each.generator, each.at) for place, each in enumerate(placed, begin)
        ]

    @property
    def failed(self) -> str | None:
        """Return which module gave up, the first by number, and why; None if none did."""
        for module in sorted(self._given_up):
            return f"module_{module}: {self._given_up[module]}"
        return None

    @property
    def unfinished(self) -> str | None:
        """Return in one line what is known to be missing; None if nothing is."""
        for keeper, commits in enumerate(self._commits):
            if commits.gap:
                return f"commit {len(commits.in_order) + 1} of keeper_{keeper} is missing"
        for (what, which), waiting in self._waiting.items():
            found = site_text(which) if what == "unit" else f"{what}_{which}"
            return f"{named(waiting[0])} finds {found} as no commit has left it"
        return next(self.lacking(), None)

    def known(self, keeper: int) -> int:
        """Return up to which serial number all commits of a keeper have come."""
        return len(self._commits[keeper].in_order)

    def missing(self) -> dict[int, int]:
        """Return which keepers have more, each with the last commit before those to fetch.

        If a commit waits for others and no number is missing, any keeper may have more.
        """
        found = {
            keeper: len(commits.in_order)
            for keeper, commits in enumerate(self._commits)
            if commits.gap
        }
        if found or not self._waiting:
            return found
        return {keeper: len(commits.in_order) for keeper, commits in enumerate(self._commits)}

    def lacking(self) -> Iterator[str]:
        """Yield a line for each unit that a keeper knows in a later version than was gathered."""
        for keeper, tail in sorted(self._tails.items()):
            for unit, version, _, reads, _ in tail.units:
                known = self._unit(unit)
                if (version, reads) > (known.version, known.reads):
                    yield (
                        f"keeper_{keeper} has {site_text(unit)} at version"
                        f" {version}, read {reads} times; gathered are version {known.version},"
                        f" read {known.reads} times"
                    )

    # What comes in.

    def take(self, message: FreeMessage) -> None:
        """Take a message that belongs in the recording; CheckError as for `receive`."""
        match message:
            case Commit():
                self.receive(message)
            case CommitLog():
                self.tail(message)
            case Turns(parts=turns):
                for turn in turns:
                    if turn.failed is not None:
                        self._given_up.setdefault(turn.module, turn.failed)
            case _:
                pass

    def tail(self, tail: CommitLog) -> None:
        """Take what a keeper says of all its commits."""
        commits = self._of_keeper(tail.keeper)
        for moved in tail.parts:
            if moved.keeper != tail.keeper:
                raise CheckError(f"keeper_{tail.keeper} tells {named(moved)} as its own")
            self.receive(moved)
        if tail.serial >= commits.serial_max:
            commits.serial_max = tail.serial
            self._tails[tail.keeper] = tail

    def receive(self, moved: Commit) -> None:
        """Take a commit; CheckError if two contradict each other, or if it cannot be."""
        if not self._of_keeper(moved.keeper).is_new(moved):
            return
        ready = [moved]
        while ready:
            each = ready.pop()
            try:
                awaited = self._awaited(each)
                if awaited is None:
                    ready += self._release(each)
                else:
                    self._waiting.setdefault(awaited, []).append(each)
            except _NO_SITE as error:
                raise CheckError(f"{named(each)}: {error}") from None

    def _of_keeper(self, keeper: int) -> Commits:
        if keeper >= len(self._commits):
            raise CheckError(f"a message of keeper_{keeper}: this run has {len(self._commits)}")
        return self._commits[keeper]

    def _unit(self, unit: Site) -> _Unit:
        return self._units.get(unit, _UNTOUCHED)

    def _awaited(self, moved: Commit) -> _Awaited | None:
        """Return what must change before a commit can be released, None if nothing."""
        for unit, version in moved.read:
            known = self._unit(unit)
            if known.version < version:
                return "unit", unit
            if known.version > version:
                raise CheckError(
                    f"{named(moved)} reads version {version} of {site_text(unit)}, which was"
                    f" overwritten by one that counted {known.version} writes and not this reader"
                )
        for unit, version, reads in moved.written:
            known = self._unit(unit)
            if known.version > version:
                raise CheckError(
                    f"{named(moved)} overwrites version {version} of {site_text(unit)}, which"
                    " another has overwritten"
                )
            if known.version == version and known.reads > reads:
                raise CheckError(
                    f"{named(moved)} overwrites version {version} of {site_text(unit)} after"
                    f" {reads} readers, found {known.reads}"
                )
            if (known.version, known.reads) != (version, reads):
                return "unit", unit
        for value, version in moved.guarded:
            if self._unit(unit := value).version < version:
                return "unit", unit
        return self._awaited_module(moved)

    def _awaited_module(self, moved: Commit) -> _Awaited | None:
        for module, version, counts in _module_versions(moved):
            if module >= len(self.sites):
                raise CheckError(f"{named(moved)}: no module_{module} in this run")
            known = self._module_versions[module]
            if known < version - counts:
                return "module", module
            if counts and known >= version:
                raise CheckError(
                    f"{named(moved)} is version {version} of module_{module}, which another was"
                )
        return None

    def _release(self, moved: Commit) -> list[Commit]:
        """Carry out a commit; return those that may be ready now."""
        changed: list[_Awaited] = []
        if moved.generator is None:
            if moved.level or moved.read or moved.written or moved.motion or moved.guarded:
                raise CheckError(f"{named(moved)}: it moves nothing, expected registers alone")
        else:
            self._carry_out(moved, self._move(moved))
            changed += (("unit", unit) for unit, *_ in (*moved.read, *moved.written))
        for module, version, counts in _module_versions(moved):
            if counts:
                self._module_versions[module] = version
                changed.append(("module", module))
        self._check_registers(moved)
        if self._watch is not None:
            self._watch(moved)
        return [each for key in changed for each in self._waiting.pop(key, ())]

    def _move(self, moved: Commit) -> Move:
        """Return the move of a commit; CheckError if the catalogue or the state has another."""
        mover, source, *_ = moved.motion[0] if moved.motion else (moved.module, None, None, 0)
        at = moved.at
        move = None
        if moved.generator is not None and moved.motion:
            move = self._system.move_named(source, moved.generator, at)
        motion = [(one, two) for _, one, two, _ in moved.motion]
        if move is None or mover != moved.module or motion != list(move.motion):
            raise CheckError(f"{named(moved)}: its motion is not that of {moved.generator!r}")
        for module, source, *_ in moved.motion:
            if self.sites[module] != source:
                raise CheckError(
                    f"{named(moved)}: module_{module} stands at {site_text(self.sites[module])},"
                    f" it says at {site_text(source)}"
                )
        reads, writes = support_units(self._system, self._tiles, move)
        stated_reads = [unit for unit, _ in moved.read]
        stated_writes = [unit for unit, *_ in moved.written]
        if (
            (frozenset(stated_reads), frozenset(stated_writes)) != (reads, writes)
            or len(stated_reads) != len(reads)
            or len(stated_writes) != len(writes)
        ):
            raise CheckError(f"{named(moved)}: it reads or writes other units than its move does")
        return move

    def _carry_out(self, moved: Commit, move: Move) -> None:
        reads = [self._units.setdefault(unit, _Unit()) for unit, _ in moved.read]
        writes = [self._units.setdefault(unit, _Unit()) for unit, *_ in moved.written]
        depends = [unit.level for unit in (*reads, *writes)]
        level = 1 + max([0, *depends, *(unit.read_level for unit in writes)])
        if moved.level != level:
            raise CheckError(f"{named(moved)} is of level {moved.level}, expected {level}")
        try:
            apply_in_place(move.action, self._state)
        except InputError as error:
            raise CheckError(f"{named(moved)}: {error}") from None
        for unit in reads:
            unit.reads += 1
            unit.read_level = max(unit.read_level, level)
        for unit in writes:
            unit.version, unit.level, unit.reads, unit.read_level = unit.version + 1, level, 0, 0
        for (module, *_), (_, target) in zip(moved.motion, move.motion, strict=True):
            self.sites[module] = target
        self._raw.movers.append(moved.module)
        self._raw.names.append(self._raw.name(GeneratorPlacement(move.generator, moved.at)))
        self._levels.append(level)
        self._top = max(self._top, level)

    def _check_registers(self, moved: Commit) -> None:
        """Check where the modules of registers stand, as far as nothing has moved them since."""
        for place, module, version, _ in moved.notes:
            if self._module_versions[module] == version:
                found = self._system.place_of(self.sites[module])
                if found != place:
                    raise CheckError(
                        f"{named(moved)}: module_{module} stands at {site_text(found)}, its"
                        f" register is reported at {site_text(place)}"
                    )


_UNTOUCHED = _Unit()


def _module_versions(moved: Commit) -> Iterator[tuple[int, int, bool]]:
    """Yield the modules of a commit with their versions, and whether it counts for them."""
    carried = {module: version for module, _, _, version in moved.motion}
    yield from ((module, version, True) for module, version in carried.items())
    for _, module, version, note in moved.notes:
        if module not in carried:
            yield module, version, note is not None
        elif carried[module] != version:
            raise CheckError(f"{named(moved)}: module_{module} has two versions")


def keepers_in(recording: Recording) -> int:
    """Return the number of keepers of a run; InputError if the recording does not say."""
    stated = recording.parameters.get("keepers", "")
    if not (stated.isascii() and stated.isdigit() and 1 <= len(stated) <= 5 and int(stated)):
        raise InputError(
            f"{recording.path}: keepers={stated!r} in its parameters, expected how many there were"
        )
    return int(stated)
