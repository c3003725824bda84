"""Coordinator: the global view, from launching a run to its shortest schedule and its record.

Imports the protocol, and from the agents only what starts, names and draws them. It offers what a
user needs: run, replay and verify, shorten and convert, certificates and timetables, complexes and
their topology, searches past the homotopy class with their bounds, pictures, standard instances,
and the paper's claims. Inside the project, import each name from the module that defines it.

| room | holds | may import |
|---|---|---|
| `normal_form` | heaps of pieces, the normal cube path, its proof and its timetable | none |
| `complexes` | state and shape complexes, links, homology, collapses | none |
| `verification` | recordings and certificates derived again | `normal_form.definitions` alone |
| `search` | exact optima, lower bounds, shorter paths | `complexes`, `normal_form` |
| `runs` | runs, schedules, pictures | `search`, `verification`, `normal_form` |
| `playback` | recordings put back on zenoh, under control | `runs`, `verification` |
| `simulation` | whole runs under faults, each from its seed | `runs`, `verification` |
| `shortening` | paths from files and recordings | `runs`, `search`, `verification`, `normal_form` |
| `following` | plans whose vehicles follow | `satisfiability`, `verification` |
| `comparison` | two runs, where they part and why | `auditing`, `verification`, `shortening` |
| `paper` | the paper's claims, computed | `complexes`, `normal_form` |
| `viewing` | a run as a page in a browser | `runs`, `complexes`, `normal_form` |
| `live` | the same page while a run goes on | `viewing`, `runs`, `normal_form` |
| `experiments` | sweeps of many runs, and reports | `simulation`, `runs`, `search`, `normal_form` |
| `testing` | for the tests of others, and pytest | `runs`, `playback`, `simulation`, `shortening` |
| `attached` | a live run recorded from outside | `runs` |
| `exports` | recordings for other tools | `shortening`, `runs` |
| `commands` | the command line | all of these |
"""

from cubepath.protocol.faces import lazy_face

__getattr__, __dir__, __all__ = lazy_face(__name__)
