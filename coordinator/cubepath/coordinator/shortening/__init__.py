"""Paths from files and recordings, shortened, explained, converted and written.

Room: coordinator. Here a file becomes a path, and a path becomes an answer. It imports
`normal_form`, `search` to look beyond the class, `verification` to check results before they are
reported, and the gatherer of `runs`. The command line is built on it.
"""

from typing import TYPE_CHECKING

from cubepath.protocol.faces import lazy_face

if TYPE_CHECKING:
    from cubepath.coordinator.shortening.comparing import difference_of
    from cubepath.coordinator.shortening.conversion import Converted, convert
    from cubepath.coordinator.shortening.explain import (
        TimedPath,
        certificate_in_words,
        certified_path,
        timed_path,
    )
    from cubepath.coordinator.shortening.normal_path import Shortened, shorten, shortened
    from cubepath.coordinator.shortening.optimality import Beyond, beyond
    from cubepath.coordinator.shortening.path_input import PathInput, read_input
    from cubepath.coordinator.shortening.path_steps import (
        certified_steps,
        is_certificate,
        read_steps,
    )
    from cubepath.coordinator.shortening.tasks import Task, task_of
else:
    __getattr__, __dir__ = lazy_face(
        __name__,
        {
            "comparing": "difference_of",
            "conversion": "Converted convert",
            "explain": "TimedPath certificate_in_words certified_path timed_path",
            "normal_path": "Shortened shorten shortened",
            "optimality": "Beyond beyond",
            "tasks": "Task task_of",
            "path_input": "PathInput read_input",
            "path_steps": "certified_steps is_certificate read_steps",
        },
    )

__all__ = [
    "Beyond",
    "Converted",
    "PathInput",
    "Shortened",
    "Task",
    "TimedPath",
    "beyond",
    "certificate_in_words",
    "certified_path",
    "certified_steps",
    "convert",
    "difference_of",
    "is_certificate",
    "read_input",
    "read_steps",
    "shorten",
    "shortened",
    "task_of",
    "timed_path",
]
