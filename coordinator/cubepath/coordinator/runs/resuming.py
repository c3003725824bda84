"""Resuming a run without rounds that was cut off: its recording, and the logs of its keepers.

While such a run is under way, the logs of its keepers are in a folder beside its recording. A run
that ends removes the folder, unless it failed.

A log that lacks its last records is valid in itself: a crash before they were written would have
left the same. But a keeper logs before it sends, so the logs of other keepers and the recording
show which records a log must have. The numbers of a keeper only grow along its log, so it is enough
to compare the last ones. Those of a log that was compacted are in what is left: of each module what
was prepared or decided last, and what each keeper has acknowledged last.
"""

import os
import time
from collections import Counter
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import BinaryIO, NamedTuple, TypeAlias

from cubepath.agents.free.config import ON_CRASH
from cubepath.agents.free.fleet import INCARNATIONS, LogsInfo, log_of, read_incarnations
from cubepath.agents.keepers import journal
from cubepath.agents.keepers.attempts import chain_of
from cubepath.agents.rules.registry import is_in_file, permitted_rule
from cubepath.coordinator.runs.free_gatherer import Commits
from cubepath.coordinator.runs.plan import Plan, RunTask
from cubepath.protocol.core.errors import CheckError, InputError
from cubepath.protocol.core.input_files import file_within
from cubepath.protocol.core.output_files import locked_file, unwritable
from cubepath.protocol.core.system import Scene
from cubepath.protocol.recordings.recording import Recording, read_recording
from cubepath.protocol.wire import free_messages
from cubepath.protocol.wire.keys import Tiles
from cubepath.protocol.wire.outgoing_log import INCARNATIONS_OF_A_FLEET

_Number: TypeAlias = tuple[int, ...]
_COMMIT, _PREPARED, _DECIDED, _OPENED = (
    "commit",
    "prepared attempt",
    "decided attempt",
    "incarnation",
)


class _Key(NamedTuple):
    """What is numbered in the log of a keeper, of each module by itself or of all."""

    keeper: int
    what: str
    module: int | None = None


