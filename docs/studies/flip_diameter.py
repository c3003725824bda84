"""The parallel diameter of the flip graph of the convex n-gon, and a farthest pair.

``python docs/studies/flip_diameter.py 5..16 -o docs/studies/flip-diameter.json`` computes it,
``--quick`` for n up to 10 only.

A triangulation is a binary tree on the nodes 1..n-2: the node k is the triangle whose middle corner
is k, its base the diagonal that separates it from its parent. Trees are numbered by their root,
then by the left and the right subtree. To flip the base of a node is to rotate that edge of the
tree; the rotated edge becomes the base of the other of its two nodes, and all other bases keep
their nodes. Flips commute iff they share no triangle, so a round is a matching in the tree, and its
flips can be made one after another by one table.

Breadth-first search by rounds from one triangulation gives its eccentricity, and the triangle
inequality bounds all others, up to the 2n symmetries of the polygon, which keep distances. Searches
go on until no bound is above the greatest eccentricity found, which is then the diameter (the
method of Takes and Kosters, 2011); with ``--all``, until every eccentricity is known.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from time import process_time

import numpy as np
from numpy.typing import NDArray

from cubepath.protocol.compiled import compiled

Numbers = NDArray[np.int32]
Bytes = NDArray[np.uint8]
Longs = NDArray[np.int64]

FAR = 255
"""The distance of what has not been reached."""
PULL = 2
"""Rounds are searched backwards once `PULL` times what the last one found is more than is left."""


@dataclass(frozen=True)
class Trees:
    """All binary trees with as many nodes as the arrays have columns.

    `flips` (trees, nodes) has the tree after the flip of a node's base, the tree itself at the
    root; `parents` the parent of each node counted from 1, 0 at the root. The trees of s nodes with
    root k begin at `first[s, k]`, and there are `counts[s]` trees of s nodes.
    """

    flips: Numbers
    parents: Bytes
    first: Longs
    counts: Longs


def all_trees(nodes: int) -> Trees:
    """Return the binary trees of so many nodes, built from those of fewer nodes."""
    counts = [1]
    for size in range(nodes + 1):
        counts.append(counts[-1] * 2 * (2 * size + 1) // (size + 2))
    first = np.zeros((nodes + 2, nodes + 3), dtype=np.int64)
    for size in range(1, nodes + 1):
        for root in range(1, size + 1):
            first[size, root + 1] = first[size, root] + counts[root - 1] * counts[size - root]
    flips = [np.zeros((1, 0), dtype=np.int32)]
    parents = [np.zeros((1, 0), dtype=np.uint8)]
    for size in range(1, nodes + 1):
        flips.append(np.empty((counts[size], size), dtype=np.int32))
        parents.append(np.zeros((counts[size], size), dtype=np.uint8))
        for root in range(1, size + 1):
            _fill(flips, parents, first, counts, size, root)
    return Trees(flips[-1], parents[-1], first, np.array(counts, dtype=np.int64))


def _fill(
    flips: list[Numbers],
    parents: list[Bytes],
    first: Longs,
    counts: list[int],
    size: int,
    root: int,
) -> None:
    """Fill in the trees with one root: flips within a subtree, then those of the root's children.

    With subtrees A, B, D the flip of a child c of the root takes (A c B) root D to A c (B root D),
    and A root (B c D) to (A root B) c D.
    """
    left, right, begin = counts[root - 1], counts[size - root], int(first[size, root])
    block = slice(begin, begin + left * right)
    flip = flips[size][block].reshape(left, right, size)
    parent = parents[size][block].reshape(left, right, size)
    lefts = np.arange(left)[:, None, None]
    rights = np.arange(right)[None, :, None]
    flip[:, :, root - 1] = begin + lefts[:, :, 0] * right + rights[:, :, 0]
    flip[:, :, : root - 1] = begin + flips[root - 1][:, None, :].astype(np.int64) * right + rights
    flip[:, :, root:] = begin + lefts * right + flips[size - root][None, :, :]
    parent[:, :, : root - 1] = parents[root - 1][:, None, :]
    within = parents[size - root][None, :, :]
    parent[:, :, root:] = np.where(within > 0, within + root, 0)
    for child in range(1, root):
        outer, inner = counts[child - 1], counts[root - 1 - child]
        a = np.arange(outer)[:, None, None]
        b = np.arange(inner)[None, :, None]
        d = np.arange(right)[None, None, :]
        lower = first[size - child, root - child] + b * right + d
        there = first[size, child] + a * counts[size - child] + lower
        at = slice(int(first[root - 1, child]), int(first[root - 1, child]) + outer * inner)
        flip[at, :, child - 1] = there.reshape(-1, right)
        parent[at, :, child - 1] = root
    for child in range(root + 1, size + 1):
        inner, outer = counts[child - root - 1], counts[size - child]
        a = np.arange(left)[:, None, None]
        b = np.arange(inner)[None, :, None]
        d = np.arange(outer)[None, None, :]
        lower = first[child - 1, root] + a * inner + b
        there = first[size, child] + lower * outer + d
        start = int(first[size - root, child - root])
        at = slice(start, start + inner * outer)
        flip[:, at, child - 1] = there.reshape(left, -1)
        parent[:, at, child - 1] = root


@compiled
def turn(first: Longs, counts: Longs, turned: Numbers) -> None:
    """Fill in each tree after the polygon is turned by one corner.

    The triangles at the last corner are the path from the root to the right; they become the path
    from the root to the left, in the opposite order, and keep their other subtrees.
    """
    for tree in range(len(turned)):
        size, rest = len(first) - 2, tree
        made, done = 0, 0
        while size > 0:
            root = 1
            while first[size, root + 1] <= rest:
                root += 1
            rest -= first[size, root]
            left, rest = rest // counts[size - root], rest % counts[size - root]
            made = first[done + root, done + 1] + made * counts[root - 1] + left
            done += root
            size -= root
        turned[tree] = made


def mirrored(trees: Trees) -> Numbers:
    """Return each tree after the polygon is reflected."""
    found = [np.zeros(1, dtype=np.int64)]
    for size in range(1, trees.flips.shape[1] + 1):
        here = np.empty(trees.counts[size], dtype=np.int64)
        for root in range(1, size + 1):
            left, right = found[root - 1], found[size - root]
            begin = trees.first[size, root]
            there = trees.first[size, size + 1 - root] + right[None, :] * len(left) + left[:, None]
            here[begin : begin + there.size] = there.ravel()
        found.append(here)
    return found[-1].astype(np.int32)


@compiled
def orbits(turned: Numbers, mirror: Numbers, orbit: Numbers, corners: int) -> int:
    """Number the orbits of the polygon's symmetries, by their first trees; return how many."""
    orbit[:] = -1
    count = 0
    for tree in range(len(turned)):
        if orbit[tree] < 0:
            one, other = np.int64(tree), np.int64(mirror[tree])
            for _ in range(corners):
                orbit[one] = count
                orbit[other] = count
                one, other = np.int64(turned[one]), np.int64(turned[other])
            count += 1
    return count


