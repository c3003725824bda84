"""The options of a run, each declared once: for Python, the command line, and the checks."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal

from msgspec import Meta

SPEED_MAX = 10_000
_COUNT = {"metavar": "N"}
_ENDPOINT = {"metavar": "ENDPOINT"}


@dataclass(frozen=True, slots=True, kw_only=True)
class RunOptions:
    """How to run what a plan says."""

    seed: Annotated[int, Meta(ge=0, description="seed of every random choice (default 0)")] = 0
    hesitate: Annotated[
        float,
        Meta(
            ge=0,
            lt=1,
            description="each module skips a round with this probability (default 0)",
            extra={"metavar": "P"},
        ),
    ] = 0.0
    processes: Annotated[
        int,
        Meta(
            ge=0,
            description="processes to spread the modules over; 0 keeps them all here (default 4)",
            extra=_COUNT,
        ),
    ] = 4
    max_rounds: (
        Annotated[
            int,
            Meta(
                ge=0,
                description="end after N rounds, or levels (default 1000; with a schedule one a"
                " cube, 1000 more to repair); without rounds a few more may be done by then",
                extra=_COUNT,
            ),
        ]
        | None
    ) = None
    log: (
        Annotated[Path, Meta(description="recording to write (default: a new file in logs/)")]
        | None
    ) = None
    schedule: (
        Annotated[
            Path,
            Meta(
                description="carry out a cubes file or the schedule of a recording, one cube a"
                " round; SYSTEM can then be another scene than that of the recording",
                extra={"metavar": "CUBES"},
            ),
        ]
        | None
    ) = None
    repair: Annotated[
        bool,
        Meta(
            description="where a cube of the schedule no longer applies, follow the rule from there"
        ),
    ] = False
    patience: Annotated[
        float,
        Meta(
            gt=0,
            lt=3600,
            description="give up when a phase makes no progress for this long (default 60)",
            extra={"metavar": "SECONDS"},
        ),
    ] = 60.0
    listen: (
        Annotated[
            str,
            Meta(
                description="let others listen at tcp/HOST:PORT or tls/HOST:PORT, and join with"
                " --wait-for (default: no one can)",
                extra=_ENDPOINT,
            ),
        ]
        | None
    ) = None
    connect: (
        Annotated[
            str,
            Meta(
                description="use the router that listens there, and start none; of linked routers,"
                " all to try, separated by commas. With --listen, link the run's own router with"
                " these",
                extra=_ENDPOINT,
            ),
        ]
        | None
    ) = None
    secure: (
        Annotated[
            Path,
            Meta(
                description="use TLS with the certificates of a folder; see 'cubepath host"
                " certificates'",
                extra={"metavar": "DIR"},
            ),
        ]
        | None
    ) = None
    wait_for: Annotated[
        int,
        Meta(
            ge=0,
            description="wait until N processes have joined from elsewhere, each within --patience"
            " of the last; --processes have what they leave",
            extra=_COUNT,
        ),
    ] = 0
    clock: Annotated[
        Literal["lockstep", "free"],
        Meta(
            description="in rounds, or without: every module acts when it is ready (default"
            " lockstep)"
        ),
    ] = "lockstep"
    keepers: Annotated[
        int,
        Meta(
            ge=1,
            le=256,
            description="with the free clock: processes that keep the sites (default 4)",
            extra=_COUNT,
        ),
    ] = 4
    speeds: Mapping[int, float] = field(default_factory=dict)
    """By module how many times longer it thinks than 10 ms; the others do not think at all."""
    jitter: Annotated[
        float,
        Meta(
            ge=0,
            le=SPEED_MAX,
            description="with the free clock: delay the actions of --speed by up to J times more,"
            " at random (default 0)",
            extra={"metavar": "J"},
        ),
    ] = 0.0
    on_crash: Annotated[
        Literal["stop", "continue", "restart"],
        Meta(description="with the free clock: what to do when a process has died (default stop)"),
    ] = "stop"
    resume: (
        Annotated[
            Path,
            Meta(
                description="the recording of a run that was cut off, to be taken up where its"
                " keepers' logs end"
            ),
        ]
        | None
    ) = None
    log_time: (
        Annotated[
            Literal["round", "level", "wall"],
            Meta(
                description="the log time of messages in the recording: the round, or with the free"
                " clock the level (default), or the wall clock"
            ),
        ]
        | None
    ) = None
