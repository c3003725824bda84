"""Rules played again: whether the modules of a recording chose as their rules and the seed say.

`verification` derives what each module observed, and imports nothing of the agents; this room asks
the installed rules, as modules ask theirs. It imports `verification` and, of the agents, `rules`.
The command line verifies recordings with it.
"""
