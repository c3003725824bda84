"""Some modules live and the others from a recording, up to the first divergence."""

import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings, strategies as st
from msgspec import json as wire

from cubepath.coordinator.auditing.rule_audit import audit
from cubepath.coordinator.runs.continuing import what_if
from cubepath.coordinator.runs.live import LiveReplay, replay_live
from cubepath.coordinator.testing.commands import Command
from cubepath.coordinator.testing.run_under_test import RunUnderTest
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.sites import site_hook, site_text
from cubepath.protocol.recordings.recording import Recording, read_recording
from processes.command_line import GOLDEN
from processes.elsewhere import Commands
from samples import noting
from samples.noting import WHEN, WHO
from samples.recordings import edited, first, new_path, parts, recorded
from samples.schedules import VEHICLES, carry_out, original

NOTING = f"{noting.__file__}:noting"
CROWD = "agv:graph=grid4x4,n=7"
SYSTEMS = (CROWD, "agv-labelled:graph=grid4x4,n=6", "hex:n=5", "arm:n=5")
OWN = Path(__file__).parents[2] / "processes" / "own_module.py"


def said(recording: Recording) -> set[bytes]:
    """Return all that modules said and reported, byte by byte."""
    kinds = ("presence", "note", "claim", "verdict", "report")
    return {wire.encode(part) for part in parts(recording, *kinds)}


def live(recording: Recording, modules: list[int] | None = None, **options: Any) -> LiveReplay:
    """Replay with live modules, in no other process."""
    given: dict[str, Any] = {"processes": 0, **options}
    return replay_live(recording, modules, **given)


def child() -> Recording:
    """Return a run in which other rules took over."""
    parent = recorded(CROWD, rounds=6)
    return what_if(parent, "random", from_round=3, processes=0, log=new_path()).recording()


@pytest.mark.few(1)
@settings(max_examples=3)
@given(st.sampled_from(SYSTEMS), st.integers(0, 1), st.sets(st.integers(0, 4), min_size=1))
def test_live_modules_say_what_is_on_record_to_the_byte(
    spec: str, seed: int, modules: set[int]
) -> None:
    """And those from the log too, so both recordings hold the same, and both are verified."""
    parent = recorded(spec, "random", seed=seed, rounds=6, hesitate=0.2)
    log = new_path()
    found = live(parent, sorted(modules), log=log)
    assert (found.same, found.divergence, str(found.recording)) == (True, None, str(log))
    assert found.rounds == found.recorded_rounds == first(parent, "summary").rounds
    assert said(read_recording(log)) == said(parent)
    checks = audit(log).checks
    assert all(check.ok and check.checked for check in checks)


@pytest.mark.thorough
def test_all_modules_are_live_in_processes_too() -> None:
    """Notes, memory and all: the log says the same as a new run."""
    parent = recorded(CROWD, "tswap", rounds=10)
    log = new_path()
    assert live(parent, processes=3, log=log).same
    assert said(read_recording(log)) == said(parent)


@pytest.mark.few(1)
@pytest.mark.parametrize("name", ["agv-3", "agv-6", "arm-6", "hex-5"])
def test_recordings_of_format_1_are_compared_as_well(name: str) -> None:
    """What was said is the same, in whatever form it is on record."""
    found = live(read_recording(GOLDEN / f"{name}.mcap"), [0, 1])
    assert (found.same, found.live) == (True, (0, 1))


@pytest.mark.parametrize(
    ("rule", "round_number", "kind", "now"),
    [
        ("claiming", WHEN, "claim", "claims"),
        ("notes", WHEN + 1, "note", "notes [-1, -1]"),
        ("giving_up", WHEN, "claim", "claims nothing"),
        ("raising", WHEN, "failed", "ValueError: no idea"),
    ],
)
def test_the_first_divergence_is_named(rule: str, round_number: int, kind: str, now: str) -> None:
    """By round, module and kind, with what is on record and what came, and where it stood."""
    parent = recorded(CROWD, NOTING, seed=1, rounds=8)
    changed = f"{noting.__file__}:{rule}"
    found = live(parent, [0, WHO], rule=changed)
    told = found.divergence
    assert told is not None
    assert not found.same
    assert (told.round, told.module, told.kind) == (round_number, WHO, kind)
    assert found.rounds == round_number - 1
    assert now in told.live
    assert told.recorded != told.live
    stood = first(
        parent, "report", lambda report: (report.round, report.module) == (WHEN, WHO)
    ).before
    assert told.site is not None
    assert told.site == site_text(stood)
    sensed = [each for each in told.sensed if each.startswith("sensed module_")]
    here = {each.site: each.module for each in parts(parent, "presence") if each.round == WHEN}
    near = {
        there
        for there in here
        if abs(there[0] - stood[0]) + abs(there[1] - stood[1]) == 1  # on a grid
    }
    assert len(sensed) == len(near)
    assert all(any(f"module_{here[there]} at" in each for each in sensed) for there in near)
    assert str(told).splitlines()[0].startswith(f"round {round_number}, module_{WHO}: ")
    assert live(parent, [0, 1], rule=changed).same  # who changed is not among the live ones


