"""Checking that a rule is local: our own pass, each way of cheating is found and named."""

from collections.abc import Iterator
from math import inf
from pathlib import Path

import pytest

from cubepath.agents.locality import check as check_module
from cubepath.agents.locality.check import (
    Checker,
    LocalityReport,
    PlayProcesses,
    all_scenes,
    check_rule,
)
from cubepath.agents.rules.registry import BUILT_IN
from cubepath.protocol.core.errors import InputError
from marked import all_but

TO_GOAL = [name for name, rule in BUILT_IN.items() if rule.to_goal]
CHEATS = Path(__file__).parent / "cheats"


@pytest.fixture(scope="module")
def stage() -> Iterator[PlayProcesses]:
    """Return the processes that all rules of a test are played in."""
    with PlayProcesses(seed=1, timeout_s=inf) as found:
        yield found


def checked(
    stage: PlayProcesses, cheat: str, *systems: str
) -> tuple[LocalityReport, dict[str, str]]:
    """Return what is found of a rule in `cheats`, and the lines by kind."""
    rule = f"{CHEATS / cheat}.py:RULE"
    checker = Checker(stage, rule, seed=1, progress=lambda: None)
    for spec in systems or ("hex:n=4",):
        checker.check(spec)
    found = checker.checked()
    return found, {each.kind: each.text for each in found.findings}


def everywhere(stage: PlayProcesses, rule: str, clock: str = "lockstep") -> LocalityReport:
    """Return what is found of a rule in all scenes that it is for."""
    checker = Checker(stage, rule, seed=0, progress=lambda: None, clock=clock)
    checker.check_all(checker.fitting(all_scenes()))
    return checker.checked()


@pytest.mark.thorough
@pytest.mark.parametrize("rule", TO_GOAL)
def test_our_own_rules_are_local(stage: PlayProcesses, rule: str) -> None:
    """In a small and a larger scene of all families that they are for nothing is found."""
    found = everywhere(stage, rule)
    assert found.findings == ()
    assert len(found.systems) >= 2
    assert found.choices > 900
    assert found.changes > 40


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("rule", "spec"),
    [
        ("random", "hex:n=12"),
        ("random", "words"),
        ("random", "assembly"),
        ("metropolis", "agv:graph=grid6x6,n=9"),
        ("metropolis", "sliding"),
        ("metropolis", "polygon:n=9"),
    ],
)
def test_rules_for_every_system_are_local(stage: PlayProcesses, rule: str, spec: str) -> None:
    """In systems of each kind nothing is found."""
    checker = Checker(stage, rule, seed=0, progress=lambda: None)
    checker.check(spec)
    assert checker.checked().findings == ()


@pytest.mark.thorough
@pytest.mark.parametrize("rule", all_but(TO_GOAL, {"leader"}))
def test_our_own_rules_are_local_without_rounds(stage: PlayProcesses, rule: str) -> None:
    """The same, where they are played in turns."""
    found = everywhere(stage, rule, "free")
    assert found.findings == ()
    assert found.choices > 900
    assert found.changes > 40


@pytest.mark.slow
def test_who_cheats_is_found_without_rounds(stage: PlayProcesses, tmp_path: Path) -> None:
    """A global that modules share shows in turns too, which are named in the line."""
    text = (CHEATS / "module_globals.py").read_text()
    free = "lambda _: True, make, free=FreeRule('not at all'))"
    text = text.replace("lambda _: True, make)", free)
    (tmp_path / "cheat.py").write_text(text.replace("import Init", "import FreeRule, Init"))
    checker = Checker(
        stage, f"{tmp_path}/cheat.py:RULE", seed=1, progress=lambda: None, clock="free"
    )
    checker.check("hex:n=4")
    found = checker.checked()
    assert found.clock == "free"
    (line,) = [each.text for each in found.findings if each.kind == "state"]
    assert "WHERE changed" in line
    assert "in turn" in line


@pytest.mark.slow
def test_a_rule_for_rounds_alone_is_refused_without(stage: PlayProcesses) -> None:
    """It says nothing of why it would hold, so it is not played."""
    rule = f"{CHEATS / 'harmless'}.py:RULE"
    checker = Checker(stage, rule, seed=1, progress=lambda: None, clock="free")
    with pytest.raises(InputError, match="not for the free clock: rule"):
        checker.check("hex:n=4")
    with pytest.raises(InputError, match="clock='wall': expected one of lockstep, free"):
        check_rule("chain", clock="wall")


@pytest.mark.slow
def test_what_is_local_is_left_alone(stage: PlayProcesses) -> None:
    """A cache, a generator from the module's number, libraries that look at frames: no finding."""
    found, lines = checked(stage, "harmless", "agv:graph=grid6x6,n=6")
    assert lines == {}
    assert found.changes > 40


