"""For the tests of others: links that lose messages, conditions, assertions on the log, pytest.

It stands on `runs`, `simulation` and `shortening`, and only `commands` may use it. The plugin for
pytest is here too; it imports nothing of all this before a fixture is asked for. Unlike those of
other rooms, this face is for users.
"""

from cubepath.protocol.faces import lazy_face

__getattr__, __dir__, __all__ = lazy_face(__name__)
