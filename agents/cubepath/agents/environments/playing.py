"""Play a rule in one process, in compiled code where that pays and in plain Python elsewhere."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from cubepath.agents.arrays.warming import is_due
from cubepath.agents.environments.rollout import Played, check_max_rounds, play_in_python
from cubepath.agents.environments.rollouts import play_many
from cubepath.agents.environments.world import Round
from cubepath.agents.rules.registry import check_seeds, scene_and_rule
from cubepath.agents.rules.rule import RuleType
from cubepath.protocol.core.given import function
from cubepath.protocol.core.system import Scene

_ROUNDS = 20
"""A run is taken to have so many rounds, to tell whether compiled code pays."""


def play(
    system: str | Path | Scene = "hex",
    rule: str | RuleType | None = None,
    *,
    seed: int = 0,
    hesitate: float = 0.0,
    max_rounds: int = 1000,
    watch: Callable[[Round], None] | None = None,
) -> Played:
    """Play until the goal is reached, a rule gives up, or `max_rounds` are over.

    `system` is a scene, or its name as on the command line. `rule` is a rule or the name of one,
    and None means the rule of the system's family. One that has a vectorised form is played in
    compiled code once that is ready. `watch` is called after each round. InputError if the system
    or the rule is not known, or they do not go together, or `max_rounds` is negative.

    >>> played = play("hex:n=4", seed=1)
    >>> played.reached, len(played.rounds), len(played.path), played.sites[0]
    (True, 14, 18, (3, 1))
    >>> first = played.placed[0]
    >>> first.generator, first.at
    ('pivot-2-right', (1, -1))
    """
    check_max_rounds(max_rounds)
    if watch is not None:
        function("watch", watch)
    scene, rule = scene_and_rule(system, rule)
    check_seeds([seed], hesitate)
    if watch is None and rule.vectorised is not None and is_due(_ROUNDS * len(scene.start)):
        runs = play_many(
            scene, rule, [seed], hesitate=hesitate, max_rounds=max_rounds, keep_rounds=True
        )
        played = () if runs.played is None else runs.played[0]
        return Played(scene, played, runs.sites[0], bool(runs.reached[0]), runs.failed.get(0))
    return play_in_python(
        scene, rule, seed=seed, hesitate=hesitate, max_rounds=max_rounds, watch=watch
    )
