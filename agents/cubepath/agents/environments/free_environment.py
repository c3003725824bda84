"""The PettingZoo environment without rounds, and the functions that make environments.

Modules act one after another. In one process, a scheduler decides who acts next; it lets every
module act again and again, and depends only on the seed and the results of earlier turns.
`parallel_env` is native; `env` is PettingZoo's own conversion to turns.
"""

from collections.abc import Mapping
from copy import deepcopy
from dataclasses import replace
from heapq import heapify, heapreplace
from numbers import Real
from typing import Any, Literal, Self, Unpack

import numpy as np
from gymnasium.utils import EzPickle
from numpy.typing import NDArray
from pettingzoo import AECEnv
from pettingzoo.utils import AssertOutOfBoundsWrapper, OrderEnforcingWrapper, parallel_to_aec

from cubepath.agents.environments import observations
from cubepath.agents.environments.environment import CubepathEnv, WireEnv
from cubepath.agents.environments.free_world import ActionResult, FreeWorld
from cubepath.agents.local.observation import STAY, Observation, checked_note
from cubepath.agents.rules.rule import Choice
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.options import real_number, whole_number
from cubepath.protocol.core.system import Scene

_TICKS = 1000
"""Between two turns of a module with speed factor 1, on average."""
_PATIENCE = 30
"""An unfair scheduler lets a module wait for this many turns for each module that there is."""


class Scheduler:
    """Chooses who acts: here one after the other, by number."""

    def __init__(self, modules: int) -> None:
        """Begin with module 0."""
        self._modules = modules
        self._turns = 0

    def next(self, *, committed: bool) -> int:
        """Return which module acts, given the result of the previous turn; False at first."""
        del committed
        self._turns += 1
        return (self._turns - 1) % self._modules

    @property
    def time(self) -> float:
        """Return when the last turn began; a module of speed factor 1 takes 1 for a turn.

        Here that is how many turns each module has had before, on average.
        """
        return max(self._turns - 1, 0) / self._modules


class RandomOrder(Scheduler):
    """Each at its own pace: with factor f a module acts f times more rarely than with 1.

    The time between two of its turns is drawn from 1 - `jitter` to 1 + `jitter` times the average.
    """

    def __init__(self, modules: int, seed: int, speeds: Mapping[int, int], jitter: float) -> None:
        """Draw when each module acts first."""
        super().__init__(modules)
        self._random = np.random.default_rng(seed)
        self._periods = [_TICKS * speeds.get(module, 1) for module in range(modules)]
        self._jitter = jitter
        self._now = 0
        self._due = [
            (int(self._random.integers(period)), module)
            for module, period in enumerate(self._periods)
        ]
        heapify(self._due)

    def next(self, *, committed: bool) -> int:
        """Return whose time comes first."""
        del committed
        due, module = self._due[0]
        spread = int(self._periods[module] * self._jitter)
        pause = self._periods[module] + int(self._random.integers(-spread, spread + 1))
        heapreplace(self._due, (due + max(pause, 1), module))
        self._now = due
        return module

    @property
    def time(self) -> float:
        """Return when the last turn began."""
        return self._now / _TICKS


class UnfairOrder(Scheduler):
    """The module that acted last acts again, as long as that changes something.

    Then comes the one that acted last before it and has not acted in vain since the last commit. A
    module that has waited for `_PATIENCE` turns for each module goes before all others.
    """

    def __init__(self, modules: int) -> None:
        """Begin with the module of the highest number."""
        super().__init__(modules)
        self._acted = {module: module - modules for module in range(modules)}
        """When each module acted last."""
        self._in_vain: set[int] = set()
        self._last: int | None = None

    def next(self, *, committed: bool) -> int:
        """Return the least deserving module that is allowed."""
        if committed:
            self._in_vain.clear()
        elif self._last is not None:
            self._in_vain.add(self._last)
        self._turns += 1
        acted = self._acted
        waits = min(acted, key=lambda module: (acted[module], module))
        hopeful = [module for module in acted if module not in self._in_vain]
        if self._turns - acted[waits] <= _PATIENCE * len(acted) and hopeful:
            found = max(hopeful, key=lambda module: (acted[module], module))
        else:
            found = waits
        self._acted[found] = self._turns
        self._last = found
        return found


def scheduler_named(
    name: str, *, modules: int, seed: int, speeds: Mapping[int, int], jitter: float
) -> Scheduler:
    """Return a scheduler; InputError if there is none of that name, or it has no such speeds."""
    if not 0 <= real_number("jitter", jitter) <= 1:
        raise InputError(f"jitter={jitter}: expected 0 to 1")
    for module, factor in speeds.items():
        if module not in range(modules) or not isinstance(factor, Real) or factor < 1:
            raise InputError(
                f"speeds: module {module} with {factor}, expected modules 0 to {modules - 1} with"
                " factors of 1 or more"
            )
    if speeds and name != "random":
        raise InputError(f"speeds with scheduler={name!r}: expected scheduler='random'")
    match name:
        case "turns":
            return Scheduler(modules)
        case "random":
            return RandomOrder(modules, seed, speeds, jitter)
        case "unfair":
            return UnfairOrder(modules)
        case _:
            raise InputError(f"scheduler={name!r}: expected 'random', 'unfair' or 'turns'")


