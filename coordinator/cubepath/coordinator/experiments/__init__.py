"""Experiments: sweeps over systems, rules, clocks, faults and seeds, and standard instances.

A sweep is data. Its runs are played in compiled code, in the simulator or over the wire, in one
process or many, and kept as Parquet. `theory` finds the bounds and optima of a scene. The commands
`sweep` and `report` use this room.
"""
