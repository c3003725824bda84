"""What commands refuse, as a snapshot: `usage_errors.txt` has command lines and their answers.

    python tests/usage_errors.py    # make the answers anew, after you have changed or added a line

Each answer is the exit code and the one line on standard error. The commands run in one folder, in
which they leave nothing and print nothing to standard output.
"""

import contextlib
import io
import json
import os
import shlex
import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path

from cubepath.coordinator.commands.main import main
from cubepath.protocol.recordings.cutting import filter_recording
from cubepath.protocol.scenes.specs import scene_from_spec
from cubepath.protocol.scenes.toml import scene_to_toml

SNAPSHOT = Path(__file__).with_suffix(".txt")
ROOT = Path(__file__).parents[1]
GOLDEN = ROOT / "logs" / "golden"
FILES = {
    "edge.jsonl": '{"generator": "edge", "at": [[0, 0], [1, 0]]}\n',
    "swim.jsonl": '{"generator": "swim", "at": [[0, 0], [1, 0]]}\n',
    "illegal.jsonl": '{"generator": "edge", "at": [[2, 0], [2, 1]]}\n',
    "bad.jsonl": '{"generator": "edge", "at": [[0, 0], [1, 0]]}\n{"generator": "edge"\n',
    "moves.jsonl": "".join(
        json.dumps({"id": n, "support": [n, n + 1], "trace": [n, n + 1]} | ends) + "\n"
        for n, ends in ((0, {"before": [0], "after": [1]}), (1, {"before": [1], "after": [2]}))
    ),
    "cubes.jsonl": '{"moves": [{"generator": "edge", "at": [[0, 0], [1, 0]]}]}\n',
    "apart.jsonl": json.dumps({"moves": [{"generator": "edge", "at": [[0, 0], [1, 0]]}] * 2}),
    "grid.map": "type octile\nheight 2\nwidth 3\nmap\n...\n...\n",
    "durations.toml": 'format = "cubepath-durations-1"\n',
    "slip.toml": 'systems = "hex"\nseed = 3\n',
    "bad.toml": 'format = "cubepath-system-1"\nstart = [[0, 0]]\n[lattice]\nname = "cubes"\n',
    "named.json": "{}",
    "garbage.mcap": "garbage",
    "empty.mcap": "",
    "last.py": "from cubepath.agents import policy_rule\n"
    'last = policy_rule("last", lambda observation, action_mask: 0)\n',
    "file": "",
    "ring.json": json.dumps(
        {
            "grid": [3, 2],
            "starts": [[0, 0], [1, 0], [1, 1], [0, 1]],
            "goals": [[1, 0], [1, 1], [0, 1], [0, 0]],
            "moves": [[[0, 0], [1, 0]], [[1, 0], [1, 1]], [[1, 1], [0, 1]], [[0, 1], [0, 0]]],
            "rounds": [4],
        }
    ),
}
LINKS = {
    "soft.jsonl": "moves.jsonl",
    "soft.json": "moves.jsonl",
    "map.json": "grid.map",
    "map.jsonl": "grid.map",
    "with.jsonl": "room.map",
    "durations.jsonl": "durations.toml",
    "system.jsonl": "grid.toml",
    "hex.png": "hex.mcap",
    "moves.proof": "moves.jsonl",
    "nowhere": "not-there",
    "second.json": "first.jsonl",
}


def fill(folder: Path) -> None:
    """Write the files that the commands name."""
    shutil.copytree(ROOT / "tests/data/imports", folder, dirs_exist_ok=True)
    for name, golden in (("hex", "hex-5"), ("agv", "agv-6"), ("free", "hex-free-5")):
        shutil.copy(GOLDEN / f"{golden}.mcap", folder / f"{name}.mcap")
    for suffix in ("jsonl", "json", "png", "mcap", "proof"):
        shutil.copy(GOLDEN / "agv-3.mcap", folder / f"kept.{suffix}")
    for name, text in FILES.items():
        (folder / name).write_text(text)
    for name, target in LINKS.items():
        (folder / name).symlink_to(target)
    (folder / "hard.jsonl").hardlink_to(folder / "moves.jsonl")
    for name in ("folder", "folder.proof", "runs"):
        (folder / name).mkdir()
    grid = scene_from_spec("agv:graph=grid3x2,n=2")
    (folder / "grid.toml").write_text(scene_to_toml(grid))
    filter_recording(folder / "hex.mcap", folder / "part.mcap", first=10)
    made = (
        ("improve", "ring.json", "--following", "mapf", "-o", "ring.jsonl"),
        ("shorten", "moves.jsonl", "-o", "cubes.npz"),
        ("improve", "agv.mcap", "--prove", "0", "--proof", "best.proof"),
    )
    for arguments in made:
        with contextlib.redirect_stdout(io.StringIO()):
            assert main(arguments) == 0


def lines() -> list[str]:
    """Return the lines of the snapshot."""
    return SNAPSHOT.read_text("utf-8").splitlines()


def answered(line: str) -> str:
    """Return the exit code of a command, and the line that it writes to standard error."""
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        try:
            code: object = main(shlex.split(line))
        except SystemExit as stopped:
            code = stopped.code
    assert not out.getvalue(), f"{line}: writes {out.getvalue()!r} to standard output"
    (told,) = err.getvalue().splitlines() or [""]
    return f"{code} {told.removeprefix('cubepath: ')}".replace(f"{Path.cwd()}/", "")


def again() -> Iterator[str]:
    """Yield the lines of the snapshot with the answers of today; run in a folder of files."""
    with tempfile.TemporaryDirectory() as name, contextlib.chdir(name):
        folder = Path(name)
        fill(folder)
        before = sorted(folder.rglob("*"))
        for line in lines():
            if line.startswith("$ "):
                yield line
                yield answered(line[2:])
                assert sorted(folder.rglob("*")) == before, f"{line}: leaves files"
            elif line.startswith("#") or not line:
                yield line


if __name__ == "__main__":
    os.environ["CUBEPATH_PROGRESS"] = "0"
    SNAPSHOT.write_text("\n".join(again()) + "\n", "utf-8")
