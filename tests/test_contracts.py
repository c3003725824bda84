"""The import contracts of pyproject.toml: all are kept, and each is seen to be broken."""

import ast
import os
import re
import shutil
import subprocess
import sys
from copy import deepcopy
from functools import cache
from pathlib import Path
from typing import Any

import grimp
import pytest
from importlinter import Contract
from importlinter.api import read_configuration
from importlinter.contracts.forbidden import ForbiddenContract
from importlinter.contracts.layers import LayersContract

from faces import LARGE, ROOT, packages, sources

TYPES: dict[str, type[Contract]] = {"forbidden": ForbiddenContract, "layers": LayersContract}

BREAKS = {
    "the coordinator may use agents and protocol, agents the protocol, the protocol neither": (
        "protocol.plans.plain",
        "agents.rendering.style",
    ),
    "the protocol: each package may use those below it": (
        "protocol.path_files.durations",
        "protocol.systems.graphs",
    ),
    "the agents: each package may use those below it": (
        "agents.rules.registry",
        "agents.environments.world",
    ),
    ("the coordinator: each package may use those below it, the core no theory and no tools"): (
        "coordinator.runs.contents",
        "coordinator.commands.console",
    ),
    "theory and tools: each package may use those below it": (
        "coordinator.theory.complexes.links",
        "coordinator.theory.search.exact",
    ),
    "verification reaches nothing that runs, shortens or searches": (
        "coordinator.verification.proof",
        "coordinator.normal_form.heap",
    ),
    "nobody asks a system for its class": (
        "coordinator.theory.search.exact",
        "protocol.systems.graph",
    ),
}
"""For each contract an import, by importer and imported, that breaks this one and no other."""


@cache
def settings() -> dict[str, Any]:
    """Return the settings of import-linter and, under ``contracts_options``, the contracts."""
    return dict(read_configuration(str(ROOT / "pyproject.toml")))


def contracts() -> list[tuple[Contract, dict[str, Any]]]:
    """Return the contracts, each with the options that it is written with."""
    session = settings()["session_options"]
    return [
        (TYPES[options["type"]](options["name"], session, options), options)
        for options in settings()["contracts_options"]
    ]


@cache
def graph() -> grimp.ImportGraph:
    """Return who imports whom, as import-linter sees it."""
    (package,) = settings()["session_options"]["root_packages"]
    return grimp.build_graph(package, cache_dir=None)


def broken(*links: tuple[str, str]) -> set[str]:
    """Return the names of the contracts that are broken once some modules import others."""
    changed = deepcopy(graph())
    for importer, imported in links:
        for module in (importer, imported):
            assert f"cubepath.{module}" in changed.modules
        changed.add_import(importer=f"cubepath.{importer}", imported=f"cubepath.{imported}")
    return {
        contract.name
        for contract, _ in contracts()
        if not contract.check(deepcopy(changed), verbose=False).kept
    }


def test_all_contracts_are_kept() -> None:
    """As the project stands no contract is broken, and each has an import below that breaks it."""
    assert broken() == set()
    assert [contract.name for contract, _ in contracts()] == list(BREAKS)


@pytest.mark.parametrize("contract", BREAKS)
def test_each_contract_alone_is_broken(contract: str) -> None:
    """One import that the contract forbids breaks this contract, and no other."""
    assert broken(BREAKS[contract]) == {contract}


@pytest.mark.few(12)
@pytest.mark.parametrize(
    "link",
    [
        ("coordinator.normal_form.definitions", "coordinator.normal_form.heap"),
        ("protocol.recordings.recording", "agents.local.module"),
        ("protocol.core.actions", "coordinator.runs.gatherer"),
        *(
            ("coordinator.verification.rounds", room.removeprefix("cubepath."))
            for room in packages()
            if not room.startswith("cubepath.protocol.")
            and room.rpartition(".")[2] not in {"verification", "normal_form"}
        ),
    ],
)
def test_verification_is_broken_however_it_is_reached(link: tuple[str, str]) -> None:
    """Directly or through what it imports, by a face or a module: every other room is seen."""
    assert broken(link)


def test_verification_takes_of_the_core_what_it_cannot_do_without() -> None:
    """Of the actions `Action` and `commute`, of the definitions those of cubes and of normal."""
    allowed = {
        "cubepath.protocol.core.actions": {"Action", "commute"},
        "cubepath.coordinator.normal_form.definitions": {"is_cube", "too_late"},
    }
    taken: dict[str, set[str]] = {module: set() for module in allowed}
    for name, source in sources().items():
        if name.startswith("cubepath.coordinator.verification."):
            for node in ast.walk(source.tree):
                if isinstance(node, ast.ImportFrom) and node.module in taken:
                    taken[node.module] |= {alias.name for alias in node.names}
    assert taken == allowed


def test_the_core_names_theory_and_tools_in_one_table() -> None:
    """No module of the core but `plugins` names theirs, not even in a string; the face does."""
    core = [
        source.path
        for name, source in sources().items()
        if not name.startswith(("cubepath.coordinator.theory", "cubepath.coordinator.tools"))
    ]
    naming = {
        path.name
        for path in core
        if re.search(
            r"\bcoordinator\.(theory|tools)\.|\b(theory|tools)\.\w+\.\w+", path.read_text()
        )
    }
    assert naming == {"plugins.py"}


@pytest.mark.parametrize("large", LARGE)
def test_a_new_room_must_find_its_place(large: str) -> None:
    """A room that no contract knows breaks the one that has the rooms in their order."""
    changed = deepcopy(graph())
    changed.add_module(f"cubepath.{large}.annexe")
    (order,) = [
        contract
        for contract, options in contracts()
        if options.get("containers") == [f"cubepath.{large}"]
    ]
    assert not order.check(changed, verbose=False).kept


@pytest.fixture
def copied(tmp_path: Path) -> Path:
    """Return a folder with a copy of the project, in one package that hides the installed one."""
    for large in LARGE:
        shutil.copytree(
            ROOT / large / "cubepath",
            tmp_path / "cubepath",
            dirs_exist_ok=True,
            ignore=shutil.ignore_patterns("__pycache__"),
        )
    (tmp_path / "cubepath" / "__init__.py").touch()
    shutil.copy(ROOT / "pyproject.toml", tmp_path)
    return tmp_path


def lint_imports(folder: Path) -> tuple[int, str]:
    """Return the exit code of ``lint-imports`` in a folder, and what it prints."""
    program = "from importlinter.cli import lint_imports_command; lint_imports_command()"
    done = subprocess.run(
        [sys.executable, "-c", program, "--no-cache"],
        capture_output=True,
        text=True,
        timeout=100,
        check=False,
        cwd=folder,
        env={**os.environ, "COLUMNS": "300"},
    )
    return done.returncode, done.stdout


@pytest.mark.slow
def test_the_command_sees_what_is_written(copied: Path) -> None:
    """``lint-imports`` keeps all, and breaks all once these imports stand in functions."""
    code, text = lint_imports(copied)
    assert code == 0, text
    assert all(f"{name} KEPT" in text for name in BREAKS)
    for importer, imported in BREAKS.values():
        path = copied.joinpath("cubepath", *importer.split(".")).with_suffix(".py")
        with path.open("a") as stream:
            stream.write(f"\n\ndef _late() -> None:\n    import cubepath.{imported}\n")
    code, text = lint_imports(copied)
    assert code == 1
    assert all(f"{name} BROKEN" in text for name in BREAKS), text
