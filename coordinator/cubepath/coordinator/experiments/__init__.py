"""Experiments: standard instances that rules are held against.

Room: coordinator. It imports no other room of the coordinator.
"""

from typing import TYPE_CHECKING

from cubepath.protocol.faces import lazy_face

if TYPE_CHECKING:
    from cubepath.coordinator.experiments.instances import StandardInstance, standard
else:
    __getattr__, __dir__ = lazy_face(
        __name__,
        {
            "instances": "StandardInstance standard",
        },
    )

__all__ = ["StandardInstance", "standard"]
