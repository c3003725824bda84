"""Checks whether a rule is local: plays it with everything else changed, and watches it.

It imports `environments`, `rules`, `local` and the protocol. A rule is only ever loaded in a
separate process. The command line uses this room.
"""
