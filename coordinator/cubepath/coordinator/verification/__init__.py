"""Recordings and certificates derived again, by code that shares nothing with the run.

Room: coordinator. Of the coordinator it imports `normal_form.definitions` and nothing else, of the
agents nothing, and that holds of whatever these import too: a fault of the run cannot hide itself
here. Of the core's actions it takes `Action` and `commute`; what admissible means it says itself.
Runs and shortening check with it what they give out.
"""

from typing import TYPE_CHECKING

from cubepath.protocol.faces import lazy_face

if TYPE_CHECKING:
    from cubepath.coordinator.verification.certificate import check_certificate, compare_cubes
    from cubepath.coordinator.verification.proof import check_proof
    from cubepath.coordinator.verification.recording import Recovered, Verification, recover, verify
else:
    __getattr__, __dir__ = lazy_face(
        __name__,
        {
            "certificate": "check_certificate compare_cubes",
            "proof": "check_proof",
            "recording": "Recovered Verification recover verify",
        },
    )

__all__ = [
    "Recovered",
    "Verification",
    "check_certificate",
    "check_proof",
    "compare_cubes",
    "recover",
    "verify",
]
