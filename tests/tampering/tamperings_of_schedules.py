"""Recordings of schedules that were tampered with: what was carried out, and where it stopped."""

from dataclasses import replace as with_fields
from typing import Any

from msgspec.structs import replace

from cubepath.protocol.core.catalogue import GeneratorPlacement
from cubepath.protocol.path_files.durations import schedule_from_jsonl, schedule_to_jsonl
from cubepath.protocol.recordings.recording import Recording
from cubepath.protocol.wire.messages import Stopped
from samples.recordings import edited, first
from samples.schedules import (
    VEHICLES,
    a_place_on_the_way,
    carry_out,
    original,
    without_module,
    without_place,
    written,
)
from tampering.tamperings import tampers


def carried_out() -> Recording:
    """Return a schedule that was carried out to its end."""
    return carry_out(original(*VEHICLES).path)[1]


def stopped(*, repair: bool = False) -> Recording:
    """Return one that stopped at a place that was closed."""
    run = original(*VEHICLES)
    scene = without_place(run.scene, a_place_on_the_way(run, 2))
    return carry_out(run.path, written(scene), repair=repair)[1]


def not_begun() -> Recording:
    """Return one that stopped for want of a module."""
    run = original(*VEHICLES)
    return carry_out(run.path, written(without_module(run.scene, 0)))[1]


def with_summary(recording: Recording, **changes: Any) -> Recording:
    """Return the recording with another summary."""
    summary = first(recording, "summary")
    return edited(recording, summary, replace(summary, **changes))


def with_stop(recording: Recording, **changes: Any) -> Recording:
    """Return the recording with another stop in its summary."""
    stop = first(recording, "summary").schedule_stopped
    return with_summary(recording, schedule_stopped=replace(stop, **changes))


def with_cubes(recording: Recording, first_cube: int, last_cube: int) -> Recording:
    """Return the recording with a part of its schedule in its place."""
    cubes = schedule_from_jsonl(recording.schedule or b"")[first_cube:last_cube]
    return with_fields(recording, schedule=schedule_to_jsonl(cubes))


@tampers("schedule")
def the_schedule_is_lost() -> Recording:
    return with_fields(carried_out(), schedule=None)


@tampers("schedule")
def the_schedule_is_none() -> Recording:
    return with_fields(carried_out(), schedule=b'{"moves":["a"]}\n')


@tampers("schedule")
def the_schedule_is_no_text() -> Recording:
    return with_fields(carried_out(), schedule=b"\xff{")


@tampers("schedule")
def another_first_cube() -> Recording:
    return with_cubes(carried_out(), 1, 99)


@tampers("schedule")
def fewer_cubes_than_rounds() -> Recording:
    return with_cubes(carried_out(), 0, 2)


@tampers("schedule")
def more_cubes_than_rounds() -> Recording:
    recording = carried_out()
    text = recording.schedule or b""
    more = with_fields(recording, schedule=text + text.splitlines(keepends=True)[0])
    return with_summary(more, schedule_cubes=first(recording, "summary").schedule_cubes + 1)


@tampers("schedule")
def a_schedule_that_nobody_counted() -> Recording:
    return with_summary(carried_out(), schedule_cubes=None)


@tampers("schedule")
def a_run_that_says_it_had_a_schedule() -> Recording:
    recording = original(*VEHICLES)
    return with_summary(recording, schedule_cubes=3)


@tampers("schedule")
def a_stop_that_is_not_told() -> Recording:
    return with_summary(stopped(), schedule_stopped=None)


@tampers("schedule")
def a_stop_for_another_reason() -> Recording:
    return with_stop(stopped(), reason="it was tired")


@tampers("schedule")
def a_stop_by_another_module() -> Recording:
    other = first(stopped(), "summary").schedule_stopped.module + 1
    return with_stop(stopped(), module=other)


@tampers("schedule")
def a_stop_for_a_move_of_no_cube() -> Recording:
    return with_stop(stopped(), move=GeneratorPlacement("edge", ((9, 9), (9, 8))))


@tampers("schedule")
def a_stop_of_which_no_module_knows() -> Recording:
    cube = schedule_from_jsonl(carried_out().schedule or b"")[0]
    stop = Stopped(1, 0, cube[0], "it was tired")
    return with_summary(carried_out(), schedule_stopped=stop)


@tampers("schedule")
def a_stop_that_came_later() -> Recording:
    return with_stop(not_begun(), round=2)


@tampers("schedule")
def a_rule_that_took_over_unasked() -> Recording:
    recording = stopped(repair=True)
    go = first(recording, "go", lambda message: message.phase == "over")
    return edited(recording, go)
