"""Certificates and timetables from the command line: written, explained, and checked again."""

import json
from pathlib import Path
from typing import Any

import pytest

from cubepath.coordinator.commands.main import main
from cubepath.coordinator.runs.plan import Plan
from cubepath.coordinator.runs.run import run
from cubepath.coordinator.shortening.explain import certified_path
from cubepath.coordinator.shortening.normal_path import shorten
from cubepath.coordinator.verification.certificate import check_certificate
from cubepath.protocol.path_files.certificates import companion, read_certificate, write_certificate

SCENARIO = Path(__file__).parents[2] / "data" / "agv" / "grid8-12agents.json"

CROSSING = [
    {"generator": "edge", "at": [[0, 0], [1, 0]]},
    {"generator": "edge", "at": [[0, 1], [0, 0]]},
    {"generator": "edge", "at": [[0, 0], [0, 1]]},
    {"generator": "edge", "at": [[1, 0], [2, 0]]},
    {"generator": "edge", "at": [[0, 1], [0, 0]]},
]
SYSTEM = "agv:graph=grid3x2,n=2"


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Go to a folder with a moves file in each form."""
    write(tmp_path / "crossing.jsonl", CROSSING)
    both = [["dock", "lane"], ["lane", "door"]]
    lines: list[Any] = [
        {"id": n, "support": each, "trace": each, "before": each[:1], "after": each[1:]}
        for n, each in enumerate(both, 1)
    ]
    write(tmp_path / "told.jsonl", lines)
    ids = [{"id": each, "support": [["x"], "y"], "trace": [["x"]]} for each in "aba"]
    write(tmp_path / "named.jsonl", ids)
    write(tmp_path / "one.jsonl", ids[:1])
    monkeypatch.chdir(tmp_path)
    return tmp_path


def write(path: Path, lines: list[Any]) -> None:
    path.write_text("".join(json.dumps(line) + "\n" for line in lines))


def test_a_certificate_is_written_and_read_back(folder: Path) -> None:
    """Of self-contained moves, with where they end: from another start it proves nothing."""
    found = shorten(folder / "told.jsonl")
    write_certificate(folder / "proof.json", certified_path(found))
    proof = read_certificate(folder / "proof.json")
    assert proof.end == ["door"]
    actions = found.given.actions
    assert not any(check_certificate(proof, actions, found.given.start).values())
    assert any(check_certificate(proof, actions, frozenset({"lane"})).values())


Output = pytest.CaptureFixture[str]


def answer_of(capsys: Output, *arguments: str, code: int = 0) -> Any:
    assert main([*arguments, "--json"]) == code
    return json.loads(capsys.readouterr().out)


def test_the_chain_is_told_in_plain_words(folder: Path, capsys: Output) -> None:
    """Each move with its cube, its place in the input, its name, and why it waits."""
    assert main(["shorten", "crossing.jsonl", "--system", SYSTEM, "--explain"]) == 0
    lines = capsys.readouterr().out.splitlines()
    told = lines[lines.index("") + 1 :]
    assert told[:-1] == [
        "1 pair of equal moves cancelled; 3 moves left, and none cancel.",
        "A chain of 2 moves, each of which does not commute with the one before:",
        "  cube 1  move 1  edge at [[0,0],[1,0]]",
        "  cube 2  move 4  edge at [[1,0],[2,0]]  changes [1,0], as move 1 does",
    ]
    assert "no schedule in the class has fewer than 2 cubes" in told[-1]
    assert told[-1].endswith("It ends where the input ends.")


def test_what_stands_for_an_id_is_not_told(folder: Path, capsys: Output) -> None:
    """Of moves known by ids alone the site is one of the file, and nobody knows the end."""
    assert main(["shorten", "named.jsonl", "--explain"]) == 0
    out = capsys.readouterr().out
    assert '  cube 2  move 2  b  changes ["x"], as move 1 does\n' in out
    assert "\\u0000" not in out
    assert "It ends where" not in out


def test_sites_that_one_reads_and_the_other_writes(folder: Path, capsys: Output) -> None:
    """Who needs a site and who changes it is told the right way round."""
    lines = [
        {"id": "set", "support": ["lamp"], "trace": ["lamp"]},
        {"id": "see", "support": ["lamp", 1], "trace": [1]},
        {"id": "dim", "support": ["lamp", 2], "trace": ["lamp"]},
    ]
    write(folder / "lamp.jsonl", lines)
    assert main(["shorten", "lamp.jsonl", "--explain"]) == 0
    out = capsys.readouterr().out
    assert 'see  needs "lamp", which move 1 changes' in out
    assert 'dim  changes "lamp", which move 2 needs as it is' in out


def test_a_path_of_nothing_is_explained(folder: Path, capsys: Output) -> None:
    """No moves, no chain, and no fewer than no cubes."""
    (folder / "empty.jsonl").write_text("")
    assert main(["shorten", "empty.jsonl", "--explain"]) == 0
    assert "fewer than 0 cubes" in capsys.readouterr().out


def test_json_has_the_certificate(folder: Path, capsys: Output) -> None:
    """Under its key, in the form of the file, beside the usual ones."""
    found = answer_of(capsys, "shorten", "crossing.jsonl", "--system", SYSTEM, "--explain")
    assert found["cubes"] == 2
    assert found["certificate"] == {
        "format": "cubepath-certificate-1",
        "moves": 5,
        "cancelled": [[2, 3]],
        "cubes": [[1], [4, 5]],
        "chain": [1, 4],
        "end": [[0, 0], [2, 0]],
    }


def certify(capsys: Output, source: str, *options: str) -> Path:
    cubes = Path("cubes.jsonl")
    told = ["-o", str(cubes), "--certificate", str(companion(cubes))]
    answer_of(capsys, "shorten", source, *options, *told)
    return companion(cubes)


@pytest.mark.parametrize(
    ("source", "system", "end"),
    [
        ("crossing.jsonl", SYSTEM, True),
        ("told.jsonl", None, True),
        ("named.jsonl", None, False),
        (str(SCENARIO), None, True),
    ],
)
def test_a_certificate_of_a_file_is_verified(
    folder: Path, capsys: Output, source: str, system: str | None, end: bool
) -> None:
    """With the cubes file that it stands beside; the end where the start is known."""
    options = [] if system is None else ["--system", system]
    certificate = certify(capsys, source, *options)
    found = answer_of(capsys, "verify", "cubes.jsonl", "--of", source, *options)
    assert list(found) == ["ok", "checks", "moves", "reduced_moves", "cubes"]
    assert found["ok"]
    names = [check["name"] for check in found["checks"]]
    expected = ["form", "cancelled", "schedule", "reduced", "chain", *["end"] * end, "cubes"]
    assert names == expected
    alone = answer_of(capsys, "verify", str(certificate), "--of", source, *options)
    assert [check["name"] for check in alone["checks"]] == expected[:-1]


@pytest.mark.parametrize(
    ("source", "options", "proved"),
    [
        ("crossing.jsonl", ("--system", SYSTEM), (5, 3, 2)),
        ("named.jsonl", (), (3, 3, 3)),
        ("one.jsonl", (), (1, 1, 1)),
    ],
)
def test_what_is_proved_is_counted(
    folder: Path, capsys: Output, source: str, options: tuple[str, ...], proved: tuple[int, ...]
) -> None:
    """Moves, those that are left, and the cubes that no schedule of the class goes below."""
    arguments = ["verify", str(certify(capsys, source, *options)), "--of", source, *options]
    found = answer_of(capsys, *arguments)
    assert (found["moves"], found["reduced_moves"], found["cubes"]) == proved
    assert main(arguments) == 0
    cubes = "1 cube" if proved[-1] == 1 else f"{proved[-1]} cubes"
    told = capsys.readouterr().out.splitlines()[-1]
    assert told == f"proved: in the class of {source}, and none in it has fewer than {cubes}"


def test_a_certificate_of_a_recording_is_verified(folder: Path, capsys: Output) -> None:
    """One written from a recording proves the same as the one that is in it."""
    log = folder / "run.mcap"
    run(Plan("agv:graph=grid3x3,n=3", "random", processes=0, max_rounds=12, log=log))
    certificate = certify(capsys, str(log))
    assert answer_of(capsys, "verify", str(certificate), "--of", str(log))["ok"]
    found = answer_of(capsys, "verify", str(log))
    assert {"name": "certificate", "ok": True, "checked": True, "detail": ""} in found["checks"]
    inside = answer_of(capsys, "log", "info", str(log))["certificate"]
    proof = read_certificate(certificate)
    assert inside == {"cancelled": len(proof.cancelled), "chain": len(proof.chain)}


def test_what_does_not_hold_fails(folder: Path, capsys: Output) -> None:
    """Exit code 1, the check, and on standard error which."""
    path = certify(capsys, "crossing.jsonl", "--system", SYSTEM)
    proof = read_certificate(path)
    proof.chain[:] = [4, 5]
    write_certificate(path, proof)
    arguments = ["verify", str(path), "--of", "crossing.jsonl", "--system", SYSTEM]
    assert main(arguments) == 1
    told = capsys.readouterr()
    reason = "moves 4 and 5 are neighbours in the chain, but they commute"
    assert f"FAILED  chain      {reason}\n" in told.out
    assert "proved" not in told.out
    assert told.err == f"cubepath: {path}: checks failed: chain\n"


def test_a_certificate_of_another_path_fails(folder: Path, capsys: Output) -> None:
    """Of a path of other length its form fails; and nobody can tell an end without a start."""
    path = certify(capsys, "crossing.jsonl", "--system", SYSTEM)
    found = answer_of(capsys, "verify", str(path), "--of", "told.jsonl", code=1)
    detail = "it is of 5 moves, and the path has 2"
    assert found["checks"] == [{"name": "form", "ok": False, "detail": detail}]
    proof = certify(capsys, "named.jsonl")
    written = json.loads(proof.read_text())
    proof.write_text(json.dumps({**written, "end": ["y"]}))
    found = answer_of(capsys, "verify", str(proof), "--of", "named.jsonl", code=1)
    assert [check["name"] for check in found["checks"] if not check["ok"]] == ["end"]


def test_an_end_that_is_not_reached_fails(folder: Path, capsys: Output) -> None:
    """The end is carried out anew, from the start of the system."""
    proof = certify(capsys, "crossing.jsonl", "--system", SYSTEM)
    written = json.loads(proof.read_text())
    proof.write_text(json.dumps({**written, "end": [[0, 0], [1, 1]]}))
    arguments = ["verify", str(proof), "--of", "crossing.jsonl", "--system", SYSTEM]
    found = answer_of(capsys, *arguments, code=1)
    assert found["checks"][-1]["detail"] == "[1,1] is not at the end as it says"
    # What keeps the cubes from being carried out is told before that.
    proof.write_text(json.dumps({**written, "end": [], "cubes": written["cubes"][::-1]}))
    found = answer_of(capsys, *arguments, code=1)
    assert found["checks"][-1]["detail"].startswith("cube 1, move ")


def test_the_end_is_carried_out_where_the_start_is_known(folder: Path, capsys: Output) -> None:
    """Also where the certificate does not say it, which fails; not where its form fails already."""
    proof = certify(capsys, "crossing.jsonl", "--system", SYSTEM)
    written = json.loads(proof.read_text())
    arguments = ["verify", str(proof), "--of", "crossing.jsonl", "--system", SYSTEM]
    proof.write_text(json.dumps({**written, "end": None}))
    names = [check["name"] for check in answer_of(capsys, *arguments, code=1)["checks"]]
    assert names == ["form", "cancelled", "schedule", "reduced", "chain", "end"]
    proof.write_text(json.dumps({**written, "cubes": []}))
    found = answer_of(capsys, *arguments, code=1)
    detail = "move 1 is in no pair and in no cube"
    assert found["checks"] == [{"name": "form", "ok": False, "detail": detail}]


def test_cubes_of_another_schedule_fail(folder: Path, capsys: Output) -> None:
    """The cubes file must have the moves of the certificate, whatever their order in a cube."""
    certify(capsys, "crossing.jsonl", "--system", SYSTEM)
    arguments = ["verify", "cubes.jsonl", "--of", "crossing.jsonl", "--system", SYSTEM]
    one, two = (json.loads(line) for line in Path("cubes.jsonl").read_text().splitlines())
    write(folder / "cubes.jsonl", [one, {"moves": two["moves"][::-1]}])
    assert answer_of(capsys, *arguments)["ok"]
    for wrong, reason in (
        ([two, one], "cube 1 has other moves than the certificate"),
        ([one], "1 cubes, and the certificate has 2"),
    ):
        write(folder / "cubes.jsonl", wrong)
        checks = answer_of(capsys, *arguments, code=1)["checks"]
        assert checks[-1] == {"name": "cubes", "ok": False, "detail": reason}
    moved = ["verify", "cubes.certificate.json", *arguments[2:], "--cubes", "cubes.jsonl"]
    assert not answer_of(capsys, *moved, code=1)["ok"]


def test_a_timetable_is_written(folder: Path, capsys: Output) -> None:
    """With durations -o is a line a move, by their starts, and the makespan is told exactly."""
    (folder / "d.toml").write_text(
        'format = "cubepath-durations-1"\n[[moves]]\n'
        'generator = "edge"\nat = [[0, 1], [0, 0]]\nduration = 0.25\n'
    )
    arguments = ["shorten", "crossing.jsonl", "--system", SYSTEM, "--durations", "d.toml"]
    found = answer_of(capsys, *arguments, "--durations", "edge=1/3", "-o", "times.jsonl")
    assert found["makespan"] == "2/3"
    times = map(json.loads, (folder / "times.jsonl").read_text().splitlines())
    lines = [(each["start"], each["duration"]) for each in times]
    assert lines == [(0, "1/3"), ("1/3", "1/3"), ("1/3", "1/4")]
    assert main([*arguments, "--explain"]) == 0
    out = capsys.readouterr().out
    assert "makespan       2\n" in out
    assert out.endswith(
        "No timetable in the class is shorter than 2; one after another:\n"
        "  from 0 to 1  move 1  edge at [[0,0],[1,0]]\n"
        "  from 1 to 2  move 4  edge at [[1,0],[2,0]]\n"
    )
