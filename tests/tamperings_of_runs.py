"""Recordings that say something wrong of the run itself: its parameters, its pace, its end."""

from __future__ import annotations

from dataclasses import replace as with_fields

from cubepath.protocol.recordings.recording import Recording
from tamperings import crowd, tampers


def with_parameter(key: str, value: str) -> Recording:
    """Return a run with another parameter."""
    return with_fields(crowd(), parameters={**crowd().parameters, key: value})


@tampers("parameters")
def more_processes_than_modules() -> Recording:
    return with_parameter("processes", "9")


@tampers("parameters")
def modules_of_another_scene() -> Recording:
    return with_parameter("modules", "9")


@tampers("parameters")
def another_system() -> Recording:
    return with_parameter("system", "agv:graph=grid4x4,n=8")


@tampers("parameters")
def hesitation_that_is_certain() -> Recording:
    return with_parameter("hesitate", "1.0")


@tampers("parameters")
def rounds_that_are_no_number() -> Recording:
    return with_parameter("max_rounds", "10.0")


@tampers("parameters")
def a_repair_of_no_schedule() -> Recording:
    return with_parameter("repair", "tswap")
