"""Keepers and modules in every order of messages, with any one fault of each kind."""

from collections.abc import Iterable
from dataclasses import replace

import pytest

from cubepath.agents.keepers.attempts import AttemptPlan
from cubepath.agents.keepers.keeper import Keeper, _Last, _Pending
from cubepath.protocol.core.sites import Site
from cubepath.protocol.core.system import Scene
from cubepath.protocol.scenes.specs import scene_from_spec
from cubepath.protocol.wire.free_messages import EnterRequest, Inquiry
from exploration.keeper_explorer import Broken, Explorer
from exploration.keeper_world import Faults, Scenario

Targets = Iterable[tuple[Site, tuple[tuple[Site, Site | None], ...]]]


def _from(spec: str, *start: Site) -> Scene:
    return replace(scene_from_spec(spec), start=start, goal=None, goals=())


def _to_the_hub(module: int, site: Site) -> Targets:
    """From a leaf of a star to its hub."""
    del module
    return [(0, ())] if site else []


def _after_the_other(module: int, site: Site) -> Targets:
    """From the hub to the third leaf, and from a leaf to the hub."""
    return [(0, ())] if module else [(3, ())] if site == 0 else []


def _past_each_other(module: int, site: Site) -> Targets:
    """On a ring of four one goes on and one goes back, each if the place behind it is empty."""
    step = -1 if module else 1
    return [((site + step) % 4, (((site - step) % 4, None),))]  # type: ignore[operator]


def _either_way(module: int, site: Site) -> Targets:
    """On a ring of four each goes on or back, if the place on its other side is empty."""
    del module
    return [((site + d) % 4, (((site - d) % 4, None),)) for d in (1, -1)]  # type: ignore[operator]


HUB = Scenario(_from("agv:graph=S3,n=2", 1, 2), {0: 1, 1: 0, 2: 2, 3: 0}, _to_the_hub)
"""Two that want the hub; of one it is the last keeper, of the other the first."""
SAME = replace(HUB, keeper_of={0: 1, 1: 0, 2: 0, 3: 0})
"""The same, and both begin at keeper 0."""
RING = Scenario(_from("agv:graph=C4,n=2", 0, 2), {0: 0, 1: 1, 2: 1, 3: 0}, _past_each_other)
"""Two whose moves conflict at two keepers: each guards the place that the other goes to, or both go
to the same."""
LONG = replace(RING, keeper_of={0: 0, 1: 1, 2: 0, 3: 2})
"""The same over three keepers."""
AFTER = Scenario(_from("agv:graph=S3,n=2", 0, 1), {0: 1, 1: 0, 2: 2, 3: 2}, _after_the_other)
"""One makes way for the other, which is refused before."""
THREE = Scenario(_from("agv:graph=S3,n=3", 1, 2, 3), {0: 1, 1: 0, 2: 2, 3: 0}, _to_the_hub)

THOROUGH = (pytest.mark.thorough, pytest.mark.timeout(300))
NIGHTLY = (pytest.mark.nightly, pytest.mark.timeout(300))


def test_one_of_two_is_committed_or_none() -> None:
    """Whatever the order; none if both were given up."""
    for scenario in (HUB, SAME):
        found = Explorer(scenario).explore()
        expected = [set(), {(0, 0, 1)}, {(1, 0, 1)}]
        assert sorted(map(sorted, found.committed)) == sorted(map(sorted, expected))


def test_one_follows_another_or_is_refused_for_good() -> None:
    """The second is committed after the first, or refused, and then never committed."""
    found = Explorer(AFTER).explore()
    first, second = (0, 0, 1), (1, 0, 1)
    expected: list[set[tuple[int, int, int]]] = [set(), {first}, {first, second}]
    assert sorted(map(sorted, found.committed)) == sorted(map(sorted, expected))


