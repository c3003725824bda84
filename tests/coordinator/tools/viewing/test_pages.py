"""Pages as files: one file that loads nothing, in which names stay names."""

import json
import re
import shutil
from html.parser import HTMLParser
from itertools import zip_longest
from pathlib import Path

import pytest

from cubepath.coordinator.commands.main import main
from cubepath.coordinator.runs.continuing import what_if
from cubepath.coordinator.tools.comparison.run_comparison import diff
from cubepath.coordinator.tools.viewing.pages import page_document, run_page
from cubepath.protocol.core.errors import InputError
from processes.watched_pages import watched

GOLDEN = Path(__file__).parents[4] / "logs" / "golden"


class Elements(HTMLParser):
    """The elements of a page, and the addresses in their attributes."""

    def __init__(self) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.addresses: list[str] = []
        self.title = ""

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.addresses += [value or "" for name, value in attrs if name in {"src", "href"}]

    def handle_data(self, data: str) -> None:
        if self.tags and self.tags[-1] == "title":
            self.title += data


def elements(path: Path) -> Elements:
    found = Elements()
    found.feed(path.read_text())
    return found


def test_names_of_a_file_stay_names(tmp_path: Path) -> None:
    """A system whose names would end an element gives the same elements as any other."""
    for spec, name in (("own.toml", "own.html"), ("hex:n=5", "hex.html")):
        run_page(watched(spec, tmp_path).shown, tmp_path / name)
    own, plain = elements(tmp_path / "own.html"), elements(tmp_path / "hex.html")
    assert own.tags == plain.tags
    assert "b" not in own.tags
    (generator,) = page_document(tmp_path / "own.html")["worlds"][0]["rows"]["generators"]
    assert generator == "</script><script>alert(1)</script>"


def test_a_page_loads_nothing(tmp_path: Path) -> None:
    """No address in it but an empty one, and a policy that allows none."""
    path = tmp_path / "run.html"
    run_page(watched("hex:n=5", tmp_path).shown, path)
    assert elements(path).addresses == ["data:,"]
    assert not re.findall(r"https?://|@import|url\(", path.read_text())
    assert "default-src 'none'" in path.read_text()
    assert path.stat().st_size < 200_000


def test_the_same_run_gives_the_same_bytes(tmp_path: Path) -> None:
    """No dates and no order of sets are in a page."""
    for name in ("one.html", "other.html"):
        run_page(watched("agv-labelled:graph=grid3x3,n=3", tmp_path).shown, tmp_path / name)
    assert (tmp_path / "one.html").read_bytes() == (tmp_path / "other.html").read_bytes()


def test_a_name_that_is_no_page_is_refused(tmp_path: Path) -> None:
    """In one line, and before any work."""
    with pytest.raises(InputError, match=r"run\.htm: expected a name that ends in \.html"):
        run_page([], tmp_path / "run.htm")


@pytest.fixture
def log(tmp_path: Path) -> Path:
    return Path(shutil.copy(GOLDEN / "agv-6.mcap", tmp_path / "run.mcap"))


