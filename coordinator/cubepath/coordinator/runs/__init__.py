"""Runs from launch to recording: gathering, schedules, contents of a recording, pictures.

Room: coordinator. It imports `normal_form`, `verification` for certificates, a bound
of `search`, and `processes`, `rules` and `rendering` of the agents. It is the only room of the
coordinator that starts modules and listens to them. `shortening` takes the path of a recording from
it.
"""

from typing import TYPE_CHECKING

from cubepath.protocol.faces import lazy_face

if TYPE_CHECKING:
    from cubepath.coordinator.runs.about import About, about_key, find_run, offer
    from cubepath.coordinator.runs.asking import (
        MOVES_MAX,
        Status,
        ask,
        ask_path,
    )
    from cubepath.coordinator.runs.commits import Released
    from cubepath.coordinator.runs.conductor import Conductor, Ending
    from cubepath.coordinator.runs.contents import counted_processes, info, render
    from cubepath.coordinator.runs.continuing import what_if
    from cubepath.coordinator.runs.drawing import (
        PICTURE_SUFFIXES,
        Sheet,
        run_picture,
        save_figure,
        scene_picture,
    )
    from cubepath.coordinator.runs.edge_path import Gathered, PathDigest
    from cubepath.coordinator.runs.films import FILM_SUFFIXES, FRAMES_PER_SECOND, animate
    from cubepath.coordinator.runs.free_gatherer import FreeGatherer, keepers_in
    from cubepath.coordinator.runs.gatherer import Gatherer
    from cubepath.coordinator.runs.gathering import gathered, gathered_in_full
    from cubepath.coordinator.runs.launch import run, start
    from cubepath.coordinator.runs.live import Divergence, LiveReplay, replay_live
    from cubepath.coordinator.runs.outcome import Outcome
    from cubepath.coordinator.runs.plan import Plan, name_part, task_of
    from cubepath.coordinator.runs.running import Running
    from cubepath.coordinator.runs.side_by_side import animate_beside
    from cubepath.coordinator.runs.states import State, states_of
    from cubepath.coordinator.runs.tap import Overheard, Tap
else:
    __getattr__, __dir__ = lazy_face(
        __name__,
        {
            "commits": "Released",
            "about": "About about_key find_run offer",
            "asking": "MOVES_MAX Status ask ask_path",
            "conductor": "Conductor Ending",
            "contents": "counted_processes info render",
            "continuing": "what_if",
            "drawing": "PICTURE_SUFFIXES Sheet run_picture save_figure scene_picture",
            "edge_path": "Gathered PathDigest",
            "films": "FILM_SUFFIXES FRAMES_PER_SECOND animate",
            "free_gatherer": "FreeGatherer keepers_in",
            "gatherer": "Gatherer",
            "gathering": "gathered gathered_in_full",
            "launch": "run start",
            "live": "Divergence LiveReplay replay_live",
            "outcome": "Outcome",
            "plan": "Plan name_part task_of",
            "running": "Running",
            "side_by_side": "animate_beside",
            "states": "State states_of",
            "tap": "Overheard Tap",
        },
    )

__all__ = [
    "FILM_SUFFIXES",
    "FRAMES_PER_SECOND",
    "MOVES_MAX",
    "PICTURE_SUFFIXES",
    "About",
    "Conductor",
    "Divergence",
    "Ending",
    "FreeGatherer",
    "Gathered",
    "Gatherer",
    "LiveReplay",
    "Outcome",
    "Overheard",
    "PathDigest",
    "Plan",
    "Released",
    "Running",
    "Sheet",
    "State",
    "Status",
    "Tap",
    "about_key",
    "animate",
    "animate_beside",
    "ask",
    "ask_path",
    "counted_processes",
    "find_run",
    "gathered",
    "gathered_in_full",
    "info",
    "keepers_in",
    "name_part",
    "offer",
    "render",
    "replay_live",
    "run",
    "run_picture",
    "save_figure",
    "scene_picture",
    "start",
    "states_of",
    "task_of",
    "what_if",
]
