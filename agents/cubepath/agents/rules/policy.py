"""Policies as rules: a function of a PettingZoo observation acts for a module.

A policy that takes many rows at a time has a vectorised form too.

Trained networks are policies: they are evaluated layer by layer in numpy, deterministically or by
sampling. This module reads network files and writes none: `check_rule` treats a network as part of
the rule, as it does the rule's source. A network is an ``.npz`` file without pickles: ``format``,
``observation``, and for each layer ``weight_i``, of shape (inputs, outputs), ``bias_i`` and
``activation_i``.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterable
from dataclasses import replace
from hashlib import sha256
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias
from zipfile import BadZipFile

import numpy as np
from numpy.typing import NDArray

from cubepath.agents.local.observation import View, observation_length
from cubepath.agents.local.random_streams import DRAW_STEPS, Streams, draw_fraction
from cubepath.agents.local.relative import RelativeRows, Showing, checked_showing, relative_layout
from cubepath.agents.rules.rule import FreeRule, InitialKnowledge, Rule, RuleType
from cubepath.agents.rules.vector_rule import (
    RuleFailure,
    VectorChoice,
    VectorKnowledge,
    VectorRule,
    VectorView,
)
from cubepath.protocol.compiled import compiled
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.input_files import readable
from cubepath.protocol.core.system import System

Policy: TypeAlias = Callable[..., Any]
"""From an observation and an action mask to an action, or from rows of them to a row of actions."""


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
            batched one gets float64 of shape (B,) instead, of each module's own stream the next
            ``fraction()``, from 0 to below 1.
        fits: whether it is for a system; by default for all.
        summary: what `cubepath rule list` prints; by default the first line of the docstring.
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
    described = (
        (inspect.getdoc(policy) or "").partition("\n")[0] if inspect.isroutine(policy) else ""
    )

    def make(knowledge: InitialKnowledge) -> Rule:
        return _for_one(policy, knowledge, relative=relative, batched=batched, random=random)

    # The check that a rule keeps nothing outside its modules looks where the rule was made.
    make.__module__ = getattr(policy, "__module__", None) or make.__module__

    def vectorised(knowledge: VectorKnowledge) -> VectorRule:
        return _for_all(policy, knowledge, relative=relative, random=random)

    return RuleType(
        name=name,
        summary=summary or described.rstrip(".") or f"a policy over {observation} observations",
        source=source or getattr(policy, "__module__", None) or type(policy).__module__,
        fits=fits or (lambda _: True),
        make=make,
        free=FreeRule(why="every commit is a legal move, and nothing more is promised"),
        vectorised=vectorised if batched else None,
    )


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
            drawn = np.array([knowledge.stream.fraction()]) if batched else knowledge.random
            arrays.append(drawn)
        return int(_integers(policy(*arrays), (1,) if batched else ()).item())

    return choose


def _for_all(
    policy: Policy, knowledge: VectorKnowledge, *, relative: bool, random: bool
) -> VectorRule:
    """Return the rule of all modules: a row for each of those that are playing."""
    rows = RelativeRows(knowledge.system, knowledge.goals) if relative else None
    streams = knowledge.streams() if random else None
    modules = knowledge.modules

    def choose(seen: VectorView, chosen: VectorChoice) -> Iterable[RuleFailure]:
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


ACTIVATIONS = ("tanh", "relu")
FORMAT = "cubepath-network-1"
Floats = NDArray[np.float64]


class Layer(NamedTuple):
    """What becomes of a row: times the weights, plus the bias, then "tanh", "relu" or "none"."""

    weight: Floats
    bias: Floats
    activation: str


class PolicyNetwork(NamedTuple):
    """From what a module sees to a number for each action: the greater, the more probable."""

    observation: Showing
    layers: tuple[Layer, ...]

    def logits(self, rows: NDArray[Any]) -> Floats:
        """Return the numbers of each row, which depend on no other row, to the last bit.

        So sums are made entry by entry: a product of matrices may sum in another order for another
        number of rows.
        """
        found = rows.astype(np.float64)
        for layer in self.layers:
            entered, found = found, np.tile(layer.bias, (len(rows), 1))
            for column, weights in zip(entered.T, layer.weight, strict=True):
                found += column[:, np.newaxis] * weights
            if layer.activation == "tanh":
                found = np.tanh(found)
            elif layer.activation == "relu":
                found = np.maximum(found, 0)
        return found


def network_rule(name: str, network: PolicyNetwork, *, deterministic: bool) -> RuleType:
    """Return a network as a rule, for systems whose observations have the shape of its input."""

    def choose(rows: NDArray[Any], masks: NDArray[np.int8], draws: Any = None) -> Any:
        found = np.where(masks, network.logits(rows), -np.inf)
        if deterministic:
            return found.argmax(axis=1)
        # The first action whose probability, with those before it, exceeds what was drawn.
        shares = np.exp(found - found.max(axis=1, keepdims=True)).cumsum(axis=1)
        return (shares <= draws[:, np.newaxis] * shares[:, -1:]).sum(axis=1)

    def fits(system: System) -> bool:
        return system.local and _shape_of(system, network.observation) == (
            len(network.layers[0].weight),
            len(network.layers[-1].bias),
        )

    rule = policy_rule(
        name,
        choose,
        observation=network.observation,
        batched=True,
        random=not deterministic,
        fits=fits,
        summary=f"a network over {network.observation} observations",
        source="learned",
    )
    return replace(rule, content=_content(network, deterministic=deterministic))


def _content(network: PolicyNetwork, *, deterministic: bool) -> str:
    """Return a hash of all that decides what a network chooses."""
    digest = sha256(f"{network.observation} {deterministic}".encode())
    for layer in network.layers:
        digest.update(f" {layer.weight.shape} {layer.activation} ".encode())
        digest.update(np.ascontiguousarray(layer.weight, "<f8").tobytes())
        digest.update(np.ascontiguousarray(layer.bias, "<f8").tobytes())
    return digest.hexdigest()


def _shape_of(system: System, showing: Showing) -> tuple[int, int]:
    """Return the length of what a module of a system sees, and how many actions it has."""
    relative = showing == "relative"
    length = relative_layout(system).length if relative else observation_length(system)
    return length, system.move_slots + 1


def read_network(path: Path) -> PolicyNetwork:
    """Read a network; InputError if the file is none."""
    with readable(path):
        try:
            with np.load(path, allow_pickle=False) as arrays:
                return _network_in(arrays)
        except (ValueError, KeyError, EOFError, BadZipFile, AttributeError, TypeError) as error:
            why = " ".join(str(error).split())
            raise InputError(f"{path}: no network, expected a file of sb3_save: {why}") from None


def _network_in(arrays: Any) -> PolicyNetwork:
    if str(arrays["format"]) != FORMAT:
        raise ValueError(f"format {str(arrays['format'])!r}, expected {FORMAT!r}")
    layers: list[Layer] = []
    while f"weight_{len(layers)}" in arrays:
        weight, bias, activation = (arrays[f"{key}_{len(layers)}"] for key in Layer._fields)
        width = layers[-1].weight.shape[1] if layers else weight.shape[0]
        if weight.ndim != 2 or bias.shape != weight.shape[1:] or weight.shape[0] != width:
            shapes = f"weights {weight.shape} and bias {bias.shape}"
            raise ValueError(f"layer {len(layers)}: {shapes} do not fit")
        if str(activation) not in (*ACTIVATIONS, "none"):
            raise ValueError(f"layer {len(layers)}: activation {str(activation)!r} is not known")
        layers.append(Layer(weight.astype(float), bias.astype(float), str(activation)))
    if not layers:
        raise ValueError("there is no layer")
    return PolicyNetwork(checked_showing(str(arrays["observation"])), tuple(layers))
