"""What was cut from a recording is no shorter run: it has all moves, or it is refused."""

from collections.abc import Callable
from pathlib import Path

import pytest

from cubepath.coordinator.runs.gathering import gathered, gathered_in_full
from cubepath.coordinator.shortening.conversion import convert
from cubepath.coordinator.testing.log import RunLog
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.recordings.cutting import filter_recording, merge_recordings, split_recording
from cubepath.protocol.recordings.recording import read_recording

GOLDEN = Path(__file__).parents[3] / "logs" / "golden"
Cut = Callable[[Path], None]


def without(name: str, *exclude: str) -> Cut:
    """Leave topics out of a recording."""
    return lambda out: print(filter_recording(GOLDEN / name, out, exclude=exclude))


def with_a_gap(out: Path) -> None:
    """Leave out the rounds in the middle."""
    parts = split_recording(GOLDEN / "hex-5.mcap", out.parent / "parts", rounds=10)
    merge_recordings([parts[0], parts[2]], out)


@pytest.mark.parametrize(
    ("cut", "said"),
    [
        (without("hex-5.mcap", "reports"), "no reports on record; it holds "),
        (without("hex-5.mcap", "reports/process_1"), "round 1 is not complete, but"),
        (
            without("hex-free-5.mcap", "commit/keeper_1"),
            "commit 1 of keeper_1 is missing; it holds",
        ),
        (with_a_gap, "round 11 is not complete, but there are reports of round 29"),
    ],
)
def test_what_lacks_reports_in_between_is_refused(cut: Cut, said: str, tmp_path: Path) -> None:
    """By all who take its moves for those of the run; none of them says that it had fewer."""
    path = tmp_path / "part.mcap"
    cut(path)
    for take in (
        lambda: gathered_in_full(read_recording(path)),
        lambda: RunLog.read(path).rounds,
        lambda: convert(path, tmp_path / "moves.jsonl"),
    ):
        with pytest.raises(InputError, match=said):
            take()
    assert not (tmp_path / "moves.jsonl").exists()


@pytest.mark.parametrize("name", ["hex-5.mcap", "hex-free-5.mcap"])
def test_what_has_all_of_them_is_gathered(name: str, tmp_path: Path) -> None:
    """The commits or reports alone, and the beginning of a run."""
    whole = gathered(read_recording(GOLDEN / name))
    said = tmp_path / "said.mcap"
    filter_recording(GOLDEN / name, said, topics=["commit"] if "free" in name else ["report*"])
    assert gathered_in_full(read_recording(said)).digest == whole.digest
    early = tmp_path / "early.mcap"
    filter_recording(GOLDEN / name, early, until=9)
    assert 0 < gathered_in_full(read_recording(early)).rounds < whole.rounds
