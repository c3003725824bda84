"""A system of another distribution: switches on a ring, each of which needs a quiet neighbour.

It is written as a stranger would write it, with the names that `cubepath.protocol` offers, and is
installed beside the project by the tests of foreign systems. Switch i may flip while switch i + 1
is off; so neighbours never flip at one time.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from math import cos, pi, sin
from typing import Any, ClassVar, Self

from cubepath.protocol import Action, Family, InputError, Move, Scene, Site, State, System
from cubepath.protocol.core.system import Bound, Ways

LETTERS = ("off", "on")
FIRST_CODE = 4


class Ring(System):
    """A site is ``(switch, "off")`` or ``(switch, "on")``; a switch is an agent that stays."""

    table: ClassVar[str] = "ring"
    filled = frozenset()
    drawing = "letters"
    letters = LETTERS
    site_size = 2
    move_slots = 1
    sense_slots = 1
    reach_slots = 2
    codes = FIRST_CODE + len(LETTERS)

    def __init__(self, size: int) -> None:
        """Make a ring of so many switches."""
        if size < 3:
            raise InputError(f"switches={size}: expected at least 3")
        self.size = size
        self.places = tuple(range(size))
        turns = [2 * pi * place / size for place in range(size)]
        self.positions = {
            place: (size / 4 * sin(turn), size / 4 * cos(turn)) for place, turn in enumerate(turns)
        }

    def to_table(self) -> dict[str, Any]:
        """Return the size."""
        return {"switches": self.size}

    @classmethod
    def from_table(cls, table: Mapping[str, Any]) -> Self:
        """Return the ring of a table."""
        if set(table) != {"switches"} or type(table["switches"]) is not int:
            raise InputError("a ring has the key switches, a whole number")
        return cls(table["switches"])

    def _split(self, site: Site) -> tuple[int, str]:
        match site:
            case (int(place), str(letter)) if 0 <= place < self.size and letter in LETTERS:
                return place, letter
            case _:
                raise InputError(f"{site!r} is no switch with off or on")

    def action(self, generator: str, at: Site) -> Action:
        """Return the flip of a switch."""
        if generator != "flip":
            raise InputError(f"unknown generator {generator!r}, expected flip")
        if not (type(at) is int and 0 <= at < self.size):
            raise InputError(f"generator flip: {at!r} is no switch, expected 0 to {self.size - 1}")
        off, on = (at, "off"), (at, "on")
        quiet = ((at + 1) % self.size, "off")
        return Action((off, on, quiet), (off, on), (off, quiet), (on, quiet), label=f"flip at {at}")

    def moves(self, site: Site) -> tuple[Move | None, ...]:
        """Return the one move of a switch."""
        place, letter = self._split(site)
        target = (place, "on" if letter == "off" else "off")
        return (Move(self.action("flip", place), "flip", place, ((site, target),)),)

    def sensed(self, place: Site) -> tuple[Site | None, ...]:
        """Return the next switch."""
        return ((self._number(place) + 1) % self.size,)

    def listeners(self, place: Site) -> tuple[Site, ...]:
        """Return the switch before."""
        return ((self._number(place) - 1) % self.size,)

    def reach(self, place: Site) -> tuple[Site, ...]:
        """Return both neighbours."""
        return tuple(sorted((self._number(place) + by) % self.size for by in (-1, 1)))

    def _number(self, place: Site) -> int:
        if isinstance(place, int):
            return place
        raise InputError(f"{place!r} is no switch")

    def encode_site(self, site: Site) -> tuple[int, ...]:
        """Return switch and letter."""
        place, letter = self._split(site)
        return place, LETTERS.index(letter)

    def decode_site(self, numbers: Sequence[int], label: int | None) -> Site:
        """Return the site."""
        del label
        return int(numbers[0]), LETTERS[int(numbers[1])]

    def has_place(self, place: Site) -> bool:
        """Tell whether it is a switch."""
        return isinstance(place, int) and 0 <= place < self.size

    def place_of(self, site: Site) -> Site:
        """Return the switch."""
        return self._split(site)[0]

    def site_at(self, place: Site, code: int) -> Site | None:
        """Return the site that shows this code."""
        return (place, LETTERS[code - FIRST_CODE]) if code >= FIRST_CODE else None

    def code_of(self, site: Site) -> int:
        """Return the code of the letter."""
        return FIRST_CODE + LETTERS.index(self._split(site)[1])

    def ways(self) -> Ways:
        """Return the other letter of the switch."""

        def near(site: Site) -> Iterable[Site]:
            return [move.target for move in self.moves(site) if move is not None]

        return Ways(near, one_to_one=True)

    def bounds(self, start: State, goal: State) -> Iterable[Bound]:
        """Return 2 where two neighbours have to flip: they never do at one time."""
        changed = {self.place_of(site) for site in goal - start}
        if any((self._number(place) + 1) % self.size in changed for place in changed):
            yield Bound(2, "neighbours take turns")

    def potential(self, goal: State) -> Callable[[Site], int]:
        """Return 1 for a switch that is not as it is to be."""
        return lambda site: int(site not in goal)


def ring(name: str, values: Mapping[str, str]) -> Scene:
    """Build a ring that is off, every other switch of which is to be on."""
    try:
        size = int(values["n"])
    except ValueError:
        raise InputError(f"n={values['n']}: expected a whole number") from None
    system = Ring(size)
    goal = tuple((place, LETTERS[place % 2]) for place in range(size))
    return Scene(
        spec=name,
        family=name,
        system=system,
        start=tuple((place, "off") for place in range(size)),
        goal=frozenset(goal),
        goals=tuple((site,) for site in goal),
    )


RING = Family(
    "ring",
    "switches on a ring, each of which flips while the next one is off",
    {"n": ("6", "number of switches")},
    ring,
    Ring,
)
