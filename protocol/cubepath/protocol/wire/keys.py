"""Key expressions: a message's key is its address.

A module sends messages to places: the key names each of them, and a module subscribes to the keys
that name the place where it stands. So zenoh itself delivers to a module only what is addressed to
it, with one put per message:

    cubepath/RUN/from/0,0/claim/module_3/0,1/1,0/1,1 a claim, addressed to three places
    cubepath/RUN/from/0,0/*/*/**/1,0/** what the module at (1, 0) hears cubepath/RUN/report/module_3
    for anyone who gathers

The chunk after `from` is the region of the sender. A module subscribes once for each region within
its reach, so a message is matched only against the subscriptions of its surroundings, not of the
whole aggregate.
"""

from __future__ import annotations

from collections.abc import Iterable

from cubepath.protocol.core.sites import Site, site_chunk, site_from_json
from cubepath.protocol.core.system import System
from cubepath.protocol.wire.messages import (
    Certified,
    Claim,
    Cube,
    Edges,
    Go,
    Here,
    Message,
    Note,
    Ready,
    Reset,
    Summary,
    Verdict,
    kind_of,
)

ROOT = "cubepath"


def addressees(system: System, message: Message) -> tuple[Site, ...] | None:
    """Return the places that a message is addressed to; None if it is not addressed to places."""
    match message:
        case Here(site=site):
            return system.listeners(system.place_of(site_from_json(site)))
        case Note(site=site) | Claim(site=site):
            return system.reach(system.place_of(site_from_json(site)))
        case Verdict(to=to):
            return tuple(site_from_json(place) for place in to)
        case _:
            return None


def sender(message: Message) -> str:
    """Return the name of a message's sender."""
    match message:
        case Go() | Reset() | Edges() | Cube() | Certified() | Summary():
            return "coordinator"
        case Ready(process=process):
            return f"process_{process}"
        case _:
            return f"module_{message.module}"


def key_of(run: str, system: System, message: Message) -> str | None:
    """Return the key that a message is put on; None if there is no place to address it to."""
    places = addressees(system, message)
    if places is None:
        return f"{ROOT}/{run}/{topic_of(message)}"
    if not places:
        return None
    region = system.region(_origin(system, message))
    return f"{ROOT}/{run}/from/{region}/{topic_of(message)}/{_join(places)}"


def _origin(system: System, message: Message) -> Site:
    match message:
        case Here(site=site) | Note(site=site) | Claim(site=site) | Verdict(site=site):
            return system.place_of(site_from_json(site))
        case _:
            raise AssertionError(f"{kind_of(message)} has no origin")  # it has no addressees


def topic_in(run: str, key: str) -> str:
    """Return the topic of the message that was put on `key`."""
    chunks = key.removeprefix(f"{ROOT}/{run}/").split("/")
    first = 2 if chunks[0] == "from" else 0
    return "/".join(chunks[first : first + 2])


def topic_of(message: Message) -> str:
    """Return the part of the key that names kind and sender; it is the topic in recordings."""
    return f"{kind_of(message)}/{sender(message)}"


def _join(places: Iterable[Site]) -> str:
    return "/".join(site_chunk(place) for place in places)


def heard_at(run: str, system: System, place: Site) -> tuple[str, ...]:
    """Return the key expressions of all messages addressed to a place; no key matches two."""
    senders = {near for near in system.sensed(place) if near is not None} | {*system.reach(place)}
    regions = sorted({system.region(sender) for sender in senders})
    return tuple(f"{ROOT}/{run}/from/{r}/*/*/**/{site_chunk(place)}/**" for r in regions)


def everything(run: str) -> str:
    """Return the key expression of every message of a run."""
    return f"{ROOT}/{run}/**"


def topic_key(run: str, kind: str, who: str = "*") -> str:
    """Return the key expression of a kind of message that is not addressed to places."""
    return f"{ROOT}/{run}/{kind}/{who}"
