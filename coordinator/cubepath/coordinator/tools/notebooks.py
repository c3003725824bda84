"""What notebooks show of scenes, runs, logs, paths, complexes and sweeps: figures and pictures.

The figures are those that commands print, the pictures those that they draw. Of what is large there
are figures alone. Whatever is wrong with a value is shown as well: nothing here raises.
"""

import re
from base64 import b64encode
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from functools import partial
from html import escape
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

from cubepath.coordinator.commands.console import table
from cubepath.coordinator.commands.run import outcome_rows
from cubepath.coordinator.plugins import plugin
from cubepath.coordinator.runs.contents import info, render
from cubepath.coordinator.runs.drawing import run_picture, scene_picture
from cubepath.coordinator.runs.gathering import gathered_in_full
from cubepath.coordinator.shortening.normal_path import shorten
from cubepath.coordinator.shortening.path_steps import PathSteps, steps_gathered, steps_of
from cubepath.protocol.core.formatting import visible
from cubepath.protocol.core.system import Scene
from cubepath.protocol.recordings.recording import Recording

MOVES_MAX, MODULES_MAX, MESSAGES_MAX, RUNS_MAX = 2_000, 100, 100_000, 1_000
"""Of what has more there is no picture, which would take many seconds."""


class Display(NamedTuple):
    """What is shown of a value: its figures, and parts in HTML, made only where that is shown."""

    figures: str
    parts: Sequence[Callable[[], str]] = ()


def html_of(value: object) -> str:
    """Return the display of a value of a class named in `DISPLAYS` as HTML."""
    shown = _display(value)
    rows = (re.split(r"(?<=\S) {2,}", line, maxsplit=1) for line in shown.figures.splitlines())
    cells = ('<td style="text-align:left">'.join(["<tr>", *map(escape, row)]) for row in rows)
    return "".join(["<table>", *cells, "</table>", *map(_part, shown.parts)])


def text_of(value: object) -> str:
    """Return the figures of a value of a class named in `DISPLAYS` as text."""
    return _display(value).figures


def _display(value: Any) -> Display:
    name = next(each.__name__ for each in type(value).__mro__ if each.__name__ in DISPLAYS)
    try:
        return DISPLAYS[name](value)
    except Exception as error:  # noqa: BLE001 - a recording may be damaged, or gone
        return Display(table([(name, error)]))


def _part(make: Callable[[], str]) -> str:
    try:
        return make()
    except Exception as error:  # noqa: BLE001 - the rest is shown whatever is wrong with a picture
        return f"<p>no picture: {escape(visible(str(error)))}</p>"


def _images(images: Iterable[bytes], width: str = "49%") -> str:
    """Return images in PNG, two in a row."""
    begin = f'<img style="max-width:{width}" src="data:image/png;base64,'
    return "".join(f'{begin}{b64encode(each).decode()}">' for each in images)


def _drawn(draw: Callable[[Path], object]) -> str:
    with TemporaryDirectory() as folder:
        path = Path(folder, "picture.png")
        draw(path)
        return _images([path.read_bytes()], "100%")


def _with_run(text: str, moves: int, modules: int, steps: Callable[[], PathSteps]) -> Display:
    """Return a display with the picture of a run, unless that is large."""
    if moves > MOVES_MAX or modules > MODULES_MAX:
        return Display(f"{text}\npicture  none: over {MOVES_MAX} moves or {MODULES_MAX} modules")

    def draw(path: Path) -> None:
        run = steps()
        how: dict[str, Any] = {"found": run.normal_form, "step_name": run.step_name}
        run_picture(run.scene, run.steps, run.cubes, path, **how)

    return Display(text, [partial(_drawn, draw)])


def _outcome(run: Any) -> Display:
    rows = outcome_rows(run) + ([] if run.error is None else [("error", run.error)])
    steps = partial(steps_gathered, Path(run.log), run.gathered, free=run.keepers is not None)
    return _with_run(table(rows), run.moves, run.modules, steps)