@compiled
def search(flips: Numbers, parents: Bytes, source: int, distance: Bytes, left: Numbers) -> int:
    """Fill in how many rounds each tree is from `source`; return the greatest.

    Rounds are enumerated as matchings in ascending order of their nodes, depth first. `left` has
    room for all trees. Forwards, all rounds from the trees of the last level are made; backwards, a
    tree that is left needs one round that leads to a tree known before.
    """
    trees, nodes = flips.shape
    distance[:] = FAR
    distance[source] = 0
    reached = found = 1
    listed = backwards = False
    level = many = 0
    at = np.zeros(nodes + 1, dtype=np.int64)
    node = np.zeros(nodes + 1, dtype=np.int64)
    taken = np.zeros(nodes + 1, dtype=np.int64)
    edge = np.zeros(nodes, dtype=np.int64)
    while reached < trees:
        level += 1
        backwards = backwards or found * PULL > trees - reached
        if backwards and not listed:
            listed = True
            for tree in range(trees):
                if distance[tree] == FAR:
                    left[many] = tree
                    many += 1
        found = kept = 0
        for number in range(many if backwards else trees):
            tree = int(left[number]) if backwards else number
            if not backwards and distance[tree] != level - 1:
                continue
            for k in range(nodes):
                parent = parents[tree, k]
                edge[k] = (1 << k) | (1 << (np.int64(parent) - 1)) if parent else 0
            depth = 0
            at[0], node[0], taken[0] = tree, 0, 0
            near = False
            while depth >= 0 and not near:
                k = node[depth]
                if k == nodes:
                    depth -= 1
                    continue
                node[depth] = k + 1
                if not edge[k] or edge[k] & taken[depth]:
                    continue
                there = np.int64(flips[at[depth], k])
                if backwards:
                    near = distance[there] < level
                elif distance[there] == FAR:
                    distance[there] = level
                    found += 1
                depth += 1
                at[depth], node[depth] = there, k + 1
                taken[depth] = taken[depth - 1] | edge[k]
            if near:
                distance[tree] = level
                found += 1
            elif backwards:
                left[kept] = tree
                kept += 1
        many = kept
        reached += found
    return level


@compiled
def narrow(distance: Bytes, orbit: Numbers, greatest: int, low: Numbers, high: Numbers) -> None:
    """Narrow the bounds of all eccentricities by the distances from a tree whose own is known."""
    for tree in range(len(distance)):
        here, far = orbit[tree], np.int64(distance[tree])
        high[here] = min(np.int64(high[here]), greatest + far)
        low[here] = max(np.int64(low[here]), far, greatest - far)


