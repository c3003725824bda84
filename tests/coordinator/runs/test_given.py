"""What is given of a wrong type, or out of range, is refused in one line before anything starts."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from cubepath.agents.environments.rollouts import play, play_free, play_many
from cubepath.agents.rules.rule import Choice, RuleType
from cubepath.coordinator.runs.asking import ask
from cubepath.coordinator.runs.run import run, start
from cubepath.coordinator.shortening.normal_path import shorten
from cubepath.protocol.core.errors import CheckError, InputError, RuleError
from cubepath.protocol.recordings.recording import read_recording
from cubepath.protocol.scenes.specs import scene_from_spec
from cubepath.protocol.scenes.toml import scene_to_toml

WRONG: list[tuple[dict[str, Any], str]] = [
    ({"processes": "three"}, "processes='three': expected a whole number"),
    ({"processes": 2.5}, "processes=2.5: expected a whole number"),
    ({"seed": "a"}, "seed='a': expected a whole number"),
    ({"seed": 1.5}, "seed=1.5: expected a whole number"),
    ({"seed": True}, "seed=True: expected a whole number"),
    ({"seed": -1}, "seed=-1: expected 0 or more"),
    ({"processes": -1}, "processes=-1: expected 0 or more"),
    ({"max_rounds": -1}, "max-rounds=-1: expected 0 or more"),
    ({"hesitate": 1.5}, "hesitate=1.5: expected at least 0 and less than 1"),
    ({"hesitate": float("nan")}, "hesitate=nan: expected at least 0 and less than 1"),
    ({"max_rounds": "9"}, "max-rounds='9': expected a whole number"),
    ({"hesitate": "x"}, "hesitate='x': expected a number"),
    ({"patience": None}, "patience=None: expected a number"),
    ({"what": 5}, "system=5: expected a name, a file or a scene"),
    ({"what": ["hex"]}, "system=['hex']: expected a name, a file or a scene"),
    ({"rule": 5}, "rule=5: expected the name of a rule, or FILE.py:NAME"),
    ({"clock": "fre"}, "clock=fre (did you mean 'free'?): expected one of lockstep, free"),
    (
        {"log_time": "levl"},
        "log-time=levl (did you mean 'level'?): expected one of round, level, wall",
    ),
    ({"log_time": "level"}, "log-time=level: only for runs without rounds, expected round or wall"),
    (
        {"log_time": "round", "clock": "free"},
        "log-time=round: without rounds (clock=free), expected level or wall",
    ),
    ({"log": 5}, "log=5: expected a path"),
    ({"speeds": 5, "clock": "free"}, "speeds=5: expected factors by module, as in {0: 2.0}"),
    ({"speeds": {0: "x"}, "clock": "free"}, "speed=0='x': expected a number"),
]


@pytest.mark.parametrize(("given", "told"), WRONG, ids=[told for _, told in WRONG])
def test_a_run_of_wrong_types_is_refused(given: dict[str, Any], told: str, tmp_path: Path) -> None:
    """By `start` as by `run`; nothing is written."""
    given = {"what": "hex:n=4", "log": tmp_path / "a.mcap", **given}
    begins: tuple[Callable[..., object], ...] = (run, start)
    for begin in begins:
        with pytest.raises(InputError) as error:
            begin(**given)
        assert str(error.value) == told
    assert not list(tmp_path.iterdir())


def test_what_a_run_is_asked_for_is_checked(tmp_path: Path) -> None:
    """How far it is to go, until when, and by which signal."""
    with start("hex:n=3", processes=0, log=tmp_path / "a.mcap") as running:
        asked: Any = running
        acts: list[tuple[Callable[[], object], str]] = [
            (lambda: asked.step("x"), "step='x': expected 0 or more"),
            (lambda: asked.step(1.5), "step=1.5: expected 0 or more"),
            (lambda: asked.step(-1), "step=-1: expected 0 or more"),
            (lambda: asked.step(timeout_s=-1), "timeout_s=-1: expected 0 or more seconds"),
            (lambda: asked.until(5), "until=5: expected a function"),
            (lambda: asked.until(bool, timeout_s="x"), "timeout_s='x': expected a number"),
            (lambda: asked.signal("router", 999), "signal=999: expected the number of a signal"),
            (lambda: asked.signal("router", "x"), "signal='x': expected a whole number"),
        ]
        for act, told in acts:
            with pytest.raises(InputError) as error:
                act()
            assert str(error.value).startswith(told)
        assert running.round == 0
    nowhere: Any = None
    with pytest.raises(InputError, match=r"^endpoint=None: expected where"):
        ask(nowhere)


@pytest.mark.slow
def test_a_run_says_where_it_stands_before_and_after(tmp_path: Path) -> None:
    """It has not begun, goes on, or has ended; a process is named by a module in either form."""
    running = start("hex:n=3", processes=1, log=tmp_path / "a.mcap")
    with pytest.raises(CheckError, match=r"^the run has not begun: expected 'with start"):
        print(running.outcome)
    with running:
        with pytest.raises(CheckError, match=r"^the run goes on: expected it to have ended$"):
            print(running.outcome)
        modules: Any = ("module_1", 1)
        assert {running.process_of(each) for each in modules} == {"process_0"}
        asked: Any = ("module_3", 3, "three", None, True)
        for module in asked:
            name = f"module_{str(module).removeprefix('module_')}"
            with pytest.raises(InputError, match=f"^{name}: expected module_0 to module_2$"):
                running.process_of(module)


def test_what_is_no_path_is_one_line() -> None:
    """Of a file, or of a run."""
    nothing: Any = None
    wrong: list[Any] = [nothing, 5, [1]]
    played = "expected a file, or what `run` or `play` returned"
    for path in wrong:
        with pytest.raises(InputError) as error:
            shorten(path)
        assert str(error.value) == f"path={path!r}: {played}"
    for act, path in ((shorten, ""), (read_recording, ""), (read_recording, nothing)):
        with pytest.raises(InputError) as error:
            act(path)
        assert str(error.value) == f"path={path!r}: expected the path of a file"


@pytest.mark.parametrize(
    ("chosen", "told"),
    [
        (None, "returned None, expected one integer, or a Choice"),
        ("x", "returned str, expected one integer, or a Choice"),
        (1.5, "returned float, expected one integer, or a Choice"),
        ([1], "returned list, expected one integer, or a Choice"),
        (Choice("a"), "returned a Choice of the action str, expected one integer"),  # type: ignore[arg-type]
        (Choice(0, failed=5), "returned a Choice with failed=5, expected why in one line"),  # type: ignore[arg-type]
    ],
    ids=str,
)
def test_a_rule_that_returns_no_choice_is_told(chosen: object, told: str) -> None:
    """By its name, that of the module, and what it returned."""
    bad: Any = chosen
    rule = RuleType("mine", "bad", "presence", lambda _: True, lambda _: lambda _: bad)
    with pytest.raises(RuleError) as error:
        play("hex:n=3", rule, max_rounds=2)
    assert str(error.value) == f"rule 'mine', module_0: {told}"


def test_a_rule_that_makes_nothing_is_told() -> None:
    """A forgotten return, most of the time."""
    nothing: Any = None
    rule = RuleType("mine", "bad", "presence", lambda _: True, lambda _: nothing)
    line = r"^rule 'mine': make returned None, expected a function of a View$"
    with pytest.raises(InputError, match=line):
        play("hex:n=3", rule, max_rounds=2)


def test_what_is_played_is_checked_as_what_is_run(tmp_path: Path) -> None:
    """A path is a system; seeds and doubts have the types and ranges of a run."""
    plays: tuple[Callable[..., Any], ...] = (play, play_free)
    file = tmp_path / "four.toml"
    file.write_text(scene_to_toml(scene_from_spec("hex:n=4")))
    for each in plays:
        assert each(file, seed=1).path == each("hex:n=4", seed=1).path
        most = "max_rounds" if each is play else "max_cycles"
        wrong: list[tuple[dict[str, Any], str]] = [
            *(({most: bad}, f"{most}={bad!r}: expected 0 or more") for bad in ("a", None, 2.5, -1)),
            ({"seed": -1}, "seed=-1: expected 0 or more"),
            ({"seed": "a"}, "seed='a': expected 0 or more"),
            ({"hesitate": 7}, "hesitate=7: expected at least 0 and less than 1"),
            ({"hesitate": "x"}, "hesitate='x': expected a number"),
            ({"system": 5}, "system=5: expected a name, a file or a scene"),
            ({"rule": 5}, "rule=5: expected the name of a rule, or FILE.py:NAME"),
        ]
        for given, told in wrong:
            whole: dict[str, Any] = {"system": "hex:n=4", **given}
            with pytest.raises(InputError) as error:
                each(**whole)
            assert str(error.value) == told
    for given, told in (
        ({"watch": 5}, "watch=5: expected a function"),
        ({"lag": "x"}, "lag='x': expected 0 or more"),
        ({"jitter": "a"}, "jitter='a': expected a number"),
        ({"speeds": 5}, "speeds=5: expected factors by module, as in {0: 2}"),
        ({"speeds": {0: "a"}}, "speeds: module 0 with a, expected modules 0 to 3 with"),
        ({"restarts": 5}, "restarts=5: expected turns with modules, as in {12: [0]}"),
        ({"restarts": {"a": [0]}}, "restarts={'a': [0]}: expected turns with modules"),
        ({"restarts": {3: ["a"]}}, "restarts={3: ['a']}: expected turns with modules"),
    ):
        free: dict[str, Any] = {"system": "hex:n=4", **given}
        with pytest.raises(InputError) as error:
            play_free(**free)
        assert str(error.value).startswith(told)
    many: Any = play_many
    for seeds, told in (([-1], "seed=-1: exp"), ([0, "b"], "seed='b': exp"), ("ab", "seed='a': ")):
        with pytest.raises(InputError) as error:
            many("hex:n=4", "chain", seeds)
        assert str(error.value).startswith(told)
    with pytest.raises(InputError, match=r"^seeds=5: expected several seeds$"):
        many("hex:n=4", "chain", 5)
