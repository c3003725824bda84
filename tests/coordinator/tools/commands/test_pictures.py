"""``cubepath view`` draws what it is asked for, and refuses in one line what it cannot draw."""

import json
import shutil
from pathlib import Path

import pytest
from PIL import Image

from cubepath.agents.rendering.style import DARK, GOAL, PAPER, palette
from cubepath.coordinator.commands.main import main
from processes.watched_pages import OWN

GOLDEN = Path(__file__).parents[4] / "logs" / "golden"


@pytest.fixture
def log(tmp_path: Path) -> Path:
    """Return a recording of 6 rounds or so, which have fewer cubes."""
    return Path(shutil.copy(GOLDEN / "agv-6.mcap", tmp_path / "run.mcap"))


def frames(path: Path) -> int:
    with Image.open(path) as image:
        return int(getattr(image, "n_frames", 1))


def numbers(log: Path, capsys: pytest.CaptureFixture[str]) -> dict[str, int]:
    """Return what ``cubepath log info`` says of a recording."""
    capsys.readouterr()
    assert main(["log", "info", str(log), "--json"]) == 0
    found: dict[str, int] = json.loads(capsys.readouterr().out)
    return found


@pytest.mark.thorough
def test_films_of_the_run_and_of_its_schedule(
    log: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A frame for the start and up to four for each round or cube; rounds if nothing is said."""
    film = log.with_suffix(".gif")
    found = numbers(log, capsys)
    assert found["cubes"] < found["rounds"]
    for options, count in (
        ([], found["rounds"]),
        (["--what", "run"], found["rounds"]),
        (["--what", "schedule", "--rate", "10"], found["cubes"]),
    ):
        assert main(["view", str(log), "-o", str(film), *options]) == 0
        assert 1 + count < frames(film) <= 1 + 4 * count


@pytest.mark.slow
def test_pictures_lie_beside_the_recording(log: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Without a name the picture has that of the recording; of run and schedule it is another."""
    shown = []
    for what in ("run", "schedule"):
        assert main(["view", str(log), "--what", what, "--json"]) == 0
        assert json.loads(capsys.readouterr().out) == {
            "log": str(log),
            "picture": str(log.with_suffix(".png")),
        }
        shown.append(log.with_suffix(".png").read_bytes())
    assert shown[0] != shown[1]


@pytest.mark.thorough
def test_a_scene_is_drawn_with_its_start_and_its_goal(tmp_path: Path) -> None:
    """Side by side, from a name or a file; at the goal labels say which module is which."""
    toml = tmp_path / "own.toml"
    toml.write_text(OWN)
    found = {}
    for spec in ("hex:n=5", "agv-labelled:graph=grid3x3,n=3", str(toml)):
        path = toml.with_suffix(".png")
        output = [] if spec == str(toml) else ["-o", str(path)]
        assert main(["view", spec, *output]) == 0
        with Image.open(path) as image:
            middle = image.width // 2
            halves = (0, 0, middle, image.height), (middle, 0, image.width, image.height)
            found[spec] = [colours_in(image.crop(half)) for half in halves]
    modules = [tuple(round(255 * part) for part in colour) for colour in palette(5)]
    goal = tuple(bytes.fromhex(GOAL[1:]))
    one, other = found["hex:n=5"]
    assert set(modules) <= one
    assert goal in other
    assert not other & set(modules)
    one, other = found["agv-labelled:graph=grid3x3,n=3"]
    assert set(modules[:3]) <= one & other
    both = set[tuple[int, ...]]().union(*found[str(toml)])  # one picture, since it has no goal
    assert (set(modules[:2]) <= both, goal in both) == (True, False)


def colours_in(image: Image.Image) -> set[tuple[int, ...]]:
    """Return the colours that a hundred pixels or more have."""
    counted = image.convert("RGB").getcolors(1 << 24) or []
    return {colour for count, colour in counted if count >= 100 and isinstance(colour, tuple)}


@pytest.mark.thorough
def test_other_paths_are_drawn(tmp_path: Path) -> None:
    """Moves that stand for themselves, cubes of a system, and another program's plan."""
    moves = tmp_path / "moves.jsonl"
    edges = [[[0, 0], [1, 0]], [[0, 1], [1, 1]]]
    lines = [
        {"id": number, "support": edge, "trace": edge, "before": edge[:1], "after": edge[1:]}
        for number, edge in enumerate(edges)
    ]
    moves.write_text("\n".join(map(json.dumps, lines)))
    cubes = tmp_path / "cubes.jsonl"
    cubes.write_text(json.dumps({"moves": [{"generator": "edge", "at": at} for at in edges]}))
    imports = GOLDEN.parents[1] / "tests" / "data" / "imports"
    plan, room = imports / "lacam.txt", imports / "room.map"
    film, picture = str(tmp_path / "film.gif"), tmp_path / "picture.svg"
    for arguments, count in (
        ([str(moves)], 2),
        ([str(moves), "--what", "schedule"], 1),
        ([str(cubes), "--system", "agv:graph=grid2x2,n=2"], 1),
        ([str(plan), "--with", str(room)], 4),  # its rounds
    ):
        assert main(["view", *arguments, "-o", film]) == 0
        assert frames(Path(film)) == 1 + 4 * count
        assert main(["view", *arguments, "-o", str(picture)]) == 0
        assert picture.read_bytes().startswith(b"<?xml")
        picture.unlink()


def test_a_picture_for_print(log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The rounds that were asked for in order, each once; title and caption, on dark ground."""
    path = tmp_path / "print.svg"
    words = ["--title", "A chain <turns>", "--caption", "What is seen. " * 20, "--dark"]
    arguments = ["view", str(log), "-o", str(path), "--parts", "states", *words]
    assert main([*arguments, "--rounds", "0,2-4:2,4,1,2"]) == 0
    text = path.read_text()
    told = [text.index(f"<!-- {word} -->") for word in ("start", "round 2", "round 4", "round 1")]
    assert told == sorted(told)
    assert [text.count(f"<!-- {word} -->") for word in ("start", "round 2", "round 4")] == [1] * 3
    assert "<!-- A chain &lt;turns&gt; -->" in text
    assert text.count("seen.") == 20
    assert DARK.of(PAPER) in text
    assert "time step" not in text
    capsys.readouterr()
    assert main([*arguments, "--rounds", "1,100"]) == 2
    (said,) = capsys.readouterr().err.splitlines()
    assert "no round 100: expected 0, the start, to " in said