class FreeEnv(observations.ModuleAgents, AECEnv[str, Observation, int | None], EzPickle):
    """The modules of a scene as agents module_0, module_1, ... under the free clock.

    `agent_selection` is who acts next, as the scheduler wants it. Observation, mask and action are
    those of `CubepathEnv`; with a `note_length` observations have ``notes``, the registers within
    reach, and ``register``, the agent's own. `step` attempts the chosen move, which is committed
    immediately or refused, if what the agent was shown does not hold any more; `declare` before it
    adds what else a `Choice` has. ``infos[agent]`` tells of the agent's last turn: ``committed``,
    ``refused`` (why, or None) and ``illegal``. All agents share one reward: the change in the
    fraction of goal places that are taken. The episode terminates at the goal, and is truncated
    after `max_cycles` turns for each agent.

    scheduler: ``"random"``, seeded, with `speeds` (a module with factor f acts f times more rarely)
    and `jitter` (the time between two turns is 1 - jitter to 1 + jitter times the average);
    ``"unfair"``, which prefers those that acted last; ``"turns"``. `lag` shows agents what is up to
    this many commits old. What is attempted follows from the seed and the actions.

    >>> env = FreeEnv("hex:n=3", max_cycles=20)
    >>> env.reset(seed=1)
    >>> first = env.agent_selection
    >>> env.step(int(env.observe(first)["action_mask"].nonzero()[0][-1]))
    >>> env.infos[first]["committed"]
    True
    """

    metadata: dict[str, Any] = {  # noqa: RUF012 - PettingZoo types it as an instance variable
        **CubepathEnv.metadata,
        "name": "cubepath_free_v0",
        "is_parallelizable": False,
    }

    def __init__(
        self,
        system: str | Scene = "hex",
        *,
        scheduler: str = "random",
        speeds: Mapping[int, int] | None = None,
        jitter: float = 0.5,
        lag: int = 0,
        **options: Unpack[observations.EnvironmentOptions],
    ) -> None:
        """Make the environment; InputError if an argument is not as described above."""
        scheduling = {"scheduler": scheduler, "speeds": speeds, "jitter": jitter, "lag": lag}
        EzPickle.__init__(self, system, **scheduling, **options)
        super().__init__()
        whole_number("lag", lag, 0)
        if not isinstance(speeds, Mapping | None):  # pyright: ignore[reportUnnecessaryIsInstance]
            raise InputError(f"speeds={speeds!r}: expected factors by module, as in {{0: 2}}")
        self._take(system, register=True, **options)
        self.lag = lag
        self._scheduling = scheduler, dict(speeds or {}), jitter
        self._scheduler = self._make_scheduler(0)
        self._world: FreeWorld | None = None
        self._declared: Choice | None = None
        self.last_turn: ActionResult | None = None

    def __deepcopy__(self, memo: dict[int, Any]) -> Self:
        """Return another environment that is where this one is; the scene is shared."""
        shared = self.scene, self.scene.system, self._shown
        memo.update({id(each): each for each in shared})
        found = type(self).__new__(type(self))
        found.__dict__.update(deepcopy(self.__dict__, memo))
        return found

    def _make_scheduler(self, seed: int) -> Scheduler:
        name, speeds, jitter = self._scheduling
        count = len(self.possible_agents)
        return scheduler_named(name, modules=count, seed=seed, speeds=speeds, jitter=jitter)

    @property
    def world(self) -> FreeWorld:
        """Return the current world; InputError before the first reset."""
        if self._world is None:
            raise InputError("the environment has not been reset yet: call reset first")
        return self._world

    @property
    def time(self) -> float:
        """Return when the current turn began; a module of speed factor 1 takes 1 for a turn."""
        return self._scheduler.time

    def reset(
        self,
        seed: int | None = None,
        options: dict[str, Any] | None = None,  # noqa: ARG002 - PettingZoo passes it by name
    ) -> None:
        """Put every module at its start; `seed` (by default 0) decides who acts when."""
        seed = observations.checked_seed(seed)
        if self._world is None:
            self._world = FreeWorld(
                self.scene, seed=seed, note_length=self.note_length, lag=self.lag
            )
        else:
            self._world.reset(seed)
        self._scheduler = self._make_scheduler(seed)
        self._declared = None
        self.last_turn = None
        self.agents = list(self.possible_agents)
        self.rewards = dict.fromkeys(self.agents, 0.0)
        self._cumulative_rewards = dict.fromkeys(self.agents, 0.0)
        self.terminations = dict.fromkeys(self.agents, False)
        self.truncations = dict.fromkeys(self.agents, False)
        self.infos = {
            agent: _info(self.observe(agent), committed=False, refused=None, illegal=False)
            for agent in self.agents
        }
        self._select(committed=False)

    def _select(self, *, committed: bool) -> None:
        """Begin the turn of the module that the scheduler wants."""
        module = self._scheduler.next(committed=committed)
        self.agent_selection = self.possible_agents[module]
        seen = self.world.look(module)
        self.infos[self.agent_selection]["action_mask"] = seen["action_mask"]

    def observe(self, agent: str) -> Observation:
        """Return what an agent was shown when its last turn began: the selected one, this turn."""
        module = self._module[agent]
        return self._shown(module, self.world.observation(module))

    def declare(self, choice: Choice) -> None:
        """Add note, guards, heeds and exchanges of a choice to the next action of the selected one.

        The action of the choice does not count.
        """
        if choice.note is not None:
            checked_note(choice.note, self.note_length)
        for note in choice.exchanges.values():
            checked_note(note, self.note_length)
        self._declared = choice

    def act(self, choice: Choice) -> ActionResult:
        """Step with a whole choice, and return the result."""
        self.declare(choice)
        self.step(choice.action)
        if self.last_turn is None:  # `step` has just set it
            raise AssertionError("a step without a turn")
        return self.last_turn

    def step(self, action: int | None) -> None:
        """Let the selected agent act; None stays."""
        agent = self.agent_selection
        if self.terminations[agent] or self.truncations[agent]:
            self._was_dead_step(action)
            return
        world = self.world
        choice = replace(self._declared or Choice(), action=int(action or STAY))
        self._declared = None
        before = observations.share_at_goal(self.scene, world.sites)
        played = self.last_turn = world.act(self._module[agent], choice)
        reward = observations.share_at_goal(self.scene, world.sites) - before
        committed = played.moved is not None
        done = self.scene.reached(world.sites)
        late = world.turns >= self.max_cycles * len(self.possible_agents)
        self._cumulative_rewards[agent] = 0.0
        self.rewards = dict.fromkeys(self.agents, reward)
        self.terminations = dict.fromkeys(self.agents, done)
        self.truncations = dict.fromkeys(self.agents, late and not done)
        self.infos[agent] = _info(
            self.observe(agent),
            committed=committed,
            refused=played.why or None,
            illegal=played.illegal,
        )
        self._accumulate_rewards()
        if done or late:
            self.agent_selection = self.agents[0]
        else:
            self._select(committed=committed)
        if self.render_mode == "human":
            self.render()

    def state(self) -> NDArray[np.int32]:
        """Return the places of all modules, int32, shape (modules, site_size)."""
        return observations.state_of(self.scene, self.sites)

    def close(self) -> None:
        """Forget the world."""
        self._world = None
        self.agents = []


