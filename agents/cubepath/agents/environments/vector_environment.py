"""Many episodes of one scene side by side, in the form of Gymnasium's vector environments.

Source: https://gymnasium.farama.org/api/vector/. All modules of a scene act in each environment, so
each array of an environment has an axis for modules.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from gymnasium import spaces
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import ArrayLike, NDArray

from cubepath.agents.arrays.batch import Batch, RelativeArrays
from cubepath.agents.arrays.rounds import ILLEGAL
from cubepath.agents.environments.environment import EpisodeState
from cubepath.agents.environments.observations import ObservationEncoder
from cubepath.agents.local.observation import SILENT
from cubepath.agents.local.relative import Showing
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.sites import Site
from cubepath.protocol.core.system import Scene, local_only
from cubepath.protocol.scenes.specs import scene_from_spec

Arrays = dict[str, NDArray[Any]]
LATER_SEEDS = 1 << 31
"""Later episodes of an environment have seeds below this."""


class CubepathVectorEnv(VectorEnv[Arrays, NDArray[Any], NDArray[Any]]):
    """Environments of one scene, stepped together in compiled code.

    Each gives what `CubepathEnv` gives with its seed: observations and masks of all modules,
    rewards, ends. With n modules and E environments,

    - observations are a dict of ``observation``, shape (E, n, length), int32, or float32 with
      ``observation="relative"``; ``action_mask``, int8, shape (E, n, moves + 1); and ``notes`` if
      `note_length` is positive;
    - actions are integers, shape (E, n);
    - rewards (float64), terminations and truncations (bool) have shape (E,);
    - infos hold ``illegal``, bool, shape (E, n), and ``seed``, the seed of each episode.

    An environment whose episode is over is reset as `autoreset_mode` says. The first episode has
    the seed that `reset` was given, later ones draw theirs from a stream of it.

    >>> env = CubepathVectorEnv("hex:n=3", num_envs=4)
    >>> seen, infos = env.reset(seed=1)
    >>> seen["observation"].shape[:2], seen["action_mask"].shape
    ((4, 3), (4, 3, 13))
    """

    def __init__(
        self,
        system: str | Scene = "hex",
        *,
        num_envs: int = 1,
        max_cycles: int = 500,
        note_length: int = 0,
        observation: Showing = "absolute",
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        copy: bool = True,
    ) -> None:
        """Make the environments; with ``copy=False`` every step overwrites the same arrays."""
        if num_envs < 1:
            raise InputError(f"num_envs={num_envs}: expected 1 or more")
        try:
            self.autoreset_mode = AutoresetMode(autoreset_mode)
        except ValueError:
            known = ", ".join(repr(mode.value) for mode in AutoresetMode)
            raise InputError(
                f"autoreset_mode={autoreset_mode!r}: expected one of {known}"
            ) from None
        scene = scene_from_spec(system) if isinstance(system, str) else system
        self.scene = local_only(scene, "environment")
        self.num_envs = num_envs
        self.max_cycles = max_cycles
        self.note_length = note_length
        self.copy = copy
        self.metadata = {"name": "cubepath_v0", "autoreset_mode": self.autoreset_mode}
        self.batch = Batch(scene, num_envs, note_length=note_length)
        shown = ObservationEncoder(scene, observation)
        self._relative = RelativeArrays(self.batch) if shown.relative else None
        modules = len(scene.start)
        self.single_observation_space = batch_space(shown.space(note_length), modules)
        self.single_action_space = spaces.MultiDiscrete([scene.system.move_slots + 1] * modules)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._over = np.ones(num_envs, np.bool_)
        self._seeds = np.zeros(num_envs, np.int64)
        self._streams: list[np.random.Generator] = []
        self._done = self._late = np.zeros(num_envs, np.bool_)

    def reset(
        self,
        *,
        seed: int | Sequence[int | None] | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[Arrays, dict[str, Any]]:
        """Begin new episodes; ``options={"reset_mask": mask}`` chooses the environments.

        A seed s gives environment i the seed s + i; a list has one for each. None continues with
        the streams of earlier seeds, of seed 0 at first.
        """
        count = self.num_envs
        mask = (options or {}).get("reset_mask", np.ones(count, np.bool_))
        if not isinstance(mask, np.ndarray) or mask.shape != (count,) or mask.dtype != np.bool_:
            raise InputError(f"reset_mask: expected a boolean array of shape ({count},)")
        given: list[int | None] = [None] * count
        if isinstance(seed, (int, np.integer)):
            given = [int(seed) + number for number in range(count)]
        elif seed is not None:
            given = list(seed)
        if len(given) != count:
            raise InputError(f"{len(given)} seeds, expected {count}")
        if not self._streams:
            self._streams = [np.random.default_rng(number) for number in range(count)]
            given = [number if each is None else each for number, each in enumerate(given)]
        chosen = np.flatnonzero(mask)
        for number in chosen.tolist():
            own = given[number]
            if own is not None:
                if own < 0:
                    raise InputError(f"seed={own}: expected 0 or more")
                self._streams[number] = np.random.default_rng(own)
            self._seeds[number] = self._next_seed(number) if own is None else own
        self._restart(chosen)
        self.batch.observe()
        return self._observations(), self._infos(np.zeros((count, self.batch.modules), np.bool_))

    def _next_seed(self, number: int) -> int:
        return int(self._streams[number].integers(LATER_SEEDS))

    def _restart(self, chosen: NDArray[np.intp]) -> None:
        self.batch.reset(self._seeds[chosen].tolist(), chosen.tolist())
        self._over[chosen] = False

    def _restart_with_new_seeds(self, chosen: NDArray[np.intp]) -> None:
        for number in chosen.tolist():
            self._seeds[number] = self._next_seed(number)
        self._restart(chosen)

    def step(
        self, actions: ArrayLike, notes: NDArray[np.int32] | None = None
    ) -> tuple[Arrays, NDArray[Any], NDArray[Any], NDArray[Any], dict[str, Any]]:
        """Play one round in each environment.

        `notes`, int32, shape (E, n, note_length), are heard in the next round; a note that begins
        with `SILENT` leaves the module's last one as it is.
        """
        if not self._streams:
            raise InputError("the environments have not been reset yet: call reset first")
        batch = self.batch
        chosen = self._actions(actions)
        fresh = np.flatnonzero(self._over)
        if len(fresh) and self.autoreset_mode is AutoresetMode.DISABLED:
            raise InputError(f"environment {fresh[0]} is over: reset it with a reset_mask")
        live = None
        if len(fresh):
            self._restart_with_new_seeds(fresh)
            live = np.ones(self.num_envs, np.uint8)
            live[fresh] = 0
        before = batch.at_goal / batch.modules
        told = None if notes is None else self._spoken(notes)
        if told is not None and live is not None:
            told[0][live == 0] = False
        outcomes = batch.step(chosen, spoken=told, live=live)
        rewards = np.where(live == 0, 0.0, batch.at_goal / batch.modules - before)
        done, late = batch.reached, batch.round >= self.max_cycles
        if live is not None:
            done, late = done & (live == 1), late & (live == 1)
        late &= ~done
        infos = self._infos(outcomes == ILLEGAL)
        over = np.flatnonzero(done | late)
        self._over[over] = True
        if len(over) and self.autoreset_mode is AutoresetMode.SAME_STEP:
            infos["final_obs"], infos["_final_obs"] = self._observations(copy=True), done | late
            self._restart_with_new_seeds(over)
            batch.observe()
            infos["seed"] = self._seeds.copy()
        return self._observations(), rewards, done, late, infos

    def _actions(self, actions: ArrayLike) -> NDArray[np.int64]:
        found = np.asarray(actions)
        shape = (self.num_envs, self.batch.modules)
        if found.shape != shape or found.dtype.kind not in "iu":
            raise InputError(
                f"actions: expected integers of shape {shape}, found {found.dtype} {found.shape}"
            )
        return np.ascontiguousarray(found, np.int64)

    def _spoken(self, notes: NDArray[np.int32]) -> tuple[NDArray[np.bool_], NDArray[np.int32]]:
        shape = (self.num_envs, self.batch.modules, self.note_length)
        if not self.note_length or notes.shape != shape or notes.dtype != np.int32:
            raise InputError(
                f"notes: expected int32 of shape {shape}, found {notes.dtype} {notes.shape}"
            )
        return notes[:, :, 0] != SILENT, notes

    def _observations(self, *, copy: bool = False) -> Arrays:
        observed = self.batch.observed
        seen = observed.observation if self._relative is None else self._relative.update()
        found: Arrays = {"observation": seen, "action_mask": observed.mask}
        if self.note_length:
            found["notes"] = observed.notes
        if copy or self.copy:
            return {key: array.copy() for key, array in found.items()}
        return found

    def _infos(self, illegal: NDArray[np.bool_]) -> dict[str, Any]:
        everyone = np.ones(self.num_envs, np.bool_)
        return {
            "illegal": illegal,
            "_illegal": everyone,
            "seed": self._seeds.copy(),
            "_seed": everyone,
        }

    def get_state(self) -> tuple[EpisodeState, ...]:
        """Return where the episode of each environment is, as `CubepathEnv.get_state` does."""
        batch = self.batch
        return tuple(
            EpisodeState(
                seed,
                int(batch.round[number]),
                tuple(batch.sites(number)),
                tuple(map(tuple, batch.notes[number].tolist())),
                () if over else self.scene.modules,
            )
            for number, (seed, over) in enumerate(
                zip(self._seeds.tolist(), self._over, strict=True)
            )
        )

    def set_state(self, states: Sequence[EpisodeState]) -> tuple[Arrays, dict[str, Any]]:
        """Continue each environment from a state of this scene, and return what `reset` does.

        Later episodes have the seeds that follow ``reset(seed=[state.seed for state in states])``.
        """
        _, infos = self.reset(seed=[state.seed for state in states])
        for number, state in enumerate(states):
            self.batch.put(number, state.sites, state.round, state.notes)
            self._over[number] = not state.agents
        self.batch.observe()
        return self._observations(), infos

    def sites(self, environment: int) -> list[Site]:
        """Return the site of each module of an environment, by number."""
        return self.batch.sites(environment)


vector_env = CubepathVectorEnv
"""The environments by the name that goes with `parallel_env`."""
