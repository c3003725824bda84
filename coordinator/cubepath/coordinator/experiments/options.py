"""The options of a sweep with one value, each declared once: for Python, TOML and commands."""

from dataclasses import dataclass
from typing import Annotated, Literal

from msgspec import Meta

_COUNT = {"metavar": "N"}


@dataclass(frozen=True, slots=True, kw_only=True)
class SweepOptions:
    """How to play the runs of a sweep, and what to search for in their scenes."""

    core: (
        Annotated[
            Literal["compiled", "simulated", "wire"],
            Meta(
                description="where runs are played (default: compiled, or simulated if something"
                " happens to messages)"
            ),
        ]
        | None
    ) = None
    max_rounds: Annotated[
        int, Meta(ge=0, description="end a run after N rounds (default 1000)", extra=_COUNT)
    ] = 1000
    processes: Annotated[
        int,
        Meta(ge=1, description="module processes of a run with messages (default 4)", extra=_COUNT),
    ] = 4
    keepers: Annotated[
        int,
        Meta(
            ge=1,
            description="keepers of a run with messages and without rounds (default 4)",
            extra=_COUNT,
        ),
    ] = 4
    optimum: Annotated[
        int,
        Meta(
            ge=0,
            description="search for the fewest cubes from start to goal, keeping STATES states at"
            " most (default 0: no search)",
            extra={"option": "max-states", "metavar": "STATES"},
        ),
    ] = 0
    improve: Annotated[
        int,
        Meta(
            ge=0,
            description="search for a path with few cubes from start to goal in STEPS steps, from"
            " what the family's rule does with seed 0 (default 0: no search)",
            extra={"option": "steps", "metavar": "STEPS"},
        ),
    ] = 0
    timeout_s: (
        Annotated[
            float,
            Meta(
                gt=0,
                le=1_000_000,
                description="end a run that takes longer (default: none does)",
                extra={"option": "timeout", "metavar": "SECONDS"},
            ),
        ]
        | None
    ) = None
