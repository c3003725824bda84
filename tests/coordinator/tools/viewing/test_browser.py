"""Pages in a browser: headless Chromium, driven by Playwright. `pip install 'cubepath[browser]'`.

Run by .ci/run, which installs the browser, or with ``-m browser``. Whatever a page says on its
console, and whatever it asks the network for, fails the test that opened it.
"""

import re
from dataclasses import replace
from itertools import combinations
from pathlib import Path
from typing import Any

import pytest

from cubepath.agents.environments.rollouts import play
from cubepath.coordinator.commands.main import main
from cubepath.coordinator.tools.viewing.pages import run_page
from cubepath.coordinator.tools.viewing.run_view import RunView
from cubepath.protocol.scenes.specs import scene_from_spec
from processes.watched_pages import KINDS, Open, Watched, pivoting_squares, until, watched

pytestmark = pytest.mark.browser

GOLDEN = Path(__file__).parents[4] / "logs" / "golden"


@pytest.fixture
def run(tmp_path: Path) -> tuple[Path, Watched]:
    """Return a page of a run with empty rounds, and what is true of it."""
    found = watched("agv-labelled:graph=grid3x3,n=3", tmp_path)
    run_page(found.shown, tmp_path / "run.html")
    return tmp_path / "run.html", found


def settled(page: Any) -> Any:
    """Wait until a page has drawn what has changed; return it."""
    page.evaluate("new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")
    return page


def position(page: Any) -> float:
    return float(page.evaluate("cubepath.position"))


@pytest.mark.parametrize("spec", KINDS)
def test_positions_are_those_of_the_run(spec: str, tmp_path: Path, opened: Open) -> None:
    """After each step of both paths, forwards, and backwards again, in every kind of system."""
    found = watched(spec, tmp_path)
    run_page(found.shown, tmp_path / "run.html")
    page = opened(tmp_path / "run.html")
    for number, sites in enumerate(found.sites):
        steps = [*range(len(sites)), *reversed(range(len(sites)))]
        read = page.evaluate(
            "([path, steps]) => steps.map((t) =>"
            " cubepath.state(t, path).modules.map((each) => each.site))",
            [number, steps],
        )
        assert read == [sites[step] for step in steps]
    drawn = "[...document.querySelectorAll('canvas')].map((each) => each.toDataURL())"
    start = page.evaluate(drawn)
    moved = next(number for number, step in enumerate(found.shown.steps) if step)
    page.evaluate(f"cubepath.seek({moved + 0.5})")
    assert page.evaluate(drawn)[0] != start[0]


def test_a_square_that_pivots_is_never_where_another_is(tmp_path: Path, opened: Open) -> None:
    """On its way it is a whole cell away from those that stay, which it would slide through."""
    scene = pivoting_squares()
    played = play(scene, "random", seed=5, max_rounds=12)
    run_page(RunView(scene, played.steps, played.steps), tmp_path / "run.html")
    page = opened(tmp_path / "run.html")
    least = page.evaluate(
        """() => {
          const { view } = cubepath, [stage] = view.stages;
          let least = Infinity;
          for (let t = 0; t < stage.path.steps; t += 1 / 16) {
            cubepath.seek(t);
            const [one, two, three] = [0, 1, 2].map((module) => stage.poseOf(module));
            for (const [a, b] of [[one, two], [two, three], [one, three]]) {
              least = Math.min(least, Math.hypot(a.x - b.x, a.y - b.y));
            }
          }
          return least;
        }"""
    )
    assert least > 0.99


