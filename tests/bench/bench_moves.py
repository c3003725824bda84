"""How long large files take: self-contained moves of a fleet, and the plan of its vehicles.

With cubepath installed: ``python tests/bench/bench_moves.py [--quick]``; `large_fleets` is the
recipe, with its seed. At the largest size 9,000 vehicles make a million moves on a 300 by 300 grid,
with 174,000 distinct actions.

Times are processor times of one thread, medians. *read* is `cubepath shorten FILE` without the
start of the process: read, checked and shortened. *cubes* is writing the cubes as lines. The floor
decodes each line as JSON and keeps nothing; the peer, at the sizes up to 100,000, is the reader of
lines, which builds an action for each distinct contents. The growth exponent is the slope of log
time over log moves against the row before; linear is 1. *cells* names a site as ``[x, y]``,
*names* as a text and *shelves* as a text beside a list in a list: nothing depends on the kind of
site. *made* is how many actions were built as objects. Nothing is asserted.

The second table has what else is done with a path that was read: its certificate built and checked
(*certify*, as `shorten --certificate` does), checked once more (*check*, as `verify --of`), bounds,
cubes and moves as `.npz`, that read again (*load*), and moves as lines.
"""

import argparse
import json
import tempfile
from collections.abc import Callable
from functools import partial
from pathlib import Path

import msgspec
from bench_shorten import exponent, seconds
from large_fleets import Cell, steps, wandering, write_lines, write_log, write_map

from cubepath.coordinator.shortening.explain import certified_path
from cubepath.coordinator.shortening.normal_path import shorten
from cubepath.coordinator.shortening.path_input import read_input
from cubepath.coordinator.theory.optimality.optimality_report import beyond
from cubepath.coordinator.theory.optimality.tasks import task_of
from cubepath.coordinator.verification.certificate import check_certificate
from cubepath.protocol.compiled import allowance
from cubepath.protocol.path_files.moves import read_moves, write_cubes
from cubepath.protocol.path_files.npz import write_cubes_npz, write_moves_npz
from cubepath.protocol.path_files.numbered import number_moves
from cubepath.protocol.path_files.path_lines import write_path
from cubepath.protocol.path_files.supports import TabledActions

SIZES = ((10_000, 30), (100_000, 95), (1_000_000, 300))
"""Moves, and cells on a side of the grid, of which one in ten has a vehicle."""
_PEER_MAX = 100_000
KINDS: dict[str, Callable[[Cell], object]] = {
    "cells": list,
    "names": lambda cell: f"cell {cell[0]}/{cell[1]}",
    "shelves": lambda cell: ["hall", list(cell)],
}


def text(site: Callable[[Cell], object], cell: Cell) -> str:
    """Return a cell as JSON, as a site of some kind."""
    return json.dumps(site(cell))


def decode(file: Path) -> None:
    """Decode each line and keep nothing."""
    with file.open("rb") as stream:
        for line in stream:
            msgspec.json.decode(line)


def plainly(file: Path) -> None:
    """Read a file line by line."""
    number_moves(read_moves(file))


def row(kind: str, file: Path, moves: int, before: tuple[int, float] | None) -> tuple[int, float]:
    """Print the row of one file of moves."""
    found = shorten(file)
    table = found.path.actions
    made = table.made if isinstance(table, TabledActions) else len(table)
    took = seconds(partial(shorten, file), 3)
    cubes = seconds(lambda: write_cubes(file.with_suffix(".cubes"), found.named), 1)
    least = seconds(partial(decode, file), 3)
    peer = seconds(partial(plainly, file), 1) if moves <= _PEER_MAX else None
    now = moves, took
    print(
        f"{kind:>8}  {moves:>8}  {len(table):>8}  {took:7.2f}  {took / moves * 1e6:7.2f}"
        f"  {cubes:6.2f}  {took / least:7.1f}  {'-' if peer is None else f'{peer / took:.1f}':>6}"
        f"  {exponent(now, before):>6}  {made:>5}"
    )
    return now


def uses(file: Path, moves: int, before: tuple[int, float] | None) -> tuple[int, float]:
    """Print the row of what else is done with the path of a file."""
    found = shorten(file)
    path, start = found.path, found.given.start
    table, binary = path.actions, file.with_suffix(".npz")
    proof = certified_path(found)
    jobs: list[Callable[[], object]] = [
        partial(certified_path, found),
        partial(check_certificate, proof, found.given.actions, start),
        lambda: beyond(task_of(found), found),
        partial(write_cubes_npz, file.with_suffix(".cubes.npz"), path, found.left),
        partial(write_moves_npz, binary, path),
        partial(read_input, binary),
        partial(write_path, file.with_suffix(".again"), path),
    ]
    took = [seconds(job, 3) for job in jobs]
    made = table.made if isinstance(table, TabledActions) else len(table)
    now = moves, took[0]
    print(
        f"{moves:>14}  {'  '.join(f'{each:7.2f}' for each in took)}"
        f"  {exponent(now, before):>6}  {made:>5}"
    )
    return now


def main() -> None:
    """Print a table for the files of moves, and a line for each plan."""
    allowance.left = 0  # what is measured is compiled code, for small sizes too
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--quick", action="store_true", help="the smallest size")
    sizes = SIZES[:1] if parser.parse_args().quick else SIZES
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        print(
            "    kind     moves  distinct   read s  us/move  cubes s"
            "  x floor  peer x  growth   made"
        )
        fleets = [wandering(moves, side=side, vehicles=side * side // 10) for moves, side in sizes]
        for kind, site in KINDS.items():
            before: tuple[int, float] | None = None
            for (moves, _), (starts, rounds) in zip(sizes, fleets, strict=True):
                file = folder / "moves.jsonl"
                write_lines(file, steps(starts, rounds), partial(text, site))
                before = row(kind, file, moves, before)
        print(
            "\n         moves  certify    check   bounds  cub.npz     .npz     load    lines"
            "  growth   made"
        )
        before = None
        for (moves, _), (starts, rounds) in zip(sizes, fleets, strict=True):
            file = folder / "moves.jsonl"
            write_lines(file, steps(starts, rounds), partial(text, list))
            before = uses(file, moves, before)
        print("\n    plan     moves   read s  us/move  growth")
        before = None
        for (moves, side), (starts, rounds) in zip(sizes, fleets, strict=True):
            plan, grid = folder / "plan.txt", folder / "grid.map"
            write_log(plan, starts, rounds)
            write_map(grid, side)
            read = partial(shorten, plan, companions=[grid])
            now = moves, seconds(read, 1)
            took = now[1]
            print(
                f"    fleet {moves:>9}  {took:7.2f}  {took / moves * 1e6:7.2f}"
                f"  {exponent(now, before):>6}"
            )
            before = now


if __name__ == "__main__":
    main()
