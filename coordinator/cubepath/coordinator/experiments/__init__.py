"""Experiments: sweeps over systems, rules, clocks, faults and seeds, and standard instances.

A sweep is data; its runs are played in compiled code, under the simulator or over the wire, in one
process or many, and kept as Parquet. What is known of a scene, bounds and optima, `theory` finds.
The commands `sweep` and `report` use it.
"""
