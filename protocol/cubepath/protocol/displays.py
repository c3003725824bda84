"""What a notebook shows of a value: the methods that it looks for.

The coordinator makes what is shown, and is loaded by name when a notebook asks: no package below it
knows it, and nothing is loaded where nothing is shown.
"""

from importlib import import_module
from typing import Any

_PLUGINS = "cubepath.coordinator.plugins"


class Displayed:
    """Something that shows itself in a notebook: its figures as a table, and a picture."""

    __slots__ = ()

    def _repr_html_(self) -> str:
        plugin = import_module(_PLUGINS).plugin
        html: str = plugin("html_of")(self)
        return html

    def _repr_pretty_(self, printer: Any, _cycle: bool) -> None:  # noqa: FBT001 - as IPython calls it
        plugin = import_module(_PLUGINS).plugin
        # A table would tear apart a list that the value is part of.
        inner = len(printer.stack) > 1
        printer.text(repr(self) if inner else plugin("text_of")(self))
