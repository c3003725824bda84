"""States as integers and moves by number: the graph that searches in a state complex walk on.

A site has a bit, a state is the number with the bits of its sites on, and a move flips the bits of
its `toggle`. Sites and moves are numbered in the order in which they are met, which depends only on
the system and the questions. Nothing is enumerated beforehand: the lattice may be infinite.
`cubepath.coordinator.theory.complexes.state_masks` is the form for compiled code.

A move that is known by a list alone is met at the first site, in canonical order, that is on before
it; one before which nothing is on is met anywhere.

A potential guides a search, and affects only how soon the search finds something.

There is only one class if the state complex is simply connected. State complexes of local systems
are non-positively curved (Abrams and Ghrist), so their universal covers are contractible: for them,
simply connected and contractible are the same.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import NamedTuple

from cubepath.coordinator.theory.complexes.collapses import contractibility
from cubepath.coordinator.theory.complexes.exploration import explore
from cubepath.coordinator.theory.complexes.homology_groups import homology
from cubepath.coordinator.theory.complexes.state_complexes import f_vector, state_complex
from cubepath.coordinator.theory.search.budget import Budget, SpentError
from cubepath.coordinator.theory.search.lower_bounds import potential_of, ways_of
from cubepath.protocol.core.actions import Action, State
from cubepath.protocol.core.sites import Ordinals, Site, in_order, site_text
from cubepath.protocol.core.system import Scene, System
from cubepath.protocol.scenes.registry import families_of


class _Row(NamedTuple):
    """A move that may be made if a site is on: which bits it needs, and their values."""

    number: int
    need: int
    shown: int
    guards: tuple[tuple[int, int], ...]


LABELS_MAX = 64
"""With more labels the supports of vehicles are too large for masks: see `maskable`."""


def maskable(system: System | None) -> bool:
    """Return whether states of the system are small enough to be represented as integers."""
    return system is None or (system.labels or 0) <= LABELS_MAX


class Transitions:
    """The moves of a system, or of a finite list of actions, on states that are integers.

    `actions` holds the actions by number; `toggle`, `trace` and `support` their masks.
    """

    def __init__(
        self, system: System | None, listed: Iterable[Action] = (), *, budget: Budget | None = None
    ) -> None:
        """Take the moves of `system`, or without one the `listed` actions.

        Searches spend the budget. A SpentError leaves everything that is known here consistent.
        """
        self.system = system
        self.budget = Budget() if budget is None else budget
        self.actions: list[Action] = []
        self.toggle: list[int] = []
        self.trace: list[int] = []
        self.support: list[int] = []
        self.sites: list[Site] = []
        self._discover = None if system is None else system.discovery()
        # Sites whose moves are known, or that the discovery was given.
        self._met = 0
        self._bits = Ordinals[Site]()
        self._numbers: dict[Action, int] = {}
        self._rows: list[list[_Row]] = []
        # Sites at which nothing moves, so they need not be looked at.
        self._still = 0
        self._listed: dict[Site, list[tuple[Action, int]]] = {}
        # Moves that no occupied site proposes, which only a list can have.
        self._anywhere: list[_Row] = []
        for action in dict.fromkeys(listed):
            for end in (0, 1):
                if on := action.ends[end]:
                    self._listed.setdefault(in_order(on)[0], []).append((action, end))
                else:
                    self._anywhere.append(self._row(action, end))

    def bit(self, site: Site) -> int:
        """Return the number of the bit of a site."""
        found = self._bits[site]
        if found == len(self.sites):
            self.sites.append(site)
            self._rows.append([])
        return found

    def encode(self, sites: Iterable[Site]) -> int:
        """Return the state in which these sites are on."""
        found = 0
        for site in in_order(sites):
            found |= 1 << self.bit(site)
        return found

    def decode(self, state: int) -> frozenset[Site]:
        """Return the sites that are on."""
        return frozenset(self.sites[bit] for bit in bits_of(state))

    def number(self, action: Action) -> int:
        """Return the number of an action."""
        found = self._numbers.get(action)
        if found is None:
            self.budget.spend()
            found = self._numbers[action] = len(self.actions)
            self.actions.append(action)
            first, second = map(self.encode, action.ends)
            self.toggle.append(first ^ second)
            self.trace.append(self.encode(action.trace))
            self.support.append(self.encode(action.support))
        return found

    def possible(self, state: int, still: int = 0) -> list[int]:
        """Return the numbers of the moves that are admissible at the state, each once.

        Moves that write a site of `still` are left out. The rows of movers that stand there are
        skipped; unless moves are discovered, the system is not asked for them either.
        """
        found: dict[int, None] = {}
        for bit in bits_of(state & ~self._met & (-1 if self._discover else ~still)):
            self._meet(bit)
        left = state & ~self._still & ~still
        while left:
            low = left & -left
            left ^= low
            bit = low.bit_length() - 1
            for number, need, shown, guards in self._rows[bit]:
                if state & need == shown and not (guards and _unheld(guards, state)):
                    found[number] = None
        for number, need, shown, guards in self._anywhere:
            if state & need == shown and not (guards and _unheld(guards, state)):
                found[number] = None
        if still:
            return [number for number in found if not self.trace[number] & still]
        return list(found)

    def _meet(self, bit: int) -> None:
        """Learn the moves of a site that is on for the first time."""
        self.budget.spend()
        site = self.sites[bit]
        self._met |= 1 << bit
        if self.system is None:
            self._rows[bit] += [self._row(*each) for each in self._listed.get(site, ())]
        else:
            ask = self._discover or self.system.moves_at
            for move in ask(site):
                rows = self._rows[self.bit(move.source)]
                rows += [
                    self._row(move.action, end)
                    for end in (0, 1)
                    if all(source in move.action.ends[end] for source, _ in move.motion)
                ]
                # A site that had no moves so far may get one later.
                self._still &= ~(1 << self.bit(move.source))
        if not self._rows[bit]:
            self._still |= 1 << bit

    def _row(self, action: Action, end: int) -> _Row:
        number = self.number(action)
        guards = tuple(
            (1 << self.bit(site), 1 << self.bit(neighbour))
            for site, neighbour in sorted(action.guards, key=site_text)
        )
        need = self.encode(action.support - action.free)
        return _Row(number, need, self.encode(action.ends[end]), guards)

    def commute(self, one: int, other: int) -> bool:
        """Return whether two moves commute: `actions.commute` on masks."""
        return not (self.trace[one] & self.support[other] or self.trace[other] & self.support[one])

    def cubes(self, state: int, still: int = 0) -> Iterator[tuple[int, tuple[int, ...]]]:
        """Yield each non-empty set of commuting moves at the state, with the state after it."""
        options = self.possible(state, still)
        with_later = [
            sum(
                1 << later
                for later in range(place + 1, len(options))
                if self.commute(one, options[later])
            )
            for place, one in enumerate(options)
        ]
        waiting: list[tuple[int, int, tuple[int, ...]]] = [(state, (1 << len(options)) - 1, ())]
        while waiting:
            here, allowed, chosen = waiting.pop()
            while allowed:
                low = allowed & -allowed
                allowed ^= low
                place = low.bit_length() - 1
                there = here ^ self.toggle[options[place]]
                cube = (*chosen, options[place])
                yield there, cube
                further = allowed & with_later[place]
                if further:
                    waiting.append((there, further, cube))

    def greedy(self, options: Sequence[int]) -> list[int]:
        """Return a maximal set of commuting moves, built greedily in the order of `options`."""
        chosen: list[int] = []
        traces = supports = 0
        for number in options:
            if not (self.trace[number] & supports or self.support[number] & traces):
                chosen.append(number)
                traces |= self.trace[number]
                supports |= self.support[number]
        return chosen

    def states(self, start: State, cubes: Iterable[Iterable[Action]]) -> list[int]:
        """Return the states before the first cube and after each; none is checked."""
        found = [self.encode(start)]
        for cube in cubes:
            state = found[-1]
            for action in cube:
                state ^= self.toggle[self.number(action)]
            found.append(state)
        return found


def _unheld(guards: tuple[tuple[int, int], ...], state: int) -> bool:
    return any(state & site and not state & neighbour for site, neighbour in guards)


def bits_of(state: int) -> list[int]:
    """Return the numbers of the bits that are on, in ascending order."""
    found: list[int] = []
    while state:
        low = state & -state
        found.append(low.bit_length() - 1)
        state ^= low
    return found


_MARGIN = 2
"""Sites farther than all modules of the start by more than this need no exact distance."""


class ReachableSites:
    """The sites that a module can move to from each site; the system is asked once for each."""

    def __init__(self, system: System | None) -> None:
        """Ask the system."""
        found = None if system is None else ways_of(system)
        self._near = None if found is None else found.near
        self._known: dict[Site, tuple[Site, ...]] = {}

    @property
    def known(self) -> bool:
        """Return whether the system says where modules can go."""
        return self._near is not None

    def near(self, site: Site) -> tuple[Site, ...]:
        """Return the sites that are one step away."""
        found = self._known.get(site)
        if found is None and self._near is not None:
            found = self._known[site] = tuple(self._near(site))
        return found or ()


class Potential:
    """The potential of the sites towards a goal, and what each move changes.

    It is the potential of the system itself. If the system has none, it is the distance to the
    nearest site of the goal along the ways of modules; if these are not known, 1 off the goal.
    """

    def __init__(
        self, steps: Transitions, start: int, goal: int, ways: ReachableSites | None = None
    ) -> None:
        """Measure the sites as far as the modules of `start`, and a little beyond."""
        self.start, self.goal = start, goal
        self._steps = steps
        self._of_bit: dict[int, int] = {}
        self._changes: dict[int, tuple[int, int]] = {}
        self._at = _measure(
            steps, start, goal, ReachableSites(steps.system) if ways is None else ways
        )

    def of(self, state: int) -> int:
        """Return the sum over the sites that are on."""
        return sum(map(self._bit, bits_of(state)))

    def _bit(self, bit: int) -> int:
        found = self._of_bit.get(bit)
        if found is None:
            found = self._of_bit[bit] = self._at(self._steps.sites[bit])
        return found

    def change(self, number: int, state: int) -> int:
        """Return how much a move that is admissible at the state changes the sum."""
        known = self._changes.get(number)
        toggle = self._steps.toggle[number]
        before = toggle & state
        if known is None:
            change = self.of(toggle ^ before) - self.of(before)
            self._changes[number] = before, change
            return change
        return known[1] if known[0] == before else -known[1]


def _measure(
    steps: Transitions, start: int, goal: int, ways: ReachableSites
) -> Callable[[Site], int]:
    goals = steps.decode(goal)
    system = steps.system
    potential = None if system is None else potential_of(system, goals)
    if potential is not None:
        return potential
    if not ways.known:
        return lambda site: int(site not in goals)
    known = dict.fromkeys(goals, 0)
    waiting = set(steps.decode(start)) - goals
    layer: Iterable[Site] = list(known)
    distance = beyond = 0
    while layer and beyond <= _MARGIN:
        distance += 1
        following: dict[Site, None] = {}
        for here in layer:
            for there in ways.near(here):
                if there not in known:
                    known[there] = distance
                    following[there] = None
        waiting -= following.keys()
        beyond += not waiting
        layer = following
    return lambda site: known.get(site, distance + 1)


STATES_MAX = 2_000
"""A complex with more states is not computed."""
_CUBES_MAX = 50_000


def only_class(steps: Transitions, start: State) -> bool | None:
    """Return whether all paths between two states reachable from `start` are homotopic.

    True if a family of scenes knows it, by an argument for all sizes. For other systems the complex
    is computed if it has at most `STATES_MAX` states: True if it collapses to a point, False if its
    homology differs from that of a point. None if neither is found, or the budget of `steps` is
    spent.

    >>> scene = scene_from_spec("agv:graph=C4,n=1")
    >>> only_class(Transitions(scene.system), scene.start_state)
    False
    """
    system = steps.system
    if system is None:
        return None
    if any(family.one_class(system, start) for family in families_of(system)):
        return True
    if not _are_few(steps, start):
        return None
    scene = Scene("", "", system, in_order(start - system.filled))
    explored = explore(scene, max_states=STATES_MAX)
    if not explored.complete or sum(f_vector(explored)) > _CUBES_MAX:
        return None
    found = state_complex(explored).complex
    answer = contractibility(found, homology(found))
    return {"collapses to a point": True, "not contractible": False}.get(answer)


def _are_few(steps: Transitions, start: State) -> bool:
    """Return whether at most `STATES_MAX` states are reachable; a larger complex costs little."""
    first = steps.encode(start)
    known, waiting = {first}, [first]
    for state in waiting:
        try:
            steps.budget.spend()
            options = steps.possible(state)
        except SpentError:
            return False
        # Each of these moves can be made or not, independently of the others.
        if 1 << len(steps.greedy(options)) > STATES_MAX:
            return False
        for number in options:
            there = state ^ steps.toggle[number]
            if there not in known:
                known.add(there)
                waiting.append(there)
        if len(known) > STATES_MAX:
            return False
    return True
