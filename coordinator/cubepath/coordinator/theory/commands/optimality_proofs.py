"""``cubepath verify FILE.proof``: what a proof of optimality proves, checked from the moves on."""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

from cubepath.coordinator.commands.console import DONE, FAILED, answer, complain, progress_bar
from cubepath.coordinator.commands.files import Output, check_files, file_name, output_path
from cubepath.coordinator.commands.path_options import hints
from cubepath.coordinator.theory.commands.following import (
    CLAUSES,
    LOG,
    ClaimedProof,
    ProofAnswer,
    digest,
    proof_answer,
    state_text,
    write_others,
)
from cubepath.protocol.core.errors import CheckError, InputError
from cubepath.protocol.core.formatting import counted, visible
from cubepath.protocol.core.input_files import STANDARD_INPUT, InputFile, Source, opened
from cubepath.protocol.core.sites import in_order, to_json
from cubepath.protocol.file_forms import FORMS

if TYPE_CHECKING:  # a command starts faster without them
    from cubepath.coordinator.shortening.path_input import PathInput
    from cubepath.coordinator.theory.proof_checking.optimality import ClaimedRefutation, ProofResult

_SUFFIX = ".proof"


def add_proof_options(verify: argparse.ArgumentParser) -> None:
    """Add ``--out``."""
    verify.add_argument(
        "-o",
        "--out",
        action="append",
        default=[],
        type=output_path,
        metavar="FILE",
        help="LOG is a proof of optimality: write the clauses that it refutes as DIMACS (.cnf), or"
        " its log for other checkers such as drat-trim (.drat); may be given again",
    )


def is_of_a_proof(options: argparse.Namespace, sources: Sequence[Source]) -> bool:
    """Return whether a proof of optimality is to be verified; InputError if it is not alone.

    `sources` are what to read for the files, in their order.
    """
    both = zip(options.logs, sources, strict=True)
    proofs = [path for path, source in both if _is_proof(path, source)]
    if not proofs:
        if options.out:
            raise InputError("--out: is for a proof of optimality, expected one to verify")
        return False
    if len(options.logs) > 1:
        raise InputError(
            f"{proofs[0]}: found {len(options.logs)} files to check, expected one proof"
        )
    if options.cubes is not None:
        raise InputError(f"{proofs[0]}: a proof of optimality, expected no --cubes")
    if options.of is None and (options.system or options.format or options.companions):
        raise InputError("--system, --format and --with are for --of INPUT, expected that")
    return True


def _is_proof(path: Path, source: Source) -> bool:
    suffix = path.suffix.lower()
    if suffix in {_SUFFIX, ".mcap", ".json", ".jsonl"}:
        return suffix == _SUFFIX  # what is something else by its name is read once
    if not isinstance(source, InputFile) and (path == STANDARD_INPUT or not path.is_file()):
        return False  # its reader says what is wrong with it
    with suppress(OSError), opened(source) as file:
        return FORMS["proof"].holds(file) or FORMS["following proof"].holds(file)
    return False


def verify_proof(options: argparse.Namespace, source: Source) -> int:
    """Check a proof of optimality; the exit code is 1 unless it is proved."""
    from cubepath.coordinator.theory.commands.following import claimed_following, given_plan  # noqa: PLC0415

    path: Path = options.logs[0]
    check_files(
        options, [path, options.of], *(Output(each, (CLAUSES, LOG)) for each in options.out)
    )
    began = time.monotonic()
    with progress_bar(None, "verify", " lemmas") as bar, opened(source) as file:

        def tell(what: str, count: int) -> None:
            bar.set_description(what)
            bar.update(count if what == "lemmas" else 0)

        following = FORMS["following proof"].holds(file)
        plan = given_plan(options) if following else None
        given = None if following else _input(options)
        try:
            claimed = (
                claimed_following(file, plan, tell) if following else _claimed(file, given, tell)
            )
            if claimed.other_task is None and any(
                each.suffix.lower() == CLAUSES for each in options.out
            ):
                _ = claimed.refutation.clauses  # which may be wrong, before the file is opened
        except CheckError as error:
            return _refuse(options, error)
        if claimed.other_task is not None:
            return _refuse(options, CheckError(f"{file_name(options.of)} {claimed.other_task}"))
        # Outside: that a file cannot be written says nothing about the proof.
        write_others(options, claimed.refutation)
        try:
            found = claimed.refutation.checked()
        except CheckError as error:
            return _refuse(options, error)
    seconds = time.monotonic() - began
    rows, document = claimed.answer(found)
    rows.append(("time", f"{seconds:.2f} s"))
    width = max(len(name) for name, _ in rows)
    answer(
        options,
        document | {"seconds": round(seconds, 3)},
        "\n".join(f"{name:<{width}}  {visible(value)}" for name, value in rows),
    )
    return DONE


