"""Faults: how they are drawn, that what is drawn is tolerable, and that a list says the same."""

from random import Random

from cubepath.coordinator.simulation.faults import (
    ENDING,
    KINDS,
    ON_HOPS,
    ROUTER,
    SECOND_US,
    SLOW_MESSAGES,
    DrawnFaults,
    Fault,
    ListedFaults,
)

PATIENCE_US = 60 * SECOND_US
NAMES = ["process_0", "process_1"]


def drawn(seed: int, count: int = 2000) -> list[Fault]:
    """Return the faults that are drawn for so many messages at each place."""
    faults = DrawnFaults(Random(seed), "coordinator", NAMES, PATIENCE_US)  # noqa: S311 - not for secrets
    asked = [
        each
        for nth in range(count)
        for each in (
            *(faults.at(f"{name} {way}", nth) for name in NAMES for way in ("up", "down")),
            *(faults.at(name, nth) for name in ("coordinator", *NAMES, ROUTER)),
        )
    ]
    return [fault for fault in asked if fault is not None]


def test_every_kind_is_drawn_and_any_may_be_switched_off() -> None:
    """Over some seeds each kind is there in one and missing in another."""
    kinds = [{fault.kind for fault in drawn(seed, 300)} for seed in range(80)]
    assert set().union(*kinds) == set(KINDS)
    assert set.intersection(*kinds) == set()


def test_what_is_tolerated_takes_half_of_the_patience_at_most() -> None:
    """However long a run is, its outages together are shorter than that."""
    for seed in range(20):
        outages = [
            fault.amount_us * (SLOW_MESSAGES if fault.kind == "slow" else 1)
            for fault in drawn(seed)
            if fault.kind not in ENDING and fault.kind != "duplicate"
        ]
        assert sum(each for each in outages if each > 0.01 * SECOND_US) <= PATIENCE_US / 2


def test_a_stall_takes_longer_than_the_patience() -> None:
    """Ending faults come once in a run at most, each kind."""
    ends = [[fault for fault in drawn(seed, 100) if fault.kind in ENDING] for seed in range(500)]
    assert all(len({fault.kind for fault in each}) == len(each) for each in ends)
    stalls = [fault for each in ends for fault in each if fault.kind == "stall"]
    assert min(fault.amount_us for fault in stalls) > PATIENCE_US
    assert {fault.where for fault in stalls} > set(NAMES)


def test_faults_are_of_their_places() -> None:
    """A link has faults of messages, a process those of processes, the router its own."""
    for fault in drawn(3) + drawn(4):
        on_link = fault.where.endswith((" up", " down"))
        assert (fault.kind in ON_HOPS) == on_link
        assert (fault.kind == "router") == (fault.where == ROUTER)


def test_a_list_gives_what_is_on_it_and_nothing_else() -> None:
    """By place and count."""
    fault = Fault("process_0 up", 7, "delay", 12)
    death = Fault(ROUTER, 2, "router", 5)
    listed = ListedFaults([fault, death])
    assert listed.at("process_0 up", 7) == fault
    assert listed.at("process_0 up", 6) is None
    assert listed.at("process_0", 7) is None
    assert [listed.at(ROUTER, nth) for nth in range(4)] == [None, None, death, None]