class _Known:
    """What the logs of a run have, and what the others and its recording know of each."""

    def __init__(self, folder: Path, scene: Scene, keepers: int) -> None:
        self._folder = folder
        self._system, self._tiles = scene.system, Tiles(scene.system, keepers)
        self._commits = [Commits() for _ in range(keepers)]
        self._has: dict[_Key, _Number] = {}
        self._numbers: dict[_Key, tuple[_Number, Path]] = {}
        self._entered: Counter[int] = Counter()
        self._epochs: dict[int, tuple[int, Path]] = {}
        self._recorded = [0] * keepers

    def record(self, keeper: int, record: journal.Record | journal.Opened, where: Path) -> None:
        """Note a record in the log of a keeper, and of what it says of other logs."""
        match record:
            case journal.Opened(incarnation=incarnation):
                self._has[_Key(keeper, _OPENED)] = (incarnation,)
            case journal.Prepared(passed=passed):
                attempt = passed.attempt
                self._log(_Key(keeper, _PREPARED, attempt.module), attempt.epoch, attempt.number)
                # Those before are decided: a keeper prepares one attempt of a module at a time.
                self._log(_Key(keeper, _DECIDED, attempt.module), attempt.epoch, attempt.number - 1)
                self._attempted(keeper, attempt, where)
            case journal.Committed(passed=passed, decision=decision):
                self._has[_Key(keeper, _COMMIT)] = self._committed(decision, where)
                self._attempted(keeper, passed.attempt, where)
            case journal.Decided(decision=decision):
                for what in (_PREPARED, _DECIDED):
                    key = _Key(keeper, what, decision.module)
                    self._log(key, decision.epoch, decision.number)
                self._acted(decision.module, decision.epoch, where)
                self._committed(decision, where)
            case journal.Acknowledged():
                key = _Key(record.keeper, _DECIDED, record.module)
                self._tell(key, (record.epoch, record.number), where)
            case journal.JoinedRecord(enter=enter):
                self._entered[enter.module] += 1
            case journal.Compacted():
                self._compacted(keeper, record, where)
            case journal.KeptCommit(commit=moved):
                self._has[_Key(keeper, _COMMIT)] = self._moved(moved, where)

    def _compacted(self, keeper: int, record: journal.Compacted, where: Path) -> None:
        journal.check_kept(where, record.commits, self._recorded[keeper])
        self._has[_Key(keeper, _COMMIT)] = (record.commits,)
        self._entered.update(record.entered)
        for decision, owing in record.unsettled:
            for other in owing:
                key = _Key(other, _PREPARED, decision.module)
                self._tell(key, (decision.epoch, decision.number), where)

    def recorded(self) -> None:
        """Note that what has come so far is in the recording."""
        self._recorded = [len(commits.in_order) for commits in self._commits]

    def message(self, message: free_messages.FreeMessage, where: Path) -> None:
        """Note what a message in the recording says of the logs."""
        match message:
            case free_messages.Commit():
                self._moved(message, where)
            case free_messages.CommitLog(keeper=keeper, serial=serial, incarnation=incarnation):
                self._tell(_Key(keeper, _COMMIT), (serial,), where)
                self._tell(_Key(keeper, _OPENED), (incarnation,), where)
                for moved in message.parts:
                    self._moved(moved, where)
            case free_messages.Replies(parts=parts):
                for part in parts:
                    if isinstance(part, free_messages.Entered):
                        self._acted(part.occupant.module, part.occupant.epoch, where)
                    else:
                        self._committed(part, where)
            case _:
                pass

    def _attempted(self, keeper: int, attempt: free_messages.Attempt, where: Path) -> None:
        """Every keeper before this one in the chain has prepared it."""
        try:
            chain = chain_of(self._system, self._tiles, attempt)
        except InputError as error:
            raise InputError(f"{where}: {error}, expected one in the scene of the run") from None
        for other in chain:
            if other < keeper:
                key = _Key(other, _PREPARED, attempt.module)
                self._tell(key, (attempt.epoch, attempt.number), where)
        self._acted(attempt.module, attempt.epoch, where)

    def _committed(self, decision: free_messages.Decision, where: Path) -> _Number:
        return () if decision.commit is None else self._moved(decision.commit, where)

    def _moved(self, moved: free_messages.Commit, where: Path) -> _Number:
        if moved.keeper >= len(self._commits):
            raise InputError(f"{where}: has a commit of keeper_{moved.keeper}, which the run lacks")
        try:
            self._commits[moved.keeper].is_new(moved)
        except CheckError as error:
            raise InputError(f"{where}: {error} from what else is known of the run") from None
        self._tell(_Key(moved.keeper, _COMMIT), (moved.serial,), where)
        return (moved.serial,)

    def _acted(self, module: int, epoch: int, where: Path) -> None:
        """A module that acts in an epoch has joined that often."""
        if epoch > self._epochs.get(module, (0, where))[0]:
            self._epochs[module] = epoch, where

    def _log(self, key: _Key, *number: int) -> None:
        self._has[key] = max(self._has.get(key, ()), number)

    def _tell(self, key: _Key, number: _Number, where: Path) -> None:
        if number[-1] and number > self._numbers.get(key, ((), where))[0]:
            self._numbers[key] = number, where

    def check(self, incarnations: LogsInfo) -> None:
        """Check that the logs and their incarnations are complete; InputError if not."""
        for key, (incarnation, *_) in self._has.items():
            if (
                key.what == _OPENED
                and incarnation >= incarnations.incarnation + INCARNATIONS_OF_A_FLEET
            ):
                raise InputError(
                    f"{self._folder / INCARNATIONS}: the incarnation is"
                    f" {incarnations.incarnation}, expected a later one, as"
                    f" {log_of(self._folder, key.keeper)} was opened in incarnation {incarnation}:"
                    " it is older"
                )
        for key, (number, where) in self._numbers.items():
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
    incarnations = read_incarnations(folder) or LogsInfo(
        "", 0
    )  # without incarnations there are no logs
    known = _Known(folder, recording.scene, keepers)
    for record in recording.of_kind("commit", "commits", "replies"):
        known.message(free_messages.decode_free(record.data), recording.path)
    known.recorded()
    for keeper in range(keepers):
        path = log_of(folder, keeper)
        try:
            with path.open("rb") as file:
                for line in journal.read_log(path, file, incarnations.run, keeper):
                    known.record(keeper, line.record, path)
        except FileNotFoundError:
            continue  # its keeper may never have been started
        except OSError as error:
            raise InputError(
                f"{path}: {error.strerror or error}, expected a keeper's log"
            ) from None
    known.check(incarnations)


