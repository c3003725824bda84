"""One HTML page that shows runs: it opens from disk and loads nothing from a network.

The parts of the page lie next to this module, in `page/`. Its document is JSON whose arrays of
numbers are stored separately: in their place is ``{"array": type, "at": bytes, "length":
numbers}``, and their contents follow the JSON, little-endian. All of it is deflated and written in
base64, which has no character with a meaning in HTML: no name in a user's file can end the element.
"""

import json
import zlib
from base64 import b64decode, b64encode
from collections.abc import Sequence
from html import escape
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np

from cubepath.coordinator.tools.viewing.run_view import Progress, RunView, document_of
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.output_files import written_whole

_TYPES = ("u1", "u2", "u4", "i4", "f4")
_ALIGNED = 8


def pack(document: dict[str, Any]) -> str:
    """Return the text of a document: dicts, lists, texts, numbers, and numpy arrays.

    Arrays are of shape (n,), and keep their numbers: integers in the least of the types that have
    room for them, others as 32-bit floats.

    >>> unpack(pack({"name": "</script>", "steps": np.array([1, 2, 300])}))
    {'name': '</script>', 'steps': [1, 2, 300]}
    """
    parts: list[bytes] = []
    size = 0

    def aside(value: Any) -> Any:
        nonlocal size
        if not isinstance(value, np.ndarray):
            raise TypeError(f"{type(value).__name__} in a document: expected JSON or an array")
        kind = _type_of(value)
        data = value.astype(f"<{kind}").tobytes()
        data += bytes(-len(data) % _ALIGNED)
        found = {"array": kind, "at": size, "length": len(value)}
        parts.append(data)
        size += len(data)
        return found

    head = json.dumps(document, default=aside, ensure_ascii=True, separators=(",", ":")).encode()
    head += b" " * (-len(head) % _ALIGNED)
    whole = len(head).to_bytes(_ALIGNED, "little") + head + b"".join(parts)
    return b64encode(zlib.compress(whole, 9)).decode("ascii")


def unpack(text: str) -> Any:
    """Return the document of a text of `pack`, with its arrays as lists."""
    whole = zlib.decompress(b64decode(text))
    length = int.from_bytes(whole[:_ALIGNED], "little")
    body = whole[_ALIGNED + length :]

    def back(found: dict[str, Any]) -> Any:
        if found.keys() != {"array", "at", "length"}:
            return found
        kind = np.dtype(f"<{found['array']}")
        return np.frombuffer(body, kind, count=found["length"], offset=found["at"]).tolist()

    return json.loads(whole[_ALIGNED : _ALIGNED + length], object_hook=back)


def _type_of(value: np.ndarray[Any, Any]) -> str:
    if value.dtype.kind == "f":
        return "f4"
    least, most = (int(value.min()), int(value.max())) if len(value) else (0, 0)
    for kind in _TYPES[:-1]:
        found = np.iinfo(kind)
        if found.min <= least and most <= found.max:
            return kind
    raise ValueError(f"numbers from {least} to {most}: expected 32 bits")


PAGE_SUFFIXES = (".html",)
_SCRIPTS = (
    "data",
    "paths",
    "motion",
    "theme",
    "layers",
    "stage",
    "lanes",
    "marks",
    "schedule",
    "heap",
    "complex",
    "clock",
    "inspector",
    "controls",
    "main",
)
"""The scripts of a page in the order in which they run."""
_POLICY, _SAVED_POLICY = 'http-equiv="Content-Security-Policy"', 'name="saved-policy"'
_BEGIN, _END = '<script type="text/plain" id="data">', "</script>"


def run_page(
    shown: RunView | Sequence[RunView], path: Path | str, *, progress: Progress | None = None
) -> None:
    """Write a page that shows a run beside its normal cube path, or two runs beside each other.

    `progress` is called with the name of each part before it is begun. InputError if the name of
    the file ends otherwise than in .html, a move is not admissible, a place cannot be drawn, or the
    file cannot be written.

    >>> played = play("hex:n=4")
    >>> cubes = normal_cube_path(played.path)
    >>> run_page(RunView(played.scene, played.steps, cubes), "run.html")
    >>> Path("run.html").read_text().count("<script")
    16
    """
    if Path(path).suffix.lower() not in PAGE_SUFFIXES:
        raise InputError(f"{path}: expected a name that ends in {' or '.join(PAGE_SUFFIXES)}")
    document = document_of([shown] if isinstance(shown, RunView) else shown, progress)
    if progress is not None:
        progress("write")
    text = page_text(document)
    with written_whole(path) as stream:
        stream.write(text.encode())


