"""Networks that were learned, as rules: layer by layer in numpy, with or without chance.

This file reads networks and writes none: `check_rule` counts them as a part of the rule, as it does
its source. A file of one is ``.npz`` without pickles: ``format``, ``observation``, and of each
layer ``weight_i``, of shape (inputs, outputs), ``bias_i`` and ``activation_i``.
"""

from __future__ import annotations

from dataclasses import replace
from hashlib import sha256
from pathlib import Path
from typing import Any, NamedTuple
from zipfile import BadZipFile

import numpy as np
from numpy.typing import NDArray

from cubepath.agents.local.observation import observation_length
from cubepath.agents.local.relative import Showing, checked_showing, relative_layout
from cubepath.agents.rules.policy import policy_rule
from cubepath.agents.rules.rule import RuleType
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.input_files import readable
from cubepath.protocol.core.system import System

ACTIVATIONS = ("tanh", "relu")
FORMAT = "cubepath-network-1"
Floats = NDArray[np.float64]


class Layer(NamedTuple):
    """What becomes of a row: times the weights, plus the bias, then "tanh", "relu" or "none"."""

    weight: Floats
    bias: Floats
    activation: str


class Network(NamedTuple):
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


def network_rule(name: str, network: Network, *, deterministic: bool) -> RuleType:
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


def _content(network: Network, *, deterministic: bool) -> str:
    """Return a hash of all that decides what a network chooses."""
    told = sha256(f"{network.observation} {deterministic}".encode())
    for layer in network.layers:
        told.update(f" {layer.weight.shape} {layer.activation} ".encode())
        told.update(np.ascontiguousarray(layer.weight, "<f8").tobytes())
        told.update(np.ascontiguousarray(layer.bias, "<f8").tobytes())
    return told.hexdigest()


def _shape_of(system: System, showing: Showing) -> tuple[int, int]:
    """Return the length of what a module of a system sees, and how many actions it has."""
    relative = showing == "relative"
    length = relative_layout(system).length if relative else observation_length(system)
    return length, system.move_slots + 1


def read_network(path: Path) -> Network:
    """Read a network; InputError if the file is none."""
    with readable(path):
        try:
            with np.load(path, allow_pickle=False) as arrays:
                return _network_in(arrays)
        except (ValueError, KeyError, EOFError, BadZipFile, AttributeError, TypeError) as error:
            why = " ".join(str(error).split())
            raise InputError(f"{path}: no network, expected a file of sb3_save: {why}") from None


def _network_in(arrays: Any) -> Network:
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
    return Network(checked_showing(str(arrays["observation"])), tuple(layers))
