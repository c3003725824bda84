"""The recording format in MCAP: writing, reading and salvaging it.

Room: protocol. It imports `wire` for the messages, `scenes` for the scene in a recording, and
`core`. The coordinator writes and reads recordings; modules know nothing of them.
"""

from typing import TYPE_CHECKING

from cubepath.protocol.faces import lazy_face

if TYPE_CHECKING:
    from cubepath.protocol.recordings.counts import Counts
    from cubepath.protocol.recordings.description import FORMATS
    from cubepath.protocol.recordings.recording import (
        Record,
        Recording,
        is_recording,
        read_recording,
        read_undamaged,
        recording_of,
    )
    from cubepath.protocol.recordings.writing import TOPICS_MAX, RecordingWriter, copy_recording
else:
    __getattr__, __dir__ = lazy_face(
        __name__,
        {
            "counts": "Counts",
            "description": "FORMATS",
            "recording": (
                "Record Recording is_recording read_recording read_undamaged recording_of"
            ),
            "writing": "RecordingWriter TOPICS_MAX copy_recording",
        },
    )

__all__ = [
    "FORMATS",
    "TOPICS_MAX",
    "Counts",
    "Record",
    "Recording",
    "RecordingWriter",
    "copy_recording",
    "is_recording",
    "read_recording",
    "read_undamaged",
    "recording_of",
]