def test_the_keyboard_does_all(run: tuple[Path, Watched], opened: Open) -> None:
    """Space, arrows, Home and End, speed, loop, claims, the choice of a module, and Escape."""
    path, found = run
    page = opened(path)
    press = page.keyboard.press
    steps = len(found.sites[0]) - 1
    for key, wanted in (
        ("ArrowRight", 1),
        ("ArrowRight", 2),
        ("ArrowLeft", 1),
        ("End", steps),
        ("Home", 0),
    ):
        press(key)
        assert position(page) == wanted
    moved = [n for n, step in enumerate(found.shown.steps, 1) if step]
    press("Shift+ArrowRight")
    assert position(page) == min(moved[0], 1)
    press(" ")
    until(page, "cubepath.position > 1.2")
    press(" ")
    still = position(page)
    page.wait_for_timeout(120)
    assert position(page) == still
    press("b")
    until(page, "cubepath.position === 0")
    speed = settled(page).inner_text("#speed")
    press("+")
    assert settled(page).inner_text("#speed") != speed
    press("-")
    assert settled(page).inner_text("#speed") == speed
    press("2")
    assert settled(page).inner_text("#which") == "Module 2"
    assert found.sites[0][0][2] in settled(page).inner_text("#details")
    press("Escape")
    assert settled(page).inner_text("#which") == "Round 0, cube 0"


def test_words_name_one_step_at_a_time(run: tuple[Path, Watched], opened: Open) -> None:
    """While it plays the heading, the captions and the slider say the same rounds and cubes."""
    page = opened(run[0])
    page.evaluate("cubepath.view.clock.speed = 4")  # on a busy machine there are few frames
    page.keyboard.press(" ")
    seen = page.evaluate(
        """() => new Promise((done) => {
          const found = [];
          const texts = (query) => [...document.querySelectorAll(query)]
            .map((each) => each.innerText);
          const look = () => {
            const slider = document.getElementById("time").getAttribute("aria-valuetext");
            found.push([texts("#which"), texts(".where"), slider.split("; ")]);
            if (cubepath.view.clock.way) requestAnimationFrame(look); else done(found);
          };
          requestAnimationFrame(look);
        })"""
    )
    headings = set()
    for (heading,), captions, slider in seen:
        at = [each.partition(" of ")[0] for each in captions]
        assert [each.partition(" of ")[0] for each in slider] == at
        assert heading.lower() in {", ".join(at), *at}
        headings.add(heading)
    assert len(headings) > 3
    # A page that joined a run late counts rounds as the run does.
    page.evaluate("cubepath.view.paths[0].before = 40")
    page.keyboard.press("Home")
    page.keyboard.press("ArrowRight")
    assert settled(page).inner_text("#which") == "Round 41, cube 1"
    assert "round 41 of" in page.inner_text(".where")


def test_marks_stand_where_their_steps_begin(tmp_path: Path, opened: Open) -> None:
    """On the axis of the slider, none over another; a click leads there."""
    shown = watched("hex:n=5", tmp_path).shown
    marks = ((3, "one"), (3, "another"), (len(shown.steps), "a long word about the end of it"))
    run_page(replace(shown, marks=marks), tmp_path / "run.html")
    page = opened(tmp_path / "run.html")
    boxes = [each.bounding_box() for each in page.locator("#marks button").all()]
    texts = page.locator("#marks button").all_inner_texts()
    assert texts == [f"round {step}: {words}" for step, words in marks]
    axis = page.locator("#chart").bounding_box()
    lanes = page.evaluate(
        "[cubepath.view.charts.schedule.lanes.x(2), cubepath.view.clock.steps - 1]"
    )
    assert boxes[0]["x"] == pytest.approx(axis["x"] + lanes[0], abs=1)
    end = page.evaluate(f"cubepath.view.charts.schedule.lanes.x({lanes[1]})")
    assert boxes[2]["x"] + boxes[2]["width"] == pytest.approx(axis["x"] + end, abs=1)
    for one, other in combinations(boxes, 2):
        aside = one["x"] + one["width"] <= other["x"] or other["x"] + other["width"] <= one["x"]
        assert aside or abs(one["y"] - other["y"]) >= one["height"]
    page.locator("#marks button").last.click()
    assert position(page) == len(shown.steps)
    assert marks[2][1] in settled(page).inner_text("#details")
    page.select_option("select >> nth=0", "1")
    assert not settled(page).is_visible("#marks")


