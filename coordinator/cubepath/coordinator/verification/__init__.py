"""Recordings and certificates derived again, by code that shares nothing with the run.

Room: coordinator. From the coordinator it imports only `normal_form.definitions`, and from the
agents nothing. This holds for indirect imports too, so a bug in the run cannot hide here. From the
core's actions it takes `Action` and `commute`; it defines admissible itself. `runs` and
`shortening` check their results with it, and `auditing` asks the rules of a recording with it.
"""

from typing import TYPE_CHECKING

from cubepath.protocol.faces import lazy_face

if TYPE_CHECKING:
    from cubepath.coordinator.verification.certificate import (
        check_certificate,
        check_numbered,
        compare_cubes,
    )
    from cubepath.coordinator.verification.choices import Arrays, Moment, Observing
    from cubepath.coordinator.verification.equality import difference
    from cubepath.coordinator.verification.findings import Check, Progress, Verification
    from cubepath.coordinator.verification.free_transcript import turn_text
    from cubepath.coordinator.verification.free_turns import Seen
    from cubepath.coordinator.verification.parameters import hesitation_in, seed_in
    from cubepath.coordinator.verification.proof import check_proof
    from cubepath.coordinator.verification.recording import Recovered, recover, verify
    from cubepath.coordinator.verification.transcript import RECOVERED, Transcript, site_in
else:
    __getattr__, __dir__ = lazy_face(
        __name__,
        {
            "certificate": "check_certificate check_numbered compare_cubes",
            "choices": "Arrays Moment Observing",
            "equality": "difference",
            "findings": "Check Progress Verification",
            "free_transcript": "turn_text",
            "free_turns": "Seen",
            "parameters": "hesitation_in seed_in",
            "proof": "check_proof",
            "recording": "Recovered recover verify",
            "transcript": "RECOVERED Transcript site_in",
        },
    )

__all__ = [
    "RECOVERED",
    "Arrays",
    "Check",
    "Moment",
    "Observing",
    "Progress",
    "Recovered",
    "Seen",
    "Transcript",
    "Verification",
    "check_certificate",
    "check_numbered",
    "check_proof",
    "compare_cubes",
    "difference",
    "hesitation_in",
    "recover",
    "seed_in",
    "site_in",
    "turn_text",
    "verify",
]