def test_the_command_writes_a_page_of_a_recording(
    log: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """With its rule and its counts in the head, and JSON as for pictures."""
    page = log.with_suffix(".html")
    assert main(["view", str(log), "-o", str(page), "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == {"log": str(log), "page": str(page)}
    found = page_document(page)
    facts = dict(found["facts"][0])
    assert facts["rule"] == "pibt"
    assert re.fullmatch(r"\d+ rounds, \d+ moves → \d+ cubes, \d+ moves, largest cube \d", facts[""])
    assert [path["step"] for path in found["paths"]] == ["round", "cube"]
    assert {"claims", "heard", "level", "partner"} <= found["paths"][0].keys()


def test_the_command_shows_two_recordings_side_by_side(
    log: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The names of the files tell them apart."""
    other, page = GOLDEN / "hex-free-5.mcap", log.with_suffix(".html")
    assert main(["view", str(log), str(other), "-o", str(page), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["other"] == str(other)
    found = page_document(page)
    assert found["names"] == ["run", "hex-free-5"]
    assert [path["step"] for path in found["paths"]] == ["round", "cube", "level", "cube"]


@pytest.mark.slow
def test_a_page_marks_where_a_run_departs_and_where_two_differ(tmp_path: Path) -> None:
    """A what-if at the first round of its rule; two runs at what `diff` finds first in them."""
    parent, log, page = GOLDEN / "agv-6.mcap", tmp_path / "if.mcap", tmp_path / "if.html"
    what_if(parent, "random", from_round=5, seed=7, max_rounds=9, processes=0, log=log)
    assert main(["view", str(log), "-o", str(page)]) == 0
    branch = [5, "what if random, seed 7"]
    assert [path.get("marks") for path in page_document(page)["paths"]] == [[branch], None]
    assert main(["view", str(parent), str(log), "-o", str(page)]) == 0
    one, _, other, _ = page_document(page)["paths"]
    found = diff(parent, log)
    assert found.choice is not None
    assert found.message is not None
    assert found.move is not None
    wanted: dict[tuple[int, int | None], set[str]] = {}
    for kind, each in (("choice", found.choice), ("message", found.message), ("move", found.move)):
        wanted.setdefault((each.round, each.module), set()).add(kind)
    assert other["marks"] == [branch, *one["marks"]]
    marked = {}
    for step, words in one["marks"]:
        what, _, module = words.removeprefix("first difference: ").partition(" of module ")
        marked[step, int(module)] = set(re.findall(r"choice|message|move", what))
    assert marked == wanted


@pytest.mark.slow
def test_a_page_of_moves_marks_the_first_that_differs(tmp_path: Path) -> None:
    """By its step in each of two paths, and not at all where there is none."""
    moves, page = tmp_path / "moves.jsonl", tmp_path / "run.html"
    assert main(["shorten", str(GOLDEN / "hex-5.mcap"), "--convert", "-o", str(moves)]) == 0
    lines = moves.read_text().splitlines(keepends=True)
    (tmp_path / "fewer.jsonl").write_text("".join(lines[:-2]))
    cubes = tmp_path / "cubes.jsonl"
    assert main(["shorten", str(moves), "--system", "hex:n=5", "-o", str(cubes)]) == 0
    for other in (tmp_path / "fewer.jsonl", cubes, moves):
        inputs = [str(moves), str(other)]
        assert main(["view", *inputs, "--system", "hex:n=5", "-o", str(page)]) == 0
        paths = page_document(page)["paths"]
        rows = [path["rows"] for path in (paths[0], paths[2])]
        pairs = enumerate(zip_longest(*rows))
        place = next((number for number, pair in pairs if pair[0] != pair[1]), None)
        for path in (paths[0], paths[2]):
            steps = [
                n for n, end in enumerate(path["ends"], 1) if place is not None and end > place
            ]
            assert path.get("marks", []) == [[step, "first difference: move"] for step in steps[:1]]
        assert (place is None) == (other == moves)


def test_moves_cubes_and_plans_have_pages_too(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Whatever a picture is drawn of."""
    moves, page = tmp_path / "moves.jsonl", tmp_path / "moves.html"
    assert main(["shorten", str(GOLDEN / "hex-5.mcap"), "--convert", "-o", str(moves)]) == 0
    assert main(["view", str(moves), "--system", "hex:n=5", "-o", str(page)]) == 0
    found = page_document(page)
    assert [path["step"] for path in found["paths"]] == ["move", "cube"]
    assert len(found["paths"][0]["ends"]) == len(found["paths"][0]["rows"]) == 28
    plan = GOLDEN.parents[1] / "tests" / "data" / "imports" / "lacam.txt"
    assert main(["view", str(plan), str(GOLDEN / "agv-6.mcap"), "-o", str(page)]) == 0
    paths = page_document(page)["paths"]
    assert [path["step"] for path in paths] == ["round", "cube", "round", "cube"]
    assert paths[0]["ends"] == [2, 4, 7, 8]
    assert capsys.readouterr().err == ""
