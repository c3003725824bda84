"""The faces of the rooms: what they offer, that it is there, and that it costs nothing to ask."""

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
from cubepath.coordinator import Shortened
from cubepath.coordinator.theory.complexes.state_complexes import StateComplex
from cubepath.protocol import Action, Scene
from faces import FACES, LARGE, ROOT, offered, packages, sources


@pytest.mark.parametrize("face", FACES)
def test_no_module_takes_the_place_of_a_name(face: str) -> None:
    """No name is that of a module of the package, which importing would put in its place."""
    assert not [name for name in offered(face) if f"{face}.{name}" in sources()]


def test_inside_the_project_names_come_from_the_modules_that_define_them() -> None:
    """No module imports from a face, which would load more and hide where a name is defined."""
    wrong = [
        f"{source.path.relative_to(ROOT)}:{node.lineno}"
        for source in sources().values()
        for node in ast.walk(source.tree)
        if (
            isinstance(node, ast.ImportFrom)
            and node.module in FACES
            and not all(f"{node.module}.{alias.name}" in sources() for alias in node.names)
        )
        or (isinstance(node, ast.Import) and {alias.name for alias in node.names} & {*FACES})
    ]
    assert not wrong


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
    """All packages together load nothing but themselves: no zenoh, matplotlib, numba."""
    everything = [*FACES, *packages()]
    found = loaded(*everything)
    foreign = {name for name in found if name.split(".")[0] not in sys.stdlib_module_names}
    assert foreign == {"cubepath", "cubepath.protocol.faces", *everything}


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
@pytest.mark.parametrize("face", FACES)
def test_all_names_come_with_a_star(face: str) -> None:
    """``from FACE import *`` gives what is offered."""
    names: dict[str, object] = {}
    exec(f"from {face} import *", names)  # noqa: S102 - no other way to have a star in a function
    assert set(offered(face)) == set(names) - {"__builtins__"}


def test_what_comes_from_a_face_is_pickled_by_its_module() -> None:
    """A pickle names the module that defines a class, so it can be read wherever that is there."""
    step = cubepath.protocol.Action([1, 2], [1, 2], [1], [2])
    for each in (step, cubepath.coordinator.homology):
        pickled = pickle.dumps(each)
        assert pickle.loads(pickled) == each  # noqa: S301 - our own
        assert b"core.actions" in pickled or b"complexes.homology_groups" in pickled


@pytest.mark.slow
@pytest.mark.parametrize("face", FACES)
def test_help_shows_what_is_offered(face: str) -> None:
    """``help(FACE)`` has every class and function, with what it is for."""
    text = pydoc.plain(pydoc.render_doc(face))
    for name in offered(face):
        assert name in text


def docstring(module: str, name: str) -> str | None:
    """Return what stands under a name where it is defined."""
    body = [
        inner
        for statement in sources()[module].tree.body
        for inner in (statement.body if isinstance(statement, ast.If) else [statement])
    ]
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
@pytest.mark.parametrize("face", FACES)
def test_every_public_name_says_what_it_is(face: str) -> None:
    """Functions, classes, types and constants of the faces have a docstring of their own."""
    missing = [
        f"{home}.{name}" for name, home in offered(face).items() if not docstring(home, name)
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
    public = {(face, name) for face in FACES for name in offered(face)}
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


def test_pytest_takes_no_module_that_runs_for_one_of_the_plugin() -> None:
    """It rewrites what stands at the top of the package, and warns of what is loaded already."""
    from _pytest.config import _iter_rewritable_modules

    tops = [ROOT / large / "cubepath" for large in LARGE]
    files = [f"cubepath/{each.relative_to(top)}" for top in tops for each in top.rglob("*.py")]
    assert set(_iter_rewritable_modules(files)) == set(LARGE)


@pytest.mark.slow
def test_python_runs_the_command_line() -> None:
    """``python -m cubepath.coordinator --version`` says the version that is installed."""
    done = subprocess.run(
        [sys.executable, "-m", "cubepath.coordinator", "--version"],
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
