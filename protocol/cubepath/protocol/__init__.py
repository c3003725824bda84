"""Protocol: what every process agrees on, from sites and actions to systems, files and messages.

It imports neither agents nor coordinator. It offers what you need: systems and scenes and their
parts, the one definition of admissible and of commuting, files of moves, cubes, certificates and
durations, plans of other planners, recordings, and the errors. Inside the project, import each name
from the module that defines it.

Every package may use two modules: `faces`, which builds the public packages, and `compiled`.
"""

from cubepath.protocol.faces import lazy_face

__getattr__, __dir__, __all__ = lazy_face(__name__)
