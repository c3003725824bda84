"""Agents: one module's view and choice, the module process, and the PettingZoo environments.

Each module knows its neighbourhood only. It imports the protocol. This face offers what users need:
to write a rule, to observe, to play in an environment, and to draw a state. Inside the project,
names are imported from the modules that define them.
"""

from cubepath.protocol.faces import lazy_face

__getattr__, __dir__, __all__ = lazy_face(__name__)
