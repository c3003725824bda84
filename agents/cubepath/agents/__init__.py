"""Agents: one module's view and choice, the module process, and the PettingZoo environments.

Each module knows its neighbourhood only. It imports the protocol. This face offers what users need:
to write a rule, to observe, to play in an environment, and to draw a state. Inside the project,
names are imported from the modules that define them.

| room | holds | may import |
|---|---|---|
| `local` | what a module senses, and how it and its competitors decide | none |
| `keepers` | the sites themselves, of runs without rounds | none |
| `arrays` | lockstep worlds as arrays, in compiled code | `local` |
| `rules` | what a module chooses from what it sees | `local`, `keepers` |
| `processes` | module processes and the fleet that starts and paces them | `rules`, `local` |
| `rendering` | scenes as text, pixels and on axes | none |
| `environments` | the PettingZoo environments, and playing a rule in them | all of these |
| `locality` | whether a rule is local, found by playing it | `environments` and what these use |
"""

from cubepath.protocol.faces import lazy_face

__getattr__, __dir__, __all__ = lazy_face(__name__)
