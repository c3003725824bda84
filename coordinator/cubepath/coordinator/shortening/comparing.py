"""Whether two files hold equal paths, whatever form they have."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from cubepath.coordinator.shortening.path_input import PathInput, read_input
from cubepath.coordinator.verification.equality import difference
from cubepath.protocol.core.input_files import opened
from cubepath.protocol.core.sites import Site
from cubepath.protocol.plans.formats import NO_HINTS, PlanHints
from cubepath.protocol.recordings.recording import is_recording


def difference_of(
    paths: tuple[Path, Path],
    system: str | None = None,
    hints: PlanHints = NO_HINTS,
    progress: Callable[[int], object] | None = None,
    *,
    homotopic: bool = False,
) -> str | None:
    """Return the first difference between two paths in one line, None if there is none.

    They are equal up to swapping commuting moves, or with `homotopic` have one normal cube path.
    `system` is that of files of moves; a recording has its own. Errors are as for `read_input`.
    """
    one, other = (_read(path, system, hints, progress) for path in paths)
    return difference(one.actions, other.actions, _starts(one, other), homotopic=homotopic)


def _read(
    path: Path, system: str | None, hints: PlanHints, progress: Callable[[int], object] | None
) -> PathInput:
    with opened(path) as file:
        if is_recording(file):
            return read_input(file, None, NO_HINTS, progress)
        return read_input(file, system, hints, progress)


def _touched(path: PathInput) -> frozenset[Site]:
    return frozenset[Site]().union(*(action.support for action in path.numbered.actions))


def _starts(
    one: PathInput, other: PathInput
) -> tuple[frozenset[Site] | None, frozenset[Site] | None]:
    """Return the starts as far as both paths tell of the same sites."""
    first, second = one.start, other.start
    if first is None or second is None:
        return None, None
    if one.given_scene is not None and other.given_scene is not None:
        return first, second
    common = _touched(one) & _touched(other)
    return first & common, second & common
