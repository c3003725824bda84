"""Recordings with messages that are changed in every way, and files that are cut and flipped."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from random import Random
from tempfile import TemporaryDirectory

import pytest
from hypothesis import given, strategies as st

from cubepath.coordinator.runs.gathering import gathered
from cubepath.coordinator.verification.recording import verify
from cubepath.coordinator.verification.recovery import recover
from cubepath.protocol.core.errors import CubepathError
from cubepath.protocol.recordings.recording import Recording, read_recording
from samples.recordings import recorded, with_records
from tampering.junk import changed_json

SEEDS = st.integers(0, 1 << 32)


def changed(recording: Recording, random: Random) -> Recording:
    """Return a recording with some messages changed."""
    records = list(recording.records)
    for _ in range(random.choice((1, 1, 3))):
        place = random.randrange(len(records))
        data = changed_json(random, records[place].data)
        records[place] = replace(records[place], data=data)
    return with_records(recording, records)


@pytest.mark.slow
@given(spec=st.sampled_from(("hex-open:n=4", "arm:n=4", "agv:graph=grid3x3,n=3")), seed=SEEDS)
def test_changed_messages_are_verified_and_gathered(spec: str, seed: int) -> None:
    """Or refused in one line."""
    found = changed(recorded(spec, rounds=3), Random(seed))  # noqa: S311 - not for secrets
    assert "\n" not in line_of(lambda: verify(found))
    assert "\n" not in line_of(lambda: gathered(found))


def damaged(data: bytes, random: Random) -> bytes:
    """Return the bytes cut, and some of them changed or gone."""
    found = bytearray(data)
    for _ in range(random.choice((0, 1, 3, 30))):
        found[random.randrange(len(found))] ^= 1 << random.randrange(8)
    if random.randrange(2):
        del found[random.randrange(len(found)) :]
    if random.randrange(3) == 0 and found:
        place = random.randrange(len(found))
        del found[place : place + random.randrange(200)]
    return bytes(found)


@pytest.mark.slow
@given(seed=SEEDS)
def test_a_damaged_file_is_read_verified_and_recovered(seed: int) -> None:
    """Or refused in one line; what was recovered is a whole file."""
    random = Random(seed)  # noqa: S311 - not for secrets
    data = recorded("hex-open:n=4", rounds=3).path.read_bytes()
    with TemporaryDirectory() as folder:
        path, out = Path(folder) / "damaged.mcap", Path(folder) / "out.mcap"
        path.write_bytes(damaged(data, random))
        line = line_of(lambda: recover(verified(path), out))
        assert "\n" not in line
        assert line or read_recording(out).problems == ()


def verified(path: Path) -> Recording:
    """Read and verify a recording; return it."""
    found = read_recording(path)
    verify(found)
    return found


def line_of(do: Callable[[], object]) -> str:
    """Return the line with which something is refused; empty if it is done."""
    try:
        do()
    except CubepathError as error:
        return str(error)
    return ""
