"""Change the source here and there, and see whether the tests notice.

With cubepath installed: ``python tests/mutation.py [--sample 300] [--seed 1] [-n 1]
[--only FILE] [--seeds N]``, or ``--fixed``.

A sample of mutants, the same for the same seed, is drawn from the files of `MIRRORED`. Each is run
against the tests that mirror its file: those that are fast, and where they notice nothing the slow
ones. What survives is listed with its file, line and change: a test is missing, or the mutant is
equivalent. Modules compiled by numba are not among the files. Exit code 1 where less than 95% of
the sample is found, 2 where the tests fail on the source as it is.

With ``--fixed`` the mutants are those of ``fixed_mutants.json`` instead of a sample, each named by
its function and what is changed into what, in whichever file that stands. So two states of the
source can be compared: what was found before and is not now, or has no place any more, is listed,
and then the exit code is 1.

With ``--seeds N`` the files are those of `SIMULATED`. Before the tests the simulator runs its seeds
from 0 on, N at most, until one fails; the report says how many that took.
"""

import argparse
import os
import signal
import sys
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from random import Random
from statistics import mean, median

import msgspec

from cubepath.coordinator.commands.console import (
    BAD_INPUT,
    DONE,
    FAILED,
    INTERRUPTED,
    complain,
    progress_bar,
)
from cubepath.coordinator.commands.usage import whole
from mutants import ROOT, Trial, Verdict, mutations_of, run_trials

_VERIFICATION = "coordinator/cubepath/coordinator/verification"
_LOCAL = "agents/cubepath/agents/local"
_PROCESSES = "agents/cubepath/agents/processes"
_KEEPERS = "agents/cubepath/agents/keepers"
_FREE = "agents/cubepath/agents/free"
_RUNS = "coordinator/cubepath/coordinator/runs"
_EXHAUSTIVE = "tests/agents/processes/test_exhaustive.py"
_KEPT = (
    "tests/agents/keepers/test_keeper.py",
    "tests/agents/keepers/test_attempts.py",
    "tests/agents/keepers/test_units.py",
    "tests/agents/keepers/test_keeper_exploration.py",
    "tests/agents/keepers/test_keeper_in_any_order.py",
)
_RECORDED = ("tests/coordinator/verification/test_recording.py",)
MIRRORED: dict[str, tuple[str, ...]] = {
    "protocol/cubepath/protocol/core/actions.py": ("tests/protocol/core/test_actions.py",),
    "protocol/cubepath/protocol/core/catalogue.py": ("tests/protocol/core/test_catalogue.py",),
    "protocol/cubepath/protocol/recordings/salvaging.py": (
        "tests/protocol/recordings/test_salvaging.py",
    ),
    f"{_LOCAL}/observation.py": ("tests/agents/local/test_observation.py",),
    f"{_LOCAL}/arbitration.py": (
        "tests/agents/local/test_arbitration.py",
        "tests/agents/local/test_module.py",
    ),
    f"{_LOCAL}/module.py": ("tests/agents/local/test_module.py", _EXHAUSTIVE),
    f"{_PROCESSES}/dealing.py": ("tests/agents/processes/test_dealing.py",),
    f"{_PROCESSES}/judge.py": (
        "tests/agents/processes/test_judge.py",
        "tests/agents/processes/test_refusals.py",
    ),
    f"{_PROCESSES}/mailbox.py": ("tests/agents/processes/test_mailbox.py", _EXHAUSTIVE),
    f"{_PROCESSES}/node.py": ("tests/agents/processes/test_node.py", _EXHAUSTIVE),
    f"{_PROCESSES}/pacer.py": ("tests/agents/processes/test_pacer.py", _EXHAUSTIVE),
    f"{_PROCESSES}/settling.py": ("tests/agents/processes/test_settling.py",),
    f"{_KEEPERS}/attempts.py": _KEPT,
    f"{_KEEPERS}/journal.py": (
        "tests/agents/keepers/test_journal.py",
        "tests/agents/keepers/test_compacting.py",
        _KEPT[0],
    ),
    f"{_KEEPERS}/keeper.py": (
        *_KEPT[:2],
        "tests/agents/keepers/test_compacting.py",
        "tests/agents/keepers/test_keeper_node.py",
        *_KEPT[2:],
    ),
    f"{_KEEPERS}/units.py": _KEPT,
    f"{_FREE}/mover.py": ("tests/agents/free/test_mover.py",),
    f"{_FREE}/sensing.py": ("tests/agents/free/test_sensing.py",),
    f"{_RUNS}/gatherer.py": (
        "tests/coordinator/runs/test_gatherer.py",
        "tests/coordinator/runs/test_plausibility.py",
        _EXHAUSTIVE,
    ),
    f"{_RUNS}/conductor.py": (
        "tests/coordinator/runs/test_conductor.py",
        "tests/coordinator/runs/test_schedule.py",
        _EXHAUSTIVE,
    ),
    "coordinator/cubepath/coordinator/normal_form/heap.py": (
        "tests/coordinator/normal_form/test_heap.py",
    ),
    "coordinator/cubepath/coordinator/theory/search/lower_bounds.py": (
        "tests/coordinator/theory/search/test_lower_bounds.py",
    ),
    f"{_VERIFICATION}/certificate.py": (
        "tests/coordinator/verification/test_certificate.py",
        "tests/coordinator/shortening/test_explain.py",
        *_RECORDED,
    ),
    f"{_VERIFICATION}/proof.py": (
        "tests/coordinator/verification/test_proof.py",
        "tests/coordinator/normal_form/test_certificate.py",
    ),
    f"{_VERIFICATION}/lockstep.py": _RECORDED,
    f"{_VERIFICATION}/results.py": _RECORDED,
    f"{_VERIFICATION}/rounds.py": _RECORDED,
    f"{_VERIFICATION}/ending.py": (
        "tests/coordinator/verification/test_ending.py",
        "tests/coordinator/verification/test_schedule.py",
        *_RECORDED,
    ),
    f"{_VERIFICATION}/transcript.py": _RECORDED,
}
"""The files that are changed, each with the tests that are to notice."""
SIMULATED = (
    f"{_LOCAL}/arbitration.py",
    f"{_LOCAL}/module.py",
    f"{_PROCESSES}/dealing.py",
    f"{_PROCESSES}/judge.py",
    f"{_PROCESSES}/mailbox.py",
    f"{_PROCESSES}/node.py",
    f"{_PROCESSES}/pacer.py",
    f"{_PROCESSES}/settling.py",
    f"{_RUNS}/gatherer.py",
    f"{_RUNS}/conductor.py",
    f"{_KEEPERS}/attempts.py",
    f"{_KEEPERS}/keeper.py",
    f"{_KEEPERS}/node.py",
    f"{_KEEPERS}/units.py",
    f"{_FREE}/host_node.py",
    f"{_FREE}/mover.py",
    f"{_FREE}/sensing.py",
)
"""The files of a simulated run that are changed with ``--seeds``."""
FOUND_LEAST = 0.95
SECONDS_LEAST = 10.0
"""The least processor time that a mutant gets; otherwise thrice that of the source as it is."""
BASELINE_SECONDS = 600.0
FIXED = Path(__file__).with_name("fixed_mutants.json")
_Mutant = tuple[str, int]
"""A file, and which of its mutations is made."""


