"""Live pages in a browser: they follow a run, pause it, step it, and are saved."""

from __future__ import annotations

import shutil
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from cubepath.coordinator.live.watching import Live
from cubepath.coordinator.runs.gathering import gathered
from cubepath.coordinator.runs.plan import Plan
from cubepath.coordinator.runs.running import Running
from cubepath.coordinator.viewing.pages import page_document, run_page
from cubepath.coordinator.viewing.shown import Shown
from cubepath.protocol.recordings.recording import read_recording
from watched_pages import followed

pytestmark = pytest.mark.browser

FLAGS = ("--headless", "--no-sandbox", "--disable-gpu", "--no-first-run")
Open = Callable[[str], Any]


@pytest.fixture
def opened() -> Iterator[Open]:
    """Open pages; fail if one complains, or asks another than who serves it."""
    from playwright.sync_api import sync_playwright

    said: list[str] = []
    path = shutil.which("chromium")
    assert path is not None, "no chromium: apt-get install chromium"
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=path, args=list(FLAGS))

        def open_page(address: str) -> Any:
            page = browser.new_page(viewport={"width": 1280, "height": 800})
            page.on("console", lambda message: said.append(f"console: {message.text}"))
            page.on("pageerror", lambda error: said.append(f"error: {error}"))
            own = (address, "data:", "blob:")

            def asked(request: Any) -> None:
                if not request.url.startswith(own):
                    said.append(f"asks for {request.url}")

            page.on("request", asked)
            page.goto(address)
            page.wait_for_selector("html[data-ready]")
            return page

        yield open_page
        browser.close()
    assert said == []


def until(page: Any, condition: str) -> None:
    """Wait until something holds in a page, whose policy lets nobody compile code in it."""
    for _ in range(2000):
        if page.evaluate(condition):
            return
        page.wait_for_timeout(5)
    raise AssertionError(f"never held: {condition}; {page.inner_text('#live')}")


def sites(page: Any, steps: int, path: int = 0) -> list[list[str]]:
    """Return the sites of the modules at the start, and after each step of a path."""
    found: list[list[str]] = page.evaluate(
        "([steps, path]) => Array.from({ length: steps + 1 }, (_, t) =>"
        " cubepath.state(t, path).modules.map((each) => each.site))",
        [steps, path],
    )
    return found


@pytest.mark.parametrize("spec", ["hex:n=6", "arm:n=4", "agv-labelled:graph=grid3x3,n=3"])
def test_a_page_follows_a_run_pauses_it_and_steps_it(
    spec: str, tmp_path: Path, opened: Open
) -> None:
    """By its buttons and keys; what it shows, and what is saved of it, is what is recorded."""
    log = tmp_path / "run.mcap"
    running = Running(Plan(spec, seed=2, processes=0, max_rounds=60, log=log))
    player = threading.Thread(target=running.play_from_the_start)
    with Live(running, paused=True) as live:
        page = opened(live.address)
        player.start()
        until(page, "cubepath.live.state?.paused")
        assert page.inner_text("#live-said") == "round 0: paused"
        assert page.inner_text("#live-pause") == "resume run"
        page.click("#live-step")
        until(page, "cubepath.live.path.steps === 1")
        page.keyboard.press("s")
        until(page, "cubepath.live.path.steps === 2 && cubepath.position === 2")
        assert running.round == 2
        assert page.inner_text("#live-said") == "round 2: paused"
        page.click("#live-pause")
        until(page, "cubepath.live.path.steps > 3")
        player.join(60)
        second = opened(live.address)
    for each in (page, second):
        until(each, "cubepath.live.ending !== null")
    steps = gathered(read_recording(log)).steps
    scene = running.scene
    actions = [step.actions for step in steps]
    cubes = gathered(read_recording(log)).heap.cube_path()
    for each in (page, second):
        assert sites(each, len(steps)) == followed(scene, actions)
        assert sites(each, len(cubes), 1) == followed(scene, cubes)
        assert each.inner_text("#live-said").startswith(f"ended in round {len(steps)}: ")
    until(page, f"cubepath.position === {len(steps)}")
    for name in ("heap", "schedule"):
        page.click(f"#tab-{name}")
    with page.expect_download() as download:
        page.click("#live-save")
    saved = tmp_path / "saved.html"
    download.value.save_as(saved)
    run_page(
        Shown(scene, actions, cubes, step_name="round"),
        tmp_path / "run.html",
    )
    kept, whole = page_document(saved), page_document(tmp_path / "run.html")
    assert kept["paths"] == whole["paths"]
    assert kept["worlds"][0]["sites"]["name"] == whole["worlds"][0]["sites"]["name"]
    again = opened(saved.as_uri())
    assert sites(again, len(steps)) == followed(scene, actions)
    assert again.query_selector("#live") is None


def test_who_looks_back_is_left_there_until_it_asks_for_the_newest(
    tmp_path: Path, opened: Open
) -> None:
    """The slider stays where a reader has put it while steps come in."""
    running = Running(Plan("hex:n=6", seed=2, processes=0, log=tmp_path / "run.mcap"))
    player = threading.Thread(target=running.play_from_the_start)
    with Live(running, paused=True) as live:
        page = opened(live.address)
        player.start()
        for count in (1, 2, 3):
            page.click("#live-step")
            until(page, f"cubepath.position === {count}")
        page.keyboard.press("ArrowLeft")
        page.keyboard.press("ArrowLeft")
        page.click("#live-step")
        until(page, "cubepath.live.path.steps === 4")
        page.wait_for_timeout(200)
        assert page.evaluate("cubepath.position") == 1
        page.keyboard.press("n")
        assert page.evaluate("cubepath.position") == 4
        page.select_option("#live-rate", "50")
        page.keyboard.press("p")
        player.join(60)
    until(page, "cubepath.live.ending !== null && cubepath.position === cubepath.live.path.steps")
