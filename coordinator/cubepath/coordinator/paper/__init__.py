"""The claims of Abrams and Ghrist, computed one by one.

Room: coordinator. It imports `complexes` and `normal_form`; only the command line imports it.
"""

from typing import TYPE_CHECKING

from cubepath.protocol.faces import lazy_face

if TYPE_CHECKING:
    from cubepath.coordinator.paper.claims import all_claims, compute_claims
    from cubepath.coordinator.paper.registry import Claim, Row
else:
    __getattr__, __dir__ = lazy_face(
        __name__,
        {
            "claims": "all_claims compute_claims",
            "registry": "Claim Row",
        },
    )

__all__ = ["Claim", "Row", "all_claims", "compute_claims"]
