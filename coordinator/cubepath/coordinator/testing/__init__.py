"""For your tests: links that lose messages, conditions, assertions on the log, pytest fixtures.

It is built on `runs`, `simulation` and `shortening`. The plugin for pytest is here too; it imports
none of these before a fixture is used. Import from this package.
"""

from cubepath.protocol.faces import lazy_face

__getattr__, __dir__, __all__ = lazy_face(__name__)
