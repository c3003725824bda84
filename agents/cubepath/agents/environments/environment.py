"""The PettingZoo environments: one agent per module, in one process or over zenoh."""

from __future__ import annotations

import weakref
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple, Self, Unpack

import numpy as np
from gymnasium.utils import EzPickle
from numpy.typing import NDArray
from pettingzoo import ParallelEnv

from cubepath.agents.arrays.batch import is_due
from cubepath.agents.arrays.tables import UntabledError
from cubepath.agents.environments.array_world import ArrayRound, ArrayWorld, Infos
from cubepath.agents.environments.observations import (
    EnvironmentOptions,
    ModuleAgents,
    ReusedDicts,
    checked_seed,
    infos_of,
    share_at_goal,
    state_of,
)
from cubepath.agents.environments.world import Round, World
from cubepath.agents.local.observation import STAY, Note, Observation, checked_note
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.sites import Site
from cubepath.protocol.core.system import Scene

if TYPE_CHECKING:
    from cubepath.agents.environments.wire_world import WireWorld


class EpisodeState(NamedTuple):
    """Where an episode is, with the last note of each module: all that follows depends on it."""

    seed: int
    round: int
    sites: tuple[Site, ...]
    notes: tuple[Note, ...]
    agents: tuple[str, ...]


WORLDS = ("auto", "plain", "compiled")