EXPECTED = {
    "module_globals": {"state": "keeps state outside the module (WHERE changed): module_"},
    "shared_system": {"state": "keeps state outside the module: module_"},
    "frames_looked_at": {
        "frames": "looks at stack frames (sys._getframe in frames_looked_at.py:12,"
        " tb_frame in frames_looked_at.py:17): no choice was seen to change with it"
    },
    "clock": {"clock": "uses the clock (time.time_ns in clock.py:11): module_0 of hex:n=4 has"},
    "birthday": {"clock": "uses the clock (datetime.now in birthday.py:7): module_0 of hex:n=4"},
    "out_of_sight": {"repeat": "does not choose the same twice: module_"},
    "global_random": {
        "random": "uses random numbers that are not the module's own (random.choice in"
        " global_random.py:10): module_0 of hex:n=4 has action"
    },
    "numpy_random": {
        "random": "uses random numbers that are not the module's own (numpy.random.choice in"
        " numpy_random.py:10): module_0 of hex:n=4 has action"
    },
    "fresh_generator": {
        "random": "uses random numbers that are not the module's own"
        " (numpy.random.default_rng without a seed in fresh_generator.py:11, random.Random without"
        " a seed in fresh_generator.py:11): module_0"
    },
    "process_id": {
        "process": "uses the process, its threads or others (os.getpid in process_id.py:11):"
        " module_0 of hex:n=4 has action"
    },
    "environment": {
        "environment": "uses the machine or the environment of the process (os.environ in"
        " environment.py:11, os.getcwd in environment.py:11): module_0 of hex:n=4 has action"
    },
    "board": {
        "files": "uses files (open in board.py:11, open in board.py:14)",
        "state": "keeps state outside the module: module_",
    },
    "set_order": {
        "hashing": "depends on hashes or addresses, as by the order of a set: module_0 of hex"
    },
    "raises": {"fails": "fails: module_0 of hex:n=4 raises KeyError at raises.py:13 in round 3"},
    "vanishes": {"fails": "fails: hex:n=4, in a run: ended its process"},
}
ESSENTIAL = (
    "module_globals",
    "frames_looked_at",
    "clock",
    "global_random",
    "process_id",
    "board",
    "raises",
)
"""One of each kind; the others are thorough."""
"""By rule in `cheats` the kinds of what is found, and how each line begins."""


@pytest.mark.few(2)
@pytest.mark.slow
@pytest.mark.parametrize(
    "cheat",
    [
        pytest.param(cheat, marks=[] if cheat in ESSENTIAL else [pytest.mark.thorough])
        for cheat in EXPECTED
    ],
)
def test_each_way_of_cheating_is_named(stage: PlayProcesses, cheat: str) -> None:
    """What is found is that and nothing else, in the right words."""
    _, lines = checked(stage, cheat)
    assert lines.keys() == EXPECTED[cheat].keys()
    for kind, begins in EXPECTED[cheat].items():
        assert lines[kind].startswith(begins), lines[kind]


@pytest.mark.few(1)
@pytest.mark.slow
@pytest.mark.parametrize(
    ("cheat", "why"),
    [
        ("far_positions", None),
        ("frames", "looks at stack frames (sys._getframe in frames.py:14)"),
        pytest.param(
            "collector",
            "looks at what else is in memory (gc.get_objects in collector.py:10)",
            marks=pytest.mark.thorough,
        ),
    ],
)
def test_who_sees_beyond_reach_is_found(stage: PlayProcesses, cheat: str, why: str | None) -> None:
    """A choice changes with what the module cannot sense, whatever way it has found there."""
    found, lines = checked(stage, cheat, "agv:graph=grid6x6,n=5")
    assert found.changes > 40
    assert lines["reach"].startswith("sees beyond its reach: module_")
    assert "where modules beyond its reach are elsewhere action" in lines["reach"]
    assert why is None or why in lines.values()


@pytest.mark.thorough
def test_the_answer_follows_from_the_seed() -> None:
    """Twice the same, to the last number; every play is told."""
    plays: list[int] = []
    path = f"{CHEATS / 'far_positions'}.py:RULE"
    one, other = (
        check_rule(path, ["agv:graph=C7,n=3"], seed=5, progress=lambda: plays.append(1))
        for _ in range(2)
    )
    assert one == other
    assert len(plays) == 2 * 22


@pytest.mark.slow
def test_a_play_without_an_answer_is_found_and_the_last(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each would take as long."""
    monkeypatch.setattr(check_module, "PATIENCE_S", 2.0)
    found = check_rule(f"{CHEATS / 'sleeps'}.py:RULE", ["hex:n=2", "hex:n=3"])
    assert found.systems == ("hex:n=2",)
    (finding,) = found.findings
    assert finding.text == "fails: hex:n=2, in a run: gave no answer for 2 s"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("rule", "system", "why"),
    [
        ("random", "hex-connected", "hex-connected: not a local system"),
        (f"{CHEATS / 'unfit'}.py:RULE", "hex:n=3", "wants more than 3 modules"),
    ],
)
def test_what_cannot_be_checked_is_bad_input(
    stage: PlayProcesses, rule: str, system: str, why: str
) -> None:
    """With what was found and what was expected."""
    checker = Checker(stage, rule, seed=1, progress=lambda: None)
    with pytest.raises(InputError, match=why):
        checker.check(system)
