"""Many seeds: what is counted, and a planted bug that is found, shrunk, kept and opened again."""

from functools import cache
from pathlib import Path

import pytest

from cubepath.coordinator.simulation.faults import FREE_KINDS, KINDS, ListedFaults
from cubepath.coordinator.simulation.scenarios import ANYTHING, ScenarioOptions
from cubepath.coordinator.simulation.simulated import simulate
from cubepath.coordinator.simulation.swarm import (
    FREE_OUTCOMES,
    OUTCOMES,
    WITHOUT_ROUNDS,
    KeptRun,
    LockstepSwarm,
    SeedTally,
    command_of,
    shrunk,
    simulate_seeds,
    simulator_of,
)
from cubepath.coordinator.verification.recording import verify
from cubepath.protocol.recordings.recording import read_recording
from cubepath.protocol.wire.messages import Bundle, Claim, Go, Presence, Ready, Reports, encode
from exploration.planted import Raises, TakesDoubles
from processes.command_line import cubepath

LINES = ScenarioOptions("hex", "chain")


@cache
def first_failing(make: type[TakesDoubles | Raises], asked: ScenarioOptions = LINES) -> int:
    """Return the first seed that fails with a planted bug."""
    planted = LockstepSwarm(asked, make)
    return next(seed for seed in range(100) if planted.run_of(seed).failure is not None)


@pytest.fixture(scope="module")
def told(tmp_path_factory: pytest.TempPathFactory) -> tuple[KeptRun, SeedTally, list[int]]:
    """Return what is kept of a planted bug, what was counted, and the seeds that were shrunk."""
    tally, shrinking = SeedTally(LockstepSwarm(LINES, TakesDoubles)), list[int]()
    (found,) = simulate_seeds(
        [first_failing(TakesDoubles)],
        tmp_path_factory.mktemp("kept"),
        tally,
        failing=shrinking.append,
    )
    assert found is not None
    return found, tally, shrinking


@pytest.mark.slow
def test_a_planted_bug_is_found_shrunk_and_kept(told: tuple[KeptRun, SeedTally, list[int]]) -> None:
    """What is kept fails as the seed did, with two processes, one fault and few rounds."""
    kept, tally, shrinking = told
    seed = first_failing(TakesDoubles)
    assert tally.failed == [kept]
    assert shrinking == [seed]
    assert tally.outcomes["failure"] == tally.seeds == 1
    assert kept.kind == "verify deliveries"
    assert kept.modules <= 3
    assert (kept.unit, kept.long) <= ("rounds", 2)
    assert len(kept.faults) == 1
    assert kept.faults[0].startswith("duplicate at ")
    recording = read_recording(Path(kept.log))
    assert recording.problems == ()
    assert recording.parameters["simulated"] == f"seed {seed}: {kept.detail}"
    assert not {check.name: check.ok for check in verify(recording).checks}["deliveries"]


@pytest.mark.thorough
def test_what_is_kept_can_be_opened(told: tuple[KeptRun, SeedTally, list[int]]) -> None:
    """By verify, info, view and replay; the pictures show the messages, and view leaves them."""
    kept, _, _ = told
    log = Path(kept.log)
    assert {path.name for path in log.parent.iterdir()} == {
        log.name,
        f"{log.stem}-messages.svg",
        f"{log.stem}-messages.png",
    }
    before = [Path(picture).read_bytes() for picture in kept.pictures]
    assert b"<!-- coordinator -->" in before[0]
    verified = cubepath("verify", log)
    assert (verified.returncode, "FAILED  deliveries" in verified.stdout) == (1, True)
    for command in ("log info", "view", "replay"):
        done = cubepath(*command.split(), log)
        assert done.returncode == 0, done.stderr
    assert [Path(picture).read_bytes() for picture in kept.pictures] == before


