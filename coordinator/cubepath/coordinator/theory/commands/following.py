"""Plans whose vehicles follow: ``cubepath improve --following``, their proofs and ``verify``."""

from __future__ import annotations

import argparse
import hashlib
import json
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

from cubepath.coordinator.commands.console import answer, progress_bar, table
from cubepath.coordinator.commands.files import Output, check_files, file_name, none_written
from cubepath.coordinator.commands.path_options import duration_file, given_durations, hints, solved
from cubepath.coordinator.commands.verify import answer_checks
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.formatting import counted, visible
from cubepath.protocol.core.garbage import collector_paused
from cubepath.protocol.core.input_files import InputFile, opened
from cubepath.protocol.core.sites import to_json

if TYPE_CHECKING:
    from cubepath.coordinator.shortening.normal_path import Shortened
    from cubepath.coordinator.theory.following.optimum import FewestRounds
    from cubepath.coordinator.theory.following.timetable import FollowingTimetable
    from cubepath.coordinator.theory.proof_checking.following_proof import (
        FewestRoundsResult,
        FollowingRefutation,
    )
    from cubepath.coordinator.theory.proof_checking.optimality import ClaimedRefutation, ProofResult
    from cubepath.protocol.path_files.following import FollowingFile, FollowingHead, FollowingProof
    from cubepath.protocol.path_files.optimality_proofs import OptimalityProof
    from cubepath.protocol.plans.imported import VehiclePlan

CLAUSES, LOG = ".cnf", ".drat"
"""The suffixes of what other checkers read."""
_TEXT_MAX = 60
"""Longest text of a state, in characters, that is printed rather than its digest."""


ProofAnswer: TypeAlias = tuple[list[tuple[str, str]], dict[str, Any]]
"""What a checked proof proves, as rows for people and as a document."""


class ClaimedProof(NamedTuple):
    """A proof that is yet to be checked."""

    refutation: ClaimedRefutation | FollowingRefutation
    other_task: str | None
    """Why it is about another task than the one that is given, None if it is not."""
    answer: Callable[[Any], ProofAnswer]
    """Returns what its result proves."""


def digest(value: object) -> str:
    """Return the SHA-256, in hexadecimal, of a value as compact JSON with sorted keys."""
    return hashlib.sha256(_json(value).encode()).hexdigest()


def _json(value: object) -> str:
    return json.dumps(value, sort_keys=True, separators=(",", ":"), ensure_ascii=False)


def state_text(sites: list[Any], what: str) -> str:
    """Return sites, given in JSON form, as JSON, or where that is long their number and digest."""
    text = _json(sites)
    return text if len(text) <= _TEXT_MAX else f"{len(sites)} {what}, SHA-256 {digest(sites)}"


def proof_answer(
    proof: FollowingProof | OptimalityProof,
    found: FewestRoundsResult | ProofResult,
    claim: str,
    *,
    head: dict[str, Any],
    counts: dict[str, int],
    task: ProofAnswer,
) -> ProofAnswer:
    """Return what a proof proves that was checked; `head` and `counts` are keys of the document."""
    claim += ": optimal" if found.optimal else ""
    rows = [("proved", claim), *task[0], ("solver", proof.solver)]
    document = {"ok": True, **head, "optimal": found.optimal, "solver": proof.solver, **counts}
    return [*rows, *((name, str(count)) for name, count in counts.items())], document | task[1]


def write_others(
    options: argparse.Namespace, refutation: ClaimedRefutation | FollowingRefutation
) -> None:
    """Write the clauses and the log for other checkers to the files that are asked for."""
    from cubepath.protocol.core.output_files import written_whole  # noqa: PLC0415

    for path in options.out:
        with written_whole(path) as stream:
            for piece in (
                refutation.dimacs() if path.suffix.lower() == CLAUSES else refutation.proof.log
            ):
                stream.write(piece)


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
    file: InputFile, plan: VehiclePlan | None, tell: Callable[[str, int], object]
) -> ClaimedProof:
    """Return what a proof about vehicles claims; CheckError for what already does not hold."""
    from cubepath.coordinator.theory.proof_checking.following_proof import FollowingRefutation  # noqa: PLC0415
    from cubepath.protocol.path_files.following import read_following_proof  # noqa: PLC0415

    proof = read_following_proof(file)
    refutation = FollowingRefutation(proof, tell)

    def answer(found: FewestRoundsResult) -> ProofAnswer:
        less = f"no timetable of {counted(found.refuted, 'round')} or fewer"
        return proof_answer(
            proof,
            found,
            f"under the rule {proof.rule} {less}; the timetable has {found.rounds}",
            head={"following": proof.rule, "refuted": found.refuted, "rounds": found.rounds},
            counts={"variables": found.variables, "clauses": found.clauses, "lemmas": found.lemmas},
            task=_task(proof),
        )

    return ClaimedProof(refutation, None if plan is None else refutation.other_task(plan), answer)


