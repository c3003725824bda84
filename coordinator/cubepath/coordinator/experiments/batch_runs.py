"""Playing one run in a worker: its time limit, its result, and what is known of its scene.

The limit is in time of this machine, and decides only whether there is a result: a run over its
limit becomes a row with that reason. Only interrupts are raised; any other failure of a run becomes
a row too. A worker may live for long while files change, so it checks that it plays what was asked
for. The facts about a scene are added to the rows after its runs were played.
"""

import contextlib
import faulthandler
import json
import os
import signal
import sys
import threading
import time
from collections.abc import Iterable, Iterator
from dataclasses import replace
from errno import EDQUOT, EMFILE, ENFILE, ENOMEM, ENOSPC
from pathlib import Path
from types import FrameType

from cubepath.agents.rules.registry import forget_rule_files
from cubepath.coordinator.experiments.compiled_core import play_compiled
from cubepath.coordinator.experiments.instances import SceneFacts, facts_of, forget_facts
from cubepath.coordinator.experiments.outcomes import (
    ERROR,
    PlayedRun,
    failed,
    finished,
    scene_columns,
)
from cubepath.coordinator.experiments.rows import AGAIN, PREVENTED, TIMEOUT, FinishedRun, Row
from cubepath.coordinator.experiments.setting import (
    RunBatch,
    RunSetting,
    code_version,
    scene_hash,
    source_hash,
)
from cubepath.coordinator.experiments.wire_core import play_on_wire, play_simulated
from cubepath.protocol.core.errors import CubepathError, InputError
from cubepath.protocol.scenes.specs import scene_from_spec

GRACE_S = 5.0
"""A run that ignores interrupts for this long is killed with its process."""
_AGAIN_S = 1.0
"""A run that continues is interrupted again after so long: a rule may catch whatever is raised."""


class OverTimeError(BaseException):
    """A run is over its limit; no error of code, so that nobody takes it for one."""


class TimeLimit:
    """Seconds of this machine, in the main thread of a worker; None for no limit.

    A run that exceeds it meets `OverTimeError`; a run in separate processes is told to end, as by
    an interrupt. Code that never comes back to Python, as in a compiled loop, meets nothing: there
    the process ends, and the executor that handed out the run notices.
    """

    def __init__(self, seconds: float | None, *, processes: bool) -> None:
        """Take the limit, and whether what is limited is in separate processes."""
        self.seconds = seconds
        self.over = False
        self._processes = processes
        self._on = False

    def begin(self) -> None:
        """Begin to count."""
        if self.seconds is None:
            return
        self._on = True
        self._before = signal.signal(signal.SIGALRM, self._interrupt)
        # This one asks nobody: it needs neither the interpreter nor its lock.
        with Path(os.devnull).open("wb") as nowhere:
            self._nowhere = os.dup(nowhere.fileno())
        faulthandler.dump_traceback_later(self.seconds + GRACE_S, exit=True, file=self._nowhere)
        signal.setitimer(signal.ITIMER_REAL, self.seconds, _AGAIN_S)

    def end(self) -> None:
        """Count no more; a run that is late is let through."""
        if self._on:
            self._on = False
            signal.setitimer(signal.ITIMER_REAL, 0)
            faulthandler.cancel_dump_traceback_later()
            os.close(self._nowhere)
            signal.signal(signal.SIGALRM, self._before)

    def _interrupt(self, _number: int, _frame: FrameType | None) -> None:
        if not self._on:
            return
        self.over = True
        if self._processes:
            signal.raise_signal(signal.SIGINT)  # which ends them, and is ignored before and after
        else:
            raise OverTimeError


def over_limit(seconds: float) -> str:
    """Return the reason of a run that was over its limit."""
    return f"over its limit of {seconds:g} s"


_alone = threading.RLock()
"""Held while a batch is played: a worker of a cluster may have several threads."""


