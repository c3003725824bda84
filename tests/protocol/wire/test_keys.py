"""Keys: what is said to places is put on the key of their region, and on no other."""

import pytest
import zenoh

from cubepath.protocol.core.sites import site_from_json
from cubepath.protocol.scenes.specs import scene_from_spec
from cubepath.protocol.wire.keys import (
    addressees,
    belongs,
    everything,
    key_of,
    to_region,
    topic_in_key,
    topic_of,
)
from cubepath.protocol.wire.messages import (
    Bundle,
    ChosenActions,
    Claim,
    Go,
    Note,
    Presence,
    Ready,
    Reset,
    Verdict,
    decode,
    encode,
    kind_of,
)
from samples.local_families import LOCAL_FAMILIES


@pytest.mark.parametrize("spec", [*LOCAL_FAMILIES, "agv-labelled:graph=C9,n=2"])
def test_every_region_is_one_chunk_of_a_key(spec: str) -> None:
    """A region of any system makes a valid key without wildcards, which `everything` matches."""
    scene = scene_from_spec(spec)
    for site in (*scene.start, *(scene.goal or ())):
        place = scene.system.place_of(site)
        for near in {place, *scene.system.reach(place)}:
            region = scene.system.region(near)
            key = zenoh.KeyExpr(key_of("run", Bundle(1, "sense", 3, region, 0, [])))
            assert zenoh.KeyExpr("cubepath/run/to/*/process_3").includes(key)
            assert zenoh.KeyExpr(to_region("run", region)).includes(key)
            assert zenoh.KeyExpr(everything("run")).includes(key)
            assert not zenoh.KeyExpr(everything("other")).intersects(key)


@pytest.mark.parametrize("spec", LOCAL_FAMILIES)
def test_a_claim_is_addressed_within_reach_and_being_here_to_those_who_sense_it(spec: str) -> None:
    """`here` goes to the places that sense the sender's, notes and claims within its reach."""
    scene = scene_from_spec(spec)
    for site in scene.start:
        place = scene.system.place_of(site)
        assert addressees(scene.system, Presence(1, 0, site)) == scene.system.listeners(place)
        for message in (Claim(1, 0, site, "some", site), Note(1, 0, site, [1])):
            assert addressees(scene.system, message) == scene.system.reach(place)


def test_a_verdict_goes_to_those_who_wait_and_control_to_no_place() -> None:
    """The places are in the message itself; `go` has none."""
    system = scene_from_spec("hex").system
    verdict = Verdict(3, 1, (0, 0), granted=True, to=[(1, 0), (2, 0)])
    assert addressees(system, verdict) == ((1, 0), (2, 0))
    assert addressees(system, Go(1, "sense")) == ()


def test_a_key_names_kind_and_sender_or_the_region() -> None:
    """Messages to a region stand on its key; actions from outside on that of their process."""
    said = Bundle(1, "sense", 3, "0,-1", 0, [])
    assert key_of("run", said) == "cubepath/run/to/0,-1/process_3"
    assert to_region("run", "0,-1") == "cubepath/run/to/0,-1/**"
    assert topic_of(said) == "bundle/process_3"
    assert key_of("run", Go(1, "sense")) == "cubepath/run/go/coordinator"
    assert key_of("run", Ready(1, 2, "sense")) == "cubepath/run/ready/process_2"
    assert key_of("run", ChosenActions(1, 2, [])) == "cubepath/run/actions/process_2"
    assert topic_in_key("cubepath/run/hello/me") == "hello/me"


def test_messages_survive_the_wire() -> None:
    """What is encoded is decoded, with sites as tuples again."""
    verdict = Verdict(3, 1, (0, 0), granted=True, to=[(1, 0), ("a", 2)])
    again = decode(encode(verdict))
    assert isinstance(again, Verdict)
    assert [site_from_json(place) for place in again.to] == [(1, 0), ("a", 2)]
    assert topic_of(again) == "verdict/module_1"


def test_what_is_for_one_process_may_stand_on_its_key() -> None:
    """To begin a phase and to go back alone; any other message belongs on one key."""
    for message in (Go(1, "sense"), Reset(1, 0)):
        kind = kind_of(message)
        assert belongs("run", f"cubepath/run/{kind}/coordinator", message)
        assert belongs("run", f"cubepath/run/{kind}/process_12", message)
        for key in (f"{kind}/process_", f"{kind}/process_x", f"{kind}/x/process_1", "to/process_1"):
            assert not belongs("run", f"cubepath/run/{key}", message)
        assert not belongs("other", f"cubepath/run/{kind}/process_12", message)
    said = Bundle(1, "sense", 3, "0", 0, [])
    assert belongs("run", "cubepath/run/to/0/process_3", said)
    assert not belongs("run", "cubepath/run/to/0/process_2", said)
    assert not belongs("run", "cubepath/run/to/1/process_3", said)
