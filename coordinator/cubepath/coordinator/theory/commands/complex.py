"""The commands ``cubepath complex`` and ``cubepath paper``."""

from __future__ import annotations

import argparse
from pathlib import Path
from textwrap import fill
from typing import TYPE_CHECKING

from cubepath.coordinator.commands import console
from cubepath.coordinator.commands.files import Output, check_files, output_path
from cubepath.coordinator.commands.usage import whole
from cubepath.coordinator.progress import StageProgress
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.formatting import counted

if TYPE_CHECKING:
    from cubepath.coordinator.theory.complexes.report import ComplexReport
    from cubepath.coordinator.theory.paper.examples import ClaimResult
    from cubepath.protocol.core.system import Scene


def add_complex(complex_: argparse.ArgumentParser) -> None:
    """Add the options of ``complex``."""
    complex_.set_defaults(command=_complex, smaller="a smaller system or --max-states N")
    complex_.add_argument(
        "system", metavar="SYSTEM", help=console.SYSTEM_HELP.replace(" (default hex)", "")
    )
    complex_.add_argument(
        "--homology", action="store_true", help="Betti numbers, torsion, contractibility, surface"
    )
    complex_.add_argument(
        "--link", action="store_true", help="check the link condition, and so NPC, at every state"
    )
    complex_.add_argument(
        "--shape", action="store_true", help="the shape complex: states up to translation"
    )
    complex_.add_argument(
        "--max-states",
        type=whole(1),
        metavar="N",
        help="stop where there are more than N states (default 2000000)",
    )
    complex_.add_argument(
        "-o", "--out", type=output_path, metavar="FILE", help="write it: .json, or .png, .svg, .pdf"
    )
    complex_.add_argument("--dark", action="store_true", help="draw it on dark ground")


def _complex(options: argparse.Namespace) -> int:
    from cubepath.coordinator.theory.complexes.exploration import MAX_STATES  # noqa: PLC0415
    from cubepath.coordinator.theory.complexes.export import SUFFIXES, draw_complex, write_complex  # noqa: PLC0415
    from cubepath.coordinator.theory.complexes.report import complex_report  # noqa: PLC0415
    from cubepath.protocol.scenes.specs import scene_from_spec  # noqa: PLC0415

    output: Path | None = options.out
    check_files(options, [], Output(output, (".json", *SUFFIXES)))
    if options.dark and (output is None or output.suffix.lower() == ".json"):
        raise InputError("--dark: is for a picture, expected -o FILE.png, .svg or .pdf")
    limit: int = options.max_states or MAX_STATES
    with console.progress_bar(None, "complex", " done") as bar:
        scene = scene_from_spec(options.system)
        found = complex_report(
            scene,
            shape=options.shape,
            with_homology=options.homology,
            with_links=options.link,
            keep=output is not None,
            max_states=limit,
            progress=StageProgress(bar).tick,
        )
    try:
        if output is not None and found.complete and found.built is not None:
            with console.progress_bar(None, "write", ""):
                if output.suffix.lower() == ".json":
                    write_complex(found.built, output)
                else:
                    title = f"{found.system}: {found.kind}"
                    draw_complex(found.built.complex, output, title, dark=options.dark)
    finally:
        console.answer(options, found.document(), console.table(_rows(found)))
    if not found.complete:
        console.complain(
            f"{found.system}: stopped at {counted(found.states, 'state')}"
            f" ({found.memory >> 20} MiB), not all of which were expanded: {_advice(scene)}"
            + (f"; {output} was not written" if output else "")
        )
        return console.FAILED
    if output is not None:
        console.complain(f"written to {output}")
    return console.DONE


def _advice(scene: Scene) -> str:
    if scene.system.open:
        return (
            "on a lattice without end an aggregate may wander off for ever: raise --max-states, or"
            " take --shape, or a scene with a base (base=1) or a workspace"
        )
    return "raise --max-states, or take a smaller system"


def _rows(found: ComplexReport) -> list[tuple[str, object]]:
    local = "" if found.local else " (not a local system)"
    states = found.states if found.complete else f"{found.states} or more"
    rows: list[tuple[str, object]] = [
        ("system", found.system + local),
        ("complex", found.kind),
        ("states", states),
    ]
    if found.goal is not None:
        rows.append(("goal", "among them" if found.goal else "not among them: out of reach"))
    if found.f_vector is not None:
        rows += [
            ("f-vector", " ".join(map(str, found.f_vector))),
            ("Euler characteristic", found.euler),
        ]
    if found.homology is not None:
        known = found.homology
        rows += [
            ("components", found.components),
            ("Betti numbers", " ".join(map(str, known.betti))),
            ("torsion", "; ".join(_torsion(known.torsion)) or "none"),
            ("Betti numbers mod 2", " ".join(map(str, known.betti_z2))),
            ("homotopy type", found.homotopy),
        ]
        if found.surface is not None:
            rows.append(("surface", found.surface))
        if found.orientable is not None:
            rows.append(("orientable", "yes" if found.orientable else "no"))
    if found.links_checked is not None:
        condition = f"holds at {counted(found.links_checked, 'state')}"
        if found.failing:
            condition = f"fails at {found.failing} of {counted(found.links_checked, 'state')}"
        curved = {True: "yes", False: "no", None: "not known"}[found.npc]
        rows += [("link condition", condition), ("non-positive curvature", curved)]
        rows += [("witness", witness) for witness in found.witnesses]
    rows += [("memory", f"{found.memory / 2**20:.1f} MiB"), ("time", f"{found.seconds:.2f} s")]
    return rows


def _torsion(torsion: tuple[tuple[int, ...], ...]) -> list[str]:
    return [
        f"H_{k}: " + " + ".join(f"Z/{factor}" for factor in factors)
        for k, factors in enumerate(torsion)
        if factors
    ]


def add_paper(parser: argparse.ArgumentParser) -> None:
    """Add the options of ``paper``."""
    parser.set_defaults(command=_paper)


def _paper(options: argparse.Namespace) -> int:
    from cubepath.coordinator.theory.paper.claims import all_claims, compute_claims  # noqa: PLC0415

    claims = all_claims()
    rows: list[ClaimResult] = []
    with console.progress_bar(len(claims), "paper", " claims") as bar:

        def note(row: ClaimResult) -> None:
            rows.append(row)
            bar.update()

        try:
            compute_claims(claims, note)
        except KeyboardInterrupt:
            bar.close()
            _say_rows(options, rows)  # keep what was computed
            raise
    _say_rows(options, rows)
    wrong = [row for row in rows if not row.as_expected]
    for row in wrong:
        console.complain(f"{row.item}: not what is known to come out: {row.computed}")
    return console.FAILED if wrong else console.DONE


def _say_rows(options: argparse.Namespace, rows: list[ClaimResult]) -> None:
    lines = []
    for row in rows:
        mark = {True: "agrees", False: "DIFFERS", None: "open"}[row.agrees]
        lines += [
            f"{mark:<8} {row.item}  ({row.seconds:.1f} s)",
            *_wrapped("claim", row.claim),
            *_wrapped("computed", row.computed),
        ]
    found = [sum(row.agrees is outcome for row in rows) for outcome in (True, False, None)]
    lines.append(f"{len(rows)} claims: {found[0]} agree, {found[1]} differ, {found[2]} open")
    console.answer(options, [row.document() for row in rows], "\n".join(lines))


def _wrapped(name: str, text: str) -> list[str]:
    return fill(
        text, width=100, initial_indent=f"         {name:<9} ", subsequent_indent=" " * 19
    ).splitlines()
