"""The recording format in MCAP: writing, reading and salvaging it.

Room: protocol. It imports `wire` for the messages, `scenes` for the scene that stands in a
recording, and `core`. The coordinator writes and reads recordings; modules know nothing of them.
"""

from typing import TYPE_CHECKING

from cubepath.protocol.faces import lazy_face

if TYPE_CHECKING:
    from cubepath.protocol.recordings.recording import (
        FORMAT,
        Record,
        Recording,
        RecordingWriter,
        copy_recording,
        read_recording,
    )
    from cubepath.protocol.recordings.salvaging import MAGIC
else:
    __getattr__, __dir__ = lazy_face(
        __name__,
        {
            "recording": "FORMAT Record Recording RecordingWriter copy_recording read_recording",
            "salvaging": "MAGIC",
        },
    )

__all__ = [
    "FORMAT",
    "MAGIC",
    "Record",
    "Recording",
    "RecordingWriter",
    "copy_recording",
    "read_recording",
]
