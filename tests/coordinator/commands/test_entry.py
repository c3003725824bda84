"""Where the command begins: an interrupt is one line from the first moment on."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from types import ModuleType

import pytest

from cubepath.coordinator.commands.entry import entry

MAIN = "cubepath.coordinator.commands.main"


class Interrupting:
    """Stands before all that finds modules, and is interrupted while the command is imported."""

    def find_spec(
        self,
        name: str,
        _path: Sequence[str] | None,
        _target: ModuleType | None = None,
    ) -> None:
        """Raise KeyboardInterrupt where the command is looked for."""
        if name == MAIN:
            raise KeyboardInterrupt


def test_an_interrupt_before_the_command_begins_is_one_line(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """With exit code 130, and nothing on standard output."""
    monkeypatch.delitem(sys.modules, MAIN, raising=False)
    monkeypatch.setattr(sys, "meta_path", [Interrupting(), *sys.meta_path])
    assert entry() == 130
    assert capsys.readouterr() == ("", "cubepath: interrupted\n")