def _task(proof: FollowingProof) -> ProofAnswer:
    """Return what a proof is about; the digest of its graph does not depend on any numbering."""
    cells = proof.vertices
    edges = sorted({tuple(sorted((cells[one], cells[other]))) for one, other in proof.edges})
    sha256 = digest([sorted(cells), edges])
    starts, ends = to_json(tuple(proof.starts)), to_json(tuple(proof.ends))
    vertices = "1 vertex" if len(cells) == 1 else f"{len(cells)} vertices"
    rows = [
        ("graph", f"{vertices}, {counted(len(edges), 'edge')}, SHA-256 {sha256}"),
        ("vehicles", str(len(proof.starts))),
        ("starts", state_text(starts, "cells")),
        ("ends", state_text(ends, "cells")),
    ]
    graph = {"vertices": len(cells), "edges": len(edges), "sha256": sha256}
    return rows, {"graph": graph, "vehicles": len(proof.starts), "starts": starts, "ends": ends}


_FOR_CUBES = ("seconds", "steps", "bounds", "max_states")
"""Options that look for schedules of cubes."""


def _check_options(options: argparse.Namespace) -> None:
    """Check that the other options fit ``--following``; InputError if one does not."""
    for name in _FOR_CUBES:
        value = getattr(options, name)
        if value is not None and value is not False:  # 0 is given
            raise InputError(
                f"--{name.replace('_', '-')}: is for cubes, in which no vehicle follows: expected"
                " no --following with it"
            )
    if options.prove is not None and options.durations:
        raise InputError("--prove: counts rounds, expected no --durations with it")
    check_files(
        options,
        [options.input, duration_file(options)],
        Output(options.out, (".jsonl",), stream=True),
        Output(options.proof, (".proof",)),
    )


def improve_following(options: argparse.Namespace) -> int:
    """Do what ``improve --following`` asks for; InputError if the input is no plan of vehicles."""
    from cubepath.coordinator.theory.following.files import (  # noqa: PLC0415
        checked,
        read_vehicle_plan,
        timetable_file,
    )
    from cubepath.coordinator.theory.following.timetable import chain_in_words, following_timetable  # noqa: PLC0415
    from cubepath.protocol.path_files.following import write_following  # noqa: PLC0415

    _check_options(options)
    durations = given_durations(options)
    timed = durations is not None
    with opened(options.input) as file:
        with progress_bar(None, "following", ""), collector_paused():
            plan = read_vehicle_plan(file, options.system, hints(options))
            found = following_timetable(plan, options.following, durations)
            written = checked(timetable_file(found, timed=timed), plan)
        shortened = None if found.rotates else _shortened(file, options)
    with ExitStack() as logs:
        fewest = _fewest_rounds(found, options, logs)
        if fewest is not None and fewest.timetable is not None:
            written = checked(fewest.timetable, plan)
        proved = [] if fewest is None else write_fewest(options, fewest, written)
    out: Path | None = options.out
    if out is not None:
        write_following(out, written)
    document = _document(found, timed=timed)
    if fewest is not None:
        written_proof = options.proof is not None and fewest.refuted is not None
        document |= fewest.document()
        document["proof"] = str(options.proof) if written_proof else None
    figures, figure_rows = _figures(found, plan, shortened)
    searched = 0 if fewest is None else fewest.seconds
    document |= figures | {"seconds": round(figures["seconds"] + searched, 3)}
    rows = [*_following_rows(found, timed=timed), *_fewest_rows(fewest), *proved, *figure_rows]
    rows.append(("time", f"{document['seconds']:.2f} s"))
    if out is not None:
        rows.append(("written to", file_name(out)))
    lines = ["", *chain_in_words(found, timed=timed)] if options.explain else []
    answer(options, document, "\n".join([table(rows), *map(visible, lines)]))
    return solved(options, plan.unsolved)


def _shortened(file: InputFile, options: argparse.Namespace) -> Shortened:
    from cubepath.coordinator.shortening.normal_path import shortened  # noqa: PLC0415
    from cubepath.coordinator.shortening.path_input import read_input  # noqa: PLC0415

    with progress_bar(None, "shorten", " moves") as bar:
        return shortened(read_input(file, options.system, hints(options), bar.update))


