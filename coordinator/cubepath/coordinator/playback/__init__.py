"""Recordings put back on zenoh, under control, and compared with what was gathered then.

Room: coordinator. It imports `runs`, to gather again what is played, and `verification` for the
certificates on record. The pure part is the machine, which knows neither a clock nor zenoh; nothing
that runs modules depends on this room.
"""

from typing import TYPE_CHECKING

from cubepath.protocol.faces import lazy_face

if TYPE_CHECKING:
    from cubepath.coordinator.playback.comparing import Replayed
    from cubepath.coordinator.playback.orders import Order, PlayerStatus, Position, read_order
    from cubepath.coordinator.playback.player import Player
    from cubepath.coordinator.playback.playing import PlayOptions
    from cubepath.coordinator.playback.replaying import replay
    from cubepath.coordinator.playback.spots import read_pace, read_spot
else:
    __getattr__, __dir__ = lazy_face(
        __name__,
        {
            "comparing": "Replayed",
            "orders": "Order PlayerStatus Position read_order",
            "player": "Player",
            "playing": "PlayOptions",
            "replaying": "replay",
            "spots": "read_pace read_spot",
        },
    )

__all__ = [
    "Order",
    "PlayOptions",
    "Player",
    "PlayerStatus",
    "Position",
    "Replayed",
    "read_order",
    "read_pace",
    "read_spot",
    "replay",
]
