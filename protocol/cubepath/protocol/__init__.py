"""Protocol: what every process agrees on, from sites and actions to systems, files and messages.

Imports neither agents nor coordinator. This face offers what users need: systems and scenes and
their parts, the one definition of admissible and of commuting, files of moves, cubes, certificates
and durations, plans of other planners, recordings, and the errors. Inside the project, names are
imported from the modules that define them.

| room | holds | may import |
|---|---|---|
| `core` | sites, actions, catalogues, `System` and `Scene`, errors | none |
| `systems` | kinds of systems: on a lattice, on a graph, listed, flips | `core` |
| `path_files` | files of moves, cubes, schedules, durations, certificates | `core` |
| `scenes` | scenes by name or from TOML, the families of scenes | `systems`, `core` |
| `wire` | messages, key expressions, sessions | `path_files`, `core` |
| `recordings` | the recording format in MCAP | `wire`, `scenes`, `core` |
| `plans` | plans of other planners | `path_files`, `scenes`, `systems`, `core` |

Two modules belong to no room: `faces`, which builds every face, and `compiled`, which all may use.
"""

from cubepath.protocol.faces import lazy_face

__getattr__, __dir__, __all__ = lazy_face(__name__)