def _fewest_rounds(
    found: FollowingTimetable, options: argparse.Namespace, logs: ExitStack
) -> FewestRounds | None:
    if options.prove is None:
        return None
    from cubepath.coordinator.theory.following.optimum import fewest_rounds  # noqa: PLC0415

    with progress_bar(None, "prove", " rounds") as bar:

        def tick(rounds: int) -> None:
            bar.update(rounds - bar.n)

        return fewest_rounds(
            found.plan,
            found.rule,
            within=int(found.makespan),
            seconds=options.prove,
            seed=options.seed or 0,
            tick=tick,
            logs=logs,
        )


def _fewest_rows(fewest: FewestRounds | None) -> list[tuple[str, object]]:
    if fewest is None:
        return []
    rows: list[tuple[str, object]] = [
        ("improved", fewest.rounds),
        ("lower bound", f"{fewest.lower_bound} ({fewest.proved_by})"),
        ("optimal", "yes" if fewest.optimal else "not known"),
    ]
    if fewest.agreed is not None:
        rows.append(("agreed", f"{fewest.agreed} (two solvers, without a proof to check)"))
    endings = {"done": "", "time": ", out of time", "interrupt": ", interrupted"}
    ended = endings.get(fewest.ended, f", {fewest.ended}")
    return [*rows, ("spent on", f"proof {fewest.seconds:.1f} s{ended}")]


def _figures(
    found: FollowingTimetable, plan: VehiclePlan, shortened: Shortened | None
) -> tuple[dict[str, Any], list[tuple[str, object]]]:
    """Return the keys and rows that ``shorten`` always has; a plan that rotates has no cubes."""
    if shortened is not None:
        document = shortened.document()
        document["seconds"] = round(shortened.seconds + found.seconds, 3)
        cubes: list[tuple[str, object]] = [
            ("cubes", shortened.cubes),
            ("largest cube", shortened.max_cube_dimension),
        ]
    else:
        document = {
            "moves": len(plan.moves),
            "reduced_moves": len(found.starts),
            "cubes": None,
            "max_cube_dimension": None,
            "planner_rounds": plan.rounds,
            "seconds": found.seconds,
        }
        cubes = [("cubes", "none, as vehicles rotate")]
    rows = [("moves", len(plan.moves)), ("reduced moves", len(found.starts)), *cubes]
    if plan.rounds is not None:
        rows.append(("planner's rounds", plan.rounds))
    return document, rows


def _following_rows(found: FollowingTimetable, *, timed: bool) -> list[tuple[str, object]]:
    from cubepath.protocol.path_files.durations import time_text  # noqa: PLC0415

    rows: list[tuple[str, object]] = [
        ("following", found.rule),
        ("makespan" if timed else "rounds", time_text(found.makespan)),
    ]
    if found.rotations:
        rows.append(("rotations", found.rotations))
    return rows


def _document(found: FollowingTimetable, *, timed: bool) -> dict[str, Any]:
    from cubepath.protocol.path_files.durations import time_text  # noqa: PLC0415

    return {
        "following": found.rule,
        "rounds": None if timed else int(found.makespan),
        "makespan": time_text(found.makespan),
        "rotations": found.rotations,
        "chain": [place + 1 for place in found.chain],
    }


def verify_following(options: argparse.Namespace, file: InputFile) -> int:
    """Check a timetable against its input, as ``cubepath verify FILE --of INPUT`` does."""
    from cubepath.coordinator.theory.following.files import read_vehicle_plan  # noqa: PLC0415
    from cubepath.coordinator.theory.proof_checking.following import check_following  # noqa: PLC0415
    from cubepath.protocol.path_files.following import read_following  # noqa: PLC0415

    if options.cubes is not None:
        raise InputError(f"{file.path}: a timetable, which has no cubes: expected no --cubes")
    with progress_bar(None, "verify", ""):
        timetable = read_following(file)
        plan = read_vehicle_plan(options.of, options.system, hints(options))
        found = check_following(timetable, plan)
    head = timetable.head
    return answer_checks(
        options,
        str(file.path),
        found,
        {
            "moves": len(plan.moves),
            "reduced_moves": None if head.cancelled is None else head.moves,
            "following": head.rule,
            "rounds": head.rounds,
            "makespan": head.rounds if head.makespan is None else head.makespan,
        },
        _proved(head, file_name(options.of)),
    )


def _proved(head: FollowingHead, of: str) -> str:
    rounds = f"{head.rounds} round" + "s" * (head.rounds != 1)
    whole = rounds if head.makespan is None else f"makespan {head.makespan}"
    if head.cancelled is None:
        return f"legal under the rule {head.rule}, and ends as {of} does: {whole}"
    return (
        f"proved: legal under the rule {head.rule}, and with the moves of {of} and every vertex"
        f" visited in its order, none is shorter than {whole}"
    )
