"""The options of `router` and `join`: what is meant, and what is refused in one line."""

import argparse
import json
from contextlib import nullcontext
from functools import partial
from itertools import product

import pytest

from cubepath.coordinator.commands.main import main
from cubepath.coordinator.commands.usage import module_numbers
from cubepath.coordinator.experiments.spec import Sweep, expand
from cubepath.coordinator.runs.plan import Plan, task_of
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.scenes.registry import all_families


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


@pytest.mark.thorough
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
