"""One HTML page that shows runs: it opens from disk and loads nothing from a network.

The parts of the page lie next to this module, in `page/`. Its document is JSON, deflated and in
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

_PLACES = 6
"""Decimal places of the numbers of a page."""


def pack(document: dict[str, Any]) -> str:
    """Return the text of a document: dicts, lists, texts, numbers, and numpy arrays.

    >>> unpack(pack({"name": "</script>", "steps": np.array([1, 2, 300])}))
    {'name': '</script>', 'steps': [1, 2, 300]}
    """
    text = json.dumps(
        document, default=lambda array: np.round(array, _PLACES).tolist(), separators=(",", ":")
    )
    return b64encode(zlib.compress(text.encode())).decode("ascii")


def unpack(text: str) -> Any:
    """Return the document of a text of `pack`, with its arrays as lists."""
    return json.loads(zlib.decompress(b64decode(text)))


PAGE_SUFFIXES = (".html",)
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
    17
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
    folder = files("cubepath.coordinator.tools.viewing") / "page"
    parts = {each.name: each.read_text("utf-8") for each in folder.iterdir()}
    of_live = parts.pop("live.js")
    # In the order of their names: axes.js, which others extend, is the first.
    scripts = [parts[name] for name in sorted(parts) if name.endswith(".js")]
    # Filled in one pass, so that nothing in what is filled in is taken for a place to fill.
    before, style, body, rest = _split(parts["page.html"])
    return "".join(
        [
            before.replace(_POLICY, _SAVED_POLICY) if live else before,
            escape(document["title"]),
            style,
            parts["page.css"],
            body,
            f"{_BEGIN}{pack(document)}{_END}\n",
            *(f"<script>\n{script}</script>\n" for script in scripts),
            f"<script data-live>\n{of_live}</script>\n" if live else "",
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
      `colour`, `word`, and in three dimensions `kind` and `point` (x, y, z);
    - `solids`: null, or in three dimensions the `azimuth` and `tilt` of the first view in radians,
      the `kinds` of cells by their faces (x, y, z, ... each, counter-clockwise), and `fixed`, the
      obstacles and the goal: `kind`, `point` and `colour`;
    - `rows`: moves in one direction, with `generator` (a number in `generators`), `at`, and from
      ``begins[row]`` on the `source` and `target` of each module, the mover first. Each
      goes along its `legs`, from ``leg_begins`` on, or straight if it has none. A leg is seven
      numbers: a point of an axis, its direction, and the angle of a turn in radians,
      counter-clockwise; with angle 0 it is straight, by the direction.

    A path has

    - `world`, `title`, `step`: its world, its name, and what a step is: round, level, move, cube;
    - `marks`: of the path as executed, if any: pairs of a step and its label on the time axis;
    - `before`: of a saved page that joined late: the number of steps before its first;
    - `ends`: the number of moves up to the end of each step; `rows`: the row of each move;
    - `below`, `depth`: the move that each waits for, or -1; its depth in the heap, from 1;
    - `chain`: of a certificate, the moves of the chain that proves it;
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
