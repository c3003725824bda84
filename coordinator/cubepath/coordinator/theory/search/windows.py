"""Windows of a path replaced by shorter ones, found by search in the state complex.

A *window* is a set of moves of the normal cube path that can be made in direct succession: the
moves of some consecutive cubes, or one component of them, joined by moves that do not commute. The
search looks for another path between the two ends of the window and puts it in its place; then the
whole path is brought into normal form again. So the homotopy class may change, and the ends of the
path never do.

Sources: windows of plans, Siddiqui and Haslum, *Plan quality optimisation via block decomposition*
(2013); large neighbourhood search, Shaw (1998); beam search, Lowerre (1976).
"""

from collections.abc import Sequence
from random import Random

from cubepath.coordinator.normal_form.heap import Heap
from cubepath.coordinator.theory.search.exact import Parents, back, optimum
from cubepath.coordinator.theory.search.transitions import Potential, ReachableSites, Transitions
from cubepath.protocol.core.actions import Action, State

Cost = tuple[int, int]
"""Cubes, and moves: less is better."""
Path = list[tuple[int, ...]]
"""Cubes, as the numbers of their moves."""

_STATES = (200, 1_000, 5_000, 20_000)
"""Bounds on the number of states in the exhaustive search of a window."""
_BEAM = (4, 12, 40, 120)
"""Numbers of states that a beam keeps."""
_OFTEN = (12, 6, 3, 1)
"""The weights with which one of these bounds, or of these numbers, is chosen."""
_BANDS = (1, 4, 32)
"""Numbers of bands of cubes that are compared before one is taken."""
_TAILS = (0.7, 1.2, 2.0)
"""Exponents of the Pareto distribution of their widths; few bands are very wide."""
_PATIENCE = 6
"""The number of rounds that a beam may go without coming nearer to the goal."""
_CHOICES = 4
"""The number of cubes that are tried from each state of a beam."""


