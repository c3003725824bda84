"""Sweeps as data: what is written, in a file or on the command line, is what is expanded."""

import hashlib
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import tomli_w
from hypothesis import given, strategies as st

from cubepath.coordinator.experiments.setting import FaultRates, run_id, scene_hash
from cubepath.coordinator.experiments.spec import Sweep, expand, sweep_from_table, sweep_of
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.ranges import expanded, seeds_of
from cubepath.protocol.scenes.specs import scene_from_spec
from cubepath.protocol.scenes.toml import scene_to_toml


@given(st.integers(0, 50), st.integers(0, 50), st.integers(1, 9))
def test_a_range_has_its_numbers(first: int, more: int, step: int) -> None:
    """From the first to the last, each step-th; a list of them stands for the same."""
    numbers = list(range(first, first + more + 1, step))
    names = [f"hex:n={number},bend=60" for number in numbers]
    assert expanded(f"hex:n={first}..{first + more}..{step},bend=60") == names
    assert expanded(f"hex:n={','.join(map(str, numbers))},bend=60") == names


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("5..4", "empty range"),
        ("0", "expected 1 to"),
        ("x", "expected a number of seeds"),
        ("1,x", "expected a number of seeds"),
        ("1,1", "1 stands twice"),
        ("-2..3", "expected 0 or more, found -2"),
        ("1..9..0", "empty range"),
        ("0..9999999", "more than"),
    ],
)
def test_seeds_that_are_none_are_refused(text: str, why: str) -> None:
    """In a line that says what was expected."""
    with pytest.raises(InputError, match=why):
        seeds_of(text)


@pytest.mark.parametrize("key", ["seeds", "max_rounds", "processes", "optimum"])
def test_numbers_that_no_column_holds_are_refused(key: str) -> None:
    """Before anything is played."""
    given: Any = {key: [0, 10**23] if key == "seeds" else 10**23}
    with pytest.raises(InputError, match=f"^{key}[=:].*expected at most 9{{18}}"):
        Sweep(("hex:n=4",), **given)


def test_of_many_seeds_the_one_that_stands_twice_is_named() -> None:
    """However many there are."""
    with pytest.raises(InputError, match=r"^seeds: 99999 stands twice"):
        seeds_of("0..99999,99999")


def labels(sweep: Sweep) -> list[tuple[object, ...]]:
    """Return what each run of a sweep is, in order."""
    return [
        (s.label, s.rule, s.clock, s.hesitate, s.faults.text(), s.core, seed)
        for batch in expand(sweep).batches
        for s in [batch.setting]
        for seed in batch.seeds
    ]


def test_all_are_taken_with_all_in_one_order() -> None:
    """By system, rule, clock, hesitation, faults and seed, which changes fastest."""
    sweep = Sweep(
        ("hex:n=4..5",),
        rules=("random", "chain"),
        clocks=("free", "lockstep"),
        hesitate=(0.5, 0.0),
        faults=(FaultRates(), FaultRates(loss=0.1)),
        seeds=(7, 2),
        max_rounds=1,
    )
    found = labels(sweep)
    assert len(found) == len(set(found)) == 2**6
    assert found[:3] == [
        ("hex:n=4", "random", "free", 0.5, "none", "compiled", 7),
        ("hex:n=4", "random", "free", 0.5, "none", "compiled", 2),
        ("hex:n=4", "random", "free", 0.5, "loss=0.1", "simulated", 7),
    ]
    assert found == labels(sweep)


def test_what_does_not_fit_is_left_out_and_told() -> None:
    """A rule not for a system, a clock that a rule does not hold under, faults without messages."""
    found = expand(Sweep(("hex:n=4", "agv:n=2", "hex-connected"), rules=("chain",)))
    assert [batch.setting.label for batch in found.batches] == ["hex:n=4"]
    assert [line.partition(":")[0] for line in found.left_out] == ["agv", "hex-connected"]
    found = expand(Sweep(("hex:n=4",), faults=(FaultRates(), FaultRates(loss=0.1)), core="wire"))
    assert len(found.left_out) == 1
    with pytest.raises(InputError, match=r"nothing to run: agv:n=2: .* \(and 1 more\)"):
        expand(Sweep(("agv:n=2", "agv:n=3"), rules=("chain",)))


