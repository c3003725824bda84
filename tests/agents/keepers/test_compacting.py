"""Logs that are compacted: a keeper comes back from one as from the whole log."""

import resource
import subprocess
import sys
from collections.abc import Iterable
from functools import cache
from pathlib import Path
from random import Random

import pytest

from cubepath.agents.keepers import journal
from cubepath.agents.keepers.journal import (
    Acknowledged,
    FileJournal,
    Journal,
    MemoryJournal,
    Opened,
    Record,
)
from cubepath.agents.keepers.keeper import Keeper
from cubepath.protocol.core.errors import CheckError, InputError
from cubepath.protocol.wire.free_messages import CommitLog
from exploration.keeper_seats import _memory
from samples.free_runs import FreeRun


@cache
def _played(spec: str = "hex:n=5") -> FreeRun:
    """Return a run whose modules were started again."""
    run = FreeRun(spec, keepers=3, seed=1)
    run.play(40, restarts=3)
    return run


def _records(run: FreeRun, me: int = 0) -> tuple[Record, ...]:
    return tuple(run.keepers[me]._journal.records())


def _filled(records: Iterable[Record]) -> MemoryJournal:
    filled = MemoryJournal()
    for record in records:
        filled.append(record)
    return filled


def _back(run: FreeRun, log: Journal, me: int = 0, *, tell_reads: bool = False) -> Keeper:
    """Return a keeper that comes back from a log."""
    return Keeper(me, run.scene, run.tiles, log, tell_reads=tell_reads)


@pytest.mark.slow
@pytest.mark.few(1)
@pytest.mark.parametrize("tell_reads", [True, False])
@pytest.mark.parametrize("spec", ["hex:n=5", "agv:graph=grid6x6,n=6", "arm:n=5"])
def test_a_keeper_comes_back_from_a_compacted_log_as_from_the_whole(
    spec: str, *, tell_reads: bool
) -> None:
    """Compacted after any record, and again; it shows the same of its tiles."""
    run, random = _played(spec), Random(1)  # noqa: S311 - a seeded one
    for me in range(3):
        records, log = _records(run, me), MemoryJournal()
        for end, record in enumerate(records, 1):
            log.append(record)
            if end % 3:
                continue
            whole = _back(run, _filled(records[:end]), me, tell_reads=tell_reads)
            found = _back(run, log, me, tell_reads=tell_reads)
            assert _memory(found) == _memory(whole)
            assert (found._settled, found._entered) == (whole._settled, whole._entered)
            for tile in whole.units.serials:
                assert found.units.tile(tile) == whole.units.tile(tile)
            log.compact(found._compacted(random.randint(found._forgotten, found.commits)))
    assert sum(len(_records(run, me)) for me in range(3)) > 100


def test_what_was_acknowledged_last_is_kept() -> None:
    """In whatever order it came."""
    run = _played()
    records = _records(run, 2)
    settled = [each for each in records if isinstance(each, Acknowledged)]
    rest = [each for each in records if not isinstance(each, Acknowledged)]
    found = [_back(run, _filled((*rest, *some)), 2) for some in (settled, settled[::-1])]
    latest: dict[tuple[int, int], tuple[int, int]] = {}
    for each in settled:
        latest[each.keeper, each.module] = each.epoch, each.number
    assert len(latest) < len(settled)
    assert found[0]._settled == found[1]._settled == latest


def test_commits_are_forgotten_that_are_recorded(monkeypatch: pytest.MonkeyPatch) -> None:
    """Whatever is asked for then, a keeper answers with what it has."""
    run = _played()
    keeper = _back(run, _filled(_records(run)))
    count = keeper.commits
    monkeypatch.setattr(keeper._journal, "grown", True)
    for serial, recorded, first in ((2, 2, 3), (0, 1, 3), (4, 4, 5), (count, 99_999, count + 1)):
        keeper.fetch(serial, recorded)
        (answer,) = keeper.outgoing()
        assert isinstance(answer, CommitLog)
        assert answer.serial == count
        assert [each.serial for each in answer.parts] == [*range(first, count + 1)]


def _opened(incarnation: int = 1) -> Opened:
    return Opened("run", 0, incarnation)


def _written(path: Path) -> FileJournal:
    """Return a long log in a file, which is open."""
    log = FileJournal(path, _opened())
    for record in _records(_played()):
        log.append(record)
    return log


