"""Scenes of a few listed moves: by hand, or any that hypothesis draws."""

from hypothesis import strategies as st

from cubepath.protocol.core.actions import Action
from cubepath.protocol.core.catalogue import Move
from cubepath.protocol.core.sites import Site
from cubepath.protocol.core.system import Scene
from cubepath.protocol.systems.listed import TabledSystem


def listed(*moves: Move, start: list[Site], fixed: list[Site] | None = None) -> Scene:
    system = TabledSystem(moves, fixed=fixed or [], drawing="letters", positions={})
    return Scene("listed", "", system, tuple(start))


def move(
    name: str,
    support: list[Site],
    one: Site,
    other: Site,
    *,
    reads: list[Site] | None = None,
    free: list[Site] | None = None,
    guards: list[tuple[Site, Site]] | None = None,
) -> Move:
    on = reads or []
    action = Action(
        [*support, one, other], [one, other], [one, *on], [other, *on],
        free=free or [], guards=guards or [], label=name,
    )  # fmt: skip
    return Move(action, name, one, ((one, other),))


@st.composite
def listed_scenes(draw: st.DrawFn) -> Scene:
    """Draw a few moves on a few sites, with what they read, free sites, guards and obstacles."""
    sites: list[Site] = [0, 1, 2, 3, 4, 5]
    fixed = draw(st.lists(st.sampled_from(sites), max_size=1))
    places = [site for site in sites if site not in fixed]
    moves = []
    for number in range(draw(st.integers(1, 6))):
        one, other = draw(st.permutations(places))[:2]
        rest = [site for site in sites if site not in (one, other)]
        near = draw(st.lists(st.sampled_from(rest), unique=True, max_size=3))
        free = draw(st.lists(st.sampled_from(near), unique=True, max_size=2)) if near else []
        reads = [site for site in near if site not in free and draw(st.booleans())]
        guards = [(free[0], free[1])] if len(free) == 2 and draw(st.booleans()) else []
        moves.append(move(f"m{number}", near, one, other, reads=reads, free=free, guards=guards))
    start = draw(st.lists(st.sampled_from(places), unique=True, min_size=1, max_size=4))
    known = {site for each in moves for site in each.action.support}
    on = [site for site in start if site in known]
    return listed(*moves, start=on or [next(iter(moves[0].action.ends[0] - set(fixed)))], fixed=[
        site for site in fixed if site in known
    ])  # fmt: skip
