"""How long a page of a run takes to write, to open and to draw a frame, and how large it is.

    python tests/bench/bench_view.py [--quick] [--json]

Takes the extra `browser` and Debian's chromium, headless. "long" is a walk of a few hexagons, one
move a step; "wide" is a fleet of 400 vehicles that all move at once, "solid" 64 cubes that slide. A
frame is the time from one to the next while the page plays, at the medians of 120 frames, and at
the largest; drawing alone is the script's part of it. No frame is shorter than 16.7 ms, the rate of
the screen. The floor is an empty page that only asks for frames, in the same browser.
Writing is processor time, without the
search for the normal cube path. Targets: a median frame of at most 33 ms at 10,000 moves and of
100 ms at 100,000, and at most 2 MB besides the data.
"""

import argparse
import json
import shutil
import sys
import time
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1]))

from cubepath.agents.environments.rollouts import play
from cubepath.coordinator.normal_form.compiled_heap import FastHeap
from cubepath.coordinator.tools.viewing.pages import pack, page_text
from cubepath.coordinator.tools.viewing.run_view import RunView, document_of
from cubepath.protocol.core.actions import Action
from cubepath.protocol.core.system import Scene
from cubepath.protocol.scenes.specs import scene_from_spec
from samples.strategies import random_walk

FLAGS = ("--headless", "--no-sandbox", "--disable-gpu", "--disable-background-networking")
LONG, WIDE, SOLID = "hex:n=12", "agv:graph=grid40x40,n=400", "sliding-cubes:n=64,scene=random"
FRAMES = 120
MEASURE = """(frames) => new Promise((done) => {
  const gaps = [], drawn = [];
  const view = globalThis.cubepath?.view;
  if (view) {
    const draw = view.draw.bind(view);
    view.draw = () => {
      const began = performance.now();
      draw();
      drawn.push(performance.now() - began);
    };
    view.clock.looping = true;
    view.clock.play(1);
    view.changed();
  }
  let before = performance.now();
  const look = (now) => {
    gaps.push(now - before);
    before = now;
    if (gaps.length < frames) requestAnimationFrame(look);
    else done({ gaps: gaps.slice(1), drawn });
  };
  requestAnimationFrame(look);
})"""


def long_path(moves: int) -> tuple[Scene, Sequence[Sequence[Action]]]:
    """Return a walk of hexagons, a move a step."""
    return scene_from_spec(LONG), [(action,) for action in random_walk(LONG, moves, 1)]


def played_path(spec: str, at_once: int, moves: int) -> tuple[Scene, Sequence[Sequence[Action]]]:
    """Return rounds of a run that have these moves together, if each has `at_once` or more."""
    scene = scene_from_spec(spec)
    steps: list[Sequence[Action]] = []
    made = 0
    for step in play(scene, "random", seed=1, max_rounds=moves // at_once).steps:
        if made >= moves:
            break
        steps.append(step)
        made += len(step)
    return scene, steps


def median(values: Sequence[float]) -> float:
    """Return the middle value."""
    return sorted(values)[len(values) // 2]


def page_of(scene: Scene, steps: Sequence[Sequence[Action]], path: Path) -> dict[str, float]:
    """Write a page, and return how long that took and how large it and its data are."""
    heap = FastHeap(telling=True)
    heap.extend(action for step in steps for action in step)
    shown = RunView(scene, steps, heap.cube_path(), heap.normal_form())
    began = time.process_time()
    document = document_of([shown])
    text = page_text(document)
    took = time.process_time() - began
    path.write_text(text)
    data = len(pack(document))
    return {
        "moves": heap.moves,
        "write_s": took,
        "page_kB": (len(text) - data) / 1e3,
        "data_kB": data / 1e3,
    }


def frames_of(browser: Any, path: Path) -> dict[str, float]:
    """Open a page, and return the times of its frames in milliseconds."""
    page = browser.new_page(viewport={"width": 1280, "height": 800})
    began = time.perf_counter()
    page.goto(path.as_uri())
    page.wait_for_selector("html[data-ready]", timeout=120_000)
    opened = time.perf_counter() - began
    found = page.evaluate(MEASURE, FRAMES)
    page.close()
    measured = {"open_s": opened, "frame_ms": median(found["gaps"]), "worst_ms": max(found["gaps"])}
    return measured | ({"draw_ms": median(found["drawn"])} if found["drawn"] else {})


def main() -> None:
    """Measure, and print a line for each page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="one small page of each kind")
    parser.add_argument("--json", action="store_true", help="print one JSON document")
    options = parser.parse_args()
    from playwright.sync_api import sync_playwright

    sizes = [500] if options.quick else [1000, 10_000, 100_000]
    rows: list[dict[str, Any]] = []
    with TemporaryDirectory() as folder, sync_playwright() as playwright:
        browser = playwright.chromium.launch(
            executable_path=shutil.which("chromium"), args=list(FLAGS)
        )
        floor = Path(folder) / "floor.html"
        floor.write_text("<!doctype html><html data-ready><title>floor</title></html>")
        rows.append({"kind": "floor", **frames_of(browser, floor)})
        for kind, make in (
            ("long", long_path),
            ("wide", partial(played_path, WIDE, 100)),
            ("solid", partial(played_path, SOLID, 5)),
        ):
            for size in sizes:
                path = Path(folder) / f"{kind}-{size}.html"
                rows.append(
                    {"kind": kind, **page_of(*make(size), path), **frames_of(browser, path)}
                )
                if not options.json:
                    print(line(rows[-1]), flush=True)
        browser.close()
    print(json.dumps(rows) if options.json else line(rows[0]))


def line(row: dict[str, Any]) -> str:
    """Return a row as text."""
    return "  ".join(
        f"{name} {value:,.1f}" if isinstance(value, float) else f"{name} {value}"
        for name, value in row.items()
    )


if __name__ == "__main__":
    main()
