"""The golden files of a release: `python tests/released.py VERSION` writes them, once.

Every later version reads them and gives the same answers: `tests/test_released.py`. So a folder of
`tests/data/released` is never written again. It has a file of each format that is promised in
docs/files.md, and in `answers.json` what commands on them answer.
"""

import argparse
import json
import shlex
import time
from pathlib import Path
from typing import Any

import zenoh

from cubepath.coordinator.runs.plan import Plan
from cubepath.coordinator.tools.recorder.recorder import Recorder
from cubepath.protocol.wire.router import Router
from cubepath.protocol.wire.sessions import open_client
from golden import write
from processes.command_line import here

FOLDER = Path(__file__).parent / "data" / "released"
ANSWERS = "answers.json"
_SYSTEM = "--system hex:n=4"
_RUNS = {
    "rounds": Plan("hex:n=4", "chain", seed=13, hesitate=0.3, processes=2),
    "free": Plan("hex:n=4", "chain", processes=2, clock="free", keepers=2),
}
_MADE = (
    "shorten rounds.mcap --convert -o moves.jsonl",
    f"shorten moves.jsonl {_SYSTEM} --convert -o moves.npz",
    f"shorten moves.jsonl {_SYSTEM} -o cubes.jsonl --certificate cubes.certificate.json",
    f"shorten moves.jsonl {_SYSTEM} -o cubes.npz",
    f"improve moves.jsonl {_SYSTEM} --prove 60 --proof optimum.proof",
)
_ASKED = (
    "verify rounds.mcap",
    "verify free.mcap",
    "log info rounds.mcap",
    "log info free.mcap",
    "log info keys.mcap",
    "shorten rounds.mcap",
    "shorten moves.npz",
    "shorten cubes.npz --convert -o again.jsonl",
    f"verify cubes.jsonl --of moves.jsonl {_SYSTEM}",
    f"verify cubes.certificate.json --of moves.jsonl {_SYSTEM}",
    "verify optimum.proof",
)


def answer(command: str, folder: Path) -> Any:
    """Return what a command in a folder answers, without its times."""
    done = here(*shlex.split(command), "--json", cwd=folder)
    assert done.returncode == 0, (command, done.stderr)
    return _untimed(json.loads(done.stdout))


def _untimed(said: Any) -> Any:
    if isinstance(said, list):
        return [_untimed(each) for each in said]
    if isinstance(said, dict):
        return {key: _untimed(value) for key, value in said.items() if key != "seconds"}
    return said


def _record_keys(path: Path) -> None:
    """Record what a zenoh program says on keys of its own."""
    block = zenoh.CongestionControl.BLOCK
    pose = zenoh.Encoding.APPLICATION_JSON.with_schema("Pose")
    with (
        Router("tcp/127.0.0.1:0") as router,
        open_client(router.endpoint) as session,
        Recorder(router.endpoint, path, keys="robot/**") as recorder,
    ):
        session.put(
            "robot/arm", b'{"x": 1}', encoding=pose, attachment=b"1", congestion_control=block
        )
        session.put("robot/eye", b"\0\xff", congestion_control=block)
        session.delete("robot/arm", congestion_control=block)
        deadline = time.monotonic() + 20
        while recorder.messages < 4:  # an attachment counts as one
            assert time.monotonic() < deadline, recorder.messages
            time.sleep(0.01)


def main() -> None:
    """Write the files of a version; end if they are there."""
    parser = argparse.ArgumentParser(description="Write the golden files of a release.")
    parser.add_argument("version")
    folder = FOLDER / parser.parse_args().version
    folder.mkdir(parents=True)
    for name, plan in _RUNS.items():
        write(name, folder, plan)
    _record_keys(folder / "keys.mcap")
    for command in _MADE:
        done = here(*shlex.split(command), cwd=folder)
        assert done.returncode == 0, (command, done.stderr)
    answers = {command: answer(command, folder) for command in _ASKED}
    (folder / "again.jsonl").unlink()
    (folder / ANSWERS).write_text(json.dumps(answers, indent=1) + "\n")


if __name__ == "__main__":
    main()
