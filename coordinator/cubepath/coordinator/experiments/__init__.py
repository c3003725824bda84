"""Experiments: sweeps over systems, rules, clocks, faults and seeds, and standard instances.

A sweep is data; its runs are played in compiled code, under the simulator or over the wire, in one
process or many, and kept as Parquet. It imports `runs`, `simulation`, `search` and `normal_form`,
and of the agents `environments` and `rules`. The commands `sweep` and `report` use it.
"""