_MACHINE = (MemoryError.__name__, *map(os.strerror, (ENOSPC, EDQUOT, ENOMEM, EMFILE, ENFILE)))
"""What a node of a run says if the machine has no more of something."""


class _PreventedError(Exception):
    """Runs cannot be played here; the text says why."""


def play_batch(batch: RunBatch, recordings: Path | None = None) -> list[FinishedRun]:
    """Play the runs of a batch and return their rows, in the order of the seeds.

    With a folder for `recordings`, each run with messages leaves one there, named by its id. A run
    that fails by an error of code, of the rule for one, has a row with the reason. So has one that
    is prevented: cubepath, the scene or the rule are not here what they are to be, or the machine
    has no more memory or space. What was loaded of files that have changed since is loaded again.

    With a limit of time this is the main thread of a worker, which may end with a run that is over
    it; seeds that are played side by side have it together first, and then each by itself.
    """
    if len(batch.seeds) > 1 and batch.timeout_s is not None and batch.setting.core != "compiled":
        return _each_alone(batch, recordings)
    limit = TimeLimit(batch.timeout_s, processes=batch.setting.core == "wire")
    checked = False
    # A rule that prints would print into the answer of a command.
    with _alone, contextlib.redirect_stdout(sys.stderr):
        began = time.monotonic()
        try:
            limit.begin()
            _check(batch)
            checked = True
            return [
                _ended(finished(batch, seed, played))
                for seed, played in zip(batch.seeds, _played(batch, recordings), strict=True)
            ]
        except _PreventedError as error:
            return [_prevented(batch, seed, str(error)) for seed in batch.seeds]
        except (Exception, OverTimeError, KeyboardInterrupt) as error:
            # A rule, or a system, may raise anything, and what is over its time may, too.
            if isinstance(error, KeyboardInterrupt) and not limit.over:
                raise
            if len(batch.seeds) == 1 and limit.over:
                return [late(batch, time.monotonic() - began, known=checked)]
            if len(batch.seeds) == 1:
                ended = PREVENTED if _of_the_machine(error) else ERROR
                seconds = time.monotonic() - began
                return [failed(batch, batch.seeds[0], ended, _error_text(error), seconds)]
        finally:
            limit.end()
    # One of them has failed, and which one is found by playing each alone.
    return _each_alone(batch, recordings)


def _each_alone(batch: RunBatch, recordings: Path | None) -> list[FinishedRun]:
    each = [play_batch(replace(batch, seeds=(seed,)), recordings) for seed in batch.seeds]
    return [row for rows in each for row in rows]


def late(batch: RunBatch, seconds: float, *, known: bool, more: str = "") -> FinishedRun:
    """Return the row of the one run of a batch, which was over its limit of time."""
    timeout_s = batch.timeout_s or 0.0
    reason = over_limit(timeout_s) + more
    took = max(seconds, timeout_s)
    return failed(batch, batch.seeds[0], TIMEOUT, reason, took, known=known)


def _error_text(error: BaseException) -> str:
    return str(error) if isinstance(error, CubepathError) else f"{type(error).__name__}: {error}"


def _of_the_machine(error: BaseException | None) -> bool:
    """Return whether an error is due to a file or to memory, and not to the rule."""
    while error is not None:
        if isinstance(error, OSError | MemoryError):
            return True
        error = error.__cause__ or error.__context__
    return False


def _ended(run: FinishedRun) -> FinishedRun:
    """Return a run; one whose processes had no more of something was prevented."""
    row = run.run
    if row["ended"] == ERROR and any(text in (row["reason"] or "") for text in _MACHINE):
        row["ended"] = PREVENTED
    return run


def _prevented(batch: RunBatch, seed: int, why: str) -> FinishedRun:
    """Return the row of a run that cannot be played here, where its scene may be another."""
    found = failed(batch, seed, PREVENTED, why)
    found.run.update(family="", modules=None, best_known=batch.setting.best_known)
    return found


