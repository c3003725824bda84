"""The heap of pieces: the normal cube path of an edge path, updated as moves are appended.

An edge path up to homotopy is a word in the trace monoid of its actions (letters that commute may
be swapped) in which every letter is its own inverse: an element of a right-angled Coxeter group.
Its normal cube path is the Foata normal form of the reduced word. Sources: Abrams and Ghrist,
definition of normal cube path; Cartier and Foata; Viennot, heaps of pieces; Crisp, Godelle and
Wiest for linear time with cancellation.

The heap needs the actions alone, neither states nor files. The proof is in the docstring of `Heap`.
"""

from __future__ import annotations

from bisect import bisect_left, insort
from collections.abc import Iterable

from cubepath.protocol.core.actions import Action
from cubepath.protocol.core.sites import Site, in_order


class Heap:
    """A heap of pieces: each appended action falls until a piece that it does not commute with.

    Definition. Over every site of its support a piece lies as a writer (site in the trace) or as
    a reader (site in `Action.reads`). A writer lies over all pieces at the site, a reader over the
    last writer: these are exactly the pairs that do not commute, as
    `cubepath.protocol.core.actions.commute` defines it. The *level* of a piece is one more than the
    greatest level beneath it, and the pieces of level i are the i-th cube.

    Cancellation. A move that equals a piece p with nothing over it undoes p, however many moves
    came in between: all of them commute with it or have been cancelled. No search is needed, since
    a move cancels iff *it would lie exactly one level over the last piece equal to it*. Let p be
    this piece, L its level, and h the greatest level beneath the move. As the move does not commute
    with p, h >= L. If a piece lies over p, its level is above L and the move, being equal to p,
    lies over it too, so h > L. If h > L, the piece of level h beneath the move does not commute
    with p and has a greater level, so it lies over p.

    Removal. The level of a piece depends only on the pieces beneath it, and nothing lies over the
    piece that is removed, so no other level changes. A site forgets its last writer, or any one of
    the readers since.

    Cost. A move costs the size of its support, and at each site that it reads a place in the sorted
    list of the readers since the last writer. Space is that of the remaining pieces: empty columns
    and actions are dropped.

    >>> step = Action([1, 2], [1, 2], [1], [2])
    >>> far = Action([5, 6], [5, 6], [5], [6])
    >>> heap = Heap()
    >>> heap.extend([step, far])
    >>> heap.moves, heap.reduced_moves, heap.cubes
    (2, 2, 1)
    >>> heap.append(step)
    >>> heap.cube_path() == ((far,),)
    True
    """

    __slots__ = ("_columns", "_moves", "_placed", "_reduced", "_sizes")

    def __init__(self) -> None:
        """Make an empty heap: the path without moves."""
        # Invariant: `_columns` has a column iff a piece lies on it, `_placed` an action iff a piece
        # equals it. So the columns that a placed action holds are always those of `_columns`.
        self._columns: dict[Site, _Column] = {}
        self._placed: dict[Action, _Placed] = {}
        self._sizes: list[int] = []
        self._moves = 0
        self._reduced = 0

    @property
    def moves(self) -> int:
        """Return the number of moves appended so far; O(1)."""
        return self._moves

    @property
    def reduced_moves(self) -> int:
        """Return the number of moves that remain after cancellation; O(1)."""
        return self._reduced

    @property
    def cubes(self) -> int:
        """Return the length of the normal cube path, its number of cubes and its time; O(1)."""
        return len(self._sizes)

    @property
    def max_cube_dimension(self) -> int:
        """Return the greatest dimension of a cube, 0 if there is none; O(cubes)."""
        return max(self._sizes, default=0)

    def append(self, action: Action) -> None:
        """Add one move to the end of the edge path; see `Heap` for how and at what cost."""
        self._moves += 1
        placed = self._placed.get(action)
        if placed is None:
            placed = self._place(action)
        # Calling max() at each site would cost more than everything else.
        below = 0
        for column in placed.writes:
            if column.top > below:  # noqa: PLR1730 - see above
                below = column.top
        for column in placed.reads:
            if column.writer > below:  # noqa: PLR1730 - see above
                below = column.writer
        pieces = placed.pieces
        if pieces and pieces[-1][0] == below:
            self._take(placed, action)
        else:
            self._put(placed, action, below + 1)

    def extend(self, actions: Iterable[Action]) -> None:
        """Append the moves in order."""
        for action in actions:
            self.append(action)

    def cube_path(self) -> tuple[tuple[Action, ...], ...]:
        """Return the normal cube path; O(remaining moves), plus sorting the distinct actions.

        The actions of a cube are in the canonical order of the least sites of their traces. They
        commute, so their traces are disjoint and no two share that site: the order depends only on
        the content of the cube, not on the input or the process.
        """
        cubes: list[list[Action]] = [[] for _ in self._sizes]
        by_site: dict[Site, list[_Placed]] = {}
        for action, placed in self._placed.items():
            by_site.setdefault(in_order(action.trace)[0], []).append(placed)
        for site in in_order(by_site):
            for placed in by_site[site]:
                for level, action in placed.pieces:
                    cubes[level - 1].append(action)
        return tuple(tuple(cube) for cube in cubes)

    def _place(self, action: Action) -> _Placed:
        columns = self._columns

        def resolve(sites: frozenset[Site]) -> tuple[_Column, ...]:
            each = (columns.get(site) or columns.setdefault(site, _Column(site)) for site in sites)
            return tuple(each)

        placed = self._placed[action] = _Placed(resolve(action.trace), resolve(action.reads))
        return placed

    def _put(self, placed: _Placed, action: Action, level: int) -> None:
        placed.pieces.append((level, action))
        for column in placed.writes:
            column.write(level)
        for column in placed.reads:
            column.read(level)
        if level > len(self._sizes):
            self._sizes.append(1)
        else:
            self._sizes[level - 1] += 1
        self._reduced += 1

    def _take(self, placed: _Placed, action: Action) -> None:
        level, _ = placed.pieces.pop()
        for column in placed.writes:
            column.unwrite()
        for column in placed.reads:
            column.unread(level)
        self._sizes[level - 1] -= 1
        # Under every piece lies one of the level below, so only the last cube can become empty.
        if not self._sizes[-1]:
            self._sizes.pop()
        self._reduced -= 1
        if not placed.pieces:
            del self._placed[action]
            for column in (*placed.writes, *placed.reads):
                if not column.top:
                    del self._columns[column.site]