def _recording(recording: Recording) -> Display:
    found = info(recording)
    if recording.of_keys or found["messages"] > MESSAGES_MAX:
        return Display(render(found))
    free = recording.clock == "free"
    steps = lambda: steps_gathered(recording.path, gathered_in_full(recording), free=free)  # noqa: E731
    return _with_run(render(found), found["moves"] or 0, found["modules"], steps)


def _shortened(found: Any) -> Display:
    known = {key: each for key, each in found.document().items() if each is not None}
    rows = [(key.replace("_", " "), each) for key, each in known.items()]
    # Of a long path, finding the start takes a while.
    modules = len(found.given.start or ()) if found.moves <= MOVES_MAX else 0
    return _with_run(table(rows), found.moves, modules, partial(steps_of, found))


def _played(run: Any) -> Display:
    """Return the display of a run in memory, with rounds or without."""
    rounds = getattr(run, "rounds", None)
    steps = {"turns": run.turns} if rounds is None else {"rounds": len(rounds)}
    moves = len(run.moves) if rounds is None else sum(map(len, run.steps))
    rows = {"system": run.scene.spec, **steps, "moves": moves, "goal reached": run.reached}
    rows |= {} if run.failed is None else {"failed": run.failed}

    def found() -> PathSteps:
        path = steps_of(shorten(run))
        return replace(path, steps=run.steps, step_name="round") if "rounds" in rows else path

    return _with_run(table([*rows.items()]), moves, len(run.scene.start), found)


def _scene(scene: Scene) -> Display:
    goal = "none" if scene.goal is None else f"{len(scene.goal)} sites"
    rows = [("system", scene.spec), ("modules", len(scene.start)), ("goal", goal)]
    small = len(scene.start) <= MODULES_MAX
    return Display(table(rows), [partial(_drawn, partial(scene_picture, scene))] if small else [])


def _complex(scene: Scene, cubes: Any) -> Display:
    counts = " ".join(map(str, cubes.f_vector))
    rows = [("system", scene.spec), ("f-vector", counts), ("Euler characteristic", cubes.euler)]
    return Display(table(rows), [partial(_drawn, partial(plugin("draw_complex"), cubes))])


def _sweep(found: Any) -> Display:
    if not found.rows:
        return Display(table([("runs", 0)]))
    from cubepath.coordinator.experiments import plots, report, tables  # noqa: PLC0415 - matplotlib

    rows = tables.short_names(found.rows)
    made = (tables.runs_table, tables.price_table, tables.pairs_table, tables.growth_table)
    parts = [lambda: "".join(report.table_html(make(rows)) for make in made)]
    if len(rows) <= RUNS_MAX:
        parts.insert(0, lambda: _images(plot.png() for plot in plots.plots_of(rows, {})))
    return Display(table(report.run_facts(rows)), parts)


def _report(found: Any) -> Display:
    from cubepath.coordinator.experiments.report import table_html  # noqa: PLC0415 - as above

    pictures = (path.read_bytes() for path in found.files if path.suffix == ".png")
    tables = [lambda: _images(pictures), lambda: "".join(map(table_html, found.tables))]
    return Display(table([("runs", found.runs), ("page", found.files[0])]), tables)


DISPLAYS: dict[str, Callable[[Any], Display]] = {
    "FreeRollout": _played,
    "Outcome": _outcome,
    "Recording": _recording,
    "Rollout": _played,
    "RunLog": lambda log: _recording(log.recording),
    "Scene": _scene,
    "ShapeComplex": lambda found: _complex(found.scene, found.complex),
    "Shortened": _shortened,
    "StateComplex": lambda found: _complex(found.explored.scene, found.complex),
    "SweepReport": _report,
    "SweepResults": _sweep,
}
"""What is shown of each class, by its name, so that none is imported for it."""
