"""The golden recordings, made anew: `python tests/golden.py` writes all, or those that you name.

Run it once after a change of what recordings hold, and commit what it wrote; `tests/test_golden.py`
fails until then. Runs with rounds are played in virtual time, by the nodes of real processes, so
that their files come out byte for byte the same on any machine with the same zstd. The test holds
their messages against those of real processes. The file of the run without rounds is another one
each time: what its processes say depends on when each of them acts. Some figures of the files stand
in docs and examples: run `tests/test_docs.py` and `tests/test_examples.py` afterwards.
"""

import argparse
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

from cubepath.coordinator.runs.plan import Plan, parameters_of, task_of
from cubepath.coordinator.runs.run import run
from cubepath.coordinator.simulation.faults import ListedFaults
from cubepath.coordinator.simulation.scenarios import Scenario
from cubepath.coordinator.simulation.simulated import simulate
from cubepath.protocol.recordings.recording import read_recording
from cubepath.protocol.recordings.stored_messages import Record
from cubepath.protocol.recordings.writing import RecordingWriter

FOLDER = Path(__file__).parent.parent / "logs" / "golden"
PLANS = {
    "agv-3": Plan("agv:graph=C7,n=3", "random", processes=2, max_rounds=15),
    "agv-6": Plan("agv-labelled:graph=grid4x4,n=6", "pibt", seed=27, hesitate=0.2, processes=2),
    "arm-6": Plan("arm:n=6,goal=xxyxyx", "random", seed=2, processes=3, max_rounds=25),
    "hex-5": Plan("hex:n=5", "chain", seed=13, hesitate=0.3, processes=2),
    "hex-free-5": Plan("hex:n=5", "chain", processes=2, clock="free", keepers=2),
}
"""The runs on record, by the names of their files."""
_NEW_YEAR_NS = 1_767_225_600 * 10**9
"""When they begin: 2026-01-01, 0:00 UTC."""
_LATER_NS = 10**6
"""How much later the next message is of a run without rounds."""
_CHUNK = 50
"""The messages in a chunk: small files have several, as those of long runs do."""
_OF_THE_MACHINE = ("python", "platform", "cubepath", "eclipse-zenoh", "mcap", "pettingzoo", "numpy")


def records_of(plan: Plan) -> Iterable[Record]:
    """Play a run; return its messages, in the order in which they were kept."""
    if plan.is_free:
        with TemporaryDirectory() as folder:
            run(replace(plan, log=Path(folder) / "run.mcap"))
            said = list(read_recording(Path(folder) / "run.mcap").records)
        return [replace(each, wall_ns=each.sequence * _LATER_NS) for each in said]
    task = task_of(plan)
    scenario = Scenario(
        task.scene.spec, task.rule, plan.processes, plan.hesitate, task.max_rounds, plan.seed
    )
    found = simulate(scenario, ListedFaults(()))
    assert found.failure is None, found.failure
    return found.recording.records


def path_of(name: str, folder: Path = FOLDER) -> Path:
    """Return the path of a golden recording."""
    return folder / f"{name}.mcap"


def write(name: str, folder: Path = FOLDER, plan: Plan | None = None) -> Path:
    """Write the golden recording of a name, or of a plan, to a folder; return its path."""
    plan, path = plan or PLANS[name], path_of(name, folder)
    task = task_of(plan)
    told = parameters_of(plan, task)
    parameters = {key: told[key] for key in told if key not in _OF_THE_MACHINE}
    records = records_of(plan)
    path.unlink(missing_ok=True)
    with RecordingWriter(path, task.scene, parameters, clock=lambda: 0.0) as writer:
        for number, record in enumerate(records, start=1):
            writer.write(
                record.topic,
                record.data,
                round_number=record.round,
                wall_ns=_NEW_YEAR_NS + record.wall_ns,
            )
            if number % _CHUNK == 0:
                writer.flush()
    return path


def main() -> None:
    """Write what is asked for."""
    parser = argparse.ArgumentParser(description="Write golden recordings anew.")
    parser.add_argument("names", nargs="*", choices=[[], *PLANS], metavar="NAME")
    for name in parser.parse_args().names or PLANS:
        path = write(name)
        recording = read_recording(path)
        print(f"{path}: {recording.format}, {len(recording.records)} messages")


if __name__ == "__main__":
    main()