@pytest.mark.slow
@pytest.mark.parametrize(
    "faults", [Faults(double=1), Faults(loss=1), Faults(module=1), Faults(keeper=1)], ids=str
)
def test_two_bear_any_one_fault(faults: Faults) -> None:
    """A message doubled, late or lost, a module or a keeper that crashes at any moment."""
    found = Explorer(replace(HUB, faults=faults)).explore()
    assert found.states > Explorer(HUB).explore().states
    assert len(found.committed) >= 3


@pytest.mark.slow
@pytest.mark.parametrize("scenario", [replace(RING, targets=_either_way), LONG], ids=["2", "3"])
def test_two_conflict_over_keepers(scenario: Scenario) -> None:
    """Over two keepers, with two moves for each to attempt, and over three."""
    assert Explorer(scenario).explore().states > 1_000


@pytest.mark.slow
def test_a_module_attempts_again_in_its_epoch() -> None:
    """Two attempts of each, also when an earlier one is still under way somewhere."""
    found = Explorer(replace(HUB, attempts=2)).explore()
    assert frozenset({(0, 0, 2)}) in found.committed


@pytest.mark.parametrize(
    ("scenario", "faults"),
    [
        pytest.param(RING, Faults(double=1, keeper=1), marks=THOROUGH, id="ring"),
        *(
            pytest.param(LONG, faults, marks=NIGHTLY, id=f"long {at}")
            for at, faults in enumerate((Faults(loss=1), Faults(module=1), Faults(keeper=1)))
        ),
        pytest.param(THREE, Faults(), marks=NIGHTLY, id="three"),
    ],
)
def test_small_cases_are_exhausted(scenario: Scenario, faults: Faults) -> None:
    """Two faults together; three keepers with a fault; three modules."""
    assert Explorer(replace(scenario, faults=faults)).explore().states > 5_000


class _Careless(Keeper):
    """Does not remember what it has refused."""

    def _refuse(self, pending: _Pending, why: str) -> None:
        module = pending.passed.attempt.module
        before = self._last.get(module, _Last(0, 0))
        super()._refuse(pending, why)
        self._last[module] = before


class _Forgetful(Keeper):
    """Does not remember that it has forbidden an attempt."""

    def _answer(self, keeper: int, inquiry: Inquiry) -> None:
        before = self._last.get(inquiry.module, _Last(0, 0))
        super()._answer(keeper, inquiry)
        self._last[inquiry.module] = before


class _Unfenced(Keeper):
    """Takes attempts of any epoch."""

    def _fenced_off(self, plan: AttemptPlan) -> str | None:
        del plan
        return None


class _Open(Keeper):
    """Lets a module enter while a move of it is under way."""

    def _enter(self, process: int, enter: EnterRequest) -> None:
        prepared, self._prepared = self._prepared, {}
        super()._enter(process, enter)
        self._prepared = prepared


class _Silent(Keeper):
    """Never asks what became of an attempt."""

    def _inquire(self, pending: _Pending) -> None:
        pending.age = 0


class _Barging(Keeper):
    """Lets an attempt that has to wait here wait for nobody."""

    def _must_wait(self, pending: _Pending) -> bool:
        return pending.passed.attempt.module in self._prepared


LOST = Faults(loss=1, module=1)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("scenario", "kind", "told"),
    [
        (AFTER, _Careless, "refused"),
        (RING, _Forgetful, "is committed, and was refused"),
        (replace(RING, faults=Faults(module=1)), _Unfenced, "is fenced off, and committed"),
        (replace(HUB, faults=Faults(module=1)), _Open, "fence"),
        (replace(SAME, faults=LOST), _Silent, "something stays due"),
        (LONG, _Barging, "hold what only one may hold|held exclusively"),
    ],
)
def test_a_keeper_with_a_bug_is_found(scenario: Scenario, kind: type[Keeper], told: str) -> None:
    """Whatever it breaks, and the way there is told."""
    with pytest.raises(Broken, match=told) as caught:
        Explorer(scenario, kind).explore()
    assert "\nafter\nstart\n" in str(caught.value)
