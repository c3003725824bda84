"""The conductor: when a run ends, how, and what it says of a schedule that stopped."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Literal

import pytest

from cubepath.coordinator.runs.conductor import Conductor, RunEnd
from cubepath.coordinator.runs.schedule import Assignment
from cubepath.protocol.core.catalogue import GeneratorPlacement
from cubepath.protocol.core.system import Scene
from cubepath.protocol.scenes.specs import scene_from_spec
from cubepath.protocol.wire.messages import (
    Certified,
    Cube,
    Edges,
    Message,
    Ready,
    Report,
    Reports,
    Stopped,
    Summary,
)

THERE, FURTHER = GeneratorPlacement("edge", (0, 1)), GeneratorPlacement("edge", (1, 2))


def scene(start: int = 0, goal: int = 2) -> Scene:
    """Return a scene with one vehicle on a path of four vertices."""
    goals = frozenset((goal,))
    return replace(scene_from_spec("agv:graph=P4,n=1"), start=(start,), goal=goals, goals=())


def assigned(*moves: GeneratorPlacement) -> Assignment:
    """Return a schedule of single moves of the vehicle."""
    return Assignment(
        tuple((move,) for move in moves), {0: dict(enumerate(moves, 1))}, (len(moves),), None
    )


class Run:
    """A conductor with what it puts on record, and how often it ends its schedule."""

    def __init__(
        self,
        scene: Scene,
        assignment: Assignment | None = None,
        *,
        repair: bool = False,
        max_rounds: int = 9,
    ) -> None:
        self.recorded: list[Message] = []
        self.ended = 0
        self.site = scene.start[0]
        self.conductor = Conductor(
            scene,
            max_rounds=max_rounds,
            record=self.recorded.append,
            assignment=assignment,
            repair=repair,
        )

    def hear(
        self, number: int, site: int, move: GeneratorPlacement | None, failed: str | None = None
    ) -> None:
        """Hear the report of a round: where the vehicle is now, by which move."""
        claim: Literal["none", "granted"] = "none" if move is None else "granted"
        report = Report(number, 0, self.site, site, claim, move, {}, failed)
        self.site = site
        self.conductor.hear(Reports(number, 0, [report]))

    def between(self, number: int) -> RunEnd | None:
        """Ask how the run has ended after a round."""

        def end_schedule() -> None:
            self.ended += 1

        return self.conductor.between(number, end_schedule)


@pytest.mark.parametrize(
    ("start", "assignment", "ending"),
    [
        (2, None, RunEnd("goal")),
        (0, None, None),
        (2, assigned(), RunEnd("goal")),
        (0, assigned(), None),
        (2, assigned(FURTHER), None),
    ],
)
def test_a_run_is_over_before_it_begins_only_at_the_goal_and_without_a_schedule(
    start: int, assignment: Assignment | None, ending: RunEnd | None
) -> None:
    """A schedule is carried out even if it begins at the goal; one without cubes is done."""
    assert Run(scene(start), assignment).conductor.before() == ending


def test_it_ends_at_the_goal_or_after_the_last_round() -> None:
    """The goal counts also in the last round; each round goes on record."""
    for rounds, ending in ((1, RunEnd("max-rounds")), (2, RunEnd("goal")), (3, RunEnd("goal"))):
        run = Run(scene(), max_rounds=rounds)
        assert run.between(0) is None
        for number, move in enumerate((THERE, FURTHER)[:rounds], 1):
            run.hear(number, number, move)
            assert run.between(number) == (ending if number == min(rounds, 2) else None)
        edges = [each for each in run.recorded if isinstance(each, Edges)]
        assert run.recorded == edges
        assert [(each.round, len(each.moves)) for each in edges] == [
            (number, 1) for number in range(1, min(rounds, 2) + 1)
        ]


def test_a_round_that_not_all_have_reported_fails_the_run() -> None:
    """The line names it; what is no report does not count."""
    run = Run(scene())
    run.conductor.hear(Ready(1, 0, "settle"))
    line = "round 1 ended, but not all modules have reported it"
    assert run.between(1) == RunEnd("failed", line)


def test_a_module_that_gives_up_fails_the_run() -> None:
    """Its line is that of the run."""
    run = Run(scene())
    run.hear(1, 0, None, "no way")
    assert run.between(1) == RunEnd("failed", "module_0: no way")


def test_a_schedule_is_carried_out_past_the_goal_and_its_end_decides() -> None:
    """At the goal on its way it goes on; where it ends elsewhere the rounds go on to the last."""
    run = Run(scene(goal=1), assigned(THERE, FURTHER), max_rounds=3)
    assert run.conductor.schedule_cubes == 2
    for number, move in ((1, THERE), (2, FURTHER)):
        run.hear(number, number, move)
        assert run.between(number) is None
    assert run.conductor.stopped is None
    run.hear(3, 2, None)
    assert run.between(3) == RunEnd("max-rounds")
    assert run.ended == 0


def _stopped(*, repair: bool, goal: int = 2) -> tuple[Run, RunEnd | None]:
    """Return a run whose schedule stopped in its first round, and how it ended then."""
    run = Run(scene(goal=goal), assigned(THERE, FURTHER), repair=repair)
    run.hear(1, 0, None, "an obstacle")
    return run, run.between(1)


STOPPED = Stopped(1, 0, THERE, "an obstacle")
STOPPED_LINE = "the schedule stopped at round 1: module_0: an obstacle"


def test_a_schedule_that_stops_fails_the_run_unless_it_is_repaired() -> None:
    """With repair the modules are told once to follow their rule, and the run goes on."""
    run, ending = _stopped(repair=False)
    assert (ending, run.ended) == (RunEnd("failed", STOPPED_LINE), 0)
    run, ending = _stopped(repair=True)
    assert (ending, run.ended, run.conductor.stopped) == (None, 1, STOPPED)
    run.hear(2, 1, THERE)
    assert run.between(2) is None
    run.hear(3, 2, FURTHER)
    assert (run.between(3), run.ended) == (RunEnd("goal"), 1)
    run, ending = _stopped(repair=True, goal=0)
    assert (ending, run.ended) == (RunEnd("goal"), 0)


def test_a_rule_that_gives_up_after_its_schedule_has_stopped_tells_both() -> None:
    """In one line, the schedule first."""
    run, _ = _stopped(repair=True)
    run.hear(2, 0, None, "no way")
    assert run.between(2) == RunEnd("failed", f"{STOPPED_LINE}; then module_0: no way")


def results(run: Run, ending: RunEnd) -> tuple[Sequence[Message], Summary]:
    """Return what came of a run before its summary, and that."""
    *found, summary = run.conductor.results(ending)
    assert isinstance(summary, Summary)
    return found, summary


def test_the_results_are_cubes_their_certificate_and_a_summary() -> None:
    """Moves that cancel are in none of the cubes, which are counted from 1."""
    run = Run(scene(goal=3))
    for number, (site, move) in enumerate([(1, THERE), (0, THERE), (1, THERE), (2, FURTHER)], 1):
        run.hear(number, site, move)
    (one, other, proof), summary = results(run, RunEnd("interrupted"))
    assert [one, other] == [Cube(4, 1, [THERE]), Cube(4, 2, [FURTHER])]
    assert isinstance(proof, Certified)
    assert proof.round == 4
    assert (summary.round, summary.rounds, summary.moves, summary.reduced_moves) == (4, 4, 4, 2)
    assert (summary.cubes, summary.max_cube_dimension) == (2, 1)
    assert (summary.ended, summary.error, summary.goal_reached) == ("interrupted", None, False)
    assert (summary.schedule_cubes, summary.schedule_stopped) == (None, None)
    assert summary.path_digest == run.conductor.gatherer.digest


def test_the_summary_says_where_the_schedule_stopped() -> None:
    """With its number of cubes and the line on why the run failed."""
    run, ending = _stopped(repair=False)
    assert ending is not None
    _, summary = results(run, ending)
    assert (summary.ended, summary.error) == ("failed", STOPPED_LINE)
    assert (summary.schedule_cubes, summary.schedule_stopped) == (2, STOPPED)
