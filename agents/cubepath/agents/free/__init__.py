"""Modules of a run without rounds: each senses, chooses and attempts when it is ready.

It opens sessions and starts processes. It imports `rules`, `local`, `keepers` and, for child
processes, `processes`. A run under the free clock uses `FreeFleet`; the simulator uses the nodes.
"""
