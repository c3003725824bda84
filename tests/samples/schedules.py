"""Schedules carried out by real modules: recordings to carry out, and scenes that have changed."""

from collections.abc import Iterable
from dataclasses import replace
from functools import cache
from pathlib import Path

from cubepath.coordinator.runs.outcome import Outcome
from cubepath.coordinator.runs.plan import Plan
from cubepath.coordinator.runs.run import run
from cubepath.protocol.core.sites import Site, site_from_json
from cubepath.protocol.core.system import Scene
from cubepath.protocol.recordings.recording import Recording, read_recording
from cubepath.protocol.scenes.toml import scene_to_toml
from cubepath.protocol.systems.graph import GraphSystem
from cubepath.protocol.systems.lattice import LatticeSystem
from cubepath.protocol.wire.messages import Report, Summary, decode
from samples.recordings import new_path, parts, recorded

CHAIN = ("hex:n=5", "chain", 60)
VEHICLES = ("agv:graph=grid5x5,n=5", "tswap", 60)
LABELLED = ("agv-labelled:graph=grid6x6,n=4", "pibt", 60)


@cache
def original(spec: str, rule: str, rounds: int) -> Recording:
    """Return a run whose schedule is to be carried out."""
    return recorded(spec, rule, seed=2, rounds=rounds)


def carry_out(
    schedule: Path,
    system: str | None = None,
    *,
    processes: int = 0,
    repair: bool = False,
    rule: str | None = None,
    max_rounds: int | None = None,
) -> tuple[Outcome, Recording]:
    """Carry out a schedule; return what came of it, and its recording."""
    plan = Plan(
        system,
        rule,
        processes=processes,
        max_rounds=max_rounds,
        log=new_path(),
        schedule=schedule,
        repair=repair,
    )
    outcome = run(plan)
    return outcome, read_recording(Path(outcome.log))


def written(scene: Scene) -> str:
    """Write a scene to a file; return its path."""
    path = new_path(".toml")
    path.write_text(scene_to_toml(scene))
    return str(path)


def with_obstacles(scene: Scene, cells: Iterable[Site]) -> Scene:
    """Return a scene on a lattice with more obstacles."""
    system = scene.system
    assert isinstance(system, LatticeSystem)
    filled = {*system.filled, *cells}
    changed = LatticeSystem(
        system.catalogue, workspace=system.workspace, filled=filled, empty=system.empty
    )
    return replace(scene, system=changed)


def without_place(scene: Scene, place: Site) -> Scene:
    """Return a scene on a graph that lacks a vertex."""
    system = scene.system
    assert isinstance(system, GraphSystem)
    changed = GraphSystem(
        [vertex for vertex in system.vertices if vertex != place],
        [edge for edge in system.edges if place not in edge],
        labels=system.labels,
        compass=system.compass,
    )
    return replace(scene, system=changed)


def without_module(scene: Scene, module: int) -> Scene:
    """Return a scene with a start site fewer, and without a goal of its own."""
    start = [site for number, site in enumerate(scene.start) if number != module]
    return replace(scene, start=tuple(start), goal=None, goals=())


def a_place_on_the_way(recording: Recording, rounds: int) -> Site:
    """Return a place that somebody enters after some rounds, where nobody starts or ends.

    It is none of the border, so that there is always a way round it.
    """
    scene = recording.scene
    place_of = scene.system.place_of
    kept = {place_of(site) for site in (*scene.start, *(scene.goal or ()))}
    for report in reports_of(recording):
        place = place_of(site_from_json(report.site))
        inside = isinstance(place, tuple) and {0, 4, 5}.isdisjoint(place)
        if report.round > rounds and inside and place not in kept:
            return place
    raise AssertionError("everybody keeps to starts and goals")


def reports_of(recording: Recording) -> list[Report]:
    """Return all reports, in order of round and module."""
    return sorted(parts(recording, "report"), key=lambda report: (report.round, report.module))


def summary_of(recording: Recording) -> Summary:
    """Return the summary."""
    (record,) = recording.of_kind("summary")
    message = decode(record.data)
    assert isinstance(message, Summary)
    return message
