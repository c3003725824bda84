"""Who hears whom, by the definitions of the protocol's page, from the TOML of a scene alone."""

import tomllib
from collections.abc import Callable, Iterable, Iterator
from typing import Any, NamedTuple

import pytest

from cubepath.protocol.scenes.specs import scene_from_spec
from cubepath.protocol.scenes.toml import scene_to_toml

SPECS = [
    "agv:graph=grid9x3,n=4",
    "agv:graph=S4,n=2",
    "agv-labelled:graph=grid4x3,n=3",
    "hex:n=5",
    "arm-free:n=4",
    "sliding:p=3,q=2",
    pytest.param("arms", marks=pytest.mark.slow),
    "words",
]
FAR = 6
"""No support of the lattices here reaches as far."""
Place = Any


class Move(NamedTuple):
    """A move from a place: what it reads, what it writes, and who goes where, the mover first."""

    support: frozenset[Any]
    trace: frozenset[Any]
    motion: tuple[tuple[Any, Any], ...]


def frozen(value: Any) -> Any:
    """Return lists as tuples."""
    if isinstance(value, dict):
        return {key: frozen(item) for key, item in value.items()}
    return tuple(map(frozen, value)) if isinstance(value, list) else value


def both_ways(goes: Iterable[Any]) -> Iterator[tuple[tuple[Any, Any], ...]]:
    """Yield a motion and its reverse."""
    pairs = tuple(goes)
    yield pairs
    yield tuple((after, before) for before, after in pairs)


def on_graph(graph: dict[str, Any], place: Place) -> Iterator[Move]:
    """Yield the moves along the edges at a place."""
    labels = range(graph["labels"]) if "labels" in graph else (None,)
    for edge in graph["edges"]:
        if place not in edge:
            continue
        there = edge[1] if edge[0] == place else edge[0]
        sites = {label: [_site(end, label) for end in edge] for label in labels}
        support = frozenset(site for both in sites.values() for site in both)
        for label, ends in sites.items():
            motion = ((_site(place, label), _site(there, label)),)
            yield Move(support, frozenset(ends), motion)


def _site(place: Place, label: int | None) -> Any:
    return place if label is None else (place, label)


def on_lattice(lattice: dict[str, Any], place: Place) -> Iterator[Move]:
    """Yield every generator in both directions, with its mover put at a place."""
    for generator in lattice["generators"]:
        for motion in both_ways(generator["goes"]):
            mover = motion[0][0]
            if mover[2:] != place[2:]:
                continue
            by = place[0] - mover[0], place[1] - mover[1]

            def put(cell: Any, by: tuple[int, int] = by) -> Any:
                return (cell[0] + by[0], cell[1] + by[1], *cell[2:])

            yield Move(
                frozenset(map(put, generator["support"])),
                frozenset(map(put, generator["trace"])),
                tuple((put(one), put(other)) for one, other in motion),
            )


def listed(table: dict[str, Any], place: Place) -> Iterator[Move]:
    """Yield the listed moves whose mover is at a place, with any letter."""
    for move in table["moves"]:
        for motion in both_ways(move["goes"]):
            if place_in(table, motion[0][0]) == place:
                yield Move(frozenset(move["support"]), frozenset(move["trace"]), motion)


def place_in(table: dict[str, Any], site: Any) -> Place:
    """Return the place of a site, by the tables of the scene."""
    if "labels" in table:
        return site[0]
    letters = table.get("letters", ())
    lettered = isinstance(site, tuple) and len(site) == 2 and site[1] in letters
    return site[0] if lettered else site


def commute(one: Move, other: Move) -> bool:
    """Return whether neither's trace meets the other's support."""
    return not (one.trace & other.support or other.trace & one.support)


def region(scene: dict[str, Any], place: Place) -> str:
    """Return the name of the region of a place."""
    blocks = "lattice" in scene or scene.get("graph", {}).get("compass", False)
    return f"{place[0] // 8},{place[1] // 8}" if blocks else "0"


@pytest.mark.few(3)
@pytest.mark.parametrize("spec", SPECS)
def test_neighbourhoods_and_regions_are_those_of_the_page(spec: str) -> None:
    """Sensed places, who senses a place, and reach; at places where modules start and around."""
    built = scene_from_spec(spec)
    scene = frozen(tomllib.loads(scene_to_toml(built)))
    kind = next(each for each in ("graph", "lattice", "listed") if each in scene)
    table = scene[kind]
    ways: dict[str, Callable[[dict[str, Any], Place], Iterator[Move]]] = {
        "graph": on_graph,
        "lattice": on_lattice,
        "listed": listed,
    }
    places = {place_in(table, site) for site in scene["start"]}
    if kind == "graph":
        places = set(table["vertices"])
    elif kind == "listed":
        ends = (site for move in table["moves"] for pair in move["goes"] for site in pair)
        places = {place_in(table, site) for site in ends}
    known: dict[Place, list[Move]] = {}

    def moves(place: Place) -> list[Move]:
        if place not in known:
            known[place] = list(ways[kind](table, place))
        return known[place]

    def sensed(place: Place) -> set[Place]:
        return {place_in(table, x) for move in moves(place) for x in move.support} - {place}

    def takes(place: Place, other: Place) -> bool:
        along = (source for move in moves(place) for source, _ in move.motion[1:])
        return other in {place_in(table, source) for source in along}

    def competes(place: Place, other: Place) -> bool:
        pairs = ((one, two) for one in moves(place) for two in moves(other))
        crossed = any(not commute(one, two) for one, two in pairs)
        return crossed or takes(place, other) or takes(other, place)

    system = built.system
    for place in sorted(places, key=repr)[:: max(1, len(places) // 6)]:
        others = around(place) if kind == "lattice" else places - {place}
        assert sensed(place) == set(system.sensed(place)) - {None}
        assert {each for each in others if place in sensed(each)} == set(system.listeners(place))
        assert {each for each in others if competes(place, each)} == set(system.reach(place))
        assert region(scene, place) == system.region(place)


def around(place: Place) -> set[Place]:
    """Return the sites of a lattice around one, in all directions of its edges."""
    axes: list[tuple[int, ...]] = [()] if len(place) == 2 else [(0,), (1,)]
    near = range(-FAR, FAR + 1)
    found = {(place[0] + x, place[1] + y, *axis) for x in near for y in near for axis in axes}
    return found - {place}
