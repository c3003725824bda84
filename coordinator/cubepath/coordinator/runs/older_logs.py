"""Whether the logs of a run's keepers are as late as what else is known of the run.

A log without its last records is whole in itself: a crash before they were written would have left
the same. But a keeper logs first and speaks then, so the logs of other keepers, and the recording,
tell what a log must have. Numbers of a keeper only grow along its log, so it is enough to compare
the last ones.
"""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import NamedTuple, TypeAlias

from cubepath.agents.free.fleet import BIRTHS, Births, log_of, read_births
from cubepath.agents.keepers.attempts import chain_of
from cubepath.agents.keepers.journal import (
    Acknowledged,
    Born,
    Committed,
    Decided,
    Opened,
    Prepared,
    Record,
    read_log,
)
from cubepath.coordinator.runs.commits import Commits
from cubepath.protocol.core.errors import CheckError, InputError
from cubepath.protocol.core.system import Scene
from cubepath.protocol.recordings.recording import Recording
from cubepath.protocol.wire.free_messages import (
    Attempt,
    Decision,
    Entered,
    FreeMessage,
    Moved,
    Tail,
    Tells,
    decode_free,
)
from cubepath.protocol.wire.sayings import BIRTHS_OF_A_FLEET
from cubepath.protocol.wire.tiles import Tiles

_Number: TypeAlias = tuple[int, ...]
_COMMIT, _PREPARED, _DECIDED, _OPENED = "commit", "prepared attempt", "decided attempt", "birth"


class _Key(NamedTuple):
    """What is numbered in the log of a keeper, of each module by itself or of all."""

    keeper: int
    what: str
    module: int | None = None


class _Known:
    """What the logs of a run have, and what the others and its recording know of each."""

    def __init__(self, folder: Path, scene: Scene, keepers: int) -> None:
        """Begin with nothing."""
        self._folder = folder
        self._system, self._tiles = scene.system, Tiles(scene.system, keepers)
        self._commits = [Commits() for _ in range(keepers)]
        self._has: dict[_Key, _Number] = {}
        self._told: dict[_Key, tuple[_Number, Path]] = {}
        self._entered: Counter[int] = Counter()
        self._epochs: dict[int, tuple[int, Path]] = {}

    def record(self, keeper: int, record: Record | Opened, where: Path) -> None:
        """Take note of a record in the log of a keeper, and of what it says of other logs."""
        match record:
            case Opened(birth=birth):
                self._has[_Key(keeper, _OPENED)] = (birth,)
            case Prepared(passed=passed):
                attempt = passed.attempt
                self._log(_Key(keeper, _PREPARED, attempt.module), attempt.epoch, attempt.number)
                self._attempted(keeper, attempt, where)
            case Committed(passed=passed, decision=decision):
                self._has[_Key(keeper, _COMMIT)] = self._committed(decision, where)
                self._attempted(keeper, passed.attempt, where)
            case Decided(decision=decision):
                self._log(_Key(keeper, _DECIDED, decision.module), decision.epoch, decision.number)
                self._committed(decision, where)
            case Acknowledged():
                key = _Key(record.keeper, _DECIDED, record.module)
                self._tell(key, (record.epoch, record.number), where)
            case Born(enter=enter):
                self._entered[enter.module] += 1

    def message(self, message: FreeMessage, where: Path) -> None:
        """Take note of what a message on record says of the logs."""
        match message:
            case Moved():
                self._moved(message, where)
            case Tail(keeper=keeper, serial=serial, birth=birth):
                self._tell(_Key(keeper, _COMMIT), (serial,), where)
                self._tell(_Key(keeper, _OPENED), (birth,), where)
                for moved in message.parts:
                    self._moved(moved, where)
            case Tells(parts=parts):
                for part in parts:
                    if isinstance(part, Entered):
                        self._acted(part.occupant.module, part.occupant.epoch, where)
                    elif isinstance(part, Decision):
                        self._committed(part, where)
            case _:
                pass

    def _attempted(self, keeper: int, attempt: Attempt, where: Path) -> None:
        """Whoever is before this keeper in the chain has prepared it."""
        try:
            chain = chain_of(self._system, self._tiles, attempt)
        except InputError as error:
            raise InputError(f"{where}: {error}, expected one in the scene of the run") from None
        for other in chain:
            if other < keeper:
                key = _Key(other, _PREPARED, attempt.module)
                self._tell(key, (attempt.epoch, attempt.number), where)
        self._acted(attempt.module, attempt.epoch, where)

    def _committed(self, decision: Decision, where: Path) -> _Number:
        return () if decision.moved is None else self._moved(decision.moved, where)

    def _moved(self, moved: Moved, where: Path) -> _Number:
        if moved.keeper >= len(self._commits):
            raise InputError(f"{where}: has a commit of keeper_{moved.keeper}, which the run lacks")
        try:
            self._commits[moved.keeper].is_new(moved)
        except CheckError as error:
            raise InputError(f"{where}: {error} from what else is known of the run") from None
        self._tell(_Key(moved.keeper, _COMMIT), (moved.serial,), where)
        return (moved.serial,)

    def _acted(self, module: int, epoch: int, where: Path) -> None:
        """Whoever acts in an epoch has entered so often."""
        if epoch > self._epochs.get(module, (0, where))[0]:
            self._epochs[module] = epoch, where

    def _log(self, key: _Key, *number: int) -> None:
        self._has[key] = max(self._has.get(key, ()), number)

    def _tell(self, key: _Key, number: _Number, where: Path) -> None:
        if number[-1] and number > self._told.get(key, ((), where))[0]:
            self._told[key] = number, where

    def check(self, births: Births) -> None:
        """Check that the logs, and their births, have what must be there; InputError if not."""
        for key, (birth, *_) in self._has.items():
            if key.what == _OPENED and birth >= births.birth + BIRTHS_OF_A_FLEET:
                raise InputError(
                    f"{self._folder / BIRTHS}: the birth is {births.birth}, expected a later"
                    f" one, as {log_of(self._folder, key.keeper)} was opened in birth {birth}:"
                    " it is older"
                )
        for key, (number, where) in self._told.items():
            found = self._has.get(key, ())
            if found < number:
                of = "" if key.module is None else f" of module_{key.module}"
                raise InputError(
                    f"{log_of(self._folder, key.keeper)}: the last {key.what}{of} is"
                    f" {_text(found)}, expected {_text(number)} as in {where}: it is an older log"
                )
        for module, (epoch, where) in self._epochs.items():
            if self._entered[module] < epoch:
                raise InputError(
                    f"{self._folder}: module_{module} entered {self._entered[module]} times,"
                    f" expected {epoch} as in {where}: one of the logs is an older one"
                )


def _text(number: _Number) -> str:
    return ".".join(map(str, number)) or "none"


def check_logs(folder: Path, recording: Recording, keepers: int) -> None:
    """Check that no log of a keeper lacks what others know of it; InputError if one does."""
    births = read_births(folder) or Births("", 0)  # without births there are no logs
    known = _Known(folder, recording.scene, keepers)
    for keeper in range(keepers):
        path = log_of(folder, keeper)
        try:
            with path.open("rb") as file:
                for line in read_log(path, file, births.run, keeper):
                    known.record(keeper, line.record, path)
        except FileNotFoundError:
            continue  # its keeper may never have been started
        except OSError as error:
            raise InputError(
                f"{path}: {error.strerror or error}, expected a keeper's log"
            ) from None
    for record in recording.of_kind("moved", "tail", "tell"):
        known.message(decode_free(record.data), recording.path)
    known.check(births)
