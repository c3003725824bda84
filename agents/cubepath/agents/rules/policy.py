"""Policies as rules: a function of what PettingZoo gives an agent acts for a module.

A policy that takes many rows at once has the vectorised form too.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterable
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from cubepath.agents.local.observation import View
from cubepath.agents.local.relative import Showing, checked_showing
from cubepath.agents.local.relative_rows import RelativeRows
from cubepath.agents.rules.rule import FreeRule, InitialKnowledge, Rule, RuleType
from cubepath.agents.rules.vector_rule import (
    Chosen,
    GaveUp,
    Seen,
    Streams,
    VectorKnowledge,
    VectorRule,
)
from cubepath.agents.rules.vector_streams import DRAW_STEPS, draw_fraction
from cubepath.protocol.compiled import compiled
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.system import System

Policy: TypeAlias = Callable[..., Any]
"""From an observation and an action mask to an action, or from rows of them to a row of actions."""

_WHY_FREE = "every commit is a legal move, and nothing more is promised"


def policy_rule(
    name: str,
    policy: Policy,
    *,
    observation: Showing = "absolute",
    batched: bool = False,
    random: bool = False,
    fits: Callable[[System], bool] | None = None,
    summary: str | None = None,
    source: str | None = None,
) -> RuleType:
    """Return a policy over observations as a rule, to be used wherever a rule is.

    ``policy(observation, action_mask)`` is given copies of the arrays that PettingZoo gives an
    agent, and returns an action, one integer. The same policy acts for every module.

    >>> import numpy as np
    >>> from cubepath.agents import play, policy_rule
    >>> from cubepath.protocol import scene_from_spec
    >>> last = policy_rule("last", lambda observation, action_mask: action_mask.nonzero()[0][-1])
    >>> len(play(scene_from_spec("hex:n=4"), last, max_rounds=5).rounds)
    5

    Args:
        name: what the rule is called.
        policy: a plain function; what it chooses must follow from what it is given.
        observation: "absolute", int32 of shape (length,) as `observe` documents it, or "relative",
            float32 between -1 and 1; the mask is int8 of shape (moves + 1,).
        batched: the policy takes a row for each of B modules, of shapes (B, length) and
            (B, moves + 1), and returns B integers. What it returns for a row must not depend on the
            others. Then it plays many environments side by side, see `vector_actors_for`.
        random: the policy takes a third argument, the module's own `numpy.random.Generator`. A
            batched one gets float64 of shape (B,) instead, of each module's generator the next
            ``random()``, from 0 to below 1.
        fits: whether it is for a system; by default for all.
        summary: what `cubepath rules` prints; by default the first line of the docstring.
        source: where it comes from; by default the policy's module.

    An action that is not legal, another shape, or an error of the policy ends the run in one line,
    as for any rule (`RuleError`). InputError if the policy is no function, or `observation` is
    neither of the two.
    """
    if not callable(policy):
        raise InputError(
            f"policy {name!r}: found {type(policy).__name__}, expected a function of an observation"
            " and an action mask"
        )
    relative = checked_showing(observation) == "relative"
    told = (inspect.getdoc(policy) or "").partition("\n")[0] if inspect.isroutine(policy) else ""

    def make(knowledge: InitialKnowledge) -> Rule:
        return _for_one(policy, knowledge, relative=relative, batched=batched, random=random)

    # Who asks whether a rule keeps anything outside its modules looks where it was made.
    make.__module__ = getattr(policy, "__module__", None) or make.__module__

    def vectorised(knowledge: VectorKnowledge) -> VectorRule:
        return _for_all(policy, knowledge, relative=relative, random=random)

    return RuleType(
        name=name,
        summary=summary or told.rstrip(".") or f"a policy over {observation} observations",
        source=source or getattr(policy, "__module__", None) or type(policy).__module__,
        fits=fits or _fits_all,
        make=make,
        free=FreeRule(why=_WHY_FREE),
        vectorised=vectorised if batched else None,
    )


def _fits_all(_system: System) -> bool:
    return True


def _for_one(
    policy: Policy, knowledge: InitialKnowledge, *, relative: bool, batched: bool, random: bool
) -> Rule:
    """Return the rule of one module: a batch of one row, or a row by itself."""
    observer = knowledge.relative() if relative else None

    def choose(view: View) -> int:
        # Copies: what a policy writes into them must not change what is legal.
        numbers: NDArray[Any] = (
            view.numbers.copy() if observer is None else observer.of(view.numbers)
        )
        arrays: list[Any] = [numbers, view.mask.copy()]
        if batched:
            arrays = [array[np.newaxis] for array in arrays]
        if random:
            own = knowledge.random
            arrays.append(np.array([own.random()]) if batched else own)
        return int(_integers(policy(*arrays), (1,) if batched else ()).item())

    return choose


def _for_all(
    policy: Policy, knowledge: VectorKnowledge, *, relative: bool, random: bool
) -> VectorRule:
    """Return the rule of all modules: a row for each of those that are playing."""
    rows = RelativeRows(knowledge.system, knowledge.goals) if relative else None
    streams = knowledge.streams() if random else None
    modules = knowledge.modules

    def choose(seen: Seen, chosen: Chosen) -> Iterable[GaveUp]:
        playing = seen.playing
        count = int(playing.sum()) * modules
        if not count:
            return ()
        numbers: NDArray[Any] = seen.observation[playing]
        if rows is not None:
            numbers = rows.of(numbers)
        arrays: list[NDArray[Any]] = [numbers.reshape(count, -1)]
        arrays.append(seen.action_mask[playing].reshape(count, -1))
        if streams is not None:
            drawn = np.zeros((*playing.shape, modules))
            _draw.for_work(drawn.size * DRAW_STEPS, by_entries=True)(streams, playing, drawn)
            arrays.append(drawn[playing].reshape(count))
        found = _integers(policy(*arrays), (count,))
        # Of 32 bits each: a larger one stays one that nobody has.
        found = np.clip(found, -1, np.iinfo(np.int32).max)
        chosen.actions[playing] = found.reshape(-1, modules)
        return ()

    return choose


def _integers(found: Any, shape: tuple[int, ...]) -> NDArray[Any]:
    """Return what a policy returned as integers; InputError if it is anything else."""
    actions = np.asarray(found)
    if actions.shape != shape or actions.dtype.kind not in "iu":
        expected = f"integers of shape {shape}" if shape else "one integer"
        kind = type(found).__name__ if actions.dtype.kind == "O" else actions.dtype
        raise InputError(
            f"the policy returned {kind} of shape {actions.shape}, expected {expected}"
        )
    return actions


@compiled
def _draw(streams: Streams, playing: NDArray[np.bool_], drawn: NDArray[np.float64]) -> None:
    """Draw a fraction for each module of the environments that are playing."""
    for environment in range(drawn.shape[0]):
        if playing[environment]:
            for module in range(drawn.shape[1]):
                drawn[environment, module] = draw_fraction(streams, environment, module)
