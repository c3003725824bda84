"""A system of another distribution goes through every command, by what its class says of itself."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow


FLAWED = """
from dataclasses import replace

from cubepath.protocol import System
from switches_on_a_ring import RING, Ring, ring


class Bare(System):
    pass


class Taken(Ring):
    pass


class Start(Ring):
    table = "start"


NO_CLASS = replace(RING, name="no-class", system=int)
NO_TABLE = replace(RING, name="no-table", system=Bare)
TAKEN = replace(RING, name="taken", system=Taken)
START = replace(RING, name="start", system=Start)
"""
"""What a distribution may get wrong."""


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """Install a distribution with a system into a folder; return an environment that has it."""
    folder = tmp_path_factory.mktemp("site")
    shutil.copy(Path(__file__).parent / "samples" / "switches.py", folder / "switches_on_a_ring.py")
    info = folder / "switches_on_a_ring-1.0.dist-info"
    info.mkdir()
    metadata = "Metadata-Version: 2.1\nName: switches-on-a-ring\nVersion: 1.0\n"
    (info / "METADATA").write_text(metadata)
    (info / "entry_points.txt").write_text("[cubepath.systems]\nring = switches_on_a_ring:RING\n")
    return {**os.environ, "PYTHONPATH": str(folder)}


class Commands:
    """Runs commands in a folder of their own, with the distribution installed."""

    def __init__(self, folder: Path, environment: dict[str, str]) -> None:
        self.folder = folder
        self.environment = environment

    def __call__(self, *arguments: str, code: int = 0) -> str:
        """Return what a command answers; it must end with this exit code."""
        done = subprocess.run(
            [sys.executable, "-m", "cubepath.coordinator", *arguments],
            capture_output=True,
            text=True,
            timeout=100,
            check=False,
            env=self.environment,
            cwd=self.folder,
        )
        assert done.returncode == code, done.stderr
        return done.stdout if code == 0 else done.stderr

    def json(self, *arguments: str) -> dict[str, object]:
        """Return the document that a command answers with."""
        found = json.loads(self(*arguments, "--json"))
        assert isinstance(found, dict)
        return found


@pytest.fixture(scope="module")
def commands(tmp_path_factory: pytest.TempPathFactory, installed: dict[str, str]) -> Commands:
    """Return the commands, in a folder with the recording of a run in two processes."""
    found = Commands(tmp_path_factory.mktemp("work"), installed)
    run = ("run", "ring:n=6", "--seed=3", "--processes=2", "--hesitate=0.3")
    assert found.json(*run, "--max-rounds=40", "--log=ring.mcap")["moves"]
    return found


@pytest.fixture(scope="module")
def moves(commands: Commands) -> str:
    """Return the name of a file with a path on the ring, seven flips of which three are left."""
    order = (0, 4, 0, 1, 1, 2, 0)
    lines = [json.dumps({"generator": "flip", "at": place}) for place in order]
    (commands.folder / "moves.jsonl").write_text("\n".join(lines) + "\n")
    return "moves.jsonl"


@pytest.mark.thorough
def test_it_is_listed(commands: Commands) -> None:
    """It stands among the systems, behind those of the project, and the rule that fits it fits."""
    systems = json.loads(commands("system", "list", "--json"))
    assert systems[-1]["name"] == "ring"
    assert systems[-1]["keys"] == {"n": {"default": "6", "summary": "number of switches"}}
    rules = {
        rule["name"]: rule["systems"] for rule in json.loads(commands("rule", "list", "--json"))
    }
    assert "ring" in rules["random"]
    assert not any("ring" in rules[name] for name in ("chain", "tswap", "pibt", "word"))


@pytest.mark.thorough
def test_the_recording_of_a_run_is_verified_replayed_and_drawn(commands: Commands) -> None:
    """Modules in processes of their own play it, and other code derives the same."""
    assert commands.json("verify", "ring.mcap")["ok"]
    assert commands.json("replay", "ring.mcap")["same"]
    assert commands.json("log", "info", "ring.mcap")["family"] == "ring"
    for picture in ("ring.png", "ring.gif"):
        commands("view", "ring.mcap", "-o", picture)
        assert (commands.folder / picture).stat().st_size > 1000


@pytest.mark.thorough
def test_the_same_run_in_the_environment(installed: dict[str, str], commands: Commands) -> None:
    """In one process, over zenoh and in the recording: one edge path; text and pixels are drawn."""
    code = """
import numpy as np
from cubepath.agents import parallel_env

