"""Auditing: a recording verified, with the rules of its modules asked again.

Room: coordinator.
"""

from __future__ import annotations

from cubepath.coordinator.auditing.free_playing import FreePlaying
from cubepath.coordinator.auditing.playing import Playing
from cubepath.coordinator.verification.findings import Progress, Verification
from cubepath.coordinator.verification.recording import verify
from cubepath.protocol.recordings.recording import Recording


def audit(recording: Recording, progress: Progress | None = None) -> Verification:
    """Verify a recording, the check `choices` included: each module chose as its rule does.

    Where the rule is not installed, or the recording does not say how it chose, that check is
    marked as not checked. Nothing is raised, unless the file is changed while it is read.
    """
    return verify(
        recording,
        progress,
        player=lambda: Playing(recording),
        free_player=lambda: FreePlaying(recording),
    )
