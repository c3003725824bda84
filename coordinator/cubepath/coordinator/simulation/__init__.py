"""Simulation: whole runs under faults, in one process and virtual time, each from its seed.

The nodes are those of a run, on a simulated wire. It imports `runs` and `verification`, and of the
agents `processes`, `rules` and the environment, which is an independent way to the edge path of a
run. The command `simulate` and experiments use it.
"""