def test_the_same_scene_by_another_name_is_no_other_run(tmp_path: Path) -> None:
    """A name with its default keys, and a file that holds the same."""
    path = tmp_path / "mine.toml"
    path.write_text(scene_to_toml(scene_from_spec("hex:n=4")))
    found = expand(Sweep(("hex:n=4", str(path)), rules=("chain", "random")))
    assert len(list(found.batches)) == 2
    assert found.left_out == (f"{path}: the same scene as hex:n=4, which is played",)


@pytest.mark.parametrize("name", ["hex:n=3", "agv-labelled", "words", 'a"b\n.toml'])
def test_the_hash_of_a_scene_is_that_of_its_text_without_its_name(name: str) -> None:
    """Whatever the name is."""
    scene = scene_from_spec("hex:n=4" if name.endswith("toml") else name)
    nameless = scene_to_toml(replace(scene, spec=""))
    assert scene_hash(replace(scene, spec=name)) == scene_hash(replace(scene, spec=""))
    assert scene_hash(scene) == hashlib.sha256(nameless.encode()).hexdigest()[:16]


def test_what_is_planned_is_made_as_it_is_asked_for() -> None:
    """Of a million runs nothing is made but what is taken."""
    found = expand(Sweep(("hex:n=4",), seeds=tuple(range(1_000_000)), clocks=("free",)))
    batches = iter(found.batches)
    assert (found.runs, next(batches).seeds, next(batches).seeds) == (1_000_000, (0,), (1,))


MINE = """
from dataclasses import replace
from cubepath.agents.rules.uniform import RANDOM
def make(known):
    return RANDOM.make(known)
MINE = replace(RANDOM, name="mine", make=make)
"""


def test_an_id_is_of_all_that_decides(tmp_path: Path) -> None:
    """Another seed, setting, version of the code, or content of a rule's file is another run."""
    ids = set()
    for folder, text in (("one", MINE), ("two", MINE + "# another\n"), ("three", MINE)):
        rule = tmp_path / folder / "mine.py"
        rule.parent.mkdir()
        rule.write_text(text)
        (batch,) = expand(Sweep(("hex:n=4",), rules=(f"{rule}:MINE",), seeds=(1,))).batches
        ids |= {*batch.ids(), run_id(batch.setting, 2, batch.code), run_id(batch.setting, 1, "x")}
    assert len(ids) == 6  # where the file lies does not matter
    (other,) = expand(Sweep(("hex:n=4",), rules=("random",), seeds=(1,), max_rounds=3)).batches
    assert not ids & {*other.ids()}


def test_files_that_have_changed_are_other_runs_in_the_same_process(tmp_path: Path) -> None:
    """A rule and a scene; as they were before, they are the runs that they were."""
    rule, scene, ids = tmp_path / "mine.py", tmp_path / "scene.toml", list[str]()
    for text, size in ((MINE, 4), (MINE + "#", 4), (MINE, 5), (MINE, 4)):
        rule.write_text(text)
        scene.write_text(scene_to_toml(scene_from_spec(f"hex:n={size}")))
        (batch,) = expand(Sweep((str(scene),), rules=(f"{rule}:MINE",), seeds=(1,))).batches
        ids += batch.ids()
    assert ids[0] == ids[3]
    assert len({*ids}) == 3


TABLE: dict[str, Any] = {
    "systems": ["hex:n=4", {"name": "agv", "graph": ["K5", "C8"], "n": "2..3"}],
    "rules": "random",
    "hesitate": [0, 0.25],
    "seeds": "5..6",
    "faults": [{"loss": [0, 0.1]}, "crash=0.01"],
    "max_rounds": 9,
}


def test_a_file_says_what_the_command_line_says(tmp_path: Path) -> None:
    """Its tables, lists and texts; and what is given beside it counts more."""
    path = tmp_path / "sweep.toml"
    path.write_text(tomli_w.dumps(TABLE))
    given = {
        "rules": ["random"],
        "hesitate": [0.0, 0.25],
        "seeds": "5..6",
        "faults": ["loss=0,0.1", "crash=0.01"],
        "max_rounds": 9,
    }
    assert sweep_of([str(path)], {}) == sweep_of(["hex:n=4", "agv:graph=K5,C8,n=2..3"], given)
    assert sweep_of([str(path)], {"seeds": 3}).seeds == (0, 1, 2)
    assert sweep_of([str(path)], {"seeds": 3}).max_rounds == 9


