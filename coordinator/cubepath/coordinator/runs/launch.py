"""Runs by name or by plan: to the end in one call, or begun and then stepped."""

from pathlib import Path
from typing import Unpack

from cubepath.agents.processes.network import Way, straight
from cubepath.coordinator.progress import each_of, progress_bar, showing_run
from cubepath.coordinator.runs.driver import Say
from cubepath.coordinator.runs.listeners import Watch
from cubepath.coordinator.runs.outcome import Outcome
from cubepath.coordinator.runs.plan import Plan, PlanOptions, plan_of
from cubepath.coordinator.runs.run import Run
from cubepath.protocol.core.system import Scene


def run(
    what: Plan | str | Path | Scene | None = None,
    rule: str | None = None,
    *,
    watch: Watch | None = None,
    say: Say | None = None,
    progress: bool = False,
    **options: Unpack[PlanOptions],
) -> Outcome:
    """Run a system in processes to its end, and return the outcome.

    `what` is a system as the command line names it, a scene, or a whole `Plan`; `rule` is a name or
    ``FILE.py:NAME``, and None means the rule of the system's family. The options are the fields of
    `Plan`. `watch` is called after each round. `say` gets a line with the address where others can
    join, and with whom the run waits for. `progress` shows a bar of `tqdm`.

    InputError if that cannot be run at all; everything that goes wrong later (a process that dies,
    a rule that gives up, a full disk, an interrupt) is part of the outcome.

    >>> outcome = run("hex:n=4", seed=1, processes=0, log="logs/four.mcap")
    >>> outcome.goal_reached, outcome.rounds, outcome.cubes, len(outcome.path)
    (True, 14, 14, 18)
    """
    plan = plan_of(what, rule, options)
    free = plan.is_free or plan.resume is not None
    with progress_bar("run", " moves" if free else " rounds", shown=progress) as bar:
        told = each_of(watch, showing_run(bar, free=free)) if progress else watch
        return Run(plan, watch=told, say=say).play_from_the_start()


def start(
    what: Plan | str | Path | Scene | None = None,
    rule: str | None = None,
    *,
    watch: Watch | None = None,
    say: Say | None = None,
    way: Way = straight,
    **options: Unpack[PlanOptions],
) -> Run:
    """Return a run to be stepped, watched, tapped, asked and stopped, as a context manager.

    The arguments are those of `run`. Processes take the `way` to the router, which a test can lay
    through its own link. InputError as for `run`, CheckError if the processes do not start.

    >>> with start("hex:n=4", processes=2, log="logs/stepped.mcap") as running:
    ...     claims = running.tap("claim")
    ...     running.step(3)
    ...     len(claims), running.status.moves
    ...     running.until(lambda run: run.gathered.moves >= 10)
    True
    (12, 3)
    >>> running.outcome.ended
    'interrupted'
    """
    return Run(plan_of(what, rule, options), watch=watch, say=say, way=way)
