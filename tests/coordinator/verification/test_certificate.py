"""What a certificate says of the end: there where the start is known, and each site once."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from cubepath.coordinator.commands.main import main
from cubepath.coordinator.normal_form.certificate import certificate_of
from cubepath.coordinator.verification.certificate import check_certificate
from cubepath.coordinator.verification.recording import verify
from cubepath.protocol.core.actions import Action
from cubepath.protocol.wire.messages import Certified
from recordings import all_edited, first
from tamperings import crowd, failing

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
    "no site": ({"end": [[0, 0], [2, 0], None]}, "end", "null is not at the end as it says"),
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


def test_the_certificate_of_a_recording_has_an_end_too() -> None:
    """The start is known there, so leaving it out fails the check `certificate`."""
    certificate = first(crowd(), "certificate").certificate
    values = {key: getattr(certificate, key) for key in certificate.__struct_fields__}
    without = type(certificate)(**{**values, "end": None})
    changed = all_edited(crowd(), "certificate", lambda message: Certified(message.round, without))
    assert failing(verify(changed)) == {"certificate"}
