"""Key expressions: a message's key is its address.

What a module says goes to places: the key names each of them, and a module subscribes to the keys
that name the place where it stands. So zenoh itself delivers to a module what lies within reach
and nothing else, with one put a message and one subscriber a module:

    cubepath/RUN/claim/module_3/to/0,1/1,0/1,1      a claim, addressed to three places
    cubepath/RUN/*/*/to/**/1,0/**                   what the module at (1, 0) hears
    cubepath/RUN/report/module_3                    for whoever gathers
"""

from __future__ import annotations

from collections.abc import Iterable

from cubepath.protocol.messages import (
    Claim,
    Cube,
    Edges,
    Go,
    Here,
    Message,
    Note,
    Ready,
    Summary,
    Verdict,
    kind_of,
    site_of,
)
from cubepath.protocol.sites import Site, site_chunk
from cubepath.protocol.systems import System

ROOT = "cubepath"


def addressees(system: System, message: Message) -> tuple[Site, ...] | None:
    """Return the places that a message is addressed to; None if it is not addressed to places."""
    match message:
        case Here(site=site):
            return system.listeners(system.place_of(site_of(site)))
        case Note(site=site) | Claim(site=site):
            return system.reach(system.place_of(site_of(site)))
        case Verdict(to=to):
            return tuple(site_of(place) for place in to)
        case _:
            return None


def sender(message: Message) -> str:
    """Return the name of who says a message."""
    match message:
        case Go() | Edges() | Cube() | Summary():
            return "coordinator"
        case Ready(process=process):
            return f"process_{process}"
        case _:
            return f"module_{message.module}"


def key_of(run: str, system: System, message: Message) -> str | None:
    """Return the key that a message is put on; None if there is no place to address it to."""
    places = addressees(system, message)
    head = f"{ROOT}/{run}/{topic_of(message)}"
    if places is None:
        return head
    return f"{head}/to/{_join(places)}" if places else None


def topic_of(message: Message) -> str:
    """Return the part of the key that names kind and sender; it is the topic in recordings."""
    return f"{kind_of(message)}/{sender(message)}"


def _join(places: Iterable[Site]) -> str:
    return "/".join(site_chunk(place) for place in places)


def heard_at(run: str, place: Site) -> str:
    """Return the key expression of all that is addressed to a place."""
    return f"{ROOT}/{run}/*/*/to/**/{site_chunk(place)}/**"


def everything(run: str) -> str:
    """Return the key expression of every message of a run."""
    return f"{ROOT}/{run}/**"


def topic_key(run: str, kind: str, who: str = "*") -> str:
    """Return the key expression of a kind of message that is not addressed to places."""
    return f"{ROOT}/{run}/{kind}/{who}"
