"""Proofs about following vehicles: ``--following RULE --proof FILE``, and ``verify`` of it."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cubepath.coordinator.commands.files import file_name, none_written
from cubepath.coordinator.commands.path_options import hints
from cubepath.coordinator.theory.commands.checked_proofs import (
    CLAUSES,
    CheckedProof,
    ClaimedProof,
    digest,
    state_text,
)
from cubepath.protocol.core.errors import CheckError
from cubepath.protocol.core.formatting import counted
from cubepath.protocol.core.input_files import InputFile
from cubepath.protocol.core.sites import to_json

if TYPE_CHECKING:  # a command starts faster without them
    from cubepath.coordinator.theory.following.optimum import FewestRounds
    from cubepath.coordinator.theory.proof_checking.following_proof import FewestRoundsResult
    from cubepath.protocol.path_files.following import FollowingFile, FollowingProof
    from cubepath.protocol.plans.imported import VehiclePlan


def write_fewest(
    options: argparse.Namespace, fewest: FewestRounds, timetable: FollowingFile
) -> list[tuple[str, object]]:
    """Write what was proved, if that is asked for; return the line of the summary."""
    from cubepath.coordinator.theory.following.files import fewest_rounds_proof  # noqa: PLC0415
    from cubepath.protocol.path_files.following import write_following_proof  # noqa: PLC0415

    if options.proof is None:
        return []
    proof: Path = options.proof
    if fewest.refuted is None:
        return [("proof", none_written(proof, "nothing moves"))]
    write_following_proof(proof, fewest_rounds_proof(fewest.refuted, timetable))
    return [("proof", file_name(proof))]


def given_plan(options: argparse.Namespace) -> VehiclePlan | None:
    """Return the plan that a proof is to be about, None if none is given."""
    from cubepath.coordinator.theory.following.files import read_vehicle_plan  # noqa: PLC0415

    if options.of is None:
        return None
    return read_vehicle_plan(options.of, options.system, hints(options))


def claimed_following(
    options: argparse.Namespace,
    file: InputFile,
    plan: VehiclePlan | None,
    tell: Callable[[str, int], object],
) -> ClaimedProof:
    """Return what a proof about vehicles claims; CheckError for what already does not hold."""
    from cubepath.coordinator.theory.proof_checking.following_proof import FollowingRefutation  # noqa: PLC0415
    from cubepath.protocol.path_files.following import read_following_proof  # noqa: PLC0415

    proof = read_following_proof(file)
    refutation = FollowingRefutation(proof, tell)
    why = None if plan is None else refutation.other_task(plan)
    if why is not None:
        raise CheckError(f"{file_name(options.of)} {why}")
    if any(each.suffix.lower() == CLAUSES for each in options.out):
        _ = refutation.clauses  # which may be wrong, before the file is opened

    def checked() -> CheckedProof:
        found = refutation.checked()
        task = _task(proof)
        rows = _rows(proof, found)
        rows[1:1] = _task_rows(task)
        return CheckedProof(found.proved, rows, _document(proof, found) | task)

    return ClaimedProof(refutation.dimacs, proof.log, checked)


def _task(proof: FollowingProof) -> dict[str, Any]:
    """Return what a proof is about; the digest of its graph does not depend on any numbering."""
    cells = proof.vertices
    edges = sorted({tuple(sorted((cells[one], cells[other]))) for one, other in proof.edges})
    graph = {"vertices": len(cells), "edges": len(edges), "sha256": digest([sorted(cells), edges])}
    return {
        "graph": graph,
        "vehicles": len(proof.starts),
        "starts": to_json(tuple(proof.starts)),
        "ends": to_json(tuple(proof.ends)),
    }


def _task_rows(task: dict[str, Any]) -> list[tuple[str, str]]:
    graph = task["graph"]
    vertices = "1 vertex" if graph["vertices"] == 1 else f"{graph['vertices']} vertices"
    size = f"{vertices}, {counted(graph['edges'], 'edge')}"
    return [
        ("graph", f"{size}, SHA-256 {graph['sha256']}"),
        ("vehicles", str(task["vehicles"])),
        ("starts", state_text(task["starts"], "cells")),
        ("ends", state_text(task["ends"], "cells")),
    ]


def _rows(proof: FollowingProof, found: FewestRoundsResult) -> list[tuple[str, str]]:
    less = f"under the rule {proof.rule} no timetable of {counted(found.refuted, 'round')} or fewer"
    has = f"the timetable has {found.rounds}"
    if found.optimal:
        has += ": optimal"
    return [
        ("proved" if found.proved else "agreed", f"{less}; {has}"),
        ("solver", proof.solver),
        ("variables", str(found.variables)),
        ("clauses", str(found.clauses)),
        ("lemmas", str(found.lemmas)),
    ]


def _document(proof: FollowingProof, found: FewestRoundsResult) -> dict[str, Any]:
    return {
        "ok": found.proved,
        "standing": proof.standing,
        "following": proof.rule,
        "refuted": found.refuted,
        "rounds": found.rounds,
        "optimal": found.optimal,
        "solver": proof.solver,
        "variables": found.variables,
        "clauses": found.clauses,
        "lemmas": found.lemmas,
    }
