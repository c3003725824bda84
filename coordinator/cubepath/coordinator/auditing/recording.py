"""Auditing: a recording verified, with the rules of its modules asked again."""

from __future__ import annotations

from collections.abc import Collection

from cubepath.agents.rules.registry import stands_for
from cubepath.coordinator.auditing.playing import FreeRuleAudit, RuleAudit
from cubepath.coordinator.verification.findings import Progress, Verification
from cubepath.coordinator.verification.parameters import stages_in
from cubepath.coordinator.verification.recording import verify
from cubepath.protocol.core.input_files import Source
from cubepath.protocol.recordings.recording import Recording, recording_of


def audit(
    recording: Recording | Source,
    progress: Progress | None = None,
    *,
    rules: Collection[str] = (),
) -> Verification:
    """Verify a recording or its file, `choices` included: each module chose as its rule does.

    Where the rule is not installed, or the recording does not say how it chose, that check is
    marked as not checked. A rule in a file is asked only if you give it in `rules`, as
    FILE.py:NAME, since a recording can name any file. Nothing is raised, unless the recording
    cannot be read, or is changed while it is read.

    >>> found = audit("logs/golden/hex-5.mcap")
    >>> found.ok, [check.checked for check in found.checks if check.name == "choices"]
    (True, [True])
    """
    found = recording_of(recording)
    return verify(
        found,
        progress,
        player=lambda: RuleAudit(found, rules),
        free_player=lambda: FreeRuleAudit(found, rules),
    )


def unused_rules(recording: Recording, rules: Collection[str]) -> set[str]:
    """Return those of the rules, each FILE.py:NAME, that the recording does not name.

    >>> unused_rules(read_recording("logs/golden/hex-5.mcap"), ["mine.py:MINE"])
    {'mine.py:MINE'}
    """
    told = recording.parameters
    named = {told.get("rule", ""), told.get("repair", "")}
    named.update(*(stage.rules for stage in stages_in(recording)))
    return {each for each in rules if not any(stands_for(each, name) for name in named)}
