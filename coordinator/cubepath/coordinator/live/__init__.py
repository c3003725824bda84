"""A run as a page that is fed while it goes on, by a small HTTP server on this machine alone.

Room: coordinator. It imports `viewing` for the page, `runs` for the runs that are watched, and
`normal_form`.
"""

from typing import TYPE_CHECKING

from cubepath.protocol.faces import lazy_face

if TYPE_CHECKING:
    from cubepath.coordinator.live.elsewhere import watch_run
    from cubepath.coordinator.live.watching import Live
else:
    __getattr__, __dir__ = lazy_face(
        __name__,
        {
            "elsewhere": "watch_run",
            "watching": "Live",
        },
    )

__all__ = [
    "Live",
    "watch_run",
]
