"""The command line: ``cubepath`` and ``python -m cubepath``.

Room: coordinator. It reads options, asks one room for the work, and says what came of it; modules
are imported inside the command that needs them, so that each starts fast. It may import every room,
and offers nothing: it is started, at `main`.
"""
