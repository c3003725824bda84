"""The table by which the core loads `theory` and `tools`, and by which commands are found."""

import ast

import pytest

from cubepath.coordinator import plugins
from cubepath.coordinator.commands.main import main
from faces import sources


def asked_for() -> set[str]:
    """Return the names in all calls of `plugin` in the sources."""
    return {
        ast.literal_eval(node.args[0])
        for source in sources().values()
        for node in ast.walk(source.tree)
        if isinstance(node, ast.Call)
        and isinstance(node.func, ast.Name)
        and node.func.id == "plugin"
    }


@pytest.mark.thorough
def test_what_is_asked_for_is_in_the_table_and_no_more() -> None:
    """A name that is misspelt in a call, or that nobody asks for, is found here."""
    assert asked_for() == set(plugins._FUNCTIONS)


@pytest.mark.parametrize("name", sorted(plugins._FUNCTIONS))
def test_each_function_is_there(name: str) -> None:
    """The module of the table has a function of this name."""
    assert callable(plugins.plugin(name))


@pytest.mark.parametrize("name", plugins.COMMANDS)
def test_the_module_of_a_command_adds_it(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    """Its help has the options of the command, and its line in the table."""
    with pytest.raises(SystemExit) as ended:
        main([*name.split(), "--help"])
    assert ended.value.code == 0
    text = " ".join(capsys.readouterr().out.split())
    assert f"usage: cubepath {name}" in text
    assert "--json" in text
    assert plugins.COMMANDS[name][1] in text
