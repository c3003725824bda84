"""Replaying: the recorded bytes go back on zenoh, and a fresh coordinator gathers them again.

The messages of module processes go through a router from one session to another, under their
original keys but a new run id. Without rounds what keepers say is put back too. Anything else that
is connected to the router receives them as well.
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from typing import Unpack

from cubepath.coordinator.playback.comparing import Replayed
from cubepath.coordinator.playback.playing import Playing, PlayOptions
from cubepath.protocol.core.input_files import Source
from cubepath.protocol.recordings.recording import Recording, recording_of

Announce = Callable[[str, str], object]
"""Called with the endpoint and the run id before the first message is put."""


def replay(
    recording: Recording | Source,
    *,
    kinds: Collection[str] | None = None,
    announce: Announce | None = None,
    **options: Unpack[PlayOptions],
) -> Replayed:
    """Put the messages of modules back on zenoh, gather them from there, and compare the results.

    `kinds` are the kinds of `SAID` or `FREE_SAID` to put (all of them if None); the other options
    are those of `PlayOptions`. Without them all is played once, as fast as possible, and compared;
    of a part what can be compared is. InputError for bad options and malformed messages, and if a
    path is no recording; CheckError if reports contradict each other or messages do not arrive.

    >>> found = replay("logs/golden/hex-5.mcap")
    >>> found.same, found.rounds, found.moves
    (True, 29, 28)
    >>> replay("logs/golden/hex-5.mcap", begin=3, until=12).result
    'the same as recorded in 10 rounds; not compared: rounds 1 to 2, 13 to 29, cubes, summary'
    """
    recording = recording_of(recording)
    with Playing(recording, kinds=kinds, **options) as playing:
        if announce is not None:
            announce(playing.endpoint, playing.run)
        playing.play()
        return playing.result()