def page_text(document: dict[str, Any], *, live: bool = False) -> str:
    """Return the page of a document.

    A `live` one is fed by its server, which also says what the page may do: the policy in its head
    is one for the page that a reader saves.
    """
    parts = files("cubepath.coordinator.tools.viewing") / "page"
    scripts = [(parts / f"{name}.js").read_text("utf-8") for name in _SCRIPTS]
    following = [(parts / "live.js").read_text("utf-8")] if live else []
    # Filled in one pass, so that nothing in what is filled in is taken for a place to fill.
    before, style, body, rest = _split((parts / "page.html").read_text("utf-8"))
    return "".join(
        [
            before.replace(_POLICY, _SAVED_POLICY) if live else before,
            escape(document["title"]),
            style,
            (parts / "page.css").read_text("utf-8"),
            body,
            f"{_BEGIN}{pack(document)}{_END}\n",
            *(f"<script>\n{script}</script>\n" for script in scripts),
            *(f"<script data-live>\n{script}</script>\n" for script in following),
            rest,
        ]
    )


def _split(template: str) -> list[str]:
    """Return the four pieces of the template around its title, its style and its scripts."""
    before, _, rest = template.partition("<!-- title -->")
    style, _, rest = rest.partition("/* style */")
    return [before, style, *rest.split("<!-- scripts -->")]


def page_document(path: Path | str) -> Any:
    """Return the document of a page that `run_page` wrote, with its arrays as lists.

    Its keys are `format` (1); `title`, `facts` and `names`, the texts of the head; `worlds`, what
    the paths of one scene are made of; `paths`, for each input the path as executed or given, and
    its normal cube path; `beside`, the numbers of the two paths shown first; and `complex`, null
    or `counts`, `points` (x, y, z of each state), `edges`, `squares`, and for each path the state
    after each step.

    A world has

    - `spec`, `drawing`: the scene and its style of pictures;
    - `box`: left, right, low, high of the picture, in cells, y upwards;
    - `behind`, `before`: what lies below and above the modules and never changes, as `ops` in
      order and the `outlines` that they use;
    - `outline`, `thick`, `joints`: how a module looks that is a cell or a box, or a bar;
    - `modules`: the `colour` and the `word` of each;
    - `start`, `goal`: numbers of sites; -1 for a site of the goal that no module ever reached;
    - `sites`: `name`, `shape` (0 unseen, 1 cell, 2 bar, 3 box, 4 dot), `at` and `to` (x, y each),
      `colour`, `word`;
    - `rows`: moves in one direction, with `generator` (a number in `generators`), `at`, and from
      ``begins[row]`` on the `source` and `target` of each module, the mover first, with the
      `corner` about which it turns by `turn` radians counter-clockwise, or 0.

    A path has

    - `world`, `title`, `step`: its world, its name, and what a step is: round, level, move, cube;
    - `marks`: of the path as executed, if any: pairs of a step and its label on the time axis;
    - `before`: of a saved page that joined late: the number of steps before its first;
    - `ends`: the number of moves up to the end of each step; `rows`: the row of each move;
    - `below`, `depth`, `chain`: the move that each waits for, or -1; its depth in the heap, from 1;
      the longest chain;
    - `level`, `partner`: of the path as executed: the cube of each move, or 0 and then the move
      that it cancels with;
    - `claims`: of recordings: `ends`, and of each claim `module`, `row`, and `won` (0 lost,
      1 granted, 2 unknown);
    - `heard`: with rounds, the deliveries: `ends`, and of each `kind` (a number in `kinds`),
      `from` and `to`; or `left_out`, their number, if there are more than a million.
    """
    text = Path(path).read_text("utf-8")
    begin = text.index(_BEGIN) + len(_BEGIN)
    return unpack(text[begin : text.index(_END, begin)])
