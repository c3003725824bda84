"""What a system says of its paths: ways, bounds, a potential, and paths that it finds itself.

The class may belong to another distribution. An error in its methods is reported in one line that
names the class and the method.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import ParamSpec, TypeVar

from cubepath.coordinator.theory.search.budget import Budget
from cubepath.coordinator.theory.search.vehicle_lns import prepare
from cubepath.protocol.core.actions import Action, State
from cubepath.protocol.core.errors import CubepathError, InputError
from cubepath.protocol.core.sites import Site
from cubepath.protocol.core.system import Bound, System, Ways

_P = ParamSpec("_P")
_T = TypeVar("_T")


def ways_of(system: System) -> Ways | None:
    """Return where modules can go, None if the system does not say."""
    found = _named(system, "ways", system.ways)()
    if found is None:
        return None
    near = _named(system, "ways", lambda site: tuple(found.near(site)))
    return Ways(near, found.one_to_one)


def bounds_of(
    system: System, start: State, goal: State, *, within: int, budget: Budget | None = None
) -> list[Bound]:
    """Return the bounds that the system itself has, as far as the budget goes.

    None further is asked for once one is `within` cubes.
    """

    def ask() -> list[Bound]:
        found: list[Bound] = []
        for bound in system.bounds(start, goal):
            found.append(bound)
            if bound.cubes >= within or (budget is not None and budget.spent):
                break
        return found

    return _named(system, "bounds", ask)()


def potential_of(system: System, goal: State) -> Callable[[Site], int] | None:
    """Return how far a site is from the goal, None if the system does not say."""
    found = _named(system, "potential", system.potential)(goal)
    return None if found is None else _named(system, "potential", found)


def paths_of(
    system: System, start: State, goal: State, *, seed: int, known: Iterable[Action]
) -> Iterator[Sequence[Action] | None] | None:
    """Return the system's own search for paths, None if it has none."""
    ask = _named(system, "paths", system.paths)
    found = ask(start, goal, seed=seed, known=known)
    return None if found is None else _steps(_named(system, "paths", found.__next__))


def prepare_for(system: System) -> bool:
    """Compile, or load, what the search for paths of this system uses; return whether it does."""
    if system.graph is not None:
        prepare()
    own = _named(system, "prepare_paths", system.prepare_paths)()
    return own or system.graph is not None


def _steps(
    step: Callable[[], Sequence[Action] | None],
) -> Iterator[Sequence[Action] | None]:
    while True:
        try:
            found = step()
        except StopIteration:
            return
        yield found


def _named(system: System, method: str, ask: Callable[_P, _T]) -> Callable[_P, _T]:
    """Return `ask` with its errors as one-line InputErrors; the project's own pass unchanged."""

    def asked(*args: _P.args, **kwargs: _P.kwargs) -> _T:
        try:
            return ask(*args, **kwargs)
        except (CubepathError, StopIteration):
            raise
        except Exception as error:
            kind, text = system.__class__, " ".join(str(error).split())
            raise InputError(
                f"{kind.__name__}.{method} of {kind.__module__}: {type(error).__name__}: {text}"
            ) from error

    return asked
