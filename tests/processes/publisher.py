"""A run that never was: a process that says what it is, and publishes numbered messages.

Started as ``python publisher.py ENDPOINT COUNT RATE block|drop BYTES`` it waits for a line, puts so
many messages of one process, says on standard output how many of them and how long it took, and
ends when its standard input does.
"""

import sys
import time
from typing import Any, cast

import zenoh

from cubepath.coordinator.runs.asking import Answers, RunInfo, Status
from cubepath.protocol.recordings.description import FORMAT
from cubepath.protocol.scenes.specs import scene_from_spec
from cubepath.protocol.scenes.toml import scene_to_toml
from cubepath.protocol.wire.credentials import GUEST
from cubepath.protocol.wire.sessions import open_client

RUN = "0123456789ab"
KEY = f"cubepath/{RUN}/to/0,0/process_0"


def message(number: int, size: int) -> bytes:
    """Return the numbered message of a process, of so many bytes at least."""
    text = f'{{"kind":"bundle","round":{number // 1000 + 1},"phase":"settle","process":0,'
    text += f'"region":"0,0","number":{number},"parts":[]'
    return (text + " " * (size - len(text) - 1) + "}").encode()


def about() -> RunInfo:
    """Return what the run says of itself."""
    scene = scene_from_spec("hex:n=4")
    parameters = {"system": scene.spec, "family": scene.family, "rule": "random", "seed": "0"}
    return RunInfo(RUN, FORMAT, parameters, scene_to_toml(scene))


def main() -> None:
    """Publish."""
    endpoint, count, rate, how, size = sys.argv[1:]
    status = Status(0, (), 0, 0, goal_reached=False, ended=None)
    answers = Answers(endpoint, GUEST, status, about())
    control = zenoh.CongestionControl.BLOCK if how == "block" else zenoh.CongestionControl.DROP
    with open_client(endpoint) as session:
        print("there", flush=True)
        sys.stdin.readline()
        publisher = session.declare_publisher(KEY, congestion_control=control)
        while not cast("Any", publisher.matching_status).matching:  # puts before that go nowhere
            time.sleep(0.001)
        made = [message(number, int(size)) for number in range(int(count))]
        begun = time.perf_counter()
        for number, data in enumerate(made):
            source = zenoh.SourceInfo(publisher.id, number)
            publisher.put(data, source_info=source)
            if float(rate) and number % 100 == 0:
                time.sleep(max(0.0, begun + number / float(rate) - time.perf_counter()))
        if how == "drop":  # who comes last is not dropped: by its number the others are missed
            with session.declare_publisher(
                KEY, congestion_control=zenoh.CongestionControl.BLOCK
            ) as sure:
                last = message(int(count), int(size))
                sure.put(last, source_info=zenoh.SourceInfo(publisher.id, int(count)))
        print(count, time.perf_counter() - begun, flush=True)
        sys.stdin.read()
    answers.close()


if __name__ == "__main__":
    main()
