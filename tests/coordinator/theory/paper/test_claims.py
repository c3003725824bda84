"""The paper's claims: every row comes out as it is known to, and a wrong one is told."""

import json

import pytest

from cubepath.coordinator.commands.main import main
from cubepath.coordinator.theory.paper import claims
from cubepath.coordinator.theory.paper.claims import all_claims, compute_claims
from cubepath.coordinator.theory.paper.examples import SYSTEMS, Outcome, PaperClaim
from samples.local_families import LOCAL_FAMILIES


@pytest.mark.slow
@pytest.mark.parametrize(
    "number", range(len(all_claims())), ids=lambda number: all_claims()[number].item
)
def test_every_claim_comes_out_as_known(number: int) -> None:
    """What agrees agrees, what falls short falls short, what is open is open."""
    (row,) = compute_claims([all_claims()[number]])
    assert row.as_expected, row.computed
    assert row.computed


@pytest.mark.slow
def test_rows_say_what_they_rest_on() -> None:
    """A failure beyond the last pair, evidence that is no proof, an argument that is refuted."""
    shown = {
        row.claim: row.computed
        for row in compute_claims(
            each
            for each in all_claims()
            if each.item in {"5, refinement of graphs", "8, complexity"}
            or "as printed" in each.claim
        )
    }
    (printed,) = (text for claim, text in shown.items() if "as printed" in claim)
    assert "cube path of 10 cubes, whose class has a path of 6." in printed
    assert "comes out with 7 if i keeps its value, 7 if" in printed
    assert "the same if each call cancels in the last pair too" in printed
    assert "comes out with 2 cubes and not 1" in printed
    assert "with the last pair 1." in printed
    assert printed.endswith("0 of 2,000 random paths fail")
    (graphs,) = (text for claim, text in shown.items() if "homotopy type" in claim)
    assert graphs.startswith("evidence, since homology alone is compared")
    (loops,) = (text for claim, text in shown.items() if "O(N^2)" in claim)
    assert loops.startswith("not contradicted: ")
    assert "which it does not" in loops


def test_every_local_system_is_among_those_that_are_looked_at() -> None:
    """What is said of all local systems is computed for a scene of each that has an end."""
    names = {spec.partition(":")[0] for spec in SYSTEMS}
    endless = {"sliding-cubes", "pivoting-cubes", "rolling-dodecahedra"}
    assert names == set(LOCAL_FAMILIES) - endless


def test_the_command_gives_rows(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """One JSON document of rows; exit code 0 also where the paper falls short, if that is known."""
    known = (
        PaperClaim("1", "one", lambda: ("so", True)),
        PaperClaim("2", "two", lambda: ("not so", False), expected=False),
        PaperClaim("3", "three", lambda: ("who knows", None), expected=None),
    )
    monkeypatch.setattr(claims, "all_claims", lambda: known)
    assert main(["paper", "--json"]) == 0
    rows = json.loads(capsys.readouterr().out)
    assert [(row["item"], row["claim"], row["computed"], row["agrees"]) for row in rows] == [
        ("1", "one", "so", True),
        ("2", "two", "not so", False),
        ("3", "three", "who knows", None),
    ]
    assert main(["paper"]) == 0
    text = capsys.readouterr().out
    assert "3 claims: 1 agree, 1 differ, 1 open" in text


def test_an_interrupt_keeps_what_was_computed(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Exit code 130, and the rows that were there."""

    def interrupted() -> Outcome:
        raise KeyboardInterrupt

    known = (PaperClaim("1", "one", lambda: ("so", True)), PaperClaim("2", "two", interrupted))
    monkeypatch.setattr(claims, "all_claims", lambda: known)
    assert main(["paper", "--json"]) == 130
    seen = capsys.readouterr()
    assert [row["item"] for row in json.loads(seen.out)] == ["1"]
    assert seen.err == "cubepath: interrupted\n"


@pytest.mark.parametrize(("found", "expected"), [(False, True), (True, False), (None, True)])
def test_what_comes_out_otherwise_is_a_failure(
    found: bool | None,
    expected: bool | None,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Exit code 1, and one line that names the claim."""
    wrong = PaperClaim("4, arm", "text", lambda: ("surprise", found), expected)
    monkeypatch.setattr(claims, "all_claims", lambda: (wrong,))
    assert main(["paper"]) == 1
    assert "4, arm: not what is known to come out: surprise" in capsys.readouterr().err
