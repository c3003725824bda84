"""Recordings put back on zenoh, under control, and compared with what was gathered then.

It imports `runs`, to gather a replay again, and `verification` for recorded certificates. The
machine is pure: it knows neither a clock nor zenoh. No code that runs modules depends on this room.
"""
