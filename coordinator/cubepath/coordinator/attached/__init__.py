"""Recording a run from outside: attach to it where it can be listened to, and leave.

Room: coordinator. It imports `runs` for what a run says of itself; it starts no run and decides
nothing for one. It may do what a guest may: listen.
"""

from typing import TYPE_CHECKING

from cubepath.protocol.faces import lazy_face

if TYPE_CHECKING:
    from cubepath.coordinator.attached.guests import guest_at
    from cubepath.coordinator.attached.recorder import Recorder, record
else:
    __getattr__, __dir__ = lazy_face(
        __name__, {"guests": "guest_at", "recorder": "Recorder record"}
    )

__all__ = ["Recorder", "guest_at", "record"]
