"""Modules are followed through the moves of a run, by the moves alone."""

from itertools import chain

import pytest

from cubepath.coordinator.normal_form.heap import normal_cube_path
from cubepath.coordinator.runs.states import snapshots
from cubepath.protocol.scenes.specs import scene_from_spec
from samples.random_runs import SPECS, random_run


@pytest.mark.parametrize("spec", [*SPECS, "sliding:p=2,q=2,n=5", "arms:n=2"])
def test_modules_are_followed(spec: str) -> None:
    """From the actions alone follows where each module is, as in the world that moved them."""
    scene, rounds, where = random_run(spec, 30)
    found = list(snapshots(scene, rounds))
    assert [snapshot.sites for snapshot in found] == where
    for before, after, snapshot in zip(where, where[1:], found[1:], strict=False):
        left = {n: site for n, site in enumerate(before) if site != after[n]}
        assert snapshot.moved == left
        assert set(snapshot.by) == set(left)


@pytest.mark.parametrize("spec", SPECS)
def test_each_module_ends_at_the_same_place_by_the_cubes(spec: str) -> None:
    """The normal cube path takes every single module where the run took it."""
    scene, rounds, where = random_run(spec, 30)
    *_, last = snapshots(scene, normal_cube_path(chain.from_iterable(rounds)))
    assert last.sites == where[-1]


def test_a_flip_of_an_arm_moves_two_segments() -> None:
    """One action, two modules, each turning in its place."""
    scene = scene_from_spec("arm:n=2")
    rotate = scene.system.action("rotate", (0, 1))
    flip = scene.system.action("flip", (0, 0))
    *_, last = snapshots(scene, [[rotate], [flip]])
    assert last.sites == ((0, 0, 0), (1, 0, 1))
    assert last.moved == {0: (0, 0, 1), 1: (0, 1, 0)}
