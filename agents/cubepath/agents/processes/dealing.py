"""How modules are distributed over processes: neighbours stay together.

Modules of one process exchange no messages between processes, so modules are distributed by where
they start.
"""

from collections.abc import Iterable

from cubepath.protocol.core.sites import Site
from cubepath.protocol.core.system import Scene, System


def dealt(scene: Scene, processes: int, modules: Iterable[int] | None = None) -> list[list[int]]:
    """Return the modules of each process in increasing order, as equal in number as possible.

    By default all modules of the scene are distributed. They are halved along the coordinate in
    which their places are spread most, and the halves again. No process is without a module.
    """
    points = [_point(scene.system, site) for site in scene.start]
    found: list[list[int]] = []

    def halve(modules: list[int], parts: int) -> None:
        if parts <= 1:
            found.append(sorted(modules))
            return
        axes = range(min(len(points[module]) for module in modules))
        spread = [_spread([points[module][axis] for module in modules]) for axis in axes]
        axis = spread.index(max(spread)) if spread else 0
        modules.sort(key=lambda module: (points[module][axis:], points[module], module))
        first = parts // 2
        # Every process gets as many as it would if they were dealt out in turn, give or take one.
        cut = len(modules) * first // parts
        halve(modules[:cut], first)
        halve(modules[cut:], parts - first)

    those = list(range(len(points)) if modules is None else modules)
    if those:
        halve(those, min(processes, len(those)))
    return found


def _point(system: System, site: Site) -> tuple[int, ...]:
    place = system.place_of(site)
    if isinstance(place, tuple):
        numbers = tuple(number for number in place if isinstance(number, int))
        if len(numbers) == len(place):
            return numbers
    return system.encode_site(site)


def _spread(numbers: list[int]) -> int:
    return max(numbers) - min(numbers)