class WindowSearch:
    """A cube path that gets shorter, window by window; the cost never rises."""

    def __init__(self, steps: Transitions, start: State, cubes: Sequence[Sequence[Action]]) -> None:
        """Take a legal normal cube path, and cut out what lies between two visits to a state."""
        self._steps = steps
        self._ways = ReachableSites(steps.system)
        self._first = steps.encode(start)
        self._path: Path = [tuple(map(steps.number, cube)) for cube in cubes]
        self._states = steps.states(start, cubes)
        self._cut()

    @property
    def cost(self) -> Cost:
        """Return the number of cubes and of moves."""
        return len(self._path), sum(map(len, self._path))

    def actions(self) -> list[Action]:
        """Return the moves, cube by cube."""
        return [self._steps.actions[number] for cube in self._path for number in cube]

    def _take(self, word: Sequence[int]) -> bool:
        """Bring a word into normal form and keep it if it costs no more; return whether it does."""
        heap = Heap()
        heap.extend(self._steps.actions[number] for number in word)
        if (heap.cubes, heap.reduced_moves) > self.cost:
            return False
        number = self._steps.number
        self._path = [tuple(map(number, cube)) for cube in heap.cube_path()]
        self._states = [self._first]
        for cube in self._path:
            self._states.append(self._after(self._states[-1], cube))
        return True

    def _after(self, state: int, moves: Sequence[int]) -> int:
        for number in moves:
            state ^= self._steps.toggle[number]
        return state

    def _cut(self) -> None:
        """Cut out everything between two visits to the same state."""
        word = [number for cube in self._path for number in cube]
        states = [self._first]
        for number in word:
            states.append(states[-1] ^ self._steps.toggle[number])
        last = {state: place for place, state in enumerate(states)}
        found: list[int] = []
        place = last[self._first]
        while place < len(word):
            found.append(word[place])
            place = last[states[place + 1]]
        if len(found) < len(word):
            self._take(found)

    def step(self, random: Random) -> bool:
        """Try one window; return whether the cost of the path fell."""
        if not self._path:
            return False
        known = self.cost
        first, last = self._band(random)
        window = [number for cube in self._path[first:last] for number in cube]
        rest: list[int] = []
        still = 0
        if random.random() < 0.5:
            window, rest, still = self._component(random, window, self._states[first])
        begin, end = self._states[first], self._after(self._states[first], window)
        found = self._between(random, begin, end, last - first, still)
        if found is None or sum(map(len, found)) > len(window) + (last - first > len(found)) * 1000:
            return False
        ahead = [number for cube in self._path[:first] for number in cube]
        behind = [number for cube in self._path[last:] for number in cube]
        new = [number for cube in found for number in cube]
        if new == window:
            return False
        if self._take([*ahead, *new, *rest, *behind]) and self.cost < known:
            self._cut()
            return True
        return False

    def _band(self, random: Random) -> tuple[int, int]:
        """Draw some bands of consecutive cubes; return the one that changes least for its width."""
        cubes = len(self._path)
        found = (0, cubes)
        best = -1.0
        tail = random.choice(_TAILS)
        for _ in range(random.choice(_BANDS)):
            width = min(cubes, 2 + int(random.paretovariate(tail)))
            first = random.randrange(cubes - width + 1)
            changed = (self._states[first] ^ self._states[first + width]).bit_count()
            value = (width + 1) / (changed + 1)
            if value > best:
                best, found = value, (first, first + width)
        return found

    def _component(
        self, random: Random, window: list[int], begin: int
    ) -> tuple[list[int], list[int], int]:
        """Split a window into a component, the rest, and the sites that are to stay still.

        The component holds one random move of the window, and all moves that are joined to it by
        moves that do not commute. It commutes with the rest, so it can go first. The sites that
        stay still are occupied at the beginning and not written by the component; half the time
        those that it reads are excepted.
        """
        steps = self._steps
        first = random.choice(window)
        traces, supports = steps.trace[first], steps.support[first]
        apart = window
        while True:
            steps.budget.spend()
            left: list[int] = []
            for number in apart:
                if steps.trace[number] & supports or steps.support[number] & traces:
                    traces |= steps.trace[number]
                    supports |= steps.support[number]
                else:
                    left.append(number)
            if len(left) == len(apart):
                break
            # Moves that follow each other are met one after another in one of the directions.
            apart = left[::-1]
        still = begin & ~traces
        if random.random() < 0.5:
            # Modules beside the component may have to give way.
            still &= ~supports
        others = set(apart)
        chosen = [number for number in window if number not in others]
        return chosen, [number for number in window if number in others], still

    def _between(
        self, random: Random, begin: int, end: int, most: int, still: int
    ) -> Sequence[tuple[int, ...]] | None:
        """Search for a cube path of at most `most` cubes between two states."""
        if begin == end:
            return ()
        if random.random() < 0.5:
            states = random.choices(_STATES, _OFTEN)[0]
            found = optimum(self._steps, begin, end, max_states=states, most=most, still=still)
            return found.cubes
        back = random.random() < 0.5
        ends = (end, begin) if back else (begin, end)
        potential = Potential(self._steps, *ends, self._ways)
        path = beam(self._steps, potential, most, random=random, still=still)
        return path[::-1] if back and path is not None else path


def beam(
    steps: Transitions, potential: Potential, most: int, *, random: Random, still: int = 0
) -> Path | None:
    """Search for a cube path of at most `most` cubes between the ends of a potential.

    The states that seem nearest to the goal are kept. From each, some cubes are tried, built with a
    random preference for moves towards the goal; no state is visited twice. None if the goal is not
    reached.
    """
    width = random.choices(_BEAM, _OFTEN)[0]
    noise = random.choice((0.5, 3.0, 8.0))
    begin, end = potential.start, potential.goal
    parents: Parents = {begin: (begin, ())}
    kept = [(potential.of(begin), begin)]
    best, since = kept[0][0], 0
    for _ in range(most):
        found: dict[int, int] = {}
        for value, state in kept:
            options = steps.possible(state, still)
            changes = {number: potential.change(number, state) for number in options}
            for _ in range(_CHOICES):
                wishes = [
                    (changes[each] + noise * (random.random() - 0.5), each) for each in options
                ]
                cube = steps.greedy([each for wish, each in sorted(wishes) if wish < 0])
                steps.budget.spend()
                there = state
                for number in cube:
                    there ^= steps.toggle[number]
                if there in parents:
                    continue
                parents[there] = state, tuple(cube)
                found[there] = value + sum(changes[number] for number in cube)
                if there == end:
                    return back(parents, there)[::-1]
        kept = sorted((value, state) for state, value in found.items())[:width]
        since = 0 if kept and kept[0][0] < best else since + 1
        if not kept or since > _PATIENCE:
            break
        best = min(best, kept[0][0])
    return None
