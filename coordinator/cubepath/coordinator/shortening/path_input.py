"""A whole path from a file, with the state that it starts from where the file tells.

Room: coordinator. What proves things about a path needs all of its moves at one time.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from cubepath.coordinator.shortening.normal_path import moves_of
from cubepath.protocol.core.actions import Action
from cubepath.protocol.core.sites import Site
from cubepath.protocol.path_files.moves import PathMove
from cubepath.protocol.plans.formats import NO_HINTS, PlanHints
from cubepath.protocol.recordings.recording import read_recording
from cubepath.protocol.scenes.specs import scene_from_spec


@dataclass(frozen=True, slots=True)
class KnownPath:
    """The moves of a path, and the sites that are on at its start; None where nobody knows.

    Of a plan, or a moves file without a system, only the sites of the moves are known.
    """

    moves: tuple[PathMove, ...]
    start: frozenset[Site] | None

    @property
    def actions(self) -> tuple[Action, ...]:
        """Return the actions of the moves."""
        return tuple(move.action for move in self.moves)


def known_path(
    path: Path,
    system: str | None = None,
    hints: PlanHints = NO_HINTS,
    moves: Iterable[PathMove] | None = None,
) -> KnownPath:
    """Read a path; errors as `cubepath.coordinator.shortening.normal_path.shorten`.

    Where its moves have been read already, they are not read again.
    """
    kind, unread = moves_of(path, system, hints)
    found = tuple(unread if moves is None else moves)
    if kind == "recording":
        return KnownPath(found, read_recording(path).scene.start_state)
    if system is not None:
        return KnownPath(found, scene_from_spec(system).start_state)
    return KnownPath(found, _told(found))


def _told(moves: Sequence[PathMove]) -> frozenset[Site] | None:
    """Return what is on at the start: each site is as the first move that has it found it."""
    on: dict[Site, bool] = {}
    for move in moves:
        if move.before is None:
            return None
        for site in move.action.support:
            on.setdefault(site, site in move.before)
    return frozenset(site for site, is_on in on.items() if is_on)
