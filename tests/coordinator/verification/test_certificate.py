"""What a certificate says of the end, and whether the cubes of a file are its cubes."""

import json
from pathlib import Path
from typing import Any

import pytest
from msgspec.structs import replace

from cubepath.coordinator.commands.main import main
from cubepath.coordinator.normal_form.certificate import certificate_of
from cubepath.coordinator.verification.certificate import check_certificate, compare_cubes
from cubepath.coordinator.verification.recording import verify
from cubepath.protocol.core.actions import Action
from cubepath.protocol.core.catalogue import GeneratorPlacement
from cubepath.protocol.path_files.certificates import Certificate
from cubepath.protocol.path_files.moves import CubeName, NumberedId, PathMove
from cubepath.protocol.path_files.numbered import number_moves
from cubepath.protocol.wire.messages import Certified
from samples.recordings import all_edited, first
from samples.strategies import edge
from tampering.tamperings import crowd, failing

SYSTEM = "agv:graph=grid3x2,n=2"
STEPS = [[[0, 0], [1, 0]], [[0, 1], [1, 1]], [[1, 0], [2, 0]], [[1, 1], [0, 1]], [[0, 1], [0, 0]]]
ASIDE = [[[2, 0], [2, 1]]] * 2

WRONG: dict[str, tuple[dict[str, Any], str, str]] = {
    "no end": ({"end": None}, "end", 'it has no "end", expected one: what is on at the start'),
    "a site twice": ({"end": [[0, 0], [2, 0], [0, 0]]}, "end", "[0,0] stands twice at the end"),
    "a site twice in other words": (
        {"end": [[0, 0], [2, 0], [2.0, 0]]},
        "end",
        "[2,0] stands twice at the end",
    ),
    "another site": ({"end": [[0, 0], [2, 1]]}, "end", "[2,0] is not at the end as it says"),
    "pairs out of order": (
        {"cancelled": [[6, 7], [2, 4]]},
        "cancelled",
        "pair 2 ends at move 4, and the one before at move 7",
    ),
}


def certified(folder: Path) -> tuple[Path, Path, dict[str, Any]]:
    """Write moves of which two pairs cancel, and their certificate."""
    moves, proof = folder / "moves.jsonl", folder / "cubes.certificate.json"
    lines = [{"generator": "edge", "at": at} for at in [*STEPS, *ASIDE]]
    moves.write_text("".join(json.dumps(line) + "\n" for line in lines))
    command = ["shorten", str(moves), "--system", SYSTEM, "--certificate", str(proof)]
    assert main(command) == 0
    return moves, proof, json.loads(proof.read_text())


@pytest.mark.parametrize("name", WRONG)
def test_what_is_wrong_with_a_certificate_fails_its_check(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str
) -> None:
    """By the command, which exits with 1 and names the check and why."""
    moves, proof, good = certified(tmp_path)
    assert good["cancelled"] == [[2, 4], [6, 7]]
    command = ["verify", str(proof), "--of", str(moves), "--system", SYSTEM, "--json"]
    assert main(command) == 0
    change, check, told = WRONG[name]
    changed = {key: value for key, value in {**good, **change}.items() if value is not None}
    proof.write_text(json.dumps(changed))
    capsys.readouterr()
    assert main(command) == 1
    found = {each["name"]: each for each in json.loads(capsys.readouterr().out)["checks"]}
    assert [each for each in found if not found[each]["ok"]] == [check]
    assert told in found[check]["detail"]


def test_where_nobody_knows_the_start_no_end_is_expected() -> None:
    """Without a start the check is not made, unless the certificate says an end."""
    path = [Action([1, 2], [1, 2], [1], [2])]
    unknown = certificate_of(path)
    assert "end" not in check_certificate(unknown, path)
    assert check_certificate(unknown, path, frozenset({1}))["end"] is not None
    known = certificate_of(path, start=frozenset({1}))
    assert check_certificate(known, path)["end"] is not None
    assert check_certificate(known, path, frozenset({1}))["end"] is None


def test_a_move_that_cannot_be_carried_out_is_named_by_its_number() -> None:
    """Counted from 1: the path's own move, or the move of a cube where only the cubes fail."""
    path = [edge(1, 2), edge(2, 3)]
    certificate = certificate_of(path, start=frozenset({1}))

    def told(proof: Certificate, start: int) -> str:
        return str(check_certificate(proof, path, frozenset({start}))["end"]).partition(": ")[0]

    assert told(certificate, 4) == "path, move 1"
    assert told(certificate, 3) == "path, move 1"
    assert told(certificate_of(path), 2) == "path, move 2"
    assert told(replace(certificate, cubes=[[2], [1]]), 1) == "cube 1, move 2"


@pytest.mark.parametrize("shared", ["a", 7])
def test_of_a_shared_id_the_number_says_which_move_is_meant(shared: str | int) -> None:
    """Text or number: alone it is unclear, and with the number of another move it is another."""
    path = [PathMove(edge(1, 2), "go"), PathMove(edge(2, 3), shared), PathMove(edge(3, 4), shared)]
    certificate = certificate_of([move.action for move in path])
    assert certificate.cubes == [[1], [2], [3]]

    def told(*names: CubeName) -> str | None:
        return compare_cubes(certificate, number_moves(path), [[name] for name in names])

    second, third = NumberedId(shared, 2), NumberedId(shared, 3)
    assert told("go", second, third) is None
    assert told(NumberedId("go", 1), second, third) is None
    unclear = f"moves with different contents have the id {json.dumps(shared)}"
    assert told("go", second, shared) == f"cube 3: {unclear}, expected [id, number of the move]"
    assert told("go", third, second) == "cube 2 has other moves than the certificate"
    assert told("go", second, second) == "cube 3 has other moves than the certificate"
    assert told("go", second) == "2 cubes, and the certificate has 3"


def test_a_move_by_its_generator_has_no_id_to_number() -> None:
    """A cubes file that names it as a numbered id names another move."""
    path = [PathMove(edge(1, 2), GeneratorPlacement("edge", (1, 2)))]
    certificate = certificate_of([move.action for move in path])
    assert (
        compare_cubes(certificate, number_moves(path), [[GeneratorPlacement("edge", (1, 2))]])
        is None
    )
    told = compare_cubes(certificate, number_moves(path), [[NumberedId("edge", 1)]])
    assert told == "cube 1 has other moves than the certificate"


def test_the_certificate_of_a_recording_has_an_end_too() -> None:
    """The start is known there, so leaving it out fails the check `certificate`."""
    certificate = first(crowd(), "certificate").certificate
    values = {key: getattr(certificate, key) for key in certificate.__struct_fields__}
    without = type(certificate)(**{**values, "end": None})
    changed = all_edited(crowd(), "certificate", lambda message: Certified(message.round, without))
    assert failing(verify(changed)) == {"certificate"}
