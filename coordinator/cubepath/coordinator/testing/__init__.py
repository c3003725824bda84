"""For the tests of others: links that lose messages, conditions, assertions on the log, pytest.

It stands on `runs`, `simulation` and `shortening`. The plugin for pytest is here too; it imports
nothing of all this before a fixture is asked for. Users import from this package.
"""

from cubepath.protocol.faces import lazy_face

__getattr__, __dir__, __all__ = lazy_face(__name__)
