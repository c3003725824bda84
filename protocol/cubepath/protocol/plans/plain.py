"""Plain lists of moves, as written by hand: `SITE -> SITE`, one per line, for any system.

::

    # hexagons
    (0,0) -> (1,-1) about (1,0)
    (2,0) -> (2,1)          # only one pivot is possible here

This is the project's own format. A site is written as in JSON, with round or square brackets; a
word that is no JSON is a string. The move is the one of the given system that is admissible at the
present state and takes a module from the first site to the second. A run of squares that slides by
one is named by any of its modules, or by the cell that becomes free and the cell that becomes
occupied. `about` names a site that is on before and after and that the move only reads, such as the
one a module pivots about. If several moves fit, the line is refused and the error names them.
"""

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import msgspec

from cubepath.protocol.core.actions import apply_in_place, why_inadmissible
from cubepath.protocol.core.catalogue import GeneratorPlacement, Move
from cubepath.protocol.core.errors import InputError, errors_at
from cubepath.protocol.core.sites import Site, in_order, site_from_json, site_text
from cubepath.protocol.core.system import System, local_only
from cubepath.protocol.path_files.moves import PathMove
from cubepath.protocol.plans.imported import ImportedPath, PlanRequest, none_beside
from cubepath.protocol.scenes.specs import scene_from_spec

_LINE = re.compile(r"(.+?)\s*->\s*(.+?)(?:\s+about\s+(.+?))?\s*")
_EXAMPLE = "'(0,0) -> (1,0)', maybe with 'about (0,1)'"
_TOLD = 3
"""Number of candidates that an error names."""


@dataclass(frozen=True, slots=True)
class _Line:
    """The content of a line."""

    source: Site
    target: Site
    about: Site | None

    def __str__(self) -> str:
        about = "" if self.about is None else f" about {site_text(self.about)}"
        return f"{site_text(self.source)} -> {site_text(self.target)}{about}"

    def names(self, move: Move) -> bool:
        """Return whether a move takes a module, or a whole run, from one site to the other."""
        if (self.source, self.target) not in move.motion:
            sources = {source for source, _ in move.motion}
            targets = {target for _, target in move.motion}
            if (sources - targets, targets - sources) != ({self.source}, {self.target}):
                return False
        action = move.action
        return self.about is None or (
            self.about in action.reads and all(self.about in end for end in action.ends)
        )


def read_plain(request: PlanRequest) -> ImportedPath:
    """Read a list of moves of the given system; errors as `ImportedPath` says."""
    path = request.path
    none_beside(request)
    if request.system is None:
        raise InputError(f"{path}: a list of moves, expected --system SYSTEM that they are of")
    scene = local_only(scene_from_spec(request.system), "shortening")
    lines = request.file.text().splitlines()

    def moves() -> Iterator[PathMove]:
        state = set(scene.start_state)
        for number, line in enumerate(lines, 1):
            words = line.partition("#")[0].strip()
            if not words:
                continue
            with errors_at(f"{path}:{number}"):
                move = _resolved(_parsed(words), scene.system, state)
            before = move.action.support & state
            apply_in_place(move.action, state)
            yield PathMove(move.action, GeneratorPlacement(move.generator, move.at), before)

    return ImportedPath(moves(), None, lambda: scene)


def _parsed(words: str) -> _Line:
    found = _LINE.fullmatch(words)
    if found is None:
        raise InputError(f"found {words!r}, expected {_EXAMPLE}")
    about = None if found[3] is None else _site(found[3])
    return _Line(_site(found[1]), _site(found[2]), about)


def _site(words: str) -> Site:
    try:
        value = msgspec.json.decode(words.replace("(", "[").replace(")", "]"))
    except (msgspec.DecodeError, RecursionError):
        if re.search(r"[\s(){}\[\],\"]", words):
            raise InputError(f"{words!r} is no site, expected {_EXAMPLE}") from None
        return words
    return site_from_json(value)


def _resolved(line: _Line, system: System, state: set[Site]) -> Move:
    """Return the move that a line means at a state; InputError if there is none, or several."""
    if line.source not in state:
        raise InputError(f"{line}: site {site_text(line.source)} is off, expected on")
    named = _named(line, system, state, (line.source,))
    possible = [move for move in named if move.possible(state)]
    if not possible:  # the mover of a run may be another module
        named = _named(line, system, state, in_order(state))
        possible = [move for move in named if move.possible(state)]
    distinct = list({move.action: move for move in possible}.values())
    if len(distinct) == 1:
        return distinct[0]
    if distinct:
        raise InputError(
            f"{line}: {_listed(move.action.label for move in distinct)} all do that, expected one"
            " to be meant: 'about SITE' tells those apart that read another site"
        )
    if line.about is not None and line.about not in state:
        raise InputError(f"{line}: site {site_text(line.about)} is off, expected on")
    if not named:
        taken = f", and {site_text(line.target)} is on" if line.target in state else ""
        raise InputError(f"{line}: no move of the system goes so{taken}")
    raise InputError(f"{line}: {_listed(why_inadmissible(move.action, state) for move in named)}")


def _named(line: _Line, system: System, state: set[Site], sites: Iterable[Site]) -> list[Move]:
    """Return the moves of the modules at these sites that a line could mean."""
    return [
        move
        for site in sites
        if site not in system.filled and site in state
        for move in system.moves_at(site)
        if line.names(move)
    ]


def _listed(words: Iterable[str]) -> str:
    found = list(dict.fromkeys(words))
    more = f"; and {len(found) - _TOLD} more" if len(found) > _TOLD else ""
    return "; ".join(found[:_TOLD]) + more