@pytest.mark.thorough
def test_shrinking_fails_in_the_same_way() -> None:
    """The kind of the failure stays, and what is left fails each time from its list."""
    seed = first_failing(Raises)
    raising = LockstepSwarm(LINES, Raises)
    found = raising.run_of(seed)
    left = shrunk(found, seed, raising)
    assert found.failure is not None
    assert left.failure is not None
    assert left.failure.kind == found.failure.kind == "raised"
    assert "raised KeyError" in left.failure.detail
    assert len(left.fired) < len(found.fired) / 2
    assert len(left.scenario.scene.start) <= len(found.scenario.scene.start)
    again = simulate(left.scenario, ListedFaults(left.fired), fault_seed=seed, make=Raises)
    assert again.failure == left.failure


def test_a_run_that_holds_is_not_shrunk() -> None:
    """There is nothing that could be made small."""
    with pytest.raises(ValueError, match="nothing to shrink"):
        shrunk(LockstepSwarm(LINES).run_of(0), 0, LockstepSwarm(LINES))


@pytest.mark.thorough
def test_a_log_is_never_written_over(tmp_path: Path) -> None:
    """Where a recording of the seed is there it stays, and the other has a number."""
    seed = first_failing(Raises)
    earlier = tmp_path / f"simulated-{seed}.mcap"
    earlier.write_text("earlier")
    (kept,) = simulate_seeds([seed], tmp_path, SeedTally(LockstepSwarm(LINES, Raises)))
    assert kept is not None
    assert Path(kept.log).name == f"simulated-{seed}-2.mcap"
    assert earlier.read_text() == "earlier"


@pytest.mark.few(1)
@pytest.mark.parametrize(
    ("asked", "kinds", "outcomes"),
    [(ANYTHING, KINDS, OUTCOMES), (WITHOUT_ROUNDS, FREE_KINDS, FREE_OUTCOMES)],
)
def test_the_tally_counts_every_kind(
    tmp_path: Path, asked: ScenarioOptions, kinds: tuple[str, ...], outcomes: tuple[str, ...]
) -> None:
    """Also those that did not come to pass; numbers of runs add up."""
    simulator = simulator_of(asked)
    tally = SeedTally(simulator)
    assert list(simulate_seeds(range(3), tmp_path, tally)) == [None] * 3
    document = tally.document(2.0)
    assert set(document["faults"]) == set(kinds)
    assert set(document["outcomes"]) == set(outcomes)
    assert sum(document["outcomes"].values()) == document["seeds"] == 3
    assert document["failures"] == len(document["failed"]) == 0
    assert document["seeds_per_second"] == 1.5
    runs = [simulator.run_of(seed) for seed in range(3)]
    assert document["steps"] == sum(run.steps for run in runs)
    assert document[simulator.unit] == sum(run.long for run in runs)


def test_the_command_replays_the_seed_alone() -> None:
    """With what was asked for, in quotes where a shell needs them."""
    assert command_of(7, ANYTHING) == "cubepath simulate --seeds 7..7"
    command = "cubepath simulate --seeds 7..7 --clock free"
    assert command_of(7, WITHOUT_ROUNDS) == command
    asked = ScenarioOptions("my scene.toml", "random", None)
    command = "cubepath simulate --seeds 7..7 --system 'my scene.toml' --rule random"
    assert command_of(7, asked) == command


def test_messages_are_labelled() -> None:
    """In a few words: the kind, the round, and where it goes."""
    here = Presence(3, 1, (0, 0))
    claim = Claim(3, 1, (0, 0), "left", (0, 0))
    said = Bundle(3, "sense", 0, "0,1", 0, [here, here, claim])
    assert LockstepSwarm.label(encode(said)) == "2 presence, claim to 0,1"
    assert LockstepSwarm.label(encode(Go(3, "claim"))) == "go 3 claim"
    assert LockstepSwarm.label(encode(Ready(3, 0, "claim"))) == "ready 3 claim"
    assert LockstepSwarm.label(encode(Reports(3, 0, []))) == "reports 3"
    assert LockstepSwarm.label(b"?") == "no message"
