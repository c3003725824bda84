"""One batch of runs, played in the core that its setting names; what a worker does.

Room: coordinator. Nothing is raised but interrupts: what goes wrong in a run is a row of its own.
"""

from __future__ import annotations

import contextlib
import sys
import threading
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from cubepath.coordinator.experiments.compiled_core import play_compiled
from cubepath.coordinator.experiments.outcomes import ERROR, PlayedRun, failed, finished
from cubepath.coordinator.experiments.rows import Finished
from cubepath.coordinator.experiments.scene_facts import facts_of
from cubepath.coordinator.experiments.setting import Batch, code_version
from cubepath.coordinator.experiments.simulated_core import play_simulated
from cubepath.coordinator.experiments.wire_core import play_on_wire
from cubepath.protocol.core.errors import CubepathError

_alone = threading.RLock()
"""Held while a batch is played: a worker of a cluster may have several threads."""


def play_batch(batch: Batch, recordings: Path | None = None) -> list[Finished]:
    """Play the runs of a batch and return their rows, in the order of the seeds.

    With a folder for `recordings`, each run with messages leaves one there, named by its id. A run
    that fails by an error of code, of the rule for one, has a row with the reason.
    """
    if code_version() != batch.code:
        why = f"this process has cubepath {code_version()}, expected {batch.code}"
        return [failed(batch, seed, ERROR, why) for seed in batch.seeds]
    # A rule that prints would print into the answer of a command.
    with _alone, contextlib.redirect_stdout(sys.stderr):
        began = time.monotonic()
        try:
            return [
                finished(batch, seed, played)
                for seed, played in zip(batch.seeds, _played(batch, recordings), strict=True)
            ]
        except Exception as error:  # noqa: BLE001 - a rule, or a system, may raise anything
            if len(batch.seeds) == 1:
                seconds = time.monotonic() - began
                return [failed(batch, batch.seeds[0], ERROR, _told(error), seconds)]
    # One of them has failed, and which one is found by playing each alone.
    each = [play_batch(replace(batch, seeds=(seed,)), recordings) for seed in batch.seeds]
    return [row for rows in each for row in rows]


def _told(error: Exception) -> str:
    return str(error) if isinstance(error, CubepathError) else f"{type(error).__name__}: {error}"


def _played(batch: Batch, recordings: Path | None) -> Iterator[PlayedRun]:
    setting = batch.setting
    facts = facts_of(setting.system, setting.optimum)
    if setting.core == "compiled":
        yield from play_compiled(setting, facts, batch.seeds)
        return
    play = play_simulated if setting.core == "simulated" else play_on_wire
    for seed, name in zip(batch.seeds, batch.ids(), strict=True):
        log = None if recordings is None else recordings / f"{name}.mcap"
        yield play(setting, facts, seed, log)
