"""Recordings put back on zenoh, under control, and compared with what was gathered then.

It imports `runs`, to gather again what is played, and `verification` for the certificates on
record. The pure part is the machine, which knows neither a clock nor zenoh; nothing that runs
modules depends on this room.
"""