found = []
for options in ({}, {"transport": "zenoh", "processes": 1}):
    env = parallel_env("ring:n=5", max_cycles=6, render_mode="ansi", **options)
    observations, _ = env.reset(seed=4)
    seen = []
    while env.agents:
        actions = {
            name: int(np.flatnonzero(each["action_mask"])[-1])
            for name, each in observations.items()
        }
        observations, rewards, *_ = env.step(actions)
        seen.append([each["observation"].tolist() for each in observations.values()])
    found.append(seen)
    print(env.render())
    env.close()
assert found[0] == found[1] and len(found[0]) == 6, found
assert parallel_env("ring", render_mode="rgb_array").render().shape[2] == 3
"""
    done = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        timeout=100,
        check=False,
        env=installed,
        cwd=commands.folder,
    )
    assert done.returncode == 0, done.stderr
    assert "off" in done.stdout


@pytest.mark.thorough
def test_its_paths_are_shortened_and_proved(commands: Commands, moves: str) -> None:
    """The schedule is certified, its own lower bound is the proof that none is shorter."""
    options = ("--system=ring:n=6", "-o", "cubes.jsonl", "--certificate=cubes.certificate.json")
    found = commands.json("shorten", moves, *options, "--explain")
    assert (found["moves"], found["reduced_moves"], found["cubes"]) == (7, 3, 1)
    assert commands.json("improve", moves, "--system=ring:n=6", "--bounds")["optimal"] is True
    check = ("verify", "cubes.jsonl", "--of", moves, "--system=ring:n=6")
    assert commands.json(*check)["ok"]
    commands("shorten", moves, "--convert", "-o", "moves.npz", "--system=ring:n=6")
    assert commands.json("shorten", "moves.npz")["cubes"] == 1
    recorded = commands.json("improve", "ring.mcap", "--seconds=0.5")
    assert isinstance(recorded["improved"], int)


@pytest.mark.thorough
def test_its_optimum_is_proved_in_a_file(commands: Commands) -> None:
    """The clauses come from its moves alone, and the checker asks its class for them again."""
    (commands.folder / "far.jsonl").write_text(
        "".join(f'{{"generator": "flip", "at": {place}}}\n' for place in (3, 4, 5))
    )
    options = ("--system=ring:n=6", "--prove=20", "--proof=far.proof")
    found = commands.json("improve", "far.jsonl", *options)
    assert (found["improved"], found["lower_bound"], found["optimal"]) == (3, 3, True)
    check = ("verify", "far.proof", "--of", "far.jsonl", "--system=ring:n=6")
    checked = commands.json(*check)
    assert (checked["refuted"], checked["cubes"], checked["optimal"]) == (2, 3, True)


@pytest.mark.thorough
def test_its_own_bound_and_argument_are_used(commands: Commands) -> None:
    """Two neighbours never flip at one time: what the class says of that is the bound."""
    (commands.folder / "two.jsonl").write_text(
        '{"generator": "flip", "at": 23}\n{"generator": "flip", "at": 0}\n'
    )
    options = ("--system=ring:n=24", "--bounds", "--max-states=0")
    shown = commands("improve", "two.jsonl", *options)
    assert "2 (neighbours take turns)" in shown


@pytest.mark.parametrize(
    ("method", "body", "told"),
    [
        ("bounds", "yield from [][0]", "Late.bounds of raising: IndexError: list index out of"),
        (
            "ways",
            "from cubepath.protocol import Ways; return Ways(lambda site: site[9], False)",
            "Late.ways of raising: IndexError: tuple index out of range",
        ),
    ],
)
def test_what_its_methods_raise_is_one_line(
    tmp_path: Path, installed: dict[str, str], method: str, body: str, told: str
) -> None:
    """A bound or ways that fail are told by class and method."""
    arguments = {"bounds": "self, start, goal", "ways": "self"}[method]
    (tmp_path / "raising.py").write_text(
        "from dataclasses import replace\nfrom cubepath.protocol import Scene\n"
        "from switches_on_a_ring import RING, Ring\n\n"
        f"class Late(Ring):\n    table = 'late'\n    def {method}({arguments}):\n        {body}\n\n"
        "def late(name, values):\n"
        "    scene = RING.build(name, values)\n"
        "    return replace(scene, system=Late(scene.system.size))\n\n"
        "LATE = replace(RING, name='late', build=late, system=Late)\n"
    )
    info = tmp_path / "raising-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: raising\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text("[cubepath.systems]\nlate = raising:LATE\n")
    path = os.pathsep.join((str(tmp_path), installed["PYTHONPATH"]))
    commands = Commands(tmp_path, {**installed, "PYTHONPATH": path})
    lines = [json.dumps({"generator": "flip", "at": place}) for place in (0, 4, 1, 2)]
    (tmp_path / "moves.jsonl").write_text("\n".join(lines) + "\n")
    shorten = ("improve", "moves.jsonl", "--system=late:n=6", "--seconds=5")
    said = commands(*shorten, code=2)
    assert said.startswith(f"cubepath: {told}")
    assert said.count("\n") == 1


@pytest.mark.thorough
def test_a_schedule_is_carried_out(commands: Commands) -> None:
    """Of a recording, and of a cubes file in another scene of the class."""
    assert commands.json("run", "--schedule=ring.mcap", "--log=again.mcap", "--processes=2")[
        "schedule_cubes"
    ]
    assert commands.json("verify", "again.mcap")["ok"]
    (commands.folder / "two.cubes.jsonl").write_text(
        '{"moves": [{"generator": "flip", "at": 0}, {"generator": "flip", "at": 2}]}\n'
    )
    run = ("run", "ring:n=7", "--schedule=two.cubes.jsonl", "--log=seven.mcap", "--processes=0")
    assert commands.json(*run)["rounds"] == 1


@pytest.mark.thorough
def test_its_state_complex_is_computed_and_drawn(commands: Commands) -> None:
    """Four switches on a ring: states, homology, links, a file and a picture."""
    built = commands.json("complex", "ring:n=4", "--homology", "--link", "-o", "ring.json")
    assert built["states"] == 15
    assert built["npc"] is True
    commands("complex", "ring:n=4", "-o", "complex.png")
    assert (commands.folder / "complex.png").stat().st_size > 1000


@pytest.mark.thorough
def test_a_scene_of_it_is_a_file(commands: Commands, installed: dict[str, str]) -> None:
    """A TOML file with its own table is run; a bad one is refused with its place."""
    text = 'format = "cubepath-system-1"\nstart = [[0, "off"], [1, "off"], [2, "off"]]\n'
    (commands.folder / "mine.toml").write_text(text + "[ring]\nswitches = 3\n")
    run = ("run", "mine.toml", "--max-rounds=3", "--log=mine.mcap", "--processes=0")
    assert commands.json(*run)["rounds"] == 3
    (commands.folder / "bad.toml").write_text(text + "[ring]\nswitches = 2\n")
    assert "bad.toml: switches=2: expected at least 3" in commands("run", "bad.toml", code=2)
    (commands.folder / "none.toml").write_text(text + "[bell]\nswitches = 2\n")
    assert "none.toml" in commands("run", "none.toml", code=2)
    without = Commands(commands.folder, {**installed, "PYTHONPATH": ""})
    assert "ring" in without("verify", "ring.mcap", code=2)


@pytest.mark.slow
@pytest.mark.thorough
def test_a_broken_distribution_hurts_only_who_asks_for_it(
    installed: dict[str, str], tmp_path: Path
) -> None:
    """Beside one that cannot be loaded all else runs; `systems` and an unknown name say which."""
    info = tmp_path / "broken-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: broken\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text("[cubepath.systems]\nbroken = no_such_module:SYSTEM\n")
    path = os.pathsep.join((str(tmp_path), installed["PYTHONPATH"]))
    commands = Commands(tmp_path, {**installed, "PYTHONPATH": path})
    for spec in ("hex:n=3", "ring:n=3"):
        assert commands.json("run", spec, "--processes=0", "--max-rounds=1")["rounds"] == 1
    for arguments in (("system", "list"), ("run", "nothing")):
        said = commands(*arguments, code=2)
        assert "entry point broken of cubepath.systems (broken): ModuleNotFoundError" in said
    (tmp_path / "flawed.py").write_text(FLAWED)
    for name, flaw in (
        ("ring", "is no Family"),
        ("NO_CLASS", "<class 'int'> of 'no-class' is no class of System"),
        ("NO_TABLE", "Bare of 'no-table' does not define action, decode_site"),
        ("START", "table [start] of Start is a key that every scene has"),
    ):
        entry = f"[cubepath.systems]\nbroken = flawed:{name}\n"
        (info / "entry_points.txt").write_text(entry)
        assert flaw in commands("system", "list", code=2)
        assert commands.json("run", "ring:n=3", "--processes=0", "--max-rounds=1")["rounds"] == 1
    (info / "entry_points.txt").write_text("[cubepath.systems]\nbroken = flawed:TAKEN\n")
    assert "table [ring] of Ring is that of Taken" in commands("system", "list", code=2)
    said = commands("run", "ring:n=3", code=2)
    assert "ring:n=3: its system is of Ring, whose table [ring] is read by Taken" in said
