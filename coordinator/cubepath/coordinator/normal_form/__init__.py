"""Shortening itself: heaps of pieces, the normal cube path, its proof and its timetable.

Room: coordinator. It takes only actions: it knows no recording, no command and no kind of system.
From the protocol it imports `core` and the forms of `path_files`, from the coordinator nothing.
Rooms that shorten import it; `verification` imports only the self-contained `definitions`.
"""

from typing import TYPE_CHECKING

from cubepath.protocol.faces import lazy_face

if TYPE_CHECKING:
    from cubepath.coordinator.normal_form.admissibility import InadmissibleMove, carried_out, end_of
    from cubepath.coordinator.normal_form.array_heap import NormalForm
    from cubepath.coordinator.normal_form.certificate import (
        certificate_of,
        certificate_of_numbered,
        encodable_certificate,
        link,
    )
    from cubepath.coordinator.normal_form.compiled_heap import (
        FastHeap,
        PathCounter,
        cancellations,
        cubes_of,
        normal_form_of,
    )
    from cubepath.coordinator.normal_form.definitions import end_state, is_cube, is_normal, too_late
    from cubepath.coordinator.normal_form.heap import Heap, normal_cube_path
    from cubepath.coordinator.normal_form.timetable import Timetable, durations_of, earliest
else:
    __getattr__, __dir__ = lazy_face(
        __name__,
        {
            "admissibility": "InadmissibleMove carried_out end_of",
            "array_heap": "NormalForm",
            "certificate": "certificate_of certificate_of_numbered encodable_certificate link",
            "compiled_heap": "FastHeap PathCounter cancellations cubes_of normal_form_of",
            "definitions": "end_state is_cube is_normal too_late",
            "heap": "Heap normal_cube_path",
            "timetable": "Timetable durations_of earliest",
        },
    )

__all__ = [
    "FastHeap",
    "Heap",
    "InadmissibleMove",
    "NormalForm",
    "PathCounter",
    "Timetable",
    "cancellations",
    "carried_out",
    "certificate_of",
    "certificate_of_numbered",
    "cubes_of",
    "durations_of",
    "earliest",
    "encodable_certificate",
    "end_of",
    "end_state",
    "is_cube",
    "is_normal",
    "link",
    "normal_cube_path",
    "normal_form_of",
    "too_late",
]