_LOCK = "lock"
"""The file in the folder of logs that is locked: no run writes to it."""
_LOCK_S_MAX, _POLL_S = 2.0, 0.05
"""How long the keepers of a run whose launcher was killed may take to end."""


def keeper_logs(recording: Path) -> Path:
    """Return the folder of the keepers' logs of a run with this recording."""
    return recording.with_name(recording.name + ".keepers")


def resumed(plan: Plan, path: Path) -> tuple[Plan, RunTask, Recording]:
    """Return plan and task of the run in a recording, and the recording.

    InputError if its keepers' logs are not there: a run that did not fail takes them away.
    """
    given = {"system": plan.system, "schedule": plan.schedule, "speed": plan.speeds}
    for key, value in given.items():
        if value:
            raise InputError(f"{key}: the run that is resumed has its own")
    recording = read_recording(path)
    parameters = recording.parameters
    if recording.clock != "free":
        raise InputError(
            f"{path}: a run in rounds, expected --round N, the first round of another rule; only a"
            " run without rounds is resumed where it ended"
        )
    if "schedule" in parameters:
        raise InputError(f"{path}: a run of a schedule, expected one of a rule")
    logs = file_within(path.parent, keeper_logs(path).name)
    if not logs.is_dir():
        if next(recording.of_kind("summary"), None) is not None:
            raise InputError(f"{path}: the run has come to its end, there is nothing to resume")
        raise _no_logs(logs)
    try:
        rule = permitted_rule(parameters["rule"], () if plan.rule is None else (plan.rule,))
        if plan.rule is not None and not is_in_file(rule):
            raise InputError("rule: the run that is resumed has its own")
        again = replace(
            plan,
            clock="free",
            seed=int(parameters["seed"]),
            hesitate=float(parameters["hesitate"]),
            processes=int(parameters.get("processes", plan.processes)),
            keepers=int(parameters["keepers"]),
            speeds=_speeds(parameters),
            jitter=float(parameters["jitter"]),
            on_crash=next(each for each in ON_CRASH if each == parameters["on_crash"]),
            log_time="wall" if parameters["log_time"] == "wall" else "level",
        )
        most = int(parameters["max_rounds"]) if plan.max_rounds is None else plan.max_rounds
        return again, RunTask(recording.scene, rule, most), recording
    except (KeyError, ValueError, StopIteration) as error:
        raise InputError(f"{path}: its parameters are not those of a run: {error!r}") from None


def locked_logs(folder: Path) -> BinaryIO:
    """Lock the folder of keepers' logs for one run; InputError if another has them.

    The lock is on a file in the folder, and stays with it when the folder is renamed.
    """
    deadline = time.monotonic() + _LOCK_S_MAX
    path = folder / _LOCK
    while True:
        try:
            lock = locked_file(path)
            if path.exists() and os.path.samestat(os.fstat(lock.fileno()), path.stat()):
                return lock
            lock.close()  # a run that took it up had just renamed the folder
        except BlockingIOError:
            if time.monotonic() >= deadline:
                raise InputError(
                    f"{folder}: a run is writing there, expected it to end first"
                ) from None
            time.sleep(_POLL_S)
        except FileNotFoundError:
            raise _no_logs(folder) from None
        except OSError as error:
            raise unwritable(path, error) from None


def _no_logs(folder: Path) -> InputError:
    return InputError(f"{folder}: not there, expected the logs of the run's keepers")


def _speeds(parameters: Mapping[str, str]) -> dict[int, float]:
    pairs = [pair.partition("=") for pair in parameters["speeds"].split(",") if pair]
    return {int(module): float(factor) for module, _, factor in pairs}


def is_on_wire(kind: str) -> bool:
    """Return whether a record of this kind was on the wire, and is not a result."""
    return kind in free_messages.FREE_KINDS or kind == "refused"
