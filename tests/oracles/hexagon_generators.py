"""The generators of hexagons by directions alone, as the paper's figures name the cells."""

from cubepath.protocol.core.catalogue import HEX_DIRECTIONS, HEXAGONS, Catalogue, Cell, Generator


def pivots(*, keeps_topology: bool) -> tuple[Generator, ...]:
    """Return the six pivots: A to A' about B, with E and E' if the support is the larger one."""
    found = []
    for k, sense in ((k, sense) for k in range(3) for sense in (1, -1)):
        away = HEX_DIRECTIONS[k]
        held, opposite, beside = (_way(k + by * sense) for by in (1, -1, -2))
        others = [held, opposite, beside, _plus(away, opposite)]
        if keeps_topology:
            others += [_way(k + 3), _plus(away, away)]
        found.append(_generator("pivot", k, sense, others, (held,)))
    return tuple(found)


def monkey_moves() -> tuple[Generator, ...]:
    """Return the six monkey moves: A to A' across the gap B, from P to Q."""
    found = []
    for k, sense in ((k, sense) for k in range(3) for sense in (1, -1)):
        gap, opposite, first = (_way(k + by * sense) for by in (1, -1, 2))
        held = first, _plus(gap, HEX_DIRECTIONS[k])
        found.append(_generator("monkey", k, sense, [gap, opposite, *held], held))
    return tuple(found)


def catalogues() -> dict[str, Catalogue]:
    """Return the four catalogues of hexagons by the names of their pages."""
    first, second = (pivots(keeps_topology=keeps) for keeps in (True, False))
    found = {
        "hexagons-1": first,
        "hexagons-2": second,
        "hexagons-3": (*second, *monkey_moves()),
        "hexagons-tunnel": (*first[:2], *second[2:]),
    }
    return {name: Catalogue(HEXAGONS, generators) for name, generators in found.items()}


def _generator(
    name: str, k: int, sense: int, others: list[Cell], held: tuple[Cell, ...]
) -> Generator:
    here, there = (0, 0), HEX_DIRECTIONS[k]
    return Generator(
        name=f"{name}-{k}-{'left' if sense > 0 else 'right'}",
        support=(here, there, *others),
        trace=(here, there),
        before=(here, *held),
        after=(there, *held),
        motion=((here, there),),
    )


def _way(turn: int) -> Cell:
    return HEX_DIRECTIONS[turn % 6]


def _plus(one: Cell, other: Cell) -> Cell:
    return one[0] + other[0], one[1] + other[1]
