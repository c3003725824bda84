"""Writing a path as lines: each action is encoded once for each of its two directions.

The lines of self-contained moves are put together from the texts of their sites, without an action.
"""

from collections.abc import Iterable, Iterator
from itertools import islice
from pathlib import Path

import msgspec

from cubepath.protocol.core.catalogue import GeneratorPlacement
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.output_files import written_whole
from cubepath.protocol.path_files.moves import PathMove
from cubepath.protocol.path_files.npz import table_of
from cubepath.protocol.path_files.numbered import PORTION, NumberedPath, number_moves

_encode = msgspec.json.Encoder().encode


def write_moves(path: Path | str, moves: Iterable[PathMove]) -> None:
    """Write a moves file that `read_moves` reads back; it is complete afterwards, or unchanged.

    Raises InputError if it cannot be written, or if an action with free sites or guards would have
    to be written by its contents with local states, which cannot express them.

    >>> played = play("hex:n=4")
    >>> write_moves("run.jsonl", shorten(played).given.moves)
    >>> len(list(read_moves("run.jsonl", played.scene)))
    18
    """
    write_path(path, number_moves(moves))


def write_path(target: Path | str, path: NumberedPath) -> None:
    """Write a moves file that `read_path` reads back; errors as in `write_moves`."""
    with written_whole(target) as stream:
        for portion in _lines(path):
            stream.write(b"".join(portion))


def _lines(path: NumberedPath) -> Iterator[list[bytes]]:
    written = _Tails(path)
    # By the action and the local state before the move, which is -1, 0 or 1.
    tails: list[bytes | None] = [None] * (3 * len(path.action_names))
    keys = iter((3 * path.numbers + path.ends + 1).tolist())
    names = path.names
    generated = [isinstance(name, GeneratorPlacement) for name in path.action_names]
    move = 0
    while some := list(islice(keys, PORTION)):
        portion: list[bytes] = []
        for key in some:
            tail = tails[key]
            if tail is None:
                first = key - key % 3
                tails[first : first + 3] = written.tails(first // 3)
                tail = tails[key]
            if tail is None:
                raise InputError(
                    f"move {move + 1}: nothing says from which of its two local states it goes,"
                    " expected that, as a line has it"
                )
            if generated[key // 3]:
                portion.append(tail)
            else:
                name = path.action_names[key // 3] if names is None else names[move]
                portion.append(b'{"id":' + _encode(name) + tail)
            move += 1
        yield portion


class _Tails:
    """The lines of moves by their generators, and the parts of all other lines after the id."""

    def __init__(self, path: NumberedPath) -> None:
        self._path = path
        table = table_of(path.supports, path.action_names)
        self._sites = [_encode(site) for site in table.sites]
        self._parts = {
            part: (starts.tolist(), sites.tolist())
            for part, (starts, sites) in table.parts.items()
            if len(sites) or part not in {"free", "guard"}
        }

    def tails(self, number: int) -> list[bytes | None]:
        """Return the lines, or the ends of them, of an action: from no known local state, 0 and 1.

        None where it has no line; InputError if it has none at all.
        """
        path, name = self._path, self._path.action_names[number]
        if isinstance(name, GeneratorPlacement):
            return [_encode(name) + b"\n"] * 3
        support, trace = self._list("support", number), self._list("trace", number)
        found = b',"support":[%b],"trace":[%b]' % (support, trace)
        if not path.stated[number]:
            return [found + b"}\n"] * 3
        if any(part in self._parts and self._list(part, number) for part in ("free", "guard")):
            raise InputError(
                f"{path.actions[number]!r} has free sites or guards, expected it by its generator"
            )
        states = self._list("before", number), self._list("after", number)
        there, back = (
            found + b',"before":[%b],"after":[%b]}\n' % each for each in (states, states[::-1])
        )
        return [None, there, back]

    def _list(self, part: str, number: int) -> bytes:
        starts, sites = self._parts[part]
        texts = self._sites
        return b",".join([texts[site] for site in sites[starts[number] : starts[number + 1]]])
