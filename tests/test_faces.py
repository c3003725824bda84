"""The faces of the rooms: what they offer, that it is there, and that it costs nothing to ask."""

from __future__ import annotations

import ast
import importlib
import importlib.metadata
import pickle
import pydoc
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import assert_type

import pytest

import cubepath.agents
import cubepath.coordinator
import cubepath.protocol
from cubepath.agents import RuleType
from cubepath.coordinator import Shortened, StateComplex
from cubepath.protocol import Action, Scene
from faces import FOR_USERS, ROOT, home, large_faces, offered, rooms, sources

PUBLIC = {
    "cubepath.protocol": """
        Action Bound CLOSED Catalogue Certificate CheckError CubepathError Durations EDGES EMPTY
        ExcludedError FILLED FIRST_LABEL Family FlipSystem FollowingFile FollowingHead FollowingLine
        FollowingProof Generator GeneratorPlacement GraphSystem HEXAGONS InputError Lattice
        LatticeSystem MODULE Message Move MoveName OptimalityProof PathMove PlanHints Record
        Recording RecordingWriter RuleError SQUARES Scene Site State System TabledSystem TimedLine
        VehicleGraph VehicleMove VehiclePlan Ways admissible all_families apply certificate_schema
        commute cube_schema decode filter_recording following_schemas hex_catalogue in_order
        merge_recordings move_schemas open_client read_certificate read_cubes read_durations
        read_following read_following_proof read_moves read_plan read_proof read_recording
        read_scene read_timetable scene_from_spec scene_from_toml scene_to_toml schema_of
        site_from_json split_recording timetable_schema why_inadmissible write_certificate
        write_cubes write_following write_following_proof write_moves write_proof write_timetable
    """,
    "cubepath.agents": """
        Checked Choice Chosen CubepathEnv CubepathVectorEnv Finding FreeEnv FreePlayed FreeRule
        GaveUp InitialKnowledge Note Observation Played PlayedMany Rule RuleType Seen VectorActors
        VectorKnowledge VectorRule View check_rule draw_below draw_fraction draw_pixels draw_text
        env observe parallel_env play play_free play_many policy_rule raw_env rule_named sb3_env
        sb3_rule sb3_save vector_actors_for vector_env
    """,
    "cubepath.coordinator": """
        Beyond Claim Collapsed Compared Converted CubicalComplex Divergence Explored Exported
        FaultRates FewestRounds FollowingTimetable Gatherer Homology Improved Lift Links Live
        LiveReplay Macro Optimum Outcome Overheard PathInput Plan Player PlayerStatus Position
        ProvedFewest ProvedOptimal Recorder Recovered Replayed Report Row Running ShapeComplex Sheet
        Shortened Shown StandardInstance StateComplex Status Surface Sweep SweepResults Tap Task
        Timetable Transitions Verification actions_at all_claims animate animate_beside ask audit
        beyond certificate_of check_certificate check_fewest_rounds check_following check_links
        check_optimality check_proof collapse complex_from_faces compute_claims contractibility
        convert diff draw_complex durations_of earliest end_state explore export f_vector
        fewest_rounds fewest_rounds_proof following_timetable gathered homology improve info is_cube
        is_normal lift lower_bound macro normal_cube_path only_class optimum page_document
        read_sweep read_vehicle_plan record recover replay replay_live run run_page run_picture
        shape_complex shorten standard start state_complex surface sweep task_of timetable_file
        to_networkx unfilled verify watch_run what_if write_complex write_report
    """,
    "cubepath.coordinator.testing": """
        Claimed Command Executed Link Listener Log Pattern Replay Rig Rule Seen Simulate StartRun
        Trial Tried fault faults live_modules other_rule replay_into replay_into_node scenarios
        trial_of
    """,
}
"""What users may rely on. A name that goes or changes its meaning is told in CHANGELOG.md."""

FACES = [*large_faces(), *rooms()]


@pytest.mark.parametrize("face", [*large_faces(), *FOR_USERS])
def test_what_users_may_rely_on(face: str) -> None:
    """The faces for users offer these names, neither more nor fewer."""
    assert sorted(importlib.import_module(face).__all__) == sorted(PUBLIC[face].split())