class Fixed(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A mutant that is the same wherever its function stands."""

    function: str
    before: str
    after: str
    found: bool | None
    """Whether it was found before; None where nobody has tried."""

    def __str__(self) -> str:
        return f"{self.function}: {self.before}  ->  {self.after}"


@dataclass(frozen=True, slots=True)
class _Stage:
    """What is tried on all mutants that are left: seeds of the simulator, or tests of a kind."""

    name: str
    slow: bool = False
    seeds: int = 0

    def trial(self, file: str, number: int | None, seconds: float) -> Trial:
        return Trial(file, number, MIRRORED[file], self.slow, seconds, self.seeds)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a sample of mutants and print the report."""
    options = _parser().parse_args(arguments)
    fixed = located(fixed_mutants()) if options.fixed else {}
    sample = sorted(fixed) if options.fixed else _sample(options)
    stages = [_Stage("fast tests"), _Stage("slow tests", slow=True)]
    if options.seeds:
        stages.insert(0, _Stage("seeds", seeds=options.seeds))
    left, seeds = sample, dict[_Mutant, int]()
    for stage in stages if sample else ():
        seconds = _seconds_as_it_is(sorted({file for file, _ in left}), options.n, stage)
        if seconds is None:
            return BAD_INPUT
        found = _found(left, seconds, options.n, stage)
        left = [mutant for mutant in left if mutant not in found]
        if stage.seeds:
            seeds = {mutant: verdict.seeds for mutant, verdict in found.items()}
    print(_report(sample, left, seeds if options.seeds else None))
    if options.fixed:
        worse = _worse(fixed, left)
        print("\n".join([*worse, f"{len(worse)} of {len(fixed_mutants())} worse than before"]))
        return FAILED if worse else DONE
    return DONE if len(left) <= (1 - FOUND_LEAST) * len(sample) else FAILED


def _sample(options: argparse.Namespace) -> list[_Mutant]:
    files = [options.only] if options.only else list(SIMULATED if options.seeds else MIRRORED)
    every = [(file, number) for file in files for number in range(len(mutations_of(file)))]
    count = min(options.sample, len(every))
    return sorted(Random(options.seed).sample(every, count))  # noqa: S311 - to be repeated


def fixed_mutants() -> list[Fixed]:
    """Return the mutants of the fixed list."""
    return msgspec.json.decode(FIXED.read_bytes(), type=list[Fixed])


def located(wanted: Iterable[Fixed]) -> dict[_Mutant, Fixed]:
    """Return where the mutants are among the files of `MIRRORED`: those that are at one place."""
    places: dict[tuple[str, str, str], list[_Mutant]] = {}
    for file in MIRRORED:
        for number, each in enumerate(mutations_of(file)):
            key = each.function, each.before, each.after
            places.setdefault(key, []).append((file, number))
    found = ((each, places.get((each.function, each.before, each.after), [])) for each in wanted)
    return {at[0]: each for each, at in found if len(at) == 1}


def _worse(fixed: Mapping[_Mutant, Fixed], left: Sequence[_Mutant]) -> list[str]:
    """Return which mutants of the fixed list were found before, and are not now."""
    there = set(fixed.values())
    gone = [f"not at one place: {each}" for each in fixed_mutants() if each not in there]
    survived = (fixed[mutant] for mutant in left)
    return [*gone, *(f"was found before: {each}" for each in survived if each.found)]


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(description="Change the source, and see if tests notice.")
    parser.add_argument("--sample", type=int, default=300, help="how many mutants (default 300)")
    parser.add_argument("--seed", type=int, default=1, help="which sample (default 1)")
    parser.add_argument("-n", type=int, default=1, help="how many processes (default 1)")
    which = parser.add_mutually_exclusive_group()
    which.add_argument("--only", choices=MIRRORED, metavar="FILE", help="mutants of this file")
    which.add_argument("--fixed", action="store_true", help=f"those of {FIXED.name}, no sample")
    parser.add_argument(
        "--seeds", type=whole(1), metavar="N", help="run so many seeds of the simulator first"
    )
    return parser


def _seconds_as_it_is(
    files: Sequence[str], processes: int, stage: _Stage
) -> dict[str, float] | None:
    """Return the processor time of a stage for each file, of those that have any such tests.

    None, with a complaint, where something fails.
    """
    found: dict[str, float] = {}
    tried = files[:1] if stage.seeds else files  # seeds are the same for all files
    trials = [stage.trial(file, None, BASELINE_SECONDS) for file in tried]
    for trial, verdict in _shown(trials, processes, f"{stage.name} as they are"):
        if not verdict.passed:
            what = "seeds of the simulator" if stage.seeds else " ".join(trial.tests)
            complain(f"{what}: they fail on the source as it is, expected not")
            complain(verdict.output)
            return None
        if not verdict.empty:
            found[trial.file] = verdict.seconds
    return dict.fromkeys(files, found[tried[0]]) if stage.seeds else found


def _found(
    mutants: Sequence[_Mutant], seconds: dict[str, float], processes: int, stage: _Stage
) -> dict[_Mutant, Verdict]:
    """Return the mutants that are noticed."""
    trials = [
        stage.trial(file, number, max(SECONDS_LEAST, 3 * seconds[file]))
        for file, number in mutants
        if file in seconds
    ]
    return {
        (trial.file, trial.number): verdict
        for trial, verdict in _shown(trials, processes, f"{stage.name} of mutants")
        if not verdict.passed and trial.number is not None
    }


def _shown(trials: Sequence[Trial], processes: int, what: str) -> Iterable[tuple[Trial, Verdict]]:
    """Yield what comes of the trials, under a progress bar."""
    with progress_bar(len(trials), what, " trials") as bar:
        for trial, verdict in run_trials(trials, processes):
            bar.update()
            yield trial, verdict


def _report(
    sample: Sequence[_Mutant], left: Sequence[_Mutant], seeds: dict[_Mutant, int] | None
) -> str:
    """Return how many were found by file, after how many seeds, and each survivor in a line."""
    drawn, survived = Counter(file for file, _ in sample), Counter(file for file, _ in left)
    lines = []
    for file, count in drawn.items():
        found = count - survived[file]
        line = f"{found:4} of {count:4} found  {file}"
        if seeds is not None:
            took = [number for (one, _), number in seeds.items() if one == file]
            often = f" (mean {mean(took):.1f}, median {median(took):g})" if took else ""
            line += f": {len(took)} by seeds{often}, {found - len(took)} by tests only"
        lines.append(line)
    for file, number in left:
        change = mutations_of(file)[number]
        lines.append(f"{file}:{change.line}: {change.before}  ->  {change.after}")
    found = len(sample) - len(left)
    share = found / len(sample) if sample else 1
    return "\n".join([*lines, f"{found} of {len(sample)} mutants found, {share:.1%}"])


def _ended(number: int, frame: object) -> None:
    """End as after an interrupt, so that no mutant is left running."""
    del number, frame
    raise KeyboardInterrupt


if __name__ == "__main__":
    if os.environ.get("PYTHONHASHSEED") != "0":  # the order of sets is the same each time
        environment = {**os.environ, "PYTHONHASHSEED": "0"}
        os.execve(sys.executable, [sys.executable, *sys.argv], environment)  # noqa: S606 - this one
    os.chdir(ROOT)
    signal.signal(signal.SIGTERM, _ended)
    try:
        sys.exit(main())
    except KeyboardInterrupt:
        complain("interrupted")
        sys.exit(INTERRUPTED)
