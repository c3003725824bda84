"""How the command line is read: help, and what is wrong with the words of a command.

Room: coordinator.
"""

from __future__ import annotations

import argparse
import sys
from typing import Any

from cubepath.coordinator.commands.console import say


class Parser(argparse.ArgumentParser):
    """A parser that tells when its help cannot be written, as every answer does."""

    def _print_message(self, message: str, file: Any = None) -> None:
        if file is sys.stdout:
            say(message, end="")
        else:
            super()._print_message(message, file)
