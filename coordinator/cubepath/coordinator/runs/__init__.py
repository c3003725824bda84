"""Runs from launch to recording: gathering, schedules, replay, contents of a recording, pictures.

Room: coordinator. It imports `normal_form`, `verification` to compare a replay, a bound
of `search`, and `processes`, `rules` and `rendering` of the agents. It is the only room of the
coordinator that starts modules and listens to them. `shortening` takes the path of a recording from
it.
"""

from typing import TYPE_CHECKING

from cubepath.protocol.faces import lazy_face

if TYPE_CHECKING:
    from cubepath.coordinator.runs.asking import Status, ask
    from cubepath.coordinator.runs.conductor import Conductor, Ending
    from cubepath.coordinator.runs.contents import info, render
    from cubepath.coordinator.runs.drawing import PICTURE_SUFFIXES, run_picture, save_figure
    from cubepath.coordinator.runs.edge_path import Gathered, PathDigest
    from cubepath.coordinator.runs.films import FILM_SUFFIXES, FRAMES_PER_SECOND, animate
    from cubepath.coordinator.runs.free_gatherer import FreeGatherer
    from cubepath.coordinator.runs.gatherer import Gatherer
    from cubepath.coordinator.runs.gathering import gathered
    from cubepath.coordinator.runs.launch import run, start
    from cubepath.coordinator.runs.outcome import Outcome
    from cubepath.coordinator.runs.plan import Plan, task_of
    from cubepath.coordinator.runs.playback import Replayed, replay
    from cubepath.coordinator.runs.running import Running
    from cubepath.coordinator.runs.tap import Overheard, Tap
else:
    __getattr__, __dir__ = lazy_face(
        __name__,
        {
            "asking": "Status ask",
            "conductor": "Conductor Ending",
            "contents": "info render",
            "drawing": "PICTURE_SUFFIXES run_picture save_figure",
            "edge_path": "Gathered PathDigest",
            "films": "FILM_SUFFIXES FRAMES_PER_SECOND animate",
            "free_gatherer": "FreeGatherer",
            "gatherer": "Gatherer",
            "gathering": "gathered",
            "launch": "run start",
            "outcome": "Outcome",
            "plan": "Plan task_of",
            "playback": "Replayed replay",
            "running": "Running",
            "tap": "Overheard Tap",
        },
    )

__all__ = [
    "FILM_SUFFIXES",
    "FRAMES_PER_SECOND",
    "PICTURE_SUFFIXES",
    "Conductor",
    "Ending",
    "FreeGatherer",
    "Gathered",
    "Gatherer",
    "Outcome",
    "Overheard",
    "PathDigest",
    "Plan",
    "Replayed",
    "Running",
    "Status",
    "Tap",
    "animate",
    "ask",
    "gathered",
    "info",
    "render",
    "replay",
    "run",
    "run_picture",
    "save_figure",
    "start",
    "task_of",
]
