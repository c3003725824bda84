"""The recording format in MCAP: writing, reading and salvaging it.

Room: protocol. It imports `wire` for the messages, `scenes` for the scene in a recording, and
`core`. The coordinator writes and reads recordings; modules know nothing of them.
"""

from typing import TYPE_CHECKING

from cubepath.protocol.faces import lazy_face

if TYPE_CHECKING:
    from cubepath.protocol.recordings.appending import McapAppender
    from cubepath.protocol.recordings.counts import Counts
    from cubepath.protocol.recordings.cuts import (
        FILTERED,
        SPLIT,
        Selection,
        check_topics,
        is_beginning,
        left_out,
        whole_of,
    )
    from cubepath.protocol.recordings.cutting import filter_recording, split_recording
    from cubepath.protocol.recordings.description import (
        ATTACHED,
        FORMATS,
        FREE_FORMAT,
        LEFT_OUT,
        PART,
        Clock,
        format_of,
    )
    from cubepath.protocol.recordings.logged import kinds_of
    from cubepath.protocol.recordings.merging import merge_recordings
    from cubepath.protocol.recordings.recording import (
        Recording,
        is_recording,
        read_recording,
        read_undamaged,
        recording_of,
    )
    from cubepath.protocol.recordings.records import Record
    from cubepath.protocol.recordings.remains import Remains, remains_of
    from cubepath.protocol.recordings.whole_rounds import rounds_in_turn
    from cubepath.protocol.recordings.writing import (
        CHUNK_BYTES,
        TOPICS_MAX,
        RecordingWriter,
        copy_recording,
    )
else:
    __getattr__, __dir__ = lazy_face(
        __name__,
        {
            "appending": "McapAppender",
            "counts": "Counts",
            "cuts": "FILTERED SPLIT Selection check_topics is_beginning left_out whole_of",
            "cutting": "filter_recording split_recording",
            "description": "ATTACHED Clock FORMATS FREE_FORMAT LEFT_OUT PART format_of",
            "logged": "kinds_of",
            "merging": "merge_recordings",
            "recording": "Recording is_recording read_recording read_undamaged recording_of",
            "records": "Record",
            "remains": "Remains remains_of",
            "whole_rounds": "rounds_in_turn",
            "writing": "CHUNK_BYTES RecordingWriter TOPICS_MAX copy_recording",
        },
    )

__all__ = [
    "ATTACHED",
    "CHUNK_BYTES",
    "FILTERED",
    "FORMATS",
    "FREE_FORMAT",
    "LEFT_OUT",
    "PART",
    "SPLIT",
    "TOPICS_MAX",
    "Clock",
    "Counts",
    "McapAppender",
    "Record",
    "Recording",
    "RecordingWriter",
    "Remains",
    "Selection",
    "check_topics",
    "copy_recording",
    "filter_recording",
    "format_of",
    "is_beginning",
    "is_recording",
    "kinds_of",
    "left_out",
    "merge_recordings",
    "read_recording",
    "read_undamaged",
    "recording_of",
    "remains_of",
    "rounds_in_turn",
    "split_recording",
    "whole_of",
]