def test_a_part_is_repeated(run: tuple[Path, Watched], opened: Open) -> None:
    """Between the brackets, both ways, until the loop is given up."""
    page = opened(run[0])
    page.evaluate("cubepath.seek(2)")
    page.keyboard.press("[")
    page.evaluate("cubepath.seek(4)")
    page.keyboard.press("]")
    assert settled(page).get_attribute("#loop", "aria-pressed") == "true"
    assert page.evaluate("cubepath.view.clock.loop") == [2, 4]
    for _ in range(6):
        page.keyboard.press("+")
    for key in (" ", "b"):
        page.evaluate("cubepath.seek(3)")
        page.keyboard.press(key)
        seen = page.evaluate(
            """() => new Promise((done) => {
              const found = [];
              const look = () => {
                found.push(cubepath.position);
                if (found.length < 20) requestAnimationFrame(look); else done(found);
              };
              look();
            })"""
        )
        assert all(2 <= t <= 4 for t in seen)
        assert page.evaluate("cubepath.view.clock.way") != 0
    page.keyboard.press("l")
    assert settled(page).get_attribute("#loop", "aria-pressed") == "false"


def test_the_mouse_does_all(run: tuple[Path, Watched], opened: Open) -> None:
    """Buttons, the slider, the chart, and modules in the picture."""
    path, found = run
    page = opened(path)
    steps = len(found.sites[0]) - 1
    for button, wanted in (("#forward", 1), ("#back", 0), ("#last", steps), ("#first", 0)):
        page.click(button)
        assert position(page) == wanted
    box = page.locator("#time").bounding_box()
    page.mouse.click(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    assert position(page) == pytest.approx(steps / 2, abs=0.2)
    chart = page.locator("#chart").bounding_box()
    page.mouse.click(chart["x"] + chart["width"] * 0.75, chart["y"] + 30)
    assert position(page) == pytest.approx(0.75 * steps, abs=0.5)
    page.click("#first")
    settled(page)  # what is under the mouse is looked up in what is drawn
    spot = page.evaluate(
        """() => {
          const [stage] = cubepath.view.stages, { x, y } = cubepath.state(0).modules[1];
          const box = stage.canvas.getBoundingClientRect();
          return [box.x + stage.left + stage.scale * x, box.y + stage.top - stage.scale * y];
        }"""
    )
    page.mouse.move(*spot)
    until(page, "document.getElementById('which').textContent === 'Module 1'")
    page.mouse.click(*spot)
    page.mouse.move(5, 5)
    settled(page)
    assert settled(page).inner_text("#which") == "Module 1"
    page.click("#play")
    assert settled(page).get_attribute("#play", "aria-label") == "Pause"
    until(page, "cubepath.position > 0.5")


def test_what_a_move_waited_for_and_cancels_with(tmp_path: Path, opened: Open) -> None:
    """It is said of the move under the mouse, and is what the data has."""
    found = watched("sliding:p=2,q=1,n=4", tmp_path, rounds=20)
    run_page(found.shown, tmp_path / "run.html")
    page = opened(tmp_path / "run.html")
    said = page.evaluate(
        """() => {
          const path = cubepath.view.paths[0];
          return path.rows.map((_, move) => {
            cubepath.view.module = path.modulesOf(move)[0];
            cubepath.view.move = { path, move };
            cubepath.view.inspector.tell();
            return document.getElementById("details").innerText;
          });
        }"""
    )
    below, partner = page.evaluate(
        "[cubepath.view.paths[0].below, Array.from(cubepath.view.paths[0].data.partner)]"
    )
    for text, waits, cancels in zip(said, below, partner, strict=True):
        assert ("waited for\nnobody" in text) == (waits < 0)
        assert ("cancels with" in text) == (cancels >= 0)
    assert any(cancels >= 0 for cancels in partner)


def test_who_cannot_see_is_told(run: tuple[Path, Watched], opened: Open) -> None:
    """The slider and the pictures say where they are, each control has a name, focus is seen."""
    path, found = run
    page = opened(path)
    steps, cubes = (len(each) - 1 for each in found.sites)
    page.keyboard.press("ArrowRight")
    said = f"round 1 of {steps}; cube 1 of {cubes}"
    assert settled(page).get_attribute("#time", "aria-valuetext").startswith(said)
    assert settled(page).inner_text("#now").startswith(said)
    names: list[str] = []
    for _ in range(16):
        page.keyboard.press("Tab")
        names.append(
            page.evaluate(
                """() => {
                  const found = document.activeElement;
                  const label = found.getAttribute("aria-label") || found.innerText || "";
                  const outline = getComputedStyle(found).outlineStyle;
                  return outline === "none" ? "no outline: " + label : label || found.id;
                }"""
            )
        )
    assert {"Path on the left", "Play", "To the end", "Time step"} <= set(names)
    assert not [name for name in names if not name or name.startswith("no outline")]
    page.focus("#tab-schedule")
    page.keyboard.press("ArrowRight")
    assert settled(page).get_attribute("#tab-heap", "aria-selected") == "true"
    assert "longest chain" in settled(page).get_attribute("#chart", "aria-label")


def test_light_dark_and_print(run: tuple[Path, Watched], opened: Open) -> None:
    """Dark where that is preferred, and black on white on paper, pictures included."""
    look = """() => {
      const chart = document.getElementById("chart"), copy = document.createElement("canvas");
      copy.width = chart.width;
      copy.height = chart.height;
      const context = copy.getContext("2d", { willReadFrequently: true });
      context.drawImage(chart, 0, 0);
      const lane = context.getImageData(chart.width - 60, 14, 1, 1).data;
      return [getComputedStyle(document.body).backgroundColor, lane[0]];
    }"""
    light, dark = opened(run[0]), opened(run[0], scheme="dark")
    settled(dark)
    white, pale = light.evaluate(look)
    black, dim = dark.evaluate(look)
    assert (white, black) == ("rgb(255, 255, 255)", "rgb(21, 24, 28)")
    assert dim < 80
    assert pale > 200
    dark.emulate_media(media="print")
    until(dark, "document.documentElement.hasAttribute('data-print')")
    settled(dark)
    paper, lane = dark.evaluate(look)
    assert paper == white
    assert lane > 200
    assert not dark.is_visible("#player")
    # What was drawn for the screen is not stretched to the columns of the paper: a page holds it.
    fits = "[...document.querySelectorAll('canvas')].map(each => getComputedStyle(each).objectFit)"
    assert set(dark.evaluate(fits)) == {"contain"}
    assert b"/Count 1" in dark.pdf(format="A4")
    dark.emulate_media(media="screen")
    settled(dark)
    assert dark.evaluate(look)[0] == black


def test_a_run_begins_by_itself_unless_motion_is_unwanted(
    run: tuple[Path, Watched], opened: Open
) -> None:
    """Whoever opens a page sees the robot move; and it stops at the end."""
    page = opened(run[0], playing=True)
    until(page, "cubepath.position > 0.3")
    page.evaluate("cubepath.view.clock.speed = 64")
    until(page, "cubepath.view.clock.way === 0")
    assert position(page) == len(run[1].sites[0]) - 1
    assert ", " in settled(page).inner_text(".where")


def test_recordings_have_claims_and_messages(tmp_path: Path, opened: Open) -> None:
    """Both can be chosen, and change the picture; a path without them does not offer them."""
    page_path = tmp_path / "run.html"
    assert main(["view", str(GOLDEN / "agv-6.mcap"), "-o", str(page_path)]) == 0
    page = opened(page_path)
    lost = page.evaluate("Array.from(cubepath.view.paths[0].data.claims.won).indexOf(0)")
    step = page.evaluate(
        f"Array.from(cubepath.view.paths[0].data.claims.ends).findIndex((end) => end > {lost}) + 1"
    )
    page.evaluate(f"cubepath.seek({step})")
    assert "1 lost" in settled(page).inner_text("#details")
    picture = "document.querySelector('.stage canvas').toDataURL()"
    seen = [page.evaluate(picture)]
    for key in ("c", "m"):
        page.keyboard.press(key)
        settled(page)
        seen.append(page.evaluate(picture))
    assert len(set(seen)) == 3
    assert page.is_checked("#messages")
    assert not page.is_checked("#claims")


def test_two_recordings_side_by_side(tmp_path: Path, opened: Open) -> None:
    """Each in its own system; any path can be chosen for either side."""
    page_path = tmp_path / "both.html"
    logs = [str(GOLDEN / f"{name}.mcap") for name in ("hex-5", "agv-6")]
    assert main(["view", *logs, "-o", str(page_path)]) == 0
    page = opened(page_path)
    head = settled(page).inner_text("#facts")
    assert re.findall(r"\w+-\d(?=:)", head) == ["hex-5", "agv-6"]
    page.select_option("select >> nth=1", "1")
    settled(page)
    assert "cube" in settled(page).inner_text(".where >> nth=1")
    longest = page.evaluate("Math.max(...cubepath.view.stages.map((each) => each.path.steps))")
    assert settled(page).get_attribute("#time", "max") == str(longest)


@pytest.mark.parametrize("steps", [0, 3])
def test_paths_without_moves_are_shown_as_well(steps: int, tmp_path: Path, opened: Open) -> None:
    """A run that has not begun, and one all of whose moves cancel: each chart can be chosen."""
    scene = scene_from_spec("hex:n=3")
    site = scene.start[0]
    move = next(each for each in scene.system.moves_at(site) if each.possible(scene.start_state))
    run = [(move.action,), (move.action,), ()][:steps]
    run_page(RunView(scene, run, ()), tmp_path / "run.html")
    page = opened(tmp_path / "run.html")
    for tab in ("#tab-heap", "#tab-schedule"):
        page.click(tab)
        page.keyboard.press("End")
        assert f"round {steps} of {steps}" in settled(page).inner_text(".where")
    assert page.evaluate("cubepath.state(99, 1).steps") == 0


def test_who_is_smaller_than_a_pixel_is_seen(tmp_path: Path, opened: Open) -> None:
    """Of a line of a thousand modules the modules, and the goal far off, have pixels."""
    scene = scene_from_spec("hex:n=1000")
    run_page(RunView(scene, [()], ()), tmp_path / "run.html")
    page = opened(tmp_path / "run.html")
    seen = settled(page).evaluate(
        """() => {
          const { canvas } = cubepath.view.stages[0], found = { robot: 0, goal: 0 };
          const { data } = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height);
          for (let each = 0; each < data.length; each += 4) {
            const [red, green, blue, alpha] = data.subarray(each, each + 4);
            if (alpha < 60) continue;
            if (red > 180 && green < 140 && blue < 190) found.goal += 1;
            else if (Math.min(red, green, blue) < 200) found.robot += 1;
          }
          return found;
        }"""
    )
    assert seen["robot"] > 200
    assert seen["goal"] > 200


@pytest.mark.parametrize("spec", ["hex:n=5", "agv-labelled:graph=grid3x3,n=3"])
def test_charts_say_what_their_axes_are(spec: str, tmp_path: Path, opened: Open) -> None:
    """Sites or modules, and steps; none of the words is cut off at the side."""
    run_page(watched(spec, tmp_path).shown, tmp_path / "run.html")
    page = opened(tmp_path / "run.html")
    page.evaluate(
        """() => {
          const write = CanvasRenderingContext2D.prototype.fillText;
          globalThis.written = [];
          CanvasRenderingContext2D.prototype.fillText = function (word, x, y) {
            const wide = this.measureText(word).width;
            if (this.textAlign === "right") globalThis.written.push([word, x - wide]);
            else globalThis.written.push([word, 0]);
            write.call(this, word, x, y);
          };
        }"""
    )
    for tab, words in (("heap", {"site", "cube"}), ("schedule", {"module", "step"})):
        page.evaluate("globalThis.written.length = 0")
        page.click(f"#tab-{tab}")
        written = settled(page).evaluate("globalThis.written")
        assert words <= {word for word, _ in written}
        assert all(left >= 0 for _, left in written)
