"""Live pages in a browser: they follow a run, pause it, step it, and are saved."""

import threading
from pathlib import Path
from typing import Any

import pytest

from cubepath.coordinator.runs.gathering import gathered
from cubepath.coordinator.runs.plan import Plan
from cubepath.coordinator.runs.run import Run
from cubepath.coordinator.tools.live.watching import LivePage
from cubepath.coordinator.tools.viewing.pages import page_document, run_page
from cubepath.coordinator.tools.viewing.run_view import RunView
from cubepath.protocol.recordings.recording import read_recording
from processes.watched_pages import Open, followed, until

pytestmark = pytest.mark.browser


def sites(page: Any, steps: int, path: int = 0) -> list[list[str]]:
    """Return the sites of the modules at the start, and after each step of a path."""
    found: list[list[str]] = page.evaluate(
        "([steps, path]) => Array.from({ length: steps + 1 }, (_, t) =>"
        " cubepath.state(t, path).modules.map((each) => each.site))",
        [steps, path],
    )
    return found


def named(document: Any) -> list[dict[str, Any]]:
    """Return the paths of a page with moves by name, without what was said on the way."""
    rows = document["worlds"][0]["rows"]
    names = [
        (rows["generators"][n], at) for n, at in zip(rows["generator"], rows["at"], strict=True)
    ]
    return [
        {key: value for key, value in path.items() if key not in {"claims", "heard"}}
        | {"rows": [names[row] for row in path["rows"]]}
        for path in document["paths"]
    ]


@pytest.mark.parametrize("spec", ["hex:n=6", "arm:n=4", "agv-labelled:graph=grid3x3,n=3"])
def test_a_page_follows_a_run_pauses_it_and_steps_it(
    spec: str, tmp_path: Path, opened: Open
) -> None:
    """By its buttons and keys; what it shows, and what is saved of it, is what is recorded."""
    log = tmp_path / "run.mcap"
    running = Run(Plan(spec, seed=2, processes=0, max_rounds=60, log=log))
    player = threading.Thread(target=running.play_from_the_start)
    with LivePage(running, paused=True) as live:
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
        until(page, "document.querySelector('#live-said').innerText === 'round 2: paused'")
        page.click("#live-pause")
        until(page, "cubepath.live.path.steps > 3")
        player.join(60)
        second = opened(live.address)
        until(second, "cubepath.live.path?.steps > 3")  # who has not asked yet is not waited for
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
    run_page(RunView(scene, actions, cubes, step_name="round"), tmp_path / "run.html")
    kept, whole = page_document(saved), page_document(tmp_path / "run.html")
    assert named(kept) == named(whole)
    assert {*whole["worlds"][0]["sites"]["name"]} <= {*kept["worlds"][0]["sites"]["name"]}
    again = opened(saved.as_uri())
    assert sites(again, len(steps)) == followed(scene, actions)
    assert again.query_selector("#live") is None


def test_who_looks_back_is_left_there_until_it_asks_for_the_newest(
    tmp_path: Path, opened: Open
) -> None:
    """The slider stays where a reader has put it while steps come in."""
    running = Run(Plan("hex:n=6", seed=2, processes=0, log=tmp_path / "run.mcap"))
    player = threading.Thread(target=running.play_from_the_start)
    with LivePage(running, paused=True) as live:
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
