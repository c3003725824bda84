"""Learning with Stable-Baselines3: environments for it, and trained models as rules.

The library is an extra, ``pip install 'cubepath[learning]'``, imported when needed.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from gymnasium import spaces

from cubepath.agents.environments.observations import ObservationEncoder
from cubepath.agents.environments.vector_environment import CubepathVectorEnv
from cubepath.agents.local.relative import Showing, relative_layout
from cubepath.agents.rules.policy import (
    ACTIVATIONS,
    FORMAT,
    Layer,
    PolicyNetwork,
    network_rule,
    read_network,
)
from cubepath.agents.rules.rule import RuleType
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.output_files import written_whole
from cubepath.protocol.core.system import Scene

if TYPE_CHECKING:
    from cubepath.agents.environments.sb3_vec_env import ModulesVecEnv


def sb3_env(
    system: str | Scene = "hex",
    *,
    num_envs: int = 1,
    max_cycles: int = 500,
    observation: Showing = "relative",
    progress: float = 0.0,
) -> ModulesVecEnv:
    """Return environments of a system as a `VecEnv` of Stable-Baselines3, with masks.

    Every module of every environment is a row, so one policy is learned for all: with n modules,
    row ``n * i + m`` is module m of environment i.

    >>> from sb3_contrib import MaskablePPO
    >>> env = sb3_env("agv:graph=grid3x3,n=2", num_envs=8, max_cycles=20)
    >>> model = MaskablePPO("MlpPolicy", env, n_steps=32, batch_size=64, seed=0).learn(1024)
    >>> env.num_envs, env.reset().shape, sb3_rule("learned", model).name
    (16, (16, 27), 'learned')

    Args: system: a system by name or file as on the command line, or a scene. num_envs: how many
        environments. max_cycles: an episode is truncated after this many rounds. observation:
        "relative", float32 between -1 and 1, or "absolute", int32. progress: what a module gets in
        addition for a move that leads nearer to its nearest known goal, and loses for one that
        leads away; the entries ``nearer`` of relative observations say which.

    `action_masks`, as `MaskablePPO` asks for it, is bool of shape (rows, moves + 1). The reward is
    that of PettingZoo, the same for all modules of an environment, and `progress`; they end
    together. An episode that is over begins anew in the same step, with ``terminal_observation``,
    ``TimeLimit.truncated`` and ``is_success`` in the infos of its rows. ``seed(s)`` gives
    environment i the seed s + i; later episodes draw theirs from it as those of `vector_env` do.

    InputError if Stable-Baselines3 is missing, or as for `vector_env`.
    """
    try:
        from cubepath.agents.environments.sb3_vec_env import ModulesVecEnv  # noqa: PLC0415 - an extra
    except ImportError:
        raise InputError(
            "sb3_env takes Stable-Baselines3: pip install 'cubepath[learning]'"
        ) from None
    env = CubepathVectorEnv(
        system,
        num_envs=num_envs,
        max_cycles=max_cycles,
        observation=observation,
        autoreset_mode="SameStep",
    )
    scene = env.scene
    if progress and (observation != "relative" or relative_layout(scene.system).sites is None):
        raise InputError(f"progress={progress}: expected relative observations with a part nearer")
    space = ObservationEncoder(scene, observation).space(0)["observation"]
    if not isinstance(space, spaces.Box):
        raise TypeError("an observation is a box of numbers")
    return ModulesVecEnv(env, space, progress)


def sb3_save(model: Any, path: str | Path) -> None:
    """Write the network of a `MaskablePPO` to a new file, ``.npz``, which `sb3_rule` reads.

    What reads it needs numpy alone: no process of a run has to load torch. InputError if the model
    has a policy of another form than ``MlpPolicy``, or if the file exists or cannot be written.
    """
    network, path = _network_of(model), Path(path)
    if path.suffix != ".npz":
        raise InputError(f"{path}: expected a name that ends in .npz")
    if path.exists():
        raise InputError(f"{path}: exists already, expected a new file")
    arrays: dict[str, Any] = {"format": FORMAT, "observation": network.observation}
    for number, layer in enumerate(network.layers):
        for key, value in layer._asdict().items():
            arrays[f"{key}_{number}"] = value
    with written_whole(path) as stream:
        np.savez(stream, **arrays)


def sb3_rule(name: str, model: Any, *, deterministic: bool = False) -> RuleType:
    """Return what was learned in an `sb3_env` as a rule: it runs on the wire as any other.

    `model` is a `MaskablePPO` with an ``MlpPolicy``, or the path of a file of `sb3_save`. A module
    draws its action from the probabilities of the network, by its own random stream; with
    `deterministic` it takes the most probable one, and the first of several. The rule is for
    systems whose observations have the shape of those that it was trained with.

    InputError if the policy has another form, or the file cannot be read.
    """
    network = read_network(Path(model)) if isinstance(model, str | Path) else _network_of(model)
    return network_rule(name, network, deterministic=deterministic)


def _network_of(model: Any) -> PolicyNetwork:
    """Return the part of a model that decides, as numpy has it."""
    try:
        policy, space = model.policy, model.observation_space
        parts = [*policy.pi_features_extractor.children(), *policy.mlp_extractor.policy_net]
        parts.append(policy.action_net)
    except (AttributeError, TypeError):
        raise InputError(
            f"{type(model).__name__}: expected a model with an MlpPolicy, such as a MaskablePPO"
        ) from None
    layers: list[Layer] = []
    for part in parts:
        kind = type(part).__name__.lower()
        if kind == "linear":
            weight, bias = (each.detach().cpu().numpy() for each in (part.weight, part.bias))
            layers.append(Layer(weight.T.astype(np.float64), bias.astype(np.float64), "none"))
        elif kind in ACTIVATIONS and layers:
            layers[-1] = layers[-1]._replace(activation=kind)
        elif kind != "flatten":
            raise InputError(
                f"the policy has a part {type(part).__name__}, expected Linear, Tanh and ReLU:"
                " policy_rule takes any other as a function"
            )
    return PolicyNetwork("relative" if space.dtype == np.float32 else "absolute", tuple(layers))