def normal_cube_path(actions: Iterable[Action]) -> tuple[tuple[Action, ...], ...]:
    """Return the normal cube path of an edge path, given as its moves in order.

    Definition: a cube path in which no action of a cube is in the cube before or commutes with all
    of it; there is exactly one in each homotopy class, and it is the shortest (Abrams and Ghrist,
    theorem on normal cube paths). One pass, see `Heap`. Whether the moves are admissible is not
    checked here; if they are admissible one after another, so are the cubes.

    >>> out, other = Action([1, 2], [1, 2], [1], [2]), Action([5, 6], [5, 6], [5], [6])
    >>> normal_cube_path([out, other, out, other])
    ()
    >>> normal_cube_path([other, out]) == normal_cube_path([out, other]) == ((out, other),)
    True
    """
    heap = Heap()
    heap.extend(actions)
    return heap.cube_path()


class _Placed:
    """An action that has pieces in the heap: the columns they lie on, and the pieces.

    Holding the columns saves hashing the sites again for every further equal move. `pieces` are
    ordered from the lowest to the highest, since equal actions do not commute. Each piece keeps its
    own action object, since equal actions may have different labels.
    """

    __slots__ = ("pieces", "reads", "writes")

    def __init__(self, writes: tuple[_Column, ...], reads: tuple[_Column, ...]) -> None:
        self.writes = writes
        self.reads = reads
        self.pieces: list[tuple[int, Action]] = []


class _Column:
    """The pieces over one site, as the levels of its writers and of the readers between them.

    `writer` is the level of the last writer, or 0; `top` the greatest level over the site. Levels
    rise from writer to readers to writer, so a level identifies a piece, except among the readers
    of one group.
    """

    __slots__ = ("_groups", "_readers", "_writers", "site", "top", "writer")

    def __init__(self, site: Site) -> None:
        self.site = site
        self.top = 0
        self.writer = 0
        # In ascending order.
        self._readers = _NOBODY
        # Under each writer: the writer before it, and the readers between the two.
        self._writers: list[int] = []
        self._groups: list[list[int]] = []

    def write(self, level: int) -> None:
        self._writers.append(self.writer)
        self._groups.append(self._readers)
        self._readers = _NOBODY
        self.writer = self.top = level

    def unwrite(self) -> None:
        self.writer = self._writers.pop()
        self._readers = self._groups.pop()
        self.top = self._readers[-1] if self._readers else self.writer

    def read(self, level: int) -> None:
        if not self._readers:
            self._readers = [level]
        elif level >= self._readers[-1]:
            self._readers.append(level)
        else:
            insort(self._readers, level)
        self.top = max(self.top, level)

    def unread(self, level: int) -> None:
        if self._readers[-1] == level:
            self._readers.pop()
        else:
            del self._readers[bisect_left(self._readers, level)]
        self.top = self._readers[-1] if self._readers else self.writer


_NOBODY: list[int] = []
"""The readers of a group that has none; it stays empty."""
