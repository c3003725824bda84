"""Certificates as pages: their path, their schedule, and the chain that proves it."""

import json
from pathlib import Path

import pytest

from cubepath.coordinator.commands.main import main
from cubepath.coordinator.tools.viewing.pages import page_document

GOLDEN = Path(__file__).parents[4] / "logs" / "golden"
SYSTEM = "agv:graph=grid3x2,n=2"
MOVES = (((0, 0), (1, 0)), ((0, 1), (1, 1)), ((1, 0), (2, 0)), ((1, 1), (0, 1)), ((0, 1), (0, 0)))


@pytest.fixture
def proof(tmp_path: Path) -> Path:
    """Return a certificate of which one pair cancels; its moves lie beside it."""
    moves, path = tmp_path / "moves.jsonl", tmp_path / "proof.json"
    moves.write_text(
        "".join(json.dumps({"generator": "edge", "at": at}) + "\n" for at in MOVES), "utf-8"
    )
    assert main(["shorten", str(moves), "--system", SYSTEM, "--certificate", str(path)]) == 0
    return path


def view(proof: Path, output: Path, *more: str) -> int:
    of = str(proof.with_name("moves.jsonl"))
    return main(["view", str(proof), "--of", of, "--system", SYSTEM, "-o", str(output), *more])


def test_a_page_has_the_schedule_of_the_certificate_and_its_chain(proof: Path) -> None:
    """Also where the schedule is not the normal cube path: what is drawn is what is proved."""
    told = json.loads(proof.read_text())
    assert told["cubes"] == [[1], [3, 5]]
    told.update(chain=[1, 5])
    proof.write_text(json.dumps(told))
    page = proof.with_suffix(".html")
    assert view(proof, page) == 0
    found = page_document(page)
    given, schedule = found["paths"]
    assert (given["step"], given["level"], given["partner"]) == (
        "move",
        [1, 0, 2, 0, 2],
        [-1, 3, -1, 1, -1],
    )
    assert schedule["title"] == "certified schedule"
    assert [schedule["rows"].index(given["rows"][move - 1]) for move in (1, 5)] == schedule["chain"]
    assert schedule["ends"] == [1, 3]
    assert found["facts"][0][-1][1] == "proved: no schedule in the class has fewer than 2 cubes"


def test_a_certificate_of_a_recording_has_its_rounds(tmp_path: Path) -> None:
    """And may stand beside the recording itself."""
    proof, page = tmp_path / "proof.json", tmp_path / "both.html"
    log = str(GOLDEN / "hex-free-5.mcap")
    assert main(["shorten", log, "--certificate", str(proof)]) == 0
    assert main(["view", str(proof), log, "--of", log, "-o", str(page)]) == 0
    proved, _, executed, normal = page_document(page)["paths"]
    assert (proved["step"], proved["ends"]) == ("level", executed["ends"])
    assert sorted(proved["rows"]) == sorted(normal["rows"])


@pytest.mark.parametrize("suffix", [".png", ".gif"])
def test_pictures_and_films_of_certificates(suffix: str, proof: Path) -> None:
    """Whatever has a page can be drawn."""
    assert view(proof, proof.with_suffix(suffix), "--what", "schedule") == 0


def test_what_is_not_proved_is_not_drawn(proof: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The check that fails is named, with exit code 1."""
    proof.write_text(proof.read_text().replace('"chain":[1,3]', '"chain":[3,1]'))
    page = proof.with_suffix(".html")
    assert view(proof, page) == 1
    assert f"{proof}: check 'chain' failed: " in capsys.readouterr().err
    assert not page.exists()


def test_a_certificate_alone_says_nothing(proof: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """It asks for its path; and a path that is no certificate has none."""
    page = str(proof.with_suffix(".html"))
    assert main(["view", str(proof), "--system", SYSTEM, "-o", page]) == 2
    assert f"{proof}: a certificate, " in capsys.readouterr().err
    moves = str(proof.with_name("moves.jsonl"))
    assert main(["view", moves, "--of", moves, "--system", SYSTEM, "-o", page]) == 2
    assert f"{moves}: no certificate, expected no --of" in capsys.readouterr().err
    assert not Path(page).exists()
