"""Commands in a process that is listened to: which files each opens, and what falls onto heaps.

Run as a script it carries out the commands that it is told on standard input. An audit hook writes
down what that process opens, and so do those that it starts.
"""

import contextlib
import io
import json
import os
import subprocess
import sys
from collections import Counter
from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

HOOK = """
import os, sys
under = os.environ["AUDITED_FOLDER"] + os.sep
log = os.open(os.environ["AUDITED_LOG"], os.O_WRONLY | os.O_APPEND)

def hook(event, arguments):
    if event == "open" and isinstance(arguments[0], (str, bytes, os.PathLike)):
        path = os.path.abspath(os.fsdecode(arguments[0]))
        if path.startswith(under) and arguments[2] & os.O_ACCMODE == os.O_RDONLY:
            os.write(log, (path[len(under):] + "\\n").encode())

sys.addaudithook(hook)
"""
"""Put where Python looks for `sitecustomize`, it listens from the first to the last line."""


@dataclass(frozen=True)
class Carried:
    """What a command came to: its exit code and answer, and what was seen of it.

    `opened` says of each file of the folder how often it was opened to be read.
    `fallen` is how many moves fell onto heaps of numbers, `fallen_plainly` onto those of the
    reference.
    """

    code: int
    out: str
    opened: dict[str, int]
    fallen: int
    fallen_plainly: int

    @property
    def document(self) -> Any:
        """Return the answer of a command with ``--json``."""
        return json.loads(self.out)


def carried_out(folder: Path, commands: Sequence[Sequence[str]]) -> list[Carried]:
    """Carry out the commands, one after another, in the folder and in one process."""
    hidden = folder / ".hook"
    hidden.mkdir(exist_ok=True)
    (hidden / "sitecustomize.py").write_text(HOOK)
    log = hidden / "opened.log"
    log.write_text("")
    done = subprocess.run(
        [sys.executable, __file__],
        input=json.dumps(commands),
        capture_output=True,
        text=True,
        timeout=110,
        check=False,
        cwd=folder,
        env={
            **os.environ,
            "PYTHONPATH": str(hidden),
            "PYTHONDONTWRITEBYTECODE": "1",
            "MPLBACKEND": "Agg",
            "AUDITED_FOLDER": str(folder),
            "AUDITED_LOG": str(log),
        },
    )
    assert done.returncode == 0, done.stderr
    opened = [Counter(part.splitlines()) for part in log.read_text().split("#\n")[1:]]
    answers = json.loads(done.stdout)
    assert len(answers) == len(opened) == len(commands)
    return [
        Carried(opened=dict(names), **answer) for names, answer in zip(opened, answers, strict=True)
    ]


def _read_twice(path: str) -> int:
    """Do what no command may do: look into a file, and open it again to read it."""
    from cubepath.coordinator.commands.main import main

    Path(path).read_bytes()
    return main(["shorten", path, "--json"])


def _fall_twice(path: str) -> int:
    """Do what no command may do: shorten a path, and build its heap again for the certificate."""
    from cubepath.coordinator.normal_form.certificate import certificate_of
    from cubepath.coordinator.shortening.normal_path import shorten

    found = shorten(Path(path))
    certificate_of(found.given.actions)
    print(json.dumps(found.document()))
    return 0


OFFENCES = {"read-twice": _read_twice, "fall-twice": _fall_twice}
"""What must be seen, as if it were commands: their name, and a file."""


@contextlib.contextmanager
def _counting() -> Generator[Callable[[], tuple[int, int]]]:
    """Count the moves that fall onto heaps, until now."""
    from cubepath.coordinator.normal_form.array_heap import NumberedHeap
    from cubepath.coordinator.normal_form.heap import Heap

    numbered, plain = NumberedHeap.append, Heap.append
    fallen = [0, 0]

    def append_numbers(self: NumberedHeap, numbers: Any, **options: Any) -> Any:
        fallen[0] += len(numbers)
        return numbered(self, numbers, **options)

    def append(self: Heap, action: Any) -> None:
        fallen[1] += 1
        plain(self, action)

    NumberedHeap.append = append_numbers  # type: ignore[method-assign]
    Heap.append = append  # type: ignore[method-assign]
    yield lambda: (fallen[0], fallen[1])


def _main() -> None:
    from cubepath.coordinator.commands.main import main

    log = os.open(os.environ["AUDITED_LOG"], os.O_WRONLY | os.O_APPEND)
    answers: list[dict[str, object]] = []
    with _counting() as counted:
        for command in json.load(sys.stdin):
            os.write(log, b"#\n")
            before = counted()
            with contextlib.redirect_stdout(io.StringIO()) as out:
                name, *rest = command
                code = OFFENCES[name](*rest) if name in OFFENCES else main(command)
            now = counted()
            answers.append(
                {
                    "code": code,
                    "out": out.getvalue(),
                    "fallen": now[0] - before[0],
                    "fallen_plainly": now[1] - before[1],
                }
            )
    print(json.dumps(answers))


if __name__ == "__main__":
    _main()