class CubepathEnv(ModuleAgents, ParallelEnv[str, Observation, int | None], EzPickle):
    """The modules of a scene as agents module_0, module_1, ...

    Observation and mask are those of `cubepath.agents.local.observation.observe`; with
    ``observation="relative"`` the array ``observation`` is that of
    `cubepath.agents.local.relative.RelativeObserver` instead. Action 0 stays, action i is the move
    in slot i - 1. Conflicting choices are settled by seeded rank; a choice that is not admissible
    counts as stay and is marked ``illegal`` in the infos. All agents share one reward: the change
    in the fraction of goal places that are taken. The episode terminates when the goal is reached,
    and is truncated after `max_cycles` rounds.

    >>> env = CubepathEnv("hex:n=3")
    >>> seen, infos = env.reset(seed=1)
    >>> actions = {name: int(each["action_mask"].nonzero()[0][-1]) for name, each in seen.items()}
    >>> seen, rewards, ended, cut, infos = env.step(actions)
    >>> len(env.last_round.moves), env.state().shape
    (2, (3, 2))
    """

    metadata: dict[str, Any] = {  # noqa: RUF012 - PettingZoo types it as an instance variable
        "name": "cubepath_v0",
        "render_modes": ["human", "ansi", "rgb_array"],
        "is_parallelizable": True,
        "render_fps": 4,
    }

    def __init__(
        self,
        system: str | Scene = "hex",
        *,
        copy: bool = True,
        world: str = "auto",
        **options: Unpack[EnvironmentOptions],
    ) -> None:
        """Make the environment; `EnvironmentOptions` has the other options.

        With ``copy=False`` the dicts and arrays that `reset` and `step` return are the same each
        time, and overwritten: twice as fast, for who has read them before the next step. `world` is
        "plain" for the world in plain Python, which is the reference; "compiled" for the one in
        compiled code, which gives the same and is a hundred times as fast; by default the first
        begins, and the second continues from there when there is more to do than to compile.
        """
        EzPickle.__init__(self, system, copy=copy, world=world, **options)
        if world not in WORLDS:
            raise InputError(f"world={world!r}: expected one of {', '.join(WORLDS)}")
        self._take(system, **options)
        self.copy = copy
        self._which = world
        self._world: World | ArrayWorld | WireWorld | None = None
        self._played: Round | ArrayRound | None = None
        self._kept: ReusedDicts | None = None

    def reset(
        self,
        seed: int | None = None,
        options: dict[str, Any] | None = None,  # noqa: ARG002 - PettingZoo passes it by name
    ) -> tuple[dict[str, Observation], Infos]:
        """Put every module at its start; `seed` (by default 0) ranks the claims."""
        self.agents = list(self.possible_agents)
        seed = checked_seed(seed)
        if self._world is None:
            self._world = self._make_world(seed)
        else:
            self._world.reset(seed)
        self._played = None
        self._compile_when_it_pays()
        return self._begun()

    def _begun(self) -> tuple[dict[str, Observation], Infos]:
        """Return the observations and infos before a step."""
        if isinstance(self._world, ArrayWorld):
            return self._all_shown(self._world, ())
        observations = self._show(self._observe())
        return observations, infos_of(observations, set())

    def _make_world(self, seed: int) -> World | ArrayWorld | WireWorld:
        if self._which == "compiled":
            try:
                return ArrayWorld(
                    self.scene,
                    seed=seed,
                    note_length=self.note_length,
                    relative=self._shown.relative,
                )
            except UntabledError as error:
                raise InputError(f"{self.scene.spec}: world='compiled': {error}") from error
        return World(self.scene, seed=seed, note_length=self.note_length)

    def _compile_when_it_pays(self) -> None:
        """Go on in compiled code when it is ready, once there was enough to do."""
        world = self._world
        if self._which != "auto" or not isinstance(world, World):
            return
        if is_due(len(self.agents)):
            try:
                self._world = ArrayWorld.after(world, relative=self._shown.relative)
            except UntabledError:
                self._which = "plain"

    @property
    def last_round(self) -> Round | None:
        """Return what the last round did; None after a reset."""
        if isinstance(self._played, ArrayRound):
            self._played = self._played.round()
        return self._played

    @property
    def world(self) -> World | ArrayWorld | WireWorld:
        """Return the current world; InputError before the first reset."""
        if self._world is None:
            raise InputError("the environment has not been reset yet: call reset first")
        return self._world

    def get_state(self) -> EpisodeState:
        """Return where the episode is; InputError before the first reset, and over zenoh."""
        world = self._own_world()
        sites, notes = tuple(world.sites), tuple(world.spoken())
        return EpisodeState(world.seed, world.round, sites, notes, tuple(self.agents))

    def set_state(self, state: EpisodeState) -> tuple[dict[str, Observation], Infos]:
        """Continue from where an episode of the same scene was, and return what `reset` does.

        Each following step returns what it returned there after the same actions. InputError over
        zenoh.
        """
        self.reset(state.seed)
        self._own_world().put(state.sites, state.round, state.notes)
        seen = self._begun()
        self.agents = list(state.agents)
        return seen

    def __deepcopy__(self, memo: object) -> Self:
        """Return another environment that is where this one is; the scene is shared."""
        given: dict[str, Any] = self._ezpickle_kwargs
        found = type(self)(self.scene, **given)
        found.max_cycles, found.render_mode = self.max_cycles, self.render_mode
        if self._world is not None:
            found.set_state(self.get_state())
        return found

    def _own_world(self) -> World | ArrayWorld:
        if not isinstance(self.world, World | ArrayWorld):
            raise InputError("state: modules over zenoh keep it, expected a world of one process")
        return self.world

    def _observe(self) -> dict[str, Observation]:
        world = self.world
        if isinstance(world, ArrayWorld):
            raise TypeError("a compiled world observes for all modules at once")
        return {name: world.observe(self._module[name]) for name in self.agents}

    def _show(self, seen: Mapping[str, Observation]) -> dict[str, Observation]:
        return {name: self._shown(self._module[name], each) for name, each in seen.items()}

    def step(
        self, actions: Mapping[str, int | None], notes: Mapping[str, Note] | None = None
    ) -> tuple[dict[str, Observation], dict[str, float], dict[str, bool], dict[str, bool], Infos]:
        """Play one round; `notes`, for rules that send notes, are heard in the next round."""
        world = self.world
        if not self.agents:
            return {}, {}, {}, {}, {}
        spoken = {
            self._number(name): checked_note(note, self.note_length)
            for name, note in (notes or {}).items()
        }
        if isinstance(world, ArrayWorld):
            return self._step_arrays(world, actions, spoken)
        wanted = {self._number(name): int(action or STAY) for name, action in actions.items()}
        before = self._at_goal()
        played = self._played = world.step(wanted, spoken)
        illegal = {
            self.possible_agents[module]
            for module, action in wanted.items()
            if action and module not in played.moves and module not in played.lost
        }
        reward = self._at_goal() - before
        done = self.scene.reached(world.sites)
        late = world.round >= self.max_cycles
        observations = self._show(self._observe())
        result = (
            observations,
            dict.fromkeys(self.agents, reward),
            dict.fromkeys(self.agents, done),
            dict.fromkeys(self.agents, late and not done),
            infos_of(observations, illegal),
        )
        self._end_round(over=done or late)
        return result

    def _end_round(self, *, over: bool) -> None:
        if over:
            self.agents = []
        if self.render_mode == "human":
            self.render()
        if not over:
            self._compile_when_it_pays()

    def _step_arrays(
        self, world: ArrayWorld, actions: Mapping[str, int | None], spoken: Mapping[int, Note]
    ) -> tuple[dict[str, Observation], dict[str, float], dict[str, bool], dict[str, bool], Infos]:
        agents = self.agents
        before = world.at_goal
        played = self._played = world.step(self._as_array(actions), spoken)
        reward = world.at_goal / len(agents) - before / len(agents)
        done = world.reached
        late = world.round >= self.max_cycles
        observations, infos = self._all_shown(world, played.illegal().tolist())
        if self._kept is not None:
            rewards, ended, cut = self._kept.results(reward, done=done, late=late and not done)
        else:
            rewards = dict.fromkeys(agents, reward)
            ended = dict.fromkeys(agents, done)
            cut = dict.fromkeys(agents, late and not done)
        self._end_round(over=done or late)
        return observations, rewards, ended, cut, infos

    def _as_array(self, actions: Mapping[str, int | None]) -> NDArray[np.int64]:
        """Return an action for each module, -1 for any that no module can have."""
        agents = self.possible_agents
        if list(actions) == agents:
            try:
                return np.fromiter(actions.values(), np.int64, len(agents))
            except (TypeError, ValueError, OverflowError):  # None among them, or far too large
                pass
        found = np.full(len(agents), STAY, np.int64)
        most = self.scene.system.move_slots
        for name, action in actions.items():
            number = int(action or STAY)
            found[self._number(name)] = number if 0 <= number <= most else -1
        return found

    def _all_shown(
        self, world: ArrayWorld, illegal: Sequence[int]
    ) -> tuple[dict[str, Observation], Infos]:
        """Return the observations and infos of all agents."""
        names = self.possible_agents
        if self.copy:
            observations = world.observations(names, copy=True)
            return observations, infos_of(observations, {names[module] for module in illegal})
        if self._kept is None or self._kept.world is not world:
            self._kept = ReusedDicts(world, names)
        else:
            world.refresh()
        return self._kept.observations, self._kept.marked(illegal)

    def _number(self, name: str) -> int:
        number = self._module.get(name)
        if number is None:
            raise InputError(f"{name!r} is no agent, expected one of {self.possible_agents}")
        return number

    def _at_goal(self) -> float:
        return share_at_goal(self.scene, self.sites)

    def state(self) -> NDArray[np.int32]:
        """Return the places of all modules, int32, shape (modules, site_size)."""
        if isinstance(self._world, ArrayWorld):
            return self._world.places()
        return state_of(self.scene, self.sites)

    def close(self) -> None:
        """Release the resources of the world: over zenoh, its processes and sessions."""
        if self._world is not None:
            self._world.close()
            self._world = self._kept = None
            self.agents = []


class WireEnv(CubepathEnv):
    """The same environment with the modules in separate processes, over zenoh.

    The first `reset` starts the processes; they serve all episodes, and end with `close`.
    """

    def __init__(
        self,
        system: str | Scene = "hex",
        *,
        processes: int = 2,
        **options: Unpack[EnvironmentOptions],
    ) -> None:
        """Make the environment; `processes` 0 keeps the modules here, still over a session."""
        super().__init__(system, **options)
        EzPickle.__init__(self, system, processes=processes, **options)
        if processes < 0:
            raise InputError(f"processes={processes}: expected 0 or more")
        self.processes = processes

    def _make_world(self, seed: int) -> World | ArrayWorld | WireWorld:
        from cubepath.agents.environments.wire_world import WireWorld  # noqa: PLC0415 - zenoh only when used

        world = WireWorld(
            self.scene, seed=seed, note_length=self.note_length, processes=self.processes
        )
        # An environment that is dropped, or left open at exit, ends its processes.
        weakref.finalize(self, world.close)
        return world
