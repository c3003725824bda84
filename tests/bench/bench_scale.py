"""Shortening at scale: the compiled heap on numbers up to 10^7 moves, and files of 10^6 lines.

With cubepath installed: ``python tests/bench/bench_scale.py [--quick]``; some 3 GB at the end.

Times are processor times, of one thread, medians. The floor is one compiled pass over the same
support arrays that touches each site once. Bytes are those of the arrays of the heap at the end
beside what goes in and out (4 bytes a move in, 8 out). The growth exponent is the slope of log time
over log moves against the row before; linear is 1. Nothing is asserted.

All actions have supports of 8 sites and write 2 of them, like a pivoting hexagon's:

- *ring*: actions placed at random on a ring of so many sites; about one in seven moves cancels;
- *there and back*: half of the path, and the same backwards: every move is undone, the first one
  across all the others;
- *read hub*: as the ring, but 6 of 7 actions read one common site, and one move in 1000 writes it.
"""

import argparse
import tempfile
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
from bench_shorten import exponent, random_walk, seconds

from cubepath.coordinator.normal_form.array_heap import ActionTable, NumberedHeap, normal_form
from cubepath.coordinator.normal_form.compiled_heap import FastHeap, Numbering
from cubepath.coordinator.normal_form.kernel import Numbers
from cubepath.coordinator.shortening.normal_path import shorten
from cubepath.protocol.compiled import allowance, compiled
from cubepath.protocol.core.actions import apply_in_place
from cubepath.protocol.core.catalogue import GeneratorPlacement
from cubepath.protocol.core.sites import in_order
from cubepath.protocol.path_files.moves import PathMove
from cubepath.protocol.path_files.npz import write_cubes_npz, write_moves_npz
from cubepath.protocol.path_files.numbered import NumberedPath, number_moves
from cubepath.protocol.path_files.path_lines import write_path
from cubepath.protocol.scenes.specs import scene_from_spec

SIZES = (1_000, 10_000, 100_000, 1_000_000, 10_000_000)
LINES = 1_000_000
SPEC = "hex:n=40"
_BUSY = 100_000


def ring(moves: int, sites: int) -> tuple[Numbers, ActionTable]:
    """Return a path of actions placed at random: each writes 2 of 8 neighbouring sites."""
    places = np.arange(sites)[:, None]
    table = ActionTable(
        np.arange(0, 2 * sites + 1, 2, dtype=np.int32),
        ((places + np.arange(2)) % sites).astype(np.int32).ravel(),
        np.arange(0, 6 * sites + 1, 6, dtype=np.int32),
        ((places + np.arange(2, 8)) % sites).astype(np.int32).ravel(),
    )
    return np.random.default_rng(1).integers(0, sites, moves).astype(np.int32), table


