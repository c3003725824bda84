"""Experiments: sweeps over systems, rules, clocks, faults and seeds, and standard instances.

Room: coordinator. A sweep is data; its runs are played in compiled code, under the simulator or
over the wire, in one process or many, and kept as Parquet. It imports `runs`, `simulation`,
`search` and `normal_form`, and of the agents `environments` and `rules`. The commands `sweep` and
`report` use it.
"""

from typing import TYPE_CHECKING

from cubepath.protocol.faces import lazy_face

if TYPE_CHECKING:
    from cubepath.coordinator.experiments.instances import StandardInstance, standard
    from cubepath.coordinator.experiments.report import Report, write_report
    from cubepath.coordinator.experiments.setting import FaultRates
    from cubepath.coordinator.experiments.spec import Expansion, Sweep, expand, sweep_of
    from cubepath.coordinator.experiments.sweeping import (
        SweepResults,
        play_sweep,
        read_sweep,
        sweep,
    )
    from cubepath.coordinator.experiments.tables import Table
    from cubepath.coordinator.experiments.workers import cores
else:
    __getattr__, __dir__ = lazy_face(
        __name__,
        {
            "instances": "StandardInstance standard",
            "report": "Report write_report",
            "setting": "FaultRates",
            "spec": "Expansion Sweep expand sweep_of",
            "sweeping": "SweepResults play_sweep read_sweep sweep",
            "tables": "Table",
            "workers": "cores",
        },
    )

__all__ = [
    "Expansion",
    "FaultRates",
    "Report",
    "StandardInstance",
    "Sweep",
    "SweepResults",
    "Table",
    "cores",
    "expand",
    "play_sweep",
    "read_sweep",
    "standard",
    "sweep",
    "sweep_of",
    "write_report",
]