def diagonals(trees: Trees, tree: int) -> list[tuple[int, int]]:
    """Return the triangulation as its diagonals, pairs of corners, in ascending order."""
    found: list[tuple[int, int]] = []
    corners = trees.flips.shape[1] + 2
    todo = [(0, corners - 1, tree)]
    while todo:
        one, other, number = todo.pop()
        size = other - one - 1
        if not size:
            continue
        if size < corners - 2:
            found.append((one, other))
        root = int(np.searchsorted(trees.first[size, 1 : size + 1], number, side="right"))
        left, right = divmod(number - int(trees.first[size, root]), int(trees.counts[size - root]))
        todo += [(one, one + root, left), (one + root, other, right)]
    return sorted(found)


@dataclass(frozen=True)
class Row:
    """What is known of the flip graph of one polygon.

    `pair` is a farthest pair, as diagonals. `eccentricities` has, if all are known, the number of
    orbits by eccentricity; `searches` is how many were made.
    """

    n: int
    triangulations: int
    orbits: int
    diameter: int
    searches: int
    pair: list[list[tuple[int, int]]]
    eccentricities: dict[str, int] | None


def measure(
    corners: int,
    *,
    seed: int = 0,
    every: bool = False,
    watch: Callable[[int, int, int], object] | None = None,
) -> Row:
    """Return what is found of the polygon with so many corners.

    `watch` is called after each search with the number of searches, the greatest eccentricity found
    and the number of orbits that were open before it.
    """
    trees = all_trees(corners - 2)
    count = len(trees.flips)
    turned, orbit = np.empty(count, dtype=np.int32), np.empty(count, dtype=np.int32)
    turn(trees.first, trees.counts, turned)
    classes = orbits(turned, mirrored(trees), orbit, corners)
    firsts = np.unique(orbit, return_index=True)[1]
    low, high = np.zeros(classes, dtype=np.int32), np.full(classes, FAR, dtype=np.int32)
    distance, room = np.empty(count, dtype=np.uint8), np.empty(count, dtype=np.int32)
    draw = np.random.default_rng(seed)
    diameter, searches, ends = -1, 0, (0, 0)
    while True:
        open_ = np.flatnonzero(low < high if every else high > diameter)
        if not len(open_):
            break
        # In turn one that may be farthest, and one that may be central and so bounds others well.
        best = high[open_] == high[open_].max() if searches % 2 else low[open_] == low[open_].min()
        chosen = int(draw.choice(open_[best]))
        source = int(firsts[chosen])
        greatest = search(trees.flips, trees.parents, source, distance, room)
        searches += 1
        if greatest > diameter:
            diameter, ends = greatest, (source, int(np.flatnonzero(distance == greatest)[0]))
        narrow(distance, orbit, greatest, low, high)
        low[chosen] = high[chosen] = greatest
        if watch is not None:
            watch(searches, diameter, len(open_))
    known = {str(each): int(np.sum(low == each)) for each in np.unique(low)} if every else None
    pair = [diagonals(trees, end) for end in ends]
    return Row(corners, count, classes, diameter, searches, pair, known)


def read(path: Path) -> dict[int, Row]:
    """Return the rows of a file by n."""
    rows = json.loads(path.read_text("utf-8")) if path.exists() else []
    for row in rows:
        row["pair"] = [[(one, other) for one, other in each] for each in row["pair"]]
    return {row["n"]: Row(**row) for row in rows}


def write(path: Path, rows: dict[int, Row]) -> None:
    """Write the rows in ascending order, one a line."""
    lines = [json.dumps(asdict(rows[n]), separators=(",", ":")) for n in sorted(rows)]
    path.write_text("[\n" + ",\n".join(lines) + "\n]\n", "utf-8")


def sizes(text: str) -> Iterator[int]:
    """Yield the sizes of a range such as ``5..10``, or the one size."""
    low, _, high = text.partition("..")
    yield from range(int(low), int(high or low) + 1)


def main() -> None:
    """Print the rows that are asked for, and add them to a file."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("sizes", nargs="?", default="5..13", help="corners, 5..13 if not given")
    parser.add_argument("--quick", action="store_true", help="up to 10 corners only")
    parser.add_argument("--all", action="store_true", help="every eccentricity")
    parser.add_argument("--seed", type=int, default=0, help="of the order of the searches")
    parser.add_argument("-o", type=Path, metavar="FILE", help="a JSON file that gets the rows")
    asked = parser.parse_args()

    def watch(searches: int, diameter: int, left: int) -> None:
        if searches % 50 == 0:
            said = f"{searches} searches, at least {diameter}, {left} orbits open"
            print(said, file=sys.stderr, flush=True)

    for corners in sizes("5..10" if asked.quick else asked.sizes):
        began = process_time()
        row = measure(corners, seed=asked.seed, every=asked.all, watch=watch)
        seconds = process_time() - began
        known = "" if row.eccentricities is None else f", eccentricities {row.eccentricities}"
        print(
            f"{corners} corners: diameter {row.diameter}; {row.triangulations} triangulations,"
            f" {row.orbits} orbits, {row.searches} searches, {seconds:.1f} s{known}",
            flush=True,
        )
        if asked.o is not None:
            write(asked.o, read(asked.o) | {corners: row})


if __name__ == "__main__":
    main()
