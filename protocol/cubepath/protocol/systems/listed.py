"""Systems listed move by move: a finite set of actions on any sites, with where modules go.

For systems that are neither a lattice with translations nor a graph: flips of triangulations,
words, assemblies, arms with marked points. All neighbourhoods follow from the list.
"""

from collections.abc import Iterable, Mapping, Sequence
from functools import cached_property, lru_cache, partial
from itertools import chain
from math import dist, inf, isfinite
from typing import Any, ClassVar, Self

import msgspec

from cubepath.protocol.core.actions import Action, ActionContents, commute, contents_of
from cubepath.protocol.core.catalogue import Move
from cubepath.protocol.core.errors import ExcludedError, InputError
from cubepath.protocol.core.sites import Site, in_order, site_hook, site_text, to_json
from cubepath.protocol.core.system import FAR, FIRST_LABEL, KEPT, System, Ways, one_to_one

Point = tuple[float, float]
DRAWINGS = ("chords", "letters", "edges", "graph")


class TabledSystem(System):
    """A finite list of moves; each is listed once and goes both ways.

    With `letters` a site may be ``(place, letter)``: the module is then a fixed place and moves
    change its letter, exactly one of which is on at any time. `fixed` are sites that are always on
    and in no trace (obstacles). `positions` says where places lie in a picture, `drawing` how they
    look: "chords" (a place is a pair of points), "letters" (a row of places), "edges" or "graph".

    >>> step = Action(["a", "b"], ["a", "b"], ["a"], ["b"])
    >>> system = TabledSystem([Move(step, "step", "a", (("a", "b"),))], drawing="graph")
    >>> [move.target for move in system.moves("a") if move is not None]
    ['b']
    """

    table: ClassVar[str] = "listed"

    def __init__(
        self,
        moves: Iterable[Move],
        *,
        letters: Sequence[str] = (),
        fixed: Iterable[Site] = (),
        drawing: str,
        positions: Mapping[Site, Point] | None = None,
    ) -> None:
        """Check that the names of moves differ and that each move says where its modules go."""
        self.listed = tuple(moves)
        self.letters = tuple(letters)
        self.filled = frozenset(fixed)
        self.drawing = drawing
        self.positions = dict(positions or {})
        self.codes = FIRST_LABEL + len(self.letters)
        self._letter = {letter: number for number, letter in enumerate(self.letters)}
        if len(self._letter) < len(self.letters):
            twice = next(each for each in self.letters if self.letters.count(each) > 1)
            raise InputError(f"letter {twice!r} stands twice among the letters")
        if drawing not in DRAWINGS:
            raise InputError(f"drawing {drawing!r}: expected one of {', '.join(DRAWINGS)}")
        for site in in_order(self.filled):
            if self._split(site)[1] is not None:
                raise InputError(f"{site!r} is fixed and has a letter: a place with letters moves")
        self.by_name: dict[tuple[str, Site], Move] = {}
        self._by_source: dict[Site, list[Move]] = {}
        # The moves that read and that write a site, by the place of the mover.
        self._readers: dict[Site, dict[Site, list[Move]]] = {}
        self._writers: dict[Site, dict[Site, list[Move]]] = {}
        for move in self.listed:
            self._file(move)
        if not self.listed:
            raise InputError("a system has at least one move, found none")
        sites = in_order(
            {site for move in self.listed for site in move.action.support} | self.filled
        )
        self.places = in_order({self.place_of(site) for site in sites})
        self._check_positions()
        self._index = {place: number for number, place in enumerate(self.places)}
        self._sites_at: dict[Site, list[Site]] = {}
        for site in sites:
            self._sites_at.setdefault(self.place_of(site), []).append(site)
        self._lettered = in_order(
            {place for place, letter in map(self._split, sites) if letter is not None}
        )
        self.site_size = 2 if self.letters else 1
        self.move_slots = max(len(found) for found in self._by_source.values())
        self._near = {place: self._seen_from(place) for place in self.places}
        self.sense_slots = max(len(found) for found in self._near.values())
        heard: dict[Site, list[Site]] = {place: [] for place in self.places}
        for place, near in self._near.items():
            for other in near:
                heard[other].append(place)
        self._heard = {place: in_order(found) for place, found in heard.items()}
        self._reach = lru_cache(maxsize=KEPT)(self._competitors)
        self._coordinates = self._in_moves()
        self.dimension = 2 if self._coordinates else 0

    def _file(self, move: Move) -> None:
        key = (move.generator, move.at)
        if key in self.by_name:
            raise InputError(f"{move.generator} at {move.at!r} stands twice among the moves")
        self.by_name[key] = move
        action = move.action
        sources = frozenset(source for source, _ in move.motion)
        targets = frozenset(target for _, target in move.motion)
        ends = {end & action.trace for end in action.ends}
        if {sources, targets} != ends or not len(sources) == len(targets) == len(move.motion):
            raise InputError(
                f"{action.label}: 'goes' must take every site of the trace that is on before to"
                " one that is on after, and at least one"
            )
        if action.trace & self.filled:
            stray = in_order(action.trace & self.filled)[0]
            raise InputError(f"{action.label}: its trace holds {stray!r}, which is fixed")
        back = Move(action, move.generator, move.at, tuple((b, a) for a, b in move.motion))
        for each in (move, back):
            self._by_source.setdefault(each.source, []).append(each)
            place = self.place_of(each.source)
            for site in action.support:
                self._readers.setdefault(site, {}).setdefault(place, []).append(each)
            for site in action.trace:
                self._writers.setdefault(site, {}).setdefault(place, []).append(each)

    def _check_positions(self) -> None:
        for place, position in self.positions.items():
            if not all(map(isfinite, position)):
                raise InputError(f"position of {place!r}: expected two numbers, found {position}")
        for place in self.places if self.drawing == "chords" else ():
            ends = place if isinstance(place, tuple) and len(place) == 2 else (None,)
            if not self.positions.keys() >= {*ends}:
                raise InputError(f"chord {place!r}: expected a pair of points that have positions")

    def _in_moves(self) -> dict[Site, tuple[float, float]]:
        """Return the positions of all places, where one is the mean length of a move in the plane.

        Empty if some place has no position, if no move takes a module anywhere, or if there is no
        such scale: a picture may be as large as it likes.
        """
        if not self.positions.keys() >= {*self.places}:
            return {}
        lines = TabledSystem.lines(self)  # a class that derives from this one is not ready yet
        ways = (dist(self.positions[one], self.positions[other]) for one, other in lines)
        lengths = [length for length in ways if length]
        unit = sum(lengths) / len(lengths) if lengths else inf
        if not isfinite(unit):
            return {}
        found = {
            place: (self.positions[place][0] / unit, self.positions[place][1] / unit)
            for place in self.places
        }
        fits = all(-FAR < number < FAR for numbers in found.values() for number in numbers)
        return found if fits else {}

    def __reduce__(self) -> tuple[object, ...]:
        # The caches cannot be pickled, and need not be.
        build = partial(
            type(self),
            self.listed,
            letters=self.letters,
            fixed=self.filled,
            drawing=self.drawing,
            positions=self.positions,
        )
        return build, ()

    def to_table(self) -> dict[str, Any]:
        """Return drawing, letters, fixed sites, positions and moves."""
        table: dict[str, Any] = {"drawing": self.drawing}
        if self.letters:
            table["letters"] = list(self.letters)
        if self.filled:
            table["fixed"] = to_json(in_order(self.filled))
        if self.positions:
            table["positions"] = [
                [to_json(place), *map(float, self.positions[place])]
                for place in in_order(self.positions)
            ]
        table["moves"] = [_of_move(move) for move in self.listed]
        return table

    @classmethod
    def from_table(cls, table: Mapping[str, Any]) -> Self:
        """Return the system of a table ``[listed]``; docs/files.md has its keys."""
        found = msgspec.convert(table, _ListTable, dec_hook=site_hook)
        return cls(
            [each.move() for each in found.moves],
            letters=found.letters,
            fixed=found.fixed,
            drawing=found.drawing,
            positions={place: (x, y) for place, x, y in found.positions},
        )

    def lines(self) -> Iterable[tuple[Site, Site]]:
        """Return the pairs of places between which modules go."""
        motion = (ends for move in self.listed for ends in move.motion)
        return dict.fromkeys((self.place_of(a), self.place_of(b)) for a, b in motion)

    def ways(self) -> Ways:
        """Return where the listed moves take modules, both ways."""
        listed: dict[Site, dict[Site, None]] = {}
        for move in self.listed:
            for one, other in move.motion:
                listed.setdefault(one, {})[other] = None
                listed.setdefault(other, {})[one] = None
        return Ways(
            lambda site: listed.get(site, {}), one_to_one(move.motion for move in self.listed)
        )

    def _seen_from(self, place: Site) -> tuple[Site, ...]:
        return in_order(
            {
                self.place_of(site)
                for own in self._sites_at[place]
                for move in self._by_source.get(own, ())
                for site in move.action.support
            }
            - {place}
        )

    def _competitors(self, place: Site) -> tuple[Site, ...]:
        found: set[Site] = set()
        for own in self._sites_at[place]:
            for move in self._by_source.get(own, ()):
                found |= {self.place_of(source) for source, _ in move.motion[1:]}
                near = [self._readers[site] for site in move.action.trace]
                near += [self._writers.get(site, {}) for site in move.action.support]
                for there, others in chain.from_iterable(map(dict.items, near)):
                    if there not in found and any(
                        not commute(move.action, other.action) for other in others
                    ):
                        found.add(there)
            for move in chain.from_iterable(self._writers.get(own, {}).values()):
                if any(source == own for source, _ in move.motion[1:]):
                    found.add(self.place_of(move.source))
        return in_order(found - {place})

    @cached_property
    def reach_slots(self) -> int:  # type: ignore[override]
        """Return the greatest number of places within reach; computed on first use."""
        return max(1, *(len(self.reach(place)) for place in self.places))

    def moves(self, site: Site) -> tuple[Move | None, ...]:
        """Return the moves whose mover is at `site`, in the order of the list."""
        found = self._by_source.get(site, [])
        return (*found, *[None] * (self.move_slots - len(found)))

    def action(self, generator: str, at: Site) -> Action:
        """Return the action listed under this name and place; InputError if there is none."""
        found = self.by_name.get((generator, at))
        if found is None:
            names = in_order({name for name, _ in self.by_name})
            if generator not in names:
                known = ", ".join(str(name) for name in names)
                raise InputError(f"unknown generator {generator!r}, expected one of {known}")
            raise ExcludedError(f"generator {generator!r}: there is no move at {at!r}")
        return found.action

    def sensed(self, place: Site) -> tuple[Site | None, ...]:
        """Return the places of the supports of all moves of a module at `place`."""
        found = self._near.get(place, ())
        return (*found, *[None] * (self.sense_slots - len(found)))

    def listeners(self, place: Site) -> tuple[Site, ...]:
        """Return the places from which a module senses `place`."""
        return self._heard.get(place, ())

    def reach(self, place: Site) -> tuple[Site, ...]:
        """Return the places of possible competitors of a module at `place`."""
        return self._reach(place)

    def coordinates(self, place: Site) -> tuple[float, ...]:
        """Return the position of a place in mean lengths of a move, if all places have one."""
        return self._coordinates.get(place, ())

    def encode_site(self, site: Site) -> tuple[int, ...]:
        """Return the number of the place and, with letters, that of the letter (0 for none)."""
        place, letter = self._split(site)
        number = self._index[place]
        if not self.letters:
            return (number,)
        return (number, 0 if letter is None else 1 + self._letter[letter])

    def decode_site(self, numbers: Sequence[int], label: int | None) -> Site:
        """Return the site."""
        del label
        place = self.places[int(numbers[0])]
        if not self.letters or not numbers[1]:
            return place
        return (place, self.letters[int(numbers[1]) - 1])

    def has_place(self, place: Site) -> bool:
        """Return whether `place` is in the support of some move and not fixed."""
        return place in self._index and place not in self.filled

    def check_place(self, place: Site) -> None:
        """Raise InputError if `place` is none in the moves' own spelling: true is not 1."""
        super().check_place(place)
        known = self.places[self._index[place]]
        if site_text(place) != site_text(known):
            raise InputError(f"the place is {site_text(known)}")

    def _split(self, site: Site) -> tuple[Site, str | None]:
        if isinstance(site, tuple) and len(site) == 2:
            place, letter = site
            if isinstance(letter, str) and letter in self._letter:
                return place, letter
        return site, None

    def place_of(self, site: Site) -> Site:
        """Return the place of a site: without its letter, if it has one."""
        return self._split(site)[0]

    def site_at(self, place: Site, code: int) -> Site | None:
        """Return the site that is on at a place that shows `code`."""
        if code >= FIRST_LABEL:
            return (place, self.letters[code - FIRST_LABEL])
        return super().site_at(place, code)

    def code_of(self, site: Site) -> int:
        """Return MODULE or FILLED, or the code of the letter."""
        letter = self._split(site)[1]
        return super().code_of(site) if letter is None else FIRST_LABEL + self._letter[letter]

    def check_state(self, sites: Iterable[Site]) -> None:
        """Check that a letter is on at every place that has letters."""
        on = {self.place_of(site) for site in sites}
        for place in self._lettered:
            if place not in on:
                raise InputError(f"no letter is on at place {place!r}")


class _MoveTable(ActionContents, frozen=True):
    generator: str
    at: Site
    motion: tuple[tuple[Site, Site], ...] = msgspec.field(name="goes")

    def move(self) -> Move:
        """Return the move; InputError if it is none."""
        action = self.action(f"{self.generator} at {site_text(self.at)}")
        return Move(action, self.generator, self.at, self.motion)


class _ListTable(msgspec.Struct, forbid_unknown_fields=True, omit_defaults=True):
    drawing: str
    moves: list[_MoveTable]
    letters: list[str] = []
    fixed: list[Site] = []
    positions: list[tuple[Site, float, float]] = []


def _of_move(move: Move) -> dict[str, Any]:
    reverse = not {source for source, _ in move.motion} <= move.action.ends[0]
    contents = msgspec.structs.asdict(contents_of(move.action, reverse=reverse))
    parts = {"generator": move.generator, "at": move.at, **contents, "goes": move.motion}
    return {
        key: to_json(part) for key, part in parts.items() if part or key not in ("free", "guards")
    }