def _input(options: argparse.Namespace) -> PathInput | None:
    if options.of is None:
        return None
    from cubepath.coordinator.shortening.path_input import read_input  # noqa: PLC0415

    return read_input(options.of, options.system, hints(options))


def _claimed(
    file: InputFile, given: PathInput | None, tell: Callable[[str, int], object]
) -> ClaimedProof:
    """Return what a proof about cubes claims; CheckError for what already does not hold."""
    from cubepath.coordinator.theory.proof_checking.optimality import ClaimedRefutation  # noqa: PLC0415
    from cubepath.protocol.path_files.optimality_proofs import read_proof  # noqa: PLC0415

    proof = read_proof(file)
    refutation = ClaimedRefutation(proof, tell)

    def answer(found: ProofResult) -> ProofAnswer:
        less = f"no schedule of {counted(found.refuted, 'round')} or fewer"
        counts = {"moves": found.moves, "variables": found.variables}
        return proof_answer(
            proof,
            found,
            f"{less}; the schedule has {found.cubes}",
            head={"refuted": found.refuted, "cubes": found.cubes},
            counts=counts | {"clauses": found.clauses, "lemmas": found.lemmas},
            task=_task(refutation),
        )

    other = None if given is None else _another_task(refutation, given)
    return ClaimedProof(refutation, other, answer)


def _refuse(options: argparse.Namespace, error: CheckError) -> int:
    name = file_name(options.logs[0])
    why = str(error).removeprefix(f"{name}: ")
    answer(options, {"ok": False, "detail": why}, f"FAILED  {visible(why)}")
    complain(f"{name}: refused: {why}")
    return FAILED


def _task(refutation: ClaimedRefutation) -> ProofAnswer:
    """Return what a proof is about: its system, None if its moves are listed, and its ends."""
    proof, scene = refutation.proof, refutation.scene
    system, text = None, f"none, {counted(len(proof.moves), 'listed move')}"
    if scene is not None:
        sha256 = digest({scene.system.table: scene.system.to_table()})
        system, text = {"name": scene.spec, "sha256": sha256}, f"{scene.spec}, SHA-256 {sha256}"
    start, goal = to_json(in_order(proof.start)), to_json(in_order(proof.goal))
    rows = [
        ("system", text),
        ("start", state_text(start, "sites")),
        ("goal", state_text(goal, "sites")),
    ]
    return rows, {"system": system, "start": start, "goal": goal}


def _another_task(refutation: ClaimedRefutation, given: PathInput) -> str | None:
    """Return why a proof is not about the start, the end and the moves of an input."""
    from cubepath.coordinator.normal_form.admissibility import end_of  # noqa: PLC0415
    from cubepath.coordinator.theory.search.own_ends import OwnEnds  # noqa: PLC0415

    scene = given.scene
    start = given.start if scene is None else scene.start_state
    if start is None:
        raise InputError(
            f"{given.source}: what is on at the start is not known, expected --system SYSTEM"
        )
    goal = end_of(given.numbered, start)
    system = None if scene is None else scene.system
    if system is not None and given.labelled_goals:
        own = OwnEnds.of(system, given.actions, start)
        system, start, goal = own.system, own.start, own.goal
    return refutation.other_task(system, start, goal, given.actions)