def test_a_log_that_has_grown_is_compacted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Commits are read from it before and after, and when it is opened again."""
    monkeypatch.setattr(journal, "_GROWN_BYTES", 10_000)
    path = tmp_path / "keeper_0.log"
    with _written(path) as log:
        keeper = _back(_played(), log)
        before, count = path.stat().st_size, keeper.commits
        kept = [log.commit(serial) for serial in range(4, count + 1)]
        keeper.fetch(3, 3)
        assert 2 * path.stat().st_size < before
        keeper.fetch(count, count)  # it has not grown since
        assert [log.commit(serial) for serial in range(4, count + 1)] == kept
    assert [*tmp_path.iterdir()] == [path]
    with FileJournal(path, _opened(2), commits=count) as again:
        assert [again.commit(serial) for serial in range(4, count + 1)] == kept
        assert _memory(_back(_played(), again)) == _memory(keeper)
    with pytest.raises(InputError, match=r"keeper_0\.log: begins after commit 3, and 2 were heard"):
        FileJournal(path, _opened(3), commits=2)


KILLED = """
import os, shutil, signal, sys
from itertools import count
from pathlib import Path
from cubepath.agents.keepers import journal
from cubepath.agents.keepers.keeper import Keeper
from cubepath.protocol.scenes.specs import scene_from_spec
from cubepath.protocol.wire.keys import Tiles

folder = Path(sys.argv[1])
scene = scene_from_spec("hex:n=5")
journal._GROWN_BYTES = 0
left = 0

def counted(name, holder):
    real = getattr(holder, name)
    def call(*arguments, **more):
        global left
        left -= 1
        if left == 0 and name == "write":
            real(arguments[0], arguments[1][:len(arguments[1]) // 2])
        if left == 0:
            os.kill(os.getpid(), signal.SIGKILL)
        return real(*arguments, **more)
    setattr(holder, name, call)

for step in count(1):
    here = folder / str(step)
    here.mkdir()
    path = shutil.copy(folder / "keeper_0.log", here)
    child = os.fork()
    if not child:
        log = journal.FileJournal(Path(path), journal.Opened("run", 0, 2))
        keeper = Keeper(0, scene, Tiles(scene.system, 3), log)
        for name, holder in (("write", os), ("open", os), ("replace", Path), ("unlink", Path)):
            counted(name, holder)
        left = step
        keeper.fetch(3, 3)
        os._exit(0)
    if os.waitpid(child, 0)[1] == 0:
        break
"""


@pytest.mark.slow
def test_a_crash_at_any_step_leaves_the_log_before_or_after(tmp_path: Path) -> None:
    """A process is killed at each call that changes a file, and once it has half written."""
    with _written(tmp_path / "keeper_0.log") as log:
        keeper = _back(_played(), log)
    subprocess.run([sys.executable, "-c", KILLED, str(tmp_path)], check=True, timeout=120)
    steps = len([*tmp_path.iterdir()]) - 1
    lengths = set()
    for step in range(1, steps + 1):
        path = tmp_path / str(step) / "keeper_0.log"
        lengths.add(len(path.read_bytes().splitlines()))
        with FileJournal(path, _opened(3), commits=keeper.commits) as log:
            back = _back(_played(), log)
            assert _memory(back) == _memory(keeper)
            back.fetch(3, 3)
            (answer,) = back.outgoing()
            assert isinstance(answer, CommitLog)
            assert len(answer.parts) == keeper.commits - 3
            log.compact(back._compacted(3))  # whatever the one before has left
        assert [*path.parent.iterdir()] == [path]
    assert steps > 20
    assert len(lengths) == 2


def test_a_full_disk_leaves_the_log_as_it_was(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It is continued, and compacted when it has doubled."""
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    path = tmp_path / "keeper_0.log"
    with _written(path) as log:
        keeper, before = _back(_played(), log), path.read_bytes()
        soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
        resource.setrlimit(resource.RLIMIT_FSIZE, (4000, hard))
        try:
            log.compact(keeper._compacted(3))
            with pytest.raises(CheckError, match="log of the keeper stopped: File too large"):
                log.append(_records(_played())[0])
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
        assert [*tmp_path.iterdir()] == [path]
        assert path.read_bytes() == before
        assert log.commit(1).serial == 1
        log.compact(keeper._compacted(3))
        assert _memory(_back(_played(), log)) == _memory(keeper)
        assert len(path.read_bytes()) < len(before)