def test_what_is_on_record_otherwise_diverges_where_it_is() -> None:
    """A verdict or a report that was changed in the log is told from what comes of the claims."""
    parent = recorded(CROWD, "random", rounds=8)
    verdict = first(parent, "verdict", lambda each: each.round > 2)
    other = wire.decode(
        wire.encode(verdict).replace(
            *((b"true", b"false") if verdict.granted else (b"false", b"true"))
        ),
        type=type(verdict),
        dec_hook=site_hook,
    )
    found = live(edited(parent, verdict, other), [0]).divergence
    assert found is not None
    assert (found.round, found.module, found.kind) == (verdict.round, verdict.module, "verdict")
    assert {"granted", "lost"} == {
        "lost" if "lost" in each else "granted" for each in (found.recorded, found.live)
    }


def test_notes_of_another_length_are_a_divergence() -> None:
    """Who notes otherwise is not heard; until notes are said, in round 2, choices are compared."""
    parent = recorded("agv:graph=grid3x2,n=2", "random", rounds=5)
    found = live(parent, [0], rule="tswap").divergence
    assert found is not None
    assert (found.round <= 2, found.module) == (True, 0)
    noted = live(recorded(CROWD, NOTING, rounds=5), [1], rule="tswap").divergence
    assert noted is not None
    if noted.round == 2:
        assert (noted.kind, noted.recorded) == ("note", "notes of 2 numbers")


def test_a_recording_that_was_cut_off_is_compared_as_far_as_it_goes(tmp_path: Path) -> None:
    """Its whole rounds are."""
    whole = (GOLDEN / "agv-6.mcap").read_bytes()
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(whole[: len(whole) // 2])
    found = live(read_recording(cut), [2])
    assert found.same
    assert 2 < found.rounds == found.recorded_rounds < 27


@pytest.mark.parametrize(
    ("recording", "modules", "why"),
    [
        (lambda: recorded(CROWD, rounds=6), [7], "modules=7: no such module, .* has 0-6"),
        (lambda: recorded(CROWD, rounds=6), [], "modules: none is live"),
        (lambda: read_recording(GOLDEN / "hex-free-5.mcap"), [0], "a run without rounds"),
        (lambda: carry_out(original(*VEHICLES).path)[1], [0], "carry out a schedule"),
        (lambda: recorded(CROWD, rounds=0), [0], "no whole round is on record"),
        (child, [0], "other rules took over in round 3"),
    ],
)
def test_what_cannot_be_compared_is_refused(
    recording: Callable[[], Recording], modules: list[int], why: str
) -> None:
    """In one line that says why."""
    with pytest.raises(InputError, match=why):
        live(recording(), modules)


@pytest.fixture
def commands(tmp_path: Path) -> Iterator[Commands]:
    """Return what starts commands, and ends them."""
    with Commands(tmp_path) as found:
        yield found


@pytest.mark.thorough
def test_live_modules_may_join_from_elsewhere(commands: Commands, tmp_path: Path) -> None:
    """Processes of others have some of the live modules, and those they leave run here."""
    (tmp_path / "log.mcap").write_bytes(recorded(CROWD, NOTING, rounds=6).path.read_bytes())
    replay = commands.start(
        "replay",
        "log.mcap",
        "--modules=0-3",
        "--listen=tcp/127.0.0.1:0",
        "--wait-for=1",
        f"--rule={NOTING}",
    )
    endpoint = replay.says(r"listening on (\S+) without TLS")[1]
    joined = commands.start("join", f"--connect={endpoint}", "--modules=0-1", f"--rule={NOTING}")
    assert replay.end()[:2] == (0, "the same for 6 of 6 rounds")
    assert joined.end()[0] == 0


@pytest.mark.thorough
def test_a_process_in_another_program_is_tried_against_a_log(
    commands: Commands, tmp_path: Path
) -> None:
    """One that was written from the page of the protocol alone does again what it did."""
    log = tmp_path / "log.mcap"
    own = [sys.executable, "-I", str(OWN), "{endpoint}", "1"]
    spec = "agv-labelled:graph=grid10x4,n=4"
    with RunUnderTest(spec, seed=2, max_rounds=30, log=log, commands={"own": own}) as run:
        rounds = run.play().rounds
    again = commands.start(
        "replay", "log.mcap", "--modules=1", "--listen=tcp/127.0.0.1:0", "--wait-for=1"
    )
    endpoint = again.says(r"listening on (\S+) without TLS")[1]
    words = [word.replace("{endpoint}", endpoint) for word in own]
    commands.enter_context(Command(words, name="own"))
    assert again.end()[:2] == (0, f"the same for {rounds} of {rounds} rounds")
