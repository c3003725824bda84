"""The command line: ``cubepath`` and ``python -m cubepath``.

A command reads its options, lets one room do the work, and reports the result. Modules are imported
inside the command that needs them, so that each command starts fast. The room may import every
other room, and offers no names: it is started at `main`.
"""
