"""Agents: what one module sees and chooses, its process, and the PettingZoo environments.

A module knows only its neighbourhood. This package imports the protocol. It offers what you need to
write a rule, to observe, to play in an environment, and to draw a state. Inside the project, import
each name from the module that defines it.
"""

from cubepath.protocol.faces import lazy_face

__getattr__, __dir__, __all__ = lazy_face(__name__)