def _info(
    seen: Observation, *, committed: bool, refused: str | None, illegal: bool
) -> dict[str, Any]:
    return {
        "action_mask": seen["action_mask"],
        "committed": committed,
        "refused": refused,
        "illegal": illegal,
    }


def parallel_env(
    system: str | Scene = "hex",
    *,
    transport: Literal["local", "zenoh"] = "local",
    processes: int = 2,
    copy: bool = True,
    world: str = "auto",
    **options: Unpack[observations.EnvironmentOptions],
) -> CubepathEnv:
    """Return the parallel environment of a system; `options` are those of `EnvironmentOptions`.

    With ``transport="zenoh"`` the modules live in `processes` separate processes and learn of one
    another by messages; observations, masks and results are the same. `copy` and `world` are those
    of `CubepathEnv`, and for worlds in this process.
    """
    if transport == "local":
        return CubepathEnv(system, copy=copy, world=world, **options)
    if transport != "zenoh":
        raise InputError(f"transport={transport!r}: expected 'local' or 'zenoh'")
    return WireEnv(system, processes=processes, **options)


def env(
    system: str | Scene = "hex", *, clock: str = "lockstep", **options: Any
) -> AECEnv[str, Observation, int | None]:
    """Return the environment in turns, with PettingZoo's usual wrappers.

    `options` are those of `EnvironmentOptions`. With ``clock="free"`` there are no rounds: it is a
    `FreeEnv`, with all its options.
    """
    turns: AECEnv[str, Observation, int | None]
    known = observations.EnvironmentOptions.__annotations__
    more = sorted(options.keys() - known.keys())
    if clock == "free":
        turns = FreeEnv(system, **options)
    elif clock != "lockstep":
        raise InputError(f"clock={clock!r}: expected 'lockstep' or 'free'")
    elif more:
        raise InputError(f"{more[0]}={options[more[0]]!r}: expected clock='free'")
    else:
        turns = parallel_to_aec(CubepathEnv(system, **options))
    return OrderEnforcingWrapper(AssertOutOfBoundsWrapper(turns))


raw_env = CubepathEnv
"""The environment without wrappers, by PettingZoo's usual name."""