@pytest.mark.slow
@pytest.mark.parametrize("face", FACES)
def test_type_checkers_and_python_see_the_same(face: str) -> None:
    """Each name of ``__all__`` is imported for type checkers, and is that very object."""
    package = importlib.import_module(face)
    names = vars(package).get("__all__", [])
    assert sorted(offered(face)) == sorted(names)
    assert set(names) <= set(dir(package))
    for name in names:
        assert getattr(package, name) is getattr(importlib.import_module(home(face, name)), name)


@pytest.mark.parametrize("face", FACES)
def test_no_module_takes_the_place_of_a_name(face: str) -> None:
    """No name is that of a module of the package, which importing would put in its place."""
    assert not [name for name in offered(face) if f"{face}.{name}" in sources()]


@pytest.mark.parametrize("face", FACES)
def test_a_face_says_what_room_it_is(face: str) -> None:
    """The docstring begins with a line on what the room is and says in which large room it lies."""
    lines = (importlib.import_module(face).__doc__ or "").splitlines()
    assert lines[0].endswith(".")
    assert f"Room: {face.split('.')[1]}" in "\n".join(lines)


LOADS = """
import importlib, sys
import typing, warnings, importlib.metadata
before = set(sys.modules)
for face in sys.argv[1:]:
    importlib.import_module(face)
print(*sorted(set(sys.modules) - before))
"""


def loaded(*faces: str, also: str = "") -> set[str]:
    """Return what a fresh interpreter loads when it imports faces, and does what is said then."""
    done = subprocess.run(
        [sys.executable, "-c", LOADS.replace("print", f"{also}\nprint"), *faces],
        capture_output=True,
        text=True,
        timeout=100,
        check=True,
    )
    return set(done.stdout.split())


@pytest.mark.slow
def test_a_face_loads_nothing() -> None:
    """All faces together load nothing but themselves: no zenoh, matplotlib, numba, PettingZoo."""
    found = loaded(*FACES)
    foreign = {name for name in found if name.split(".")[0] not in sys.stdlib_module_names}
    assert foreign == {"cubepath", "cubepath.protocol.faces", *FACES}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "absent"),
    [
        ("protocol.scene_from_spec", {"zenoh", "matplotlib", "numba", "pettingzoo", "mcap"}),
        ("agents.RuleType", {"zenoh", "matplotlib", "numba", "pettingzoo"}),
        ("agents.parallel_env", {"zenoh", "matplotlib", "numba"}),
        ("coordinator.verify", {"matplotlib", "numba", "pettingzoo"}),
        ("coordinator.homology", {"zenoh", "matplotlib", "pettingzoo"}),
    ],
)
def test_a_name_loads_what_it_needs_and_no_more(name: str, absent: set[str]) -> None:
    """To ask for one name leaves alone what only others need."""
    face, _, offer = name.partition(".")
    found = loaded(also=f"from cubepath.{face} import {offer}")
    assert not absent & found


def test_what_is_not_offered_is_an_error() -> None:
    """The module and the name are told, as for any other module; so for an import."""
    with pytest.raises(AttributeError, match=r"'cubepath\.protocol' has no attribute 'commut'"):
        _ = cubepath.protocol.commut  # type: ignore[attr-defined]
    with pytest.raises(ImportError, match=r"cannot import name 'commut' from 'cubepath\.protocol'"):
        from cubepath.protocol import commut  # type: ignore[attr-defined] # noqa: F401


@pytest.mark.slow
@pytest.mark.parametrize("face", large_faces())
def test_all_names_come_with_a_star(face: str) -> None:
    """``from FACE import *`` gives what is offered."""
    names: dict[str, object] = {}
    exec(f"from {face} import *", names)  # noqa: S102 - no other way to have a star in a function
    assert set(PUBLIC[face].split()) == set(names) - {"__builtins__"}


def test_what_comes_from_a_face_is_pickled_by_its_module() -> None:
    """A pickle names the module that defines a class, so it can be read wherever that is there."""
    step = cubepath.protocol.Action([1, 2], [1, 2], [1], [2])
    for each in (step, cubepath.coordinator.homology):
        pickled = pickle.dumps(each)
        assert pickle.loads(pickled) == each  # noqa: S301 - our own
        assert b"core.actions" in pickled or b"complexes.homology_groups" in pickled


@pytest.mark.slow
@pytest.mark.parametrize("face", large_faces())
def test_help_shows_what_is_offered(face: str) -> None:
    """``help(FACE)`` has every class and function, with what it is for."""
    text = pydoc.plain(pydoc.render_doc(face))
    for name in PUBLIC[face].split():
        assert name in text


