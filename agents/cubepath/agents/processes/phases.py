"""The phases of a round, in which order they come, and when what is missing is asked for.

The nodes of module processes and of the coordinator share them.
"""

from __future__ import annotations

from typing import Literal, TypeAlias

from cubepath.protocol.wire.messages import Claim, Here, Note, Part, Verdict

Spoken: TypeAlias = Literal["sense", "claim", "settle"]
"""The phases in which modules say something to each other."""
KINDS_IN: dict[str, tuple[type[Part], ...]] = {
    "sense": (Here, Note),
    "claim": (Claim,),
    "settle": (Verdict,),
}
"""What they say in each."""
ORDER = {"sense": 0, "observe": 1, "claim": 2, "settle": 3, "join": 4, "over": 5}
"""The phases of a round in order; a process joins at the end of the round before the first."""
BEFORE: dict[str, Spoken] = {"observe": "sense", "claim": "sense", "settle": "claim"}
"""What must have been heard before a phase begins."""
ASK_S_MIN, ASK_S_MAX = 1.0, 4.0
"""What is missing is asked for after so many seconds, then after twice as many, up to the most."""
