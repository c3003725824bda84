"""Scenes without rounds, for the tests of several rooms: who acts when, and how late it sees."""

from collections.abc import Mapping
from dataclasses import dataclass

from hypothesis import strategies as st

from cubepath.agents.environments.rollouts import FreeRollout, Watch, play_free
from cubepath.agents.rules.rule import RuleType
from cubepath.protocol.core.system import Scene


@dataclass(frozen=True)
class Pace:
    """Everything that must not keep a rule from its goal."""

    scheduler: str = "random"
    seed: int = 0
    lag: int = 0
    hesitate: float = 0.0
    slow: int = 1
    """How many times more rarely module 0 acts."""
    restarts: tuple[tuple[int, int], ...] = ()
    """Before which turn which module, modulo the number of modules, loses all it knows."""

    def play(
        self, scene: Scene, rule: RuleType, *, max_cycles: int = 4000, watch: Watch | None = None
    ) -> FreeRollout:
        """Play a rule at this pace."""
        count = len(scene.start)
        restarts: dict[int, list[int]] = {}
        for turn, module in self.restarts:
            restarts.setdefault(turn, []).append(module % count)
        speeds: Mapping[int, int] | None = None
        if self.scheduler == "random":
            speeds = {0: self.slow}
        return play_free(
            scene,
            rule,
            seed=self.seed,
            hesitate=self.hesitate,
            max_cycles=max_cycles,
            scheduler=self.scheduler,
            speeds=speeds,
            lag=self.lag,
            restarts=restarts,
            watch=watch,
        )


def paces() -> st.SearchStrategy[Pace]:
    """Return paces of every kind."""
    return st.builds(
        Pace,
        scheduler=st.sampled_from(["random", "unfair", "turns"]),
        seed=st.integers(0, 999),
        lag=st.integers(0, 5),
        hesitate=st.sampled_from([0.0, 0.3]),
        slow=st.sampled_from([1, 10, 100]),
        restarts=st.lists(st.tuples(st.integers(1, 300), st.integers(0, 99)), max_size=4).map(
            tuple
        ),
    )
