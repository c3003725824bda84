"""The server that forks a process for each play: what comes of it, and that nothing is left."""

import contextlib
import time
from pathlib import Path

import pytest

from cubepath.agents.locality.fork_server import ForkServer
from cubepath.agents.locality.plays import Conditions, FitQuestion, PlayTask, WholeRun
from cubepath.protocol.scenes.specs import scene_from_spec

CHEATS = Path(__file__).parent / "cheats"
pytestmark = pytest.mark.slow


def task(rule: str, folder: Path, **conditions: bool) -> PlayTask:
    play = WholeRun(scene_from_spec("hex:n=3"), seed=1, hesitate=0.0, rounds=4)
    return PlayTask(rule, play, Conditions(**conditions), str(folder))


def running(group: int) -> list[str]:
    """Return the processes of a group that have not ended."""
    found: list[str] = []
    for path in Path("/proc").glob("[0-9]*/stat"):
        with contextlib.suppress(OSError):
            state, _, pgrp = path.read_text().rpartition(")")[2].split()[:3]
            if int(pgrp) == group and state != "Z":
                found.append(path.parent.name)
    return found


def come_to(count: int, group: int) -> bool:
    """Wait until a group has so many processes, for some seconds; return whether it has."""
    until = time.monotonic() + 30
    while len(running(group)) != count and time.monotonic() < until:
        time.sleep(0.01)
    return len(running(group)) == count


def test_each_play_is_new(tmp_path: Path) -> None:
    """What a rule has left in the memory of one is not there in the next, nor what it has wrong."""
    rule = f"{CHEATS / 'module_globals'}.py:RULE"
    with ForkServer(1) as server:
        one = server.play(task(rule, tmp_path))
        ended = server.play(task(f"{CHEATS / 'vanishes'}.py:RULE", tmp_path))
        other = server.play(task(rule, tmp_path))
    assert one.changed == other.changed == ("WHERE",)
    assert one.lives[2].choices == other.lives[2].choices
    assert ended.broken == "ended its process"


def test_hash_seeds_are_those_of_the_servers(tmp_path: Path) -> None:
    """Two servers with one seed have the same order of sets; among several seeds it differs."""
    rule = f"{CHEATS / 'set_order'}.py:RULE"

    def choices(hash_seed: int) -> list[object]:
        with ForkServer(hash_seed) as server:
            lives = server.play(task(rule, tmp_path)).lives
        return [life.choices for life in lives.values()]

    first = choices(1)
    assert choices(1) == first
    assert any(choices(hash_seed) != first for hash_seed in range(2, 6))


def test_who_never_answers_is_ended(tmp_path: Path) -> None:
    """The play is broken after the patience; with the server all its processes end."""
    with ForkServer(1) as server:
        found = server.play(task(f"{CHEATS / 'sleeps'}.py:RULE", tmp_path), 1.0)
        group = server._server.pid
        assert come_to(2, group)  # on a busy machine the play itself begins later
    assert found.broken == "gave no answer for 1 s"
    assert come_to(0, group)


def test_a_rule_is_asked_what_it_is_for(tmp_path: Path) -> None:
    """Of many scenes those that fit; what is wrong with its file is told."""
    specs = ("hex:n=3", "agv:graph=K3,n=2", "arm:n=3", "hex-connected")
    with ForkServer(1) as server:
        fit = server.play(PlayTask("tswap", FitQuestion(specs), Conditions(), str(tmp_path)))
        all_fit = server.play(PlayTask("random", FitQuestion(specs), Conditions(), str(tmp_path)))
        wrong = server.play(PlayTask("nonesuch", FitQuestion(specs), Conditions(), str(tmp_path)))
    assert fit.specs == ("agv:graph=K3,n=2",)
    assert all_fit.specs == specs[:3]
    assert wrong.unfit is not None
    assert wrong.unfit.startswith("unknown rule 'nonesuch'")