def there_and_back(moves: int, sites: int) -> tuple[Numbers, ActionTable]:
    """Return a path that undoes itself."""
    out, table = ring(moves // 2, sites)
    return np.concatenate([out, out[::-1]]), table


def read_hub(moves: int, sites: int) -> tuple[Numbers, ActionTable]:
    """Return a path whose actions mostly read one site, which one move in 1000 writes."""
    numbers, table = ring(moves, sites)
    hub = sites
    read = table.read_sites.reshape(-1, 6).copy()
    read[np.arange(sites) % 7 > 0, 5] = hub
    writer = np.arange(8, dtype=np.int32) * (sites // 8)
    writer[0] = hub
    numbers[::1000] = sites
    return numbers, ActionTable(
        np.append(table.trace_starts, table.trace_starts[-1] + 2).astype(np.int32),
        np.append(table.trace_sites, writer[:2]).astype(np.int32),
        np.append(table.read_starts, table.read_starts[-1] + 6).astype(np.int32),
        np.append(read.ravel(), writer[2:]).astype(np.int32),
    )


@compiled
def floor(numbers: Numbers, starts: Numbers, sites: Numbers, touched: Numbers) -> None:
    """Touch every site of every support once."""
    for number in numbers:
        for index in range(starts[number], starts[number + 1]):
            touched[sites[index]] += 1


def supports(table: ActionTable) -> tuple[Numbers, Numbers]:
    """Return the supports in compressed rows."""
    count = len(table.trace_starts) - 1
    trace, read = table.trace_sites.reshape(count, -1), table.read_sites.reshape(count, -1)
    both = np.concatenate([trace, read], axis=1)
    return np.arange(0, both.size + 1, both.shape[1], dtype=np.int32), both.ravel()


def kernel_row(
    name: str, path: tuple[Numbers, ActionTable], repeats: int, before: tuple[int, float] | None
) -> tuple[int, float]:
    """Time one path all at once, and print it."""
    numbers, table = path
    count = len(numbers)
    again = max(1, _BUSY // count)

    def run() -> None:
        for _ in range(again):
            normal_form(numbers, table)

    starts, sites = supports(table)
    touched = np.zeros(int(sites.max()) + 1, dtype=np.int32)

    def least() -> None:
        for _ in range(again):
            floor(numbers, starts, sites, touched)

    run()
    least()
    took, lowest = seconds(run, repeats) / again, seconds(least, repeats) / again
    heap = NumberedHeap(table)
    heap.append(numbers)
    now = count, took
    print(
        f"{name:>16}  {count:>9}  {heap.reduced_moves:>9}  {heap.cubes:>8}"
        f"  {heap.max_cube_dimension:>7}  {took:9.4f}  {took / count * 1e6:8.3f}"
        f"  {took / lowest:8.1f}  {exponent(now, before):>6}  {heap.nbytes / count:10.0f}"
    )
    return now


def stream_row(moves: int) -> None:
    """Time moves that come one by one as objects, with a question after each."""
    word = random_walk(SPEC, moves)

    def ask(question: Callable[[FastHeap], object]) -> float:
        def run() -> None:
            heap = FastHeap()
            for action in word:
                heap.append(action)
                question(heap)

        return seconds(run, 3) / moves * 1e6

    print(
        f"one by one, {moves} moves of {SPEC}:"
        f" {ask(lambda heap: heap.cubes):.1f} us a move with the length asked after each"
    )


def walk_of_lines(lines: int) -> tuple[NumberedPath, NumberedPath]:
    """Return a walk by generator, and the same self-contained with an id for each move."""
    scene = scene_from_spec(SPEC)
    # A part of it, there and back again and again, is as legal as a walk as long.
    part = random_walk(SPEC, min(lines, 20_000) // 2)
    names = {
        move.action: GeneratorPlacement(move.generator, move.at)
        for action in dict.fromkeys(part)
        for site in in_order(action.trace)
        for move in scene.system.moves(site)
        if move is not None
    }
    state = set(scene.start_state)
    moves: list[PathMove] = []
    for action in [*part, *reversed(part)]:
        before = action.support & state
        apply_in_place(action, state)
        moves.append(PathMove(action, names[action], before))
    round_trip = number_moves(moves)
    times = -(-lines // len(moves))
    numbers = np.tile(round_trip.numbers, times)[:lines]
    ends = np.tile(round_trip.ends, times)[:lines]
    actions, stated = round_trip.actions, round_trip.stated
    return (
        NumberedPath(actions, round_trip.action_names, stated, numbers, ends),
        NumberedPath(actions, list(range(len(actions))), stated, numbers, ends, list(range(lines))),
    )


def file_rows(lines: int, folder: Path) -> None:
    """Time writing a path, and reading, checking and shortening it."""
    by_generator, contents = walk_of_lines(lines)
    for what, path, name, system in (
        ("by generator", by_generator, "g.jsonl", SPEC),
        ("self-contained", contents, "c.jsonl", None),
        ("by generator", by_generator, "g.npz", None),
        ("self-contained", contents, "c.npz", None),
    ):
        file = folder / name
        write = write_moves_npz if file.suffix == ".npz" else write_path
        wrote = seconds(partial(write, file, path), 1)
        found = shorten(file, system=system)
        took = seconds(partial(shorten, file, system=system), 3)
        cubes = seconds(partial(write_cubes_npz, folder / "cubes.npz", found.path, found.left), 1)
        print(
            f"{what:>16} {file.suffix:<6}  {file.stat().st_size / 1e6:7.1f} MB"
            f"  written {wrote:6.2f} s  read, checked and shortened {took:6.2f} s"
            f"  cubes written {cubes:5.2f} s"
        )


def main() -> None:
    """Print one table for the heap, and one for files."""
    allowance.left = 0  # what is measured is compiled code, for small sizes too
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--quick", action="store_true", help="small sizes")
    given = parser.parse_args()
    sizes = SIZES[:2] if given.quick else SIZES
    print(
        f"{'path':>16}  {'moves':>9}  {'left':>9}  {'cubes':>8}  {'max dim':>7}  {'cpu s':>9}"
        f"  {'us/move':>8}  {'x floor':>8}  {'growth':>6}  {'bytes/move':>10}"
    )
    paths: list[tuple[str, Callable[[int], tuple[Numbers, ActionTable]]]] = [
        ("ring of 1000", partial(ring, sites=1000)),
        ("ring of 100000", partial(ring, sites=100_000)),
        ("there and back", partial(there_and_back, sites=1000)),
        ("read hub", partial(read_hub, sites=1000)),
    ]
    for name, make in paths:
        before: tuple[int, float] | None = None
        for size in sizes:
            before = kernel_row(name, make(size), 3, before)
    word = random_walk(SPEC, sizes[0 if given.quick else 2])
    numbering = Numbering()
    numbers = np.array([numbering.number(action) for action in word], dtype=np.int32)
    table = numbering.table()
    if table is not None:
        kernel_row(SPEC, (numbers, table), 5, None)
    print()
    stream_row(1_000 if given.quick else 100_000)
    print()
    lines = 2_000 if given.quick else LINES
    print(f"{lines} moves of {SPEC} in files")
    with tempfile.TemporaryDirectory() as folder:
        file_rows(lines, Path(folder))


if __name__ == "__main__":
    main()
