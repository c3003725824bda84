"""The command line, in this process or in its own with the standard streams that a test gives."""

import contextlib
import io
import os
import shlex
import subprocess
import sys
from pathlib import Path
from typing import Any

from cubepath.coordinator.commands.main import main

ROOT = Path(__file__).parents[2]
GOLDEN = ROOT / "logs" / "golden"
PYTHON = [sys.executable, "-W", "error", "-m", "cubepath.coordinator"]


def cubepath(*arguments: str | Path, **keywords: Any) -> subprocess.CompletedProcess[str]:
    """Run a command; its standard output and standard error are text."""
    given: dict[str, Any] = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE} | keywords
    return subprocess.run(
        [*PYTHON, *map(str, arguments)], text=True, timeout=100, check=False, **given
    )


def here(*arguments: str | Path, cwd: Path | None = None) -> subprocess.CompletedProcess[str]:
    """Run a command in this process, where the process is not what a test is about."""
    out, err = io.StringIO(), io.StringIO()
    with (
        contextlib.chdir(cwd or Path.cwd()),
        contextlib.redirect_stdout(out),
        contextlib.redirect_stderr(err),
    ):
        code = main([*map(str, arguments)])
    return subprocess.CompletedProcess(arguments, code, out.getvalue(), err.getvalue())


def refused(*arguments: str) -> str:
    """Run a command here, which must end with exit code 2; return the one line that it says."""
    with contextlib.redirect_stderr(io.StringIO()) as told:
        try:
            code: object = main(arguments)
        except SystemExit as stopped:
            code = stopped.code
    assert code == 2
    (line,) = told.getvalue().splitlines()
    return line


def in_shell(line: str, **keywords: Any) -> subprocess.CompletedProcess[str]:
    """Run a line of bash in which ``cubepath`` is the command."""
    given: dict[str, Any] = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE} | keywords
    path, python = map(
        shlex.quote, (str(Path(__file__).parent / "bin"), f"PYTHON={sys.executable}")
    )
    return subprocess.run(
        ["/bin/bash", "-c", f"export {python} PATH={path}:$PATH; {line}"],
        text=True,
        timeout=100,
        check=False,
        **given,
    )


def without_reader(*arguments: str | Path, **keywords: Any) -> subprocess.CompletedProcess[str]:
    """Run a command whose standard output is a pipe that nobody reads."""
    reading, writing = os.pipe()
    os.close(reading)
    try:
        return cubepath(*arguments, stdout=writing, **keywords)
    finally:
        os.close(writing)
