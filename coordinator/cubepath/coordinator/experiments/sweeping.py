"""Playing a sweep: all runs that are not finished yet, with their rows kept as they arrive."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterable, Mapping, Sequence
from contextlib import ExitStack, closing
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from cubepath.coordinator.experiments.batch_runs import searched_again, searching
from cubepath.coordinator.experiments.folder import SweepFolder, read_rounds, read_runs, table_of
from cubepath.coordinator.experiments.rows import (
    FAILURES,
    RUN_COLUMNS,
    FinishedRun,
    Row,
    in_canonical_order,
)
from cubepath.coordinator.experiments.setting import FaultRates, RunBatch, run_id
from cubepath.coordinator.experiments.spec import Expansion, expand, is_small, sweep_of
from cubepath.coordinator.experiments.workers import Cluster, Pool, Workers, played_by, played_here
from cubepath.coordinator.progress import each_of, progress_bar
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.input_files import file_within
from cubepath.protocol.displays import Displayed

Watch = Callable[[Sequence[FinishedRun]], object]
"""Called with the runs that were just finished."""


@dataclass(frozen=True, slots=True)
class SweepResults(Displayed):
    """The rows of a sweep in canonical order, whatever the order in which they were finished.

    `rows` has a dict for each run, with the keys of `RUN_COLUMNS`. `left_out` says which
    combinations did not fit, `known` how many runs were finished before.
    """

    rows: tuple[Row, ...]
    left_out: tuple[str, ...] = ()
    known: int = 0
    folder: Path | None = None
    _rounds: tuple[Row, ...] | None = None

    @property
    def failures(self) -> list[Row]:
        """Return the rows of runs that failed by an error of code, died, or were prevented."""
        return [row for row in self.rows if row["ended"] in FAILURES]

    @property
    def rounds(self) -> list[Row]:
        """Return a row for each round of each run, with the keys of `ROUND_COLUMNS`."""
        place = {row["id"]: number for number, row in enumerate(self.rows)}
        rounds = self._rounds or ()
        if self._rounds is None and self.folder is not None:
            rounds = tuple(read_rounds(self.folder, place))
        return sorted(rounds, key=lambda row: (place[row["id"]], row["round"]))

    def table(self) -> Any:
        """Return the runs as a `pyarrow.Table`; InputError if pyarrow is not installed."""
        return table_of(self.rows, RUN_COLUMNS)


def sweep(
    systems: str | Path | Sequence[str],
    *,
    out: Path | str | None = None,
    jobs: int = 1,
    cluster: str | None = None,
    record: bool = False,
    watch: Watch | None = None,
    progress: bool = False,
    **options: object,
) -> SweepResults:
    """Play all systems with all rules, clocks, hesitations, faults and seeds; return the rows.

    `systems` are names with ranges and lists, or the path of a TOML file. The `options` are keys of
    such a file, as ``rules``, ``seeds`` or ``max_rounds`` (see `Sweep`), and replace what it says:
    each is one value or several, ``seeds`` a number of seeds, a text such as "5..9", or the seeds.
    Paths in the file are relative to ``data``, if that is given.

    With `out`, rows are written to that folder as Parquet as they come, and runs that are finished
    there are not played again; `record` keeps a recording of each run with messages there. `jobs`
    is the number of processes, 1 for this one alone (more need a program whose work is under
    ``if __name__ == "__main__":``); `cluster` is the address of a dask scheduler instead. `watch`
    is called with the runs that were just finished, and `progress` shows a bar of `tqdm`.

    A rule that ends its process ends this one, if it is played here; with `jobs` above 1, or a
    `timeout_s`, rules from elsewhere are played in other processes whatever there is to play.

    A run that fails is a row with its reason. InputError if something is unknown or nothing fits.

    >>> found = sweep("hex:n=4..5", rules=["chain", "random"], seeds=2, max_rounds=50)
    >>> for row in found.rows[::2]:
    ...     print(row["system"], row["rule"], row["rounds"], row["ended"])
    hex:n=4 chain 14 goal
    hex:n=4 random 50 max-rounds
    hex:n=5 chain 19 goal
    hex:n=5 random 50 max-rounds
    """
    table = {key: _plain(value) for key, value in options.items() if value is not None}
    names = [systems] if isinstance(systems, str | Path) else systems
    asked = sweep_of(list(map(str, names)), table)
    if jobs < 1:
        raise InputError(f"jobs: {jobs}, expected 1 or more")
    folder = None if out is None else Path(out)
    expansion = expand(asked)
    with progress_bar("sweep", " runs", expansion.runs, shown=progress) as bar:
        return play_sweep(
            expansion,
            folder,
            jobs=jobs,
            cluster=cluster,
            record=record,
            watch=each_of(watch, lambda runs: bar.update(len(runs))),
            apart=jobs > 1 and expansion.foreign,
            begin=bar.update,
        )


def _plain(value: object) -> object:
    """Return a value as it would come from a TOML file."""
    if isinstance(value, FaultRates | Path):
        return value.text() if isinstance(value, FaultRates) else str(value)
    if isinstance(value, str | Mapping) or not isinstance(value, Iterable):
        return value
    return [_plain(each) for each in value]


def play_sweep(
    expansion: Expansion,
    folder: Path | None,
    *,
    jobs: int,
    cluster: str | None,
    record: bool,
    watch: Watch,
    apart: bool = False,
    begin: Callable[[int], object] = lambda _: None,
) -> SweepResults:
    """Play what is not finished yet; `begin` gets the number of runs that were finished before.

    Runs with a limit of time, and with `apart` all of them, are played in other processes.
    """
    timeout_s = expansion.timeout_s
    if cluster is not None and timeout_s is not None:
        raise InputError("timeout_s: not on a cluster, expected processes of this machine")
    if record and folder is None:
        raise InputError("record: without a folder for the recordings, expected one")
    if record and any(_unrecorded(batch) for batch in expansion.batches):
        raise InputError(
            "record: the simulator keeps no recording of a run without rounds, expected core wire"
            " or clock lockstep"
        )
    with ExitStack() as stack:
        writing = None if folder is None else stack.enter_context(SweepFolder(folder))
        known = dict[str, str | None]()
        if writing is not None:
            known = writing.begin(expansion.batches, timeout_s, expansion.notes)
        recordings = None
        if record and folder is not None:
            recordings = file_within(folder, "recordings").absolute()
        left = [
            rest
            for batch in expansion.batches
            if (rest := _without(batch, known, recordings) if known else batch).seeds
        ]
        before = expansion.runs - sum(len(batch.seeds) for batch in left)
        begin(before)
        if writing is not None and before and searching(expansion.batches):
            earlier = results_of(expansion, writing.folder, before).rows
            writing.replace([*searched_again(expansion.batches, earlier)])
        kept: list[FinishedRun] = []
        apart = apart or timeout_s is not None
        with closing(_played(left, recordings, jobs, cluster, apart=apart)) as played:
            for found in played:
                if writing is None:
                    kept += found
                else:
                    writing.add(found)
                watch(found)
    if folder is not None:
        return results_of(expansion, folder, before)
    rows = in_canonical_order(each.run for each in kept)
    rounds = tuple(row for each in kept for row in each.round_rows())
    return SweepResults(tuple(rows), expansion.left_out, before, None, rounds)


def results_of(expansion: Expansion, folder: Path, known: int) -> SweepResults:
    """Return the rows that a folder has of the runs of a sweep, named as the sweep names them.

    Another one may have played the same scene or rule by another name, or from another folder.
    """
    found = read_runs(folder, all_versions=True)
    # What is planned may be much more than what is there.
    seeds = {row["seed"] for row in found}.intersection(expansion.seeds)
    names = {
        run_id(setting, seed, expansion.code): {"system": setting.label, "rule": setting.rule}
        for setting in expansion.settings
        for seed in seeds
    }
    rows = (row | names[row["id"]] for row in found if row["id"] in names)
    return SweepResults(tuple(in_canonical_order(rows)), expansion.left_out, known, folder)


def read_sweep(folder: Path | str) -> SweepResults:
    """Return the rows of all sweeps of a folder; of a run with several versions the last one.

    InputError if it is no folder of a sweep, or pyarrow is not installed.
    """
    path = Path(folder)
    rows = tuple(read_runs(path))
    return SweepResults(rows, known=len(rows), folder=path)


def _unrecorded(batch: RunBatch) -> bool:
    """Return whether runs have messages of which there is no recording."""
    return batch.setting.core == "simulated" and batch.setting.clock == "free"


def _without(batch: RunBatch, known: Mapping[str, str | None], recordings: Path | None) -> RunBatch:
    """Return the rest of a batch; where recordings are kept, also the runs that lack one."""
    kept = None if batch.setting.core == "compiled" else recordings

    def is_known(run: str) -> bool:
        if run not in known or kept is None:
            return run in known
        name = known[run]
        return name is not None and (not name or file_within(kept, name).is_file())

    pairs = zip(batch.seeds, batch.ids(), strict=True)
    return replace(batch, seeds=tuple(seed for seed, run in pairs if not is_known(run)))


def _played(
    batches: Sequence[RunBatch],
    recordings: Path | None,
    jobs: int,
    cluster: str | None,
    *,
    apart: bool,
) -> Generator[list[FinishedRun]]:
    workers: Workers | None = None
    if cluster is not None:
        workers = Cluster(cluster)
    elif apart:
        workers = Pool(max(1, min(jobs, len(batches))), "jobs=1 and no timeout_s")
    elif min(jobs, len(batches)) > 1 and not is_small(batches):
        workers = Pool(min(jobs, len(batches)))
    if workers is None or not batches:
        yield from played_here(batches, recordings)
    else:
        yield from played_by(workers, batches, recordings)