def loaded_facts(setting: RunSetting, *, optimum: int, improve: int) -> SceneFacts:
    """Return what these searches find in the scene of a setting, as its file is now.

    InputError if that is not the scene that was asked for.
    """
    with _alone, contextlib.redirect_stdout(sys.stderr):
        facts = facts_of(setting.system, optimum, improve)
        if facts.hashed != setting.scene:
            forget_facts()
            facts = facts_of(setting.system, optimum, improve)
        if facts.hashed != setting.scene:
            raise InputError(f"{setting.system}: was changed while the sweep began")
    return facts


def _check(batch: RunBatch) -> None:
    """Raise an error if cubepath, the scene or the rule are not those of the batch."""
    if code_version() != batch.code:
        raise _PreventedError(f"this process has cubepath {code_version()}, expected {batch.code}")
    if _other(batch.setting) is None:
        return
    forget_facts()
    forget_rule_files()
    why = _other(batch.setting)
    if why is not None:
        raise _PreventedError(why)


def _other(setting: RunSetting) -> str | None:
    """Return which of the scene and the rule is not loaded as it is to be, in a line, or None."""
    try:
        found = facts_of(setting.system, setting.optimum, setting.improve).hashed
    except CubepathError:
        found = _read_again(setting)  # or else it is the search that fails
    if found != setting.scene:
        return f"{setting.system}: is not here what it was where the sweep began"
    try:
        source = source_hash(setting.rule)
    except (CubepathError, OSError) as error:
        return _error_text(error)
    if source != setting.source:
        return f"rule {setting.rule}: is not here what it was where the sweep began"
    return None


def _read_again(setting: RunSetting) -> str:
    """Return the hash of the scene as it is now."""
    try:
        return scene_hash(scene_from_spec(setting.system))
    except CubepathError as error:
        raise _PreventedError(_error_text(error)) from None


def _check_again(setting: RunSetting) -> None:
    """Raise an error if the files of a run have changed that its nodes read for themselves."""
    if setting.core == "wire":
        forget_rule_files()
    if _read_again(setting) != setting.scene or _other(setting) is not None:
        raise _PreventedError("its files were changed while it was played")


def _played(batch: RunBatch, recordings: Path | None) -> Iterator[PlayedRun]:
    setting = batch.setting
    facts = facts_of(setting.system, setting.optimum, setting.improve)
    if setting.core == "compiled":
        yield from play_compiled(setting, facts, batch.seeds)
        return
    play = play_simulated if setting.core == "simulated" else play_on_wire
    for seed, name in zip(batch.seeds, batch.ids(), strict=True):
        log = None if recordings is None else recordings / f"{name}.mcap"
        if log is not None:
            log.unlink(missing_ok=True)  # of a run that was cut off
        played = play(setting, facts, seed, log)
        _check_again(setting)
        yield played


_SEARCHES = ("optimum", "improve")


def searching(batches: Iterable[RunBatch]) -> bool:
    """Return whether anything is searched for in scenes."""
    return any(getattr(batch.setting, name) for batch in batches for name in _SEARCHES)


def searched_again(batches: Iterable[RunBatch], rows: Iterable[Row]) -> Iterator[Row]:
    """Yield the rows of known runs for whose scenes more is searched now, with what is found.

    A row is as that of a run which is played with these searches, and keeps what was known.
    """
    known = {row["id"]: row for row in rows if row["ended"] not in AGAIN}
    for batch in batches:
        asked = {name: getattr(batch.setting, name) for name in _SEARCHES}
        for row in (known[each] for each in batch.ids() if each in known):
            configured = json.loads(row["configuration"])
            if all(asked[name] <= configured[name] for name in _SEARCHES):
                continue
            more = {name: max(asked[name], configured[name]) for name in _SEARCHES}
            facts = loaded_facts(batch.setting, **more)
            configuration = json.dumps(configured | more, sort_keys=True)
            yield row | scene_columns(row, facts) | {"configuration": configuration}
