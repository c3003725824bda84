"""Explaining a schedule: its certificate in plain words, and when each move begins and ends.

A certificate is put into words only after `cubepath.coordinator.verification.proof` has accepted
it.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from itertools import chain, pairwise
from operator import itemgetter

import msgspec
import numpy as np
from numpy.typing import NDArray

from cubepath.coordinator.normal_form.certificate import certificate_of, link
from cubepath.coordinator.normal_form.timetable import Timetable, durations_of, earliest
from cubepath.coordinator.shortening.normal_path import Shortened
from cubepath.coordinator.shortening.path_input import PathInput
from cubepath.coordinator.verification.certificate import check_certificate
from cubepath.protocol.core.catalogue import GeneratorPlacement
from cubepath.protocol.core.errors import CheckError
from cubepath.protocol.core.formatting import counted
from cubepath.protocol.core.sites import Site, site_text
from cubepath.protocol.path_files.certificates import Certificate
from cubepath.protocol.path_files.durations import Durations, TimedLine, time_text
from cubepath.protocol.path_files.moves import PathMove, known_of_named
from cubepath.protocol.path_files.numbered import NumberedPath


def certified_path(found: Shortened) -> Certificate:
    """Return the checked certificate of a path; a CheckError means a bug in shortening.

    It lists the sites that are on at the end if the path lists those at the start.
    """
    path, start = found.path, found.given.start
    certificate = certificate_of(path, start=start, found=found.normal_form)
    for check, why in check_certificate(certificate, path.each_action, start).items():
        if why is not None:
            raise CheckError(f"the certificate does not hold: {check}: {why}")
    return certificate


def chain_in_words(path: NumberedPath, chain: Sequence[int]) -> Iterator[str]:
    """Yield a line for each move of a chain: its cube, its number, its name, why it waits."""
    if not chain:
        return
    width = len(str(max(chain)))
    moves = [path.move(move - 1) for move in chain]
    names = [name_text(move) for move in moves]
    longest = max(map(len, names))
    befores = pairwise(zip(chain, moves, strict=True))
    why = [""] + [f"  {_why(number, one, other)}" for (number, one), (_, other) in befores]
    for number, (move, name, reason) in enumerate(zip(chain, names, why, strict=True), 1):
        head = f"  cube {number:<{len(str(len(chain)))}}  move {move:<{width}}"
        yield f"{head}  {name:<{longest}}{reason}".rstrip()


def _why(before: int, one: PathMove, other: PathMove) -> str:
    """Say why the second of two moves waits for the first, which is move `before`."""
    # Sites that only encode an id are not in the input, and mean nothing to the reader.
    support, hidden = other.action.support, frozenset[Site]()
    if not isinstance(other.name, GeneratorPlacement):
        hidden = support - known_of_named(other.name, support)
    found = link(one.action, other.action, hidden)
    site = site_text(found.site)
    if found.before_writes and found.writes:
        return f"changes {site}, as move {before} does"
    if found.writes:
        return f"changes {site}, which move {before} needs as it is"
    return f"needs {site}, which move {before} changes"


def name_text(move: PathMove) -> str:
    """Return a readable name of a move: ``edge at [[0,0],[1,0]]``, or its id."""
    if isinstance(move.name, GeneratorPlacement):
        return f"{move.name.generator} at {msgspec.json.encode(move.name.at).decode()}"
    return str(move.name)


def certificate_in_words(path: PathInput, certificate: Certificate) -> list[str]:
    """Return lines on which moves cancelled, what the chain is, and what this proves."""
    pairs, cubes = len(certificate.cancelled), len(certificate.cubes)
    left = counted(certificate.moves - 2 * pairs, "move")
    lines = [f"{counted(pairs, 'pair')} of equal moves cancelled; {left} left, and none cancel."]
    if cubes:
        what = "A chain of one move" if cubes == 1 else f"A chain of {cubes} moves"
        lines.append(f"{what}, each of which does not commute with the one before:")
        lines += chain_in_words(path.numbered, certificate.chain)
    end = "" if certificate.end is None else " It ends where the input ends."
    lines.append(
        "Checked, so proved: the schedule is in the homotopy class of the input, and as the moves"
        f" of the chain must run one after another, no schedule in the class has fewer than"
        f" {counted(cubes, 'cube')}.{end}"
    )
    return lines


@dataclass(frozen=True, slots=True)
class TimedPath:
    """The remaining moves of a path, with their times.

    `places` are their places in the path, from 0, in ascending order, shape (remaining moves,);
    `durations` and `times` have one duration and one start for each.
    """

    path: NumberedPath
    places: NDArray[np.int64]
    durations: Sequence[Fraction]
    times: Timetable

    @property
    def makespan(self) -> int | str:
        """Return when the last move ends, in the form used in answers."""
        return time_text(self.times.makespan)

    def lines(self) -> list[TimedLine]:
        """Return the lines of the timetable, by start and then by place in the input."""
        names = self.path.cube_names(self.places)
        rows = zip(self.times.starts, self.durations, names, strict=True)
        return [
            TimedLine(time_text(start), time_text(duration), name)
            for start, duration, name in sorted(rows, key=itemgetter(0))
        ]

    def in_words(self) -> list[str]:
        """Return lines that say why no timetable of the class is shorter."""
        lines = [f"No timetable in the class is shorter than {self.makespan}; one after another:"]
        for place in self.times.critical:
            start, duration = self.times.starts[place], self.durations[place]
            move = int(self.places[place])
            lines.append(
                f"  from {time_text(start)} to {time_text(start + duration)}"
                f"  move {move + 1}  {name_text(self.path.move(move))}"
            )
        return lines if self.times.critical else []


def timed_path(path: PathInput, certificate: Certificate, durations: Durations) -> TimedPath:
    """Return the shortest timetable of the class; InputError as for `durations_of`."""
    times = durations_of(path.moves, durations)
    places = np.sort(np.fromiter(chain.from_iterable(certificate.cubes), dtype=np.int64)) - 1
    taken = [times[place] for place in places.tolist()]
    actions = [path.moves[place].action for place in places.tolist()]
    return TimedPath(path.numbered, places, taken, earliest(actions, taken))