def docstring(module: str, name: str) -> str | None:
    """Return what stands under a name where it is defined."""
    body = sources()[module].tree.body
    for statement, following in zip(body, [*body[1:], None], strict=True):
        if isinstance(statement, ast.FunctionDef | ast.ClassDef) and statement.name == name:
            return ast.get_docstring(statement)
        targets = (
            statement.targets
            if isinstance(statement, ast.Assign)
            else [statement.target]
            if isinstance(statement, ast.AnnAssign)
            else []
        )
        parts = [part for target in targets for part in ast.walk(target)]
        if any(isinstance(part, ast.Name) and part.id == name for part in parts):
            match following:
                case ast.Expr(ast.Constant(str(text))):
                    return text
                case _:
                    return None
    return None


@pytest.mark.slow
@pytest.mark.parametrize("face", large_faces())
def test_every_public_name_says_what_it_is(face: str) -> None:
    """Functions, classes, types and constants of the large faces have a docstring of their own."""
    missing = [
        f"{home(face, name)}.{name}"
        for name in offered(face)
        if not docstring(home(face, name), name)
    ]
    assert not missing


@pytest.mark.slow
def test_types_are_those_of_the_modules(tmp_path: Path) -> None:
    """Type checkers see through the faces, two of them deep; that they do is checked with them."""
    scene = cubepath.protocol.scene_from_spec("agv:graph=P3,n=1")
    assert_type(scene, Scene)
    action = scene.system.action("edge", (0, 1))
    assert_type(action, Action)
    built = cubepath.coordinator.state_complex(cubepath.coordinator.explore(scene))
    assert_type(built, StateComplex)
    moves = tmp_path / "moves.jsonl"
    cubepath.protocol.write_moves(moves, [cubepath.protocol.PathMove(action, 1, frozenset({0}))])
    assert_type(cubepath.coordinator.shorten(moves), Shortened)
    assert_type(cubepath.agents.rule_named("tswap", scene.system), RuleType)


IMPORT = re.compile(
    r"\bfrom\s+(cubepath[\w.]*)\s+import\s+(?:\(([^)]*)\)|([\w ,]+))|\bimport\s+(cubepath[\w.]*)"
)


def imported(page: str) -> Iterator[tuple[str, str]]:
    """Yield what a page imports of the project, in blocks and in lines of the shell."""
    for module, in_brackets, in_line, alone in IMPORT.findall(page):
        names = (in_brackets or in_line or "").replace(",", " ").split()
        yield from [(module, name) for name in names] or [(alone, "")]


PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_what_is_shown_to_users_is_what_they_may_rely_on(page: Path) -> None:
    """The README and the docs import nothing but names of the three large faces."""
    public = {(face, name) for face, names in PUBLIC.items() for name in names.split()}
    assert not set(imported(page.read_text("utf-8"))) - public


def test_every_way_to_import_is_seen() -> None:
    """The test above would find a module, a name in brackets, and one in a line of the shell."""
    page = """
    from cubepath.a import one, two
    from cubepath.b.c import (
        three,
    )
    import cubepath.d
    `python -c "from cubepath.e import four; print(four)"`
    """
    assert list(imported(page)) == [
        ("cubepath.a", "one"),
        ("cubepath.a", "two"),
        ("cubepath.b.c", "three"),
        ("cubepath.d", ""),
        ("cubepath.e", "four"),
    ]


@pytest.mark.slow
@pytest.mark.parametrize("command", [["-m", "cubepath"], ["-m", "cubepath.coordinator"]])
def test_python_runs_the_command_line(command: list[str]) -> None:
    """``python -m cubepath --version`` says the version that is installed."""
    done = subprocess.run(
        [sys.executable, *command, "--version"],
        capture_output=True,
        text=True,
        timeout=100,
        check=True,
    )
    assert done.stdout == f"cubepath {importlib.metadata.version('cubepath')}\n"


def test_the_script_runs_the_command_line(capsys: pytest.CaptureFixture[str]) -> None:
    """``cubepath --version`` says the version that is installed, and ends well."""
    (main,) = {
        entry.load()
        for entry in importlib.metadata.entry_points(group="console_scripts", name="cubepath")
    }
    with pytest.raises(SystemExit) as ended:
        main(["--version"])
    assert ended.value.code == 0
    assert capsys.readouterr().out == f"cubepath {importlib.metadata.version('cubepath')}\n"
