"""A run as a page: what a browser shows of it, as data, and the page around that.

Room: coordinator. It takes scenes and steps, and recordings for claims and messages; it imports
`complexes`, `normal_form`, and `rendering` of the agents. The page itself is plain HTML, CSS and
JavaScript in `page/`, which this room puts into one file.
"""

from typing import TYPE_CHECKING

from cubepath.protocol.faces import lazy_face

if TYPE_CHECKING:
    from cubepath.coordinator.viewing.heard import (
        DELIVERIES_MAX,
        Entry,
        claim_entry,
        delivery_entries,
    )
    from cubepath.coordinator.viewing.pages import (
        PAGE_SUFFIXES,
        page_document,
        page_text,
        run_page,
    )
    from cubepath.coordinator.viewing.shown import FORMAT, Shown, title_of
    from cubepath.coordinator.viewing.state_spaces import state_space
    from cubepath.coordinator.viewing.waits import waits_of
    from cubepath.coordinator.viewing.worlds import World, path_document
else:
    __getattr__, __dir__ = lazy_face(
        __name__,
        {
            "state_spaces": "state_space",
            "heard": "DELIVERIES_MAX Entry claim_entry delivery_entries",
            "pages": "PAGE_SUFFIXES page_document page_text run_page",
            "shown": "FORMAT Shown title_of",
            "waits": "waits_of",
            "worlds": "World path_document",
        },
    )

__all__ = [
    "DELIVERIES_MAX",
    "FORMAT",
    "PAGE_SUFFIXES",
    "Entry",
    "Shown",
    "World",
    "claim_entry",
    "delivery_entries",
    "page_document",
    "page_text",
    "path_document",
    "run_page",
    "state_space",
    "title_of",
    "waits_of",
]
