"""The best schedules that the study of prices divides by: searched for, proved, and challenged.

``python docs/studies/price_best.py`` takes for each system the run of the study with the fewest
cubes, or the schedule on file if that has fewer, and gives ``--prove SECONDS`` to the search for
the optimum (extra `proofs`). ``-o docs/studies/price-best.json`` keeps what came of it: a row
changes only if its schedule or its bound gets better. Each proof is verified, and its SHA-256 kept;
``--proofs FOLDER`` keeps the files too. ``--check`` fails where a schedule on file is beaten. A
value that is proved does not depend on the time that it took; one that is not can be better with
more.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from hashlib import sha256
from pathlib import Path
from tempfile import TemporaryDirectory
from time import monotonic
from typing import Any

import pyarrow.parquet as pq

from cubepath.agents import play
from cubepath.coordinator import Shortened, beyond, check_optimality, shorten, standard, task_of
from cubepath.protocol import read_cubes, read_proof

FOLDER = Path(__file__).parent
FILE = FOLDER / "price-best.json"
MAX_ROUNDS = 1000


@dataclass(frozen=True)
class Row:
    """The best schedule that is known of one system, and what is proved.

    The run of `rule` with `hesitate` and `seed` had `fewest` cubes, the fewest of all of the
    study. The best schedule has `best`: `moves` are its moves in order, or None if it is that run.
    No schedule has fewer than `bound`, by the argument `why`. `seconds` is how long the search took
    that changed the row last. `sha256` is of the proof of the bound, which has `size` bytes; both
    are None without one.
    """

    system: str
    rule: str
    hesitate: float
    seed: int
    fewest: int
    best: int
    bound: int
    proved: bool
    why: str
    seconds: float
    sha256: str | None
    size: int | None
    moves: list[list[Any]] | None


def read_rows(path: Path = FILE) -> list[Row]:
    """Return the rows on file."""
    return [Row(**row) for row in json.loads(path.read_text("utf-8"))]


def first_rows() -> list[Row]:
    """Return for each system of the study the row of its run with the fewest cubes."""
    best: dict[str, tuple[Any, ...]] = {}
    table = pq.read_table(FOLDER / "price.parquet")
    for run in table.to_pylist():
        if run["goal"]:
            chance = run["rule"] == "random"
            key = (run["cubes"], chance, run["hesitate"], run["rounds"], run["rule"], run["seed"])
            best[run["system"]] = min(key, best.get(run["system"], key))
    known = {each.system: each for each in standard()}
    rows = []
    for system, (cubes, _, hesitate, _, rule, seed) in best.items():
        row = Row(system, rule, hesitate, seed, cubes, cubes, 0, False, "", 0.0, None, None, None)
        if system in known:
            one = known[system]
            why = f"standard set: {one.how.rpartition('bound: ')[2]}"
            row = replace(row, bound=one.bound, proved=one.bound == row.best, why=why)
            if one.best < cubes:
                moves = _plain(list(read_cubes(one.schedule)))
                row = replace(row, best=one.best, proved=one.proved, moves=moves)
        rows.append(row)
    return rows


def schedule_of(row: Row, folder: Path) -> Shortened:
    """Return the best schedule of a row: its run, played again, or its moves, read from a file."""
    if row.moves is None:
        run = play(
            row.system, row.rule, seed=row.seed, hesitate=row.hesitate, max_rounds=MAX_ROUNDS
        )
        return shorten(run)
    path = folder / "moves.jsonl"
    lines = [json.dumps({"generator": name, "at": at}) for name, at in row.moves]
    path.write_text("\n".join(lines) + "\n", "utf-8")
    return shorten(path, system=row.system)


def challenged(row: Row, prove: float, improve: float | None, proofs: Path) -> Row:
    """Return what a search makes of a row, from its schedule on, in these times in seconds."""
    began = monotonic()
    found = schedule_of(row, proofs)
    if found.cubes != row.best:
        raise SystemExit(f"{row.system}: the schedule has {found.cubes} cubes, not {row.best}")
    path = proofs / f"{row.system.replace(':', '-').replace('/', '-')}.proof"
    known = beyond(task_of(found), found, seconds=improve, prove=prove, proof=path)
    best = found.cubes if known.improved is None else known.improved
    taken = replace(row, best=best, bound=known.lower_bound, why=known.why, sha256=None, size=None)
    if known.proof is not None:
        checked = check_optimality(read_proof(path))
        if checked.refuted + 1 != known.lower_bound or checked.cubes != best:
            raise SystemExit(f"{row.system}: the proof is of something else")
        content = path.read_bytes()
        taken = replace(taken, sha256=sha256(content).hexdigest(), size=len(content))
    if best < row.best:
        taken = replace(taken, moves=_plain(known.named))
    spent = round(monotonic() - began, 1)
    return replace(taken, proved=best == known.lower_bound, seconds=spent)


def _plain(named: Sequence[Sequence[Any]]) -> list[list[Any]]:
    return [[move.generator, move.at] for cube in named for move in cube]


def better(old: Row, new: Row) -> Row:
    """Return what is known after a search: the old row, unless a number is better."""
    if (new.best, -new.bound, new.sha256 is None) >= (old.best, -old.bound, old.sha256 is None):
        return old
    if new.bound < old.bound:
        kept = ("bound", "why", "sha256", "size")
        new = replace(new, **{name: getattr(old, name) for name in kept})
    return replace(new, proved=new.best == new.bound)


def main() -> None:
    """Print what a search makes of each row; keep it, or fail where one on file is beaten."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("systems", nargs="*", help="these alone; a file keeps its other rows")
    parser.add_argument("--open", action="store_true", help="those alone that are not proved")
    parser.add_argument("--prove", type=float, default=30.0, metavar="SECONDS", help="a system")
    parser.add_argument("--improve", type=float, metavar="SECONDS", help="a system, before that")
    parser.add_argument("--proofs", type=Path, metavar="FOLDER", help="keep the proofs there")
    doing = parser.add_mutually_exclusive_group()
    doing.add_argument("-o", type=Path, metavar="FILE", help="a JSON file that keeps the rows")
    doing.add_argument("--check", action="store_true", help="fail where a row on file is beaten")
    asked = parser.parse_args()
    rows = {row.system: row for row in first_rows()}
    source = FILE if asked.o is None else asked.o
    if source.exists():
        rows |= {row.system: better(rows[row.system], row) for row in read_rows(source)}
    if strange := [system for system in asked.systems if system not in rows]:
        parser.error(f"{strange[0]}: expected one of {', '.join(rows)}")
    if asked.proofs is not None:
        asked.proofs.mkdir(parents=True, exist_ok=True)
    beaten = []
    for system, row in rows.items():
        if (asked.systems and system not in asked.systems) or (asked.open and row.proved):
            continue
        with TemporaryDirectory() as folder:
            new = challenged(row, asked.prove, asked.improve, asked.proofs or Path(folder))
        print(
            f"{system}: fewest {row.fewest}, best {new.best}, bound {new.bound} ({new.why}),"
            f" {new.seconds} s",
            flush=True,
        )
        if new.best < row.best:
            count = "1 cube" if new.best == 1 else f"{new.best} cubes"
            beaten.append(f"{system}: {count}, the page has {row.best}")
        rows[system] = better(row, new)
        if asked.o is not None:
            lines = [json.dumps(asdict(each), separators=(",", ":")) for each in rows.values()]
            asked.o.write_text("[\n" + ",\n".join(lines) + "\n]\n", "utf-8")
    if asked.check and beaten:
        raise SystemExit("\n".join(beaten))


if __name__ == "__main__":
    main()
