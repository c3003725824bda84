"""Coordinator: the global view, from launching a run to its shortest schedule and its record.

Imports the protocol, and from the agents only what starts, names and draws them. It offers what a
user needs: run, replay and verify, shorten and convert, certificates and timetables, complexes and
their topology, searches past the homotopy class with their bounds, pictures, standard instances,
and the paper's claims. Inside the project, import each name from the module that defines it.
The packages `theory` and `tools` are plugged into the others by `plugins`.
"""

from cubepath.protocol.faces import lazy_face

__getattr__, __dir__, __all__ = lazy_face(__name__)
