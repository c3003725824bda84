"""Progress bars: those of functions with ``progress=True``, and what is shown on any bar."""

from collections.abc import Callable
from importlib import import_module
from typing import Any

from cubepath.protocol.core.formatting import counted


def progress_bar(what: str, unit: str, total: int | None = None, *, shown: bool = True) -> Any:
    """Return a bar that suits a notebook, or else a terminal; without `shown` it does nothing."""
    # A notebook that lacks widgets is warned of that, but only where there is a bar.
    kind = import_module("tqdm.auto" if shown else "tqdm")
    return kind.tqdm(desc=what, unit=unit, total=total, disable=not shown)


def each_of(*watches: Callable[..., object] | None) -> Callable[..., None]:
    """Return a function that calls those of these that there are."""

    def call(*given: object) -> None:
        for watch in filter(None, watches):
            watch(*given)

    return call


def showing_run(bar: Any, *, free: bool) -> Callable[[Any], None]:
    """Return a function that shows what was gathered: rounds, or without rounds moves."""

    def show(gathered: Any) -> None:
        heap = gathered.live if free else gathered.heap
        _show_counts(bar, heap)
        bar.update(heap.moves - bar.n if free else 1)

    return show


def _show_counts(bar: Any, path: Any) -> None:
    text = f"{counted(path.moves, 'move')}, {counted(path.cubes, 'cube')}"
    bar.set_postfix_str(text, refresh=False)


class StageProgress:
    """What a bar shows of work in stages: the steps of each, and the best path of a search."""

    def __init__(self, bar: Any) -> None:
        self.bar = bar
        self._stage = ""

    def tick(self, stage: str, done: int, total: int = 0) -> None:
        """Show how much of a stage is done, and of how much if that is known."""
        if stage != self._stage:
            self._stage = stage
            self.bar.reset()
            self.bar.set_description(stage)
        self.bar.total = total or None
        self.bar.update(done - self.bar.n)

    def watch(self, better: Any) -> None:
        """Show a better path."""
        _show_counts(self.bar, better)

    def between(self, least: int, cubes: int) -> None:
        """Show which numbers of cubes are open."""
        text = f"{counted(cubes, 'cube')}, open: {least}..{cubes - 1}"
        self.bar.set_postfix_str(text, refresh=False)
