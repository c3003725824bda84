"""The options of `router` and `join`: what is meant, and what is refused in one line."""

from __future__ import annotations

import argparse
import json
from contextlib import nullcontext
from functools import partial
from itertools import product
from pathlib import Path

import pytest

from cubepath.coordinator.commands.main import main
from cubepath.coordinator.commands.usage import module_numbers
from cubepath.coordinator.experiments.spec import Sweep, expand
from cubepath.coordinator.runs.plan import Plan, task_of
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.scenes.registry import all_families
from processes.command_line import refused


@pytest.mark.parametrize(
    ("text", "modules"),
    [("0", (0,)), ("0-7,9", (*range(8), 9)), ("9,3-4,1", (1, 3, 4, 9)), ("5-5", (5,))],
)
def test_modules_are_numbers_and_spans(text: str, modules: tuple[int, ...]) -> None:
    """In any order; the answer is in increasing order."""
    assert module_numbers(text) == modules


@pytest.mark.parametrize(
    "text", ["", "a", "1-", "-1", "3-1", "1,,2", "1-3,2", "0-9999999", "1 2", "\u0661"]
)
def test_what_names_no_modules_is_refused(text: str) -> None:
    """Also where one is named twice, or a million are."""
    with pytest.raises(argparse.ArgumentTypeError, match="expected numbers as 0-7,9, each once"):
        module_numbers(text)


@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        (("join", "--modules=0"), "the following arguments are required: --connect"),
        (("join", "--connect=tcp/h:1"), "the following arguments are required: --modules"),
        (("join", "--connect=tcp/h:1", "--modules=x"), "expected numbers as 0-7,9"),
        (("join", "--connect=h:1", "--modules=0"), "endpoint h:1: expected tcp/HOST:PORT or tls/"),
        (("join", "--connect=tcp/h:1", "--modules=0", "--as=3"), "expected process_N, found '3'"),
        (("join", "--connect=tcp/h:1", "--modules=0", "--as=process_03"), "expected process_N"),
        (("join", "--connect=tcp/h:1", "--modules=0", "--run=*"), "expected the twelve digits"),
        (("join", "--connect=tls/h:1", "--modules=0"), "expected a folder of certificates"),
        (("host", "router"), "the following arguments are required: --listen"),
        (
            ("host", "router", "--listen=tcp/h"),
            "endpoint tcp/h: expected tcp/HOST:PORT or tls/HOST:PORT",
        ),
        (
            ("host", "router", "--listen=tls/h:1"),
            "expected a folder of certificates (--secure DIR)",
        ),
        (
            ("host", "router", "--listen=tls/h:1", "--secure=none"),
            "none/authority.crt: No such file",
        ),
        (("run", "--wait-for=2"), "wait-for=2: nobody can join a private run"),
        (("run", "--listen=tcp/h:1", "--secure=none"), "expected tls/HOST:PORT with certificates"),
    ],
)
def test_what_cannot_be_meant_is_one_line(
    arguments: tuple[str, ...], line: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """With exit code 2, before anything is started."""
    try:
        code = main(arguments)
    except SystemExit as error:
        code = int(error.code or 0)
    captured = capsys.readouterr()
    assert (code, captured.out) == (2, "")
    assert line in captured.err
    assert captured.err.count("\n") == 1


@pytest.mark.parametrize("clock", ["lockstep", "free"])
def test_a_rule_that_does_not_fit_a_scene_is_refused_before_a_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, clock: str
) -> None:
    """Nothing is started or recorded."""
    monkeypatch.chdir(tmp_path)
    line = "rule 'chain': (-2, 0) to (0, 0) is no straight chain in order, expected one of random"
    options = ("hex-shapes", "--rule=chain", f"--clock={clock}")
    assert refused("run", *options) == f"cubepath: not for this scene: {line}"
    assert f"hex-shapes: not for this scene: {line}" in refused("sweep", *options, "--dry-run")
    assert not [*tmp_path.iterdir()]


@pytest.mark.slow
def test_rules_sweep_and_run_agree_on_what_fits(capsys: pytest.CaptureFixture[str]) -> None:
    """Every rule on the default scene of every family."""
    assert main(["rule", "list", "--json"]) == 0
    told = {each["name"]: each["systems"] for each in json.loads(capsys.readouterr().out)}
    assert "hex-shapes" not in told["chain"]
    for family, (rule, systems) in product(all_families(), told.items()):
        begin = partial(task_of, Plan(family, rule)), partial(expand, Sweep((family,), (rule,)))
        for what in begin:
            with nullcontext() if family in systems else pytest.raises(InputError):
                what()