def test_paths_in_a_file_are_beside_it(tmp_path: Path) -> None:
    """Those of systems; a rule in a file is given beside it."""
    path = tmp_path / "sweep.toml"
    path.write_text('systems = "mine.toml"\nrules = "mine.py:MINE"\n')
    with pytest.raises(InputError, match=r"sweep.toml: rule 'mine.py:MINE' is in a file"):
        sweep_of([str(path)], {})
    found = sweep_of([str(path)], {"rules": ["random"]})
    assert found.systems == (str(tmp_path / "mine.toml"),)
    assert found.rules == ("random",)


@pytest.mark.parametrize(
    ("change", "why"),
    [
        ({"system": "hex"}, r"unknown key 'system' \(did you mean 'systems'\?\)"),
        ({"systems": []}, "systems: expected one or more, found none"),
        ({"systems": [3]}, "systems: expected a text, found 3"),
        ({"systems": [{"n": 3}]}, "expected a table with a name"),
        ({"rules": ["nope"]}, "unknown rule 'nope'"),
        ({"rules": 3}, "rules: expected a text, found 3"),
        (
            {"clocks": "fre"},
            r"clocks: fre: expected one of lockstep, free \(did you mean 'free'\?\)",
        ),
        ({"clocks": []}, "clocks: expected one value or more"),
        ({"hesitate": 1.0}, "hesitate: 1, expected at least 0 and less than 1"),
        ({"hesitate": "much"}, "hesitate='much': expected a number"),
        ({"seeds": True}, "seeds: expected a number"),
        ({"seeds": []}, "seeds: expected one seed or more"),
        ({"seeds": [1, -1]}, "seeds: expected 0 or more, found -1"),
        ({"core": "fast"}, "core=fast: expected one of"),
        ({"max_rounds": 1.5}, "max_rounds=1.5: expected a whole number"),
        ({"timeout_s": 0}, "timeout_s=0: expected more than 0"),
        ({"timeout_s": float("nan")}, "timeout_s=nan: expected more than 0"),
        ({"timeout_s": "1"}, "timeout_s='1': expected a number"),
        ({"processes": 0}, "processes=0: expected 1 or more"),
        ({"faults": {"loss": 2}}, "faults: loss=2: expected 0 to 1"),
        ({"faults": {"losses": 1}}, "cannot read 'losses=1'"),
        ({"faults": {"slow": 0.5, "slow_factor": 0}}, "slow_factor=0: expected 1 to"),
        ({"faults": {"delay": 0.5, "delay_ms": -1}}, "delay_ms=-1: expected more than 0"),
        ({"faults": "loss=much"}, "faults: loss=much: expected a number"),
        ({"faults": "loss=nan"}, "faults: loss=nan: expected 0 to 1"),
    ],
)
def test_a_table_that_is_no_sweep_is_refused(change: dict[str, Any], why: str) -> None:
    """In one line that names the key, what was found and what was expected."""
    with pytest.raises(InputError, match=why):
        sweep_from_table(TABLE | change)


@pytest.mark.parametrize("text", ["", 'rules = "chain"\n'])
def test_a_file_that_is_neither_sweep_nor_system_is_refused(tmp_path: Path, text: str) -> None:
    """An empty one, and one that has forgotten its systems: the line has both names."""
    path = tmp_path / "sweep.toml"
    path.write_text(text)
    with pytest.raises(InputError, match=r"sweep\.toml: expected the systems of a sweep"):
        sweep_of([str(path)], {})


def test_a_sweep_in_a_file_is_named_alone(tmp_path: Path) -> None:
    """Not beside other systems; and errors in it begin with its name."""
    path = tmp_path / "sweep.toml"
    path.write_text("systems = 3\n")
    with pytest.raises(InputError, match=r"sweep\.toml: systems: expected a text"):
        sweep_of([str(path)], {})
    with pytest.raises(InputError, match="holds a sweep, expected it alone"):
        sweep_of(["hex", str(path)], {})
