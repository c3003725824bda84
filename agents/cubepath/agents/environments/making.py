"""The usual ways to make a PettingZoo environment: parallel or in turns, in processes or in one.

`parallel_env` is native; `env` is PettingZoo's own conversion to turns.
"""

from __future__ import annotations

from typing import Any, Literal

from pettingzoo import AECEnv
from pettingzoo.utils import AssertOutOfBoundsWrapper, OrderEnforcingWrapper, parallel_to_aec

from cubepath.agents.environments.environment import CubepathEnv, WireEnv
from cubepath.agents.environments.free_environment import FreeEnv
from cubepath.agents.local.observation import Observation
from cubepath.agents.local.relative import Showing
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.system import Scene


def parallel_env(
    system: str | Scene = "hex",
    *,
    max_cycles: int = 500,
    render_mode: str | None = None,
    note_length: int = 0,
    observation: Showing = "absolute",
    transport: Literal["local", "zenoh"] = "local",
    processes: int = 2,
    copy: bool = True,
    world: str = "auto",
) -> CubepathEnv:
    """Return the parallel environment of a system.

    With ``transport="zenoh"`` the modules live in `processes` separate processes and learn of one
    another by messages; observations, masks and results are the same. `copy` and `world` are those
    of `CubepathEnv`, and for worlds in this process.
    """
    if transport == "local":
        return CubepathEnv(
            system,
            max_cycles=max_cycles,
            render_mode=render_mode,
            note_length=note_length,
            copy=copy,
            world=world,
            observation=observation,
        )
    if transport != "zenoh":
        raise InputError(f"transport={transport!r}: expected 'local' or 'zenoh'")
    return WireEnv(
        system,
        max_cycles=max_cycles,
        render_mode=render_mode,
        note_length=note_length,
        observation=observation,
        processes=processes,
    )


def env(
    system: str | Scene = "hex",
    *,
    max_cycles: int = 500,
    render_mode: str | None = None,
    note_length: int = 0,
    observation: Showing = "absolute",
    clock: str = "lockstep",
    **scheduling: Any,
) -> AECEnv[str, Observation, int | None]:
    """Return the environment in turns, with PettingZoo's usual wrappers.

    With ``clock="free"`` there are no rounds: it is a `FreeEnv`, which `scheduling` is passed to.
    """
    turns: AECEnv[str, Observation, int | None]
    if clock == "free":
        turns = FreeEnv(
            system,
            max_cycles=max_cycles,
            render_mode=render_mode,
            note_length=note_length,
            observation=observation,
            **scheduling,
        )
    elif clock != "lockstep":
        raise InputError(f"clock={clock!r}: expected 'lockstep' or 'free'")
    elif scheduling:
        raise InputError(
            f"{min(scheduling)}={scheduling[min(scheduling)]!r}: expected clock='free'"
        )
    else:
        turns = parallel_to_aec(
            CubepathEnv(
                system,
                max_cycles=max_cycles,
                render_mode=render_mode,
                note_length=note_length,
                observation=observation,
            )
        )
    return OrderEnforcingWrapper(AssertOutOfBoundsWrapper(turns))


raw_env = CubepathEnv
"""The environment without wrappers, by PettingZoo's usual name."""
