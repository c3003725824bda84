"""Key expressions: a message is addressed to the places it is for, and to no other."""

import pytest
import zenoh
from hypothesis import given
from hypothesis import strategies as st

from cubepath.protocol.core.sites import Site, site_chunk, site_from_json
from cubepath.protocol.core.system import System
from cubepath.protocol.scenes.specs import scene_from_spec
from cubepath.protocol.wire.keys import addressees, everything, heard_at, key_of, topic_in, topic_of
from cubepath.protocol.wire.messages import Claim, Go, Here, Verdict, decode, encode

scalars = st.one_of(st.integers(-99, 99), st.text(max_size=6), st.booleans())
places = st.one_of(scalars, st.lists(scalars, max_size=3).map(tuple))


@given(places)
def test_every_place_has_a_valid_chunk(place: Site) -> None:
    """A chunk is one chunk of a canonical key expression, whatever the place is called."""
    chunk = site_chunk(place)
    assert "/" not in chunk
    key = zenoh.KeyExpr(f"cubepath/{chunk}")
    assert str(key) == f"cubepath/{chunk}"
    assert not key.intersects(zenoh.KeyExpr("cubepath"))


@given(places, places)
def test_different_places_have_different_chunks(one: Site, other: Site) -> None:
    """No two places share a chunk, so no message reaches the wrong one."""
    same = one == other and repr(one) == repr(other)
    assert same or site_chunk(one) != site_chunk(other) or one == other


def hears(run: str, system: System, place: Site, key: zenoh.KeyExpr) -> int:
    """Return how many of the ears of a module at `place` match the key."""
    return sum(
        key.intersects(zenoh.KeyExpr(subscriber)) for subscriber in heard_at(run, system, place)
    )


@pytest.mark.parametrize("spec", ["hex", "arm", "agv", "agv-labelled:graph=C9,n=2"])
def test_a_claim_is_heard_within_reach_and_nowhere_else(spec: str) -> None:
    """Zenoh's own matching delivers a claim once to each place within reach, and to no other."""
    scene = scene_from_spec(spec)
    system = scene.system
    for start in [*scene.start, *sorted(scene.goal or (), key=repr)]:
        here = system.place_of(start)
        claim = Claim(1, 0, start, "some", start)
        key = zenoh.KeyExpr(key_of("run", system, claim) or "")
        near = system.reach(here)
        around = {*near, *(far for place in near for far in system.reach(place))} - {here}
        for place in around:
            assert hears("run", system, place, key) == (place in near)
            assert hears("other", system, place, key) == 0
        assert key.intersects(zenoh.KeyExpr(everything("run")))
        assert topic_in("run", str(key)) == "claim/module_0"


def test_being_here_is_heard_where_it_is_sensed() -> None:
    """`here` goes to the places from which the sender's place is sensed."""
    system = scene_from_spec("arm:n=3").system
    here = Here(1, 0, (0, 1, 1))
    assert addressees(system, here) == system.listeners((0, 1, 1))


def test_control_is_addressed_to_no_place() -> None:
    """`go` reaches no module's ear."""
    system = scene_from_spec("hex").system
    key = zenoh.KeyExpr(key_of("run", system, Go(1, "sense")) or "")
    assert hears("run", system, (0, 0), key) == 0
    assert topic_in("run", str(key)) == "go/coordinator"


def test_messages_survive_the_wire() -> None:
    """What is encoded is decoded, with sites as tuples again."""
    verdict = Verdict(3, 1, (0, 0), granted=True, to=[(1, 0), ("a", 2)])
    again = decode(encode(verdict))
    assert isinstance(again, Verdict)
    assert [site_from_json(place) for place in again.to] == [(1, 0), ("a", 2)]
    assert topic_of(again) == "verdict/module_1"
