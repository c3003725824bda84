"""What is compiled beforehand is what worlds need, and nothing is compiled twice."""

import numpy as np
import pytest

from cubepath.agents import parallel_env
from cubepath.agents.arrays import batch as arrays
from cubepath.agents.arrays.batch import Batch
from cubepath.protocol.scenes.specs import scene_from_spec


@pytest.mark.parametrize(
    ("spec", "environments", "note_length"),
    [("hex:n=3", 1, 1), ("agv-labelled", 3, 0), ("arms:n=2", 2, 2), ("assembly:n=3", 1, 0)],
)
def test_one_set_of_types_serves_every_world(
    spec: str, environments: int, note_length: int
) -> None:
    """Whatever the system, with notes and without, for dicts and for arrays."""
    batch = Batch(scene_from_spec(spec), environments, note_length=note_length)
    batch.reset(range(environments))
    batch.observe()
    shape = environments, batch.modules
    for live in (None, np.zeros(environments, np.uint8)):
        batch.step(np.ones(shape, np.int64), live=live)
    env = parallel_env(spec, world="compiled", note_length=note_length)
    env.reset(seed=1)
    env.step(dict.fromkeys(env.agents, 1))
    env.step({})
    found = [len(each.dispatcher.signatures) for each in arrays._kernels()]
    assert found[0] == 1
    assert max(found) == 1
