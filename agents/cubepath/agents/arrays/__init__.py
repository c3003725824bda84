"""Lockstep worlds as arrays: the tables of a scene, and compiled kernels over them.

Room: agents. It imports `local` and the protocol. `environments` builds on it.
"""

from typing import TYPE_CHECKING

from cubepath.protocol.faces import lazy_face

if TYPE_CHECKING:
    from cubepath.agents.arrays.batch import Batch
    from cubepath.agents.arrays.kinds import UntabledError
    from cubepath.agents.arrays.relative import RelativeArrays
    from cubepath.agents.arrays.state import GRANTED, ILLEGAL, LOST
    from cubepath.agents.arrays.tables import Tables
    from cubepath.agents.arrays.warming import compile_world, is_compiled, is_due
else:
    __getattr__, __dir__ = lazy_face(
        __name__,
        {
            "batch": "Batch",
            "kinds": "UntabledError",
            "relative": "RelativeArrays",
            "state": "GRANTED ILLEGAL LOST",
            "tables": "Tables",
            "warming": "compile_world is_compiled is_due",
        },
    )

__all__ = [
    "GRANTED",
    "ILLEGAL",
    "LOST",
    "Batch",
    "RelativeArrays",
    "Tables",
    "UntabledError",
    "compile_world",
    "is_compiled",
    "is_due",
]
