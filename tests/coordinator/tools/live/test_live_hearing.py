"""Claims, messages and the state complex of live pages: those of the recording, in a browser."""

import threading
from pathlib import Path
from typing import Any

import pytest

from cubepath.coordinator.commands.main import main
from cubepath.coordinator.runs.plan import Plan
from cubepath.coordinator.runs.run import Run
from cubepath.coordinator.tools.live.watching import LivePage
from cubepath.coordinator.tools.viewing.pages import page_document
from processes.watched_pages import Open, until

pytestmark = pytest.mark.browser

_SAID = """() => {
  const { data, world, steps } = cubepath.view.paths[0], { claims, heard } = data;
  const part = (table, names, step, read) => {
    const begin = step ? table.ends[step - 1] : 0, found = [];
    for (let each = begin; each < table.ends[step]; each++) {
      found.push(read(...names.map((name) => table[name][each])));
    }
    return found.sort();
  };
  const claimed = (module, row, won) => [module, world.nameOf(row), won];
  const delivered = (kind, one, other) => [heard.kinds[kind], one, other];
  const found = Array.from({ length: steps }, (_, step) => [
    part(claims, ["module", "row", "won"], step, claimed),
    part(heard, ["kind", "from", "to"], step, delivered),
  ]);
  const { complex } = cubepath.view.charts;
  return [found, complex ? complex.data.paths.map((path) => Array.from(path)) : null];
}"""


def said(page: Any) -> Any:
    return page.evaluate(_SAID)


@pytest.mark.parametrize("spec", ["agv-labelled:graph=grid3x2,n=3", "hex:n=6", "arm:n=4"])
def test_what_was_said_is_that_of_the_recording(spec: str, tmp_path: Path, opened: Open) -> None:
    """Claims won and lost, deliveries, and both paths in the state complex, step by step."""
    log = tmp_path / "run.mcap"
    running = Run(Plan(spec, seed=2, processes=2, max_rounds=60, log=log))
    player = threading.Thread(target=running.play_from_the_start)
    with LivePage(running, paused=True) as live:
        page = opened(live.address)
        player.start()
        for count in (1, 2):
            page.click("#live-step")
            until(page, f"cubepath.position === {count}")
        page.click("#live-pause")
        player.join(60)
        late = opened(live.address)
    assert main(["view", str(log), "-o", str(tmp_path / "run.html")]) == 0
    for each in (page, late):
        until(each, "cubepath.live.ending !== null")
    recorded = said(opened((tmp_path / "run.html").as_uri()))
    assert said(page) == said(late) == recorded
    assert any(claims for claims, _ in recorded[0])
    assert any(heard for _, heard in recorded[0])
    page.keyboard.press("m")
    page.keyboard.press("c")
    with page.expect_download() as download:
        page.click("#live-save")
    saved = tmp_path / "saved.html"
    download.value.save_as(saved)
    again = opened(saved.as_uri())
    assert said(again) == recorded
    whole = page_document(tmp_path / "run.html")["complex"]
    assert (page_document(saved)["complex"] or {}).get("paths") == (whole or {}).get("paths")
    if whole:
        again.click("#tab-complex")
        assert f"{whole['counts'][0]} vertices" in again.inner_text("#legend")
