"""The command line: ``cubepath`` and ``python -m cubepath.coordinator``.

A command reads its options, calls one package to do the work, and reports the result. Modules are
imported inside the command that needs them, so that each command starts fast; those of `theory` and
`tools` come from `plugins`.
"""
