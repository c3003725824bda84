"""A page's code blocks, pasted one after another into a folder as a reader would paste them.

What stands behind the language of a block says what is done with it:

| block | is |
|---|---|
| ``sh`` | run, and every command must succeed |
| ``console`` | run after each ``$``; what it prints, on both streams, must be what stands below |
| ``python`` | executed in the page's one namespace |
| ``LANGUAGE NAME`` | written to the file NAME, which a later block must read |
| ``LANGUAGE -> NAME`` | what is now in that file |
| ``LANGUAGE ->`` | what the block before it has printed; of JSON, the document |
| ``json -> .KEY`` | what its JSON has under that key |

A shell block is run by bash, with the real command line; but one that has only commands of
cubepath, each of which ends by itself, is run here, which spares each of them half a second of
imports. Such a block may set variables, as in ``LOG=run.mcap``, and have several commands a line.
Times and names of logs are not compared, and ``...`` stands for any text.
"""

import contextlib
import io
import json
import os
import re
import shlex
import shutil
import sys
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import groupby
from pathlib import Path
from typing import Any

from cubepath.coordinator.commands.main import main
from processes.command_line import GOLDEN, ROOT, in_shell

BLOCK = re.compile(r"^( *)```(.*)\n((?:.*\n)*?)\1```$", re.MULTILINE)
ENDLESS = ("host", "join")
"""Commands that may wait for others."""
TIMES = (
    (r"\d+\.\d+ s\b", "0 s"),
    (r"\d{8}T\d{12}", "WHEN"),
    (r'"seconds": ?[\d.e-]+', '"seconds": 0'),
)


@dataclass(frozen=True)
class Block:
    """A code block: its language, what stands behind that, its text, and its line in the page."""

    language: str
    name: str
    text: str
    line: int


def blocks(page: Path) -> list[Block]:
    """Return all code blocks of a page, in order, without directives of the site: ```{NAME}."""
    found = []
    text = page.read_text("utf-8")
    for match in BLOCK.finditer(text):
        indent, info, inside = match.groups()
        language, _, name = info.strip().partition(" ")
        if language.startswith("{"):
            continue
        plain = re.sub(f"^{indent}", "", inside, flags=re.MULTILINE)
        found.append(Block(language, name, plain, text.count("\n", 0, match.start()) + 1))
    return found


@dataclass
class Desk:
    """The folder that a page is pasted into, and what the blocks so far have left."""

    folder: Path
    left_out: Mapping[str, str]
    """Pieces of shell that are not run, with the reason."""
    shown: Mapping[str, str]
    """First lines of blocks that are only shown, with the reason."""
    names: dict[str, Any] = field(default_factory=lambda: {"__name__": "page"})
    printed: str = ""
    unread: set[str] = field(default_factory=set[str])
    excused: set[str] = field(default_factory=set[str])
    installed: bool = False
    """Something was, which this process may have looked for before."""

    def __post_init__(self) -> None:
        """Put into the folder what a clone has and pages read."""
        for name in ("tests", "docs"):
            (self.folder / name).symlink_to(ROOT / name)
        shutil.copytree(GOLDEN, self.folder / "logs" / "golden")

    def paste(self, block: Block) -> None:
        """Do with a block what it is there for; AssertionError where that is nothing."""
        first = block.text.partition("\n")[0]
        if first in self.shown:
            self.excused.add(first)
        elif block.name.startswith("->"):
            self._compare(block.name.removeprefix("->").strip(), block)
        elif block.name:
            self._write(block.name, block.text)
        elif block.language in ("sh", "console", "python"):
            self.unread = {name for name in self.unread if name not in self._read_by(block)}
            getattr(self, f"_{block.language}")(block.text)
        else:
            raise AssertionError(
                f"a {block.language} block is neither a file nor an output: {first}"
            )

    def _read_by(self, block: Block) -> str:
        """Return the text that may name a file: a module is named without its suffix."""
        if block.language != "python":
            return block.text + ("pyproject.toml" if "pip install -e ." in block.text else "")
        return block.text + re.sub(r"from (\w+) import", r"\1.py", block.text)

    def _write(self, name: str, text: str) -> None:
        path = self.folder / name
        path.write_text(text, "utf-8")
        self.unread.add(name)
        if name == "pyproject.toml":
            self._install(tomllib.loads(text)["project"])

    def _install(self, project: dict[str, Any]) -> None:
        """Do what ``pip install -e .`` does: note the entry points where Python looks for them."""
        self.installed = True
        info = self.folder / f"{project['name'].replace('-', '_')}-{project['version']}.dist-info"
        info.mkdir()
        (info / "METADATA").write_text(
            f"Metadata-Version: 2.1\nName: {project['name']}\nVersion: {project['version']}\n"
        )
        lines = [
            f"[{group}]\n" + "".join(f"{name} = {value}\n" for name, value in entries.items())
            for group, entries in project["entry-points"].items()
        ]
        (info / "entry_points.txt").write_text("".join(lines))

    def _without(self, text: str) -> str:
        for piece in self.left_out:
            if piece in text:
                self.excused.add(piece)
                text = text.replace(piece, "")
        return text

    def _bash(self, text: str) -> tuple[int, str, str]:
        before = [str(Path(sys.executable).parent), os.environ["PATH"]]
        environment = os.environ | {"PATH": os.pathsep.join(before), "PYTHONPATH": str(self.folder)}
        done = in_shell(text, cwd=self.folder, env=environment)
        return done.returncode, done.stdout, done.stderr

    def _sh(self, text: str) -> None:
        text = self._without(text)
        if not self.installed and (commands := simple_commands(text)) is not None:
            self._run_here(commands)
            return
        tidy = "trap 'kill $(jobs -p) 2>/dev/null || :' EXIT"  # what a block that fails has begun
        code, self.printed, told = self._bash(f"set -eo pipefail; {tidy}\n{text}")
        assert code == 0, told

    def _run_here(self, commands: list[list[str]]) -> None:
        self.printed = ""
        for command in commands:
            printed, told = (io.TextIOWrapper(io.BytesIO(), "utf-8") for _ in range(2))
            with (
                contextlib.chdir(self.folder),
                contextlib.redirect_stdout(printed),
                contextlib.redirect_stderr(told),
            ):
                code = main(command[1:])
            self.printed += _content(printed)
            assert code == 0, _content(told)

    def _console(self, text: str) -> None:
        parts = re.split(r"^\$ (.*)\n", text, flags=re.MULTILINE)
        assert parts[0] == "", "a console block begins with a command"
        script = [f"exec 2>&1; {parts[1]}"]
        script += [f"code=$?; printf '\\0'; (exit $code); {line}" for line in parts[3::2]]
        _, printed, _ = self._bash("\n".join(script))
        for command, wanted, found in zip(
            parts[1::2], parts[2::2], printed.split("\0"), strict=True
        ):
            assert same_text(found, wanted), f"{command}\n{found}"

    def _python(self, text: str) -> None:
        printed = io.StringIO()
        code = compile(text, "example", "exec", dont_inherit=True)
        with contextlib.redirect_stdout(printed):
            exec(code, self.names)  # noqa: S102 - our own documentation
        self.printed = printed.getvalue()

    def _compare(self, name: str, block: Block) -> None:
        if name and not name.startswith("."):
            found = (self.folder / name).read_text("utf-8")
        else:
            found = self.printed
        if block.language != "json":
            assert same_text(found, block.text), found
            return
        document = json.loads(timeless(found))
        wanted = json.loads(timeless(block.text))
        shown = document[name[1:]] if name.startswith(".") else document
        assert shown == wanted, json.dumps(shown)


def simple_commands(text: str) -> list[list[str]] | None:
    """Return the commands of a block, None where it takes a shell or processes of their own."""
    variables: dict[str, str] = {}
    commands: list[list[str]] = []
    for line in text.replace("\\\n", " ").splitlines():
        words = shlex.shlex(line, posix=True, punctuation_chars=True)
        words.whitespace_split = True
        for end, several in groupby(words, lambda word: word == ";"):
            command = [variables.get(word, word) for word in several]
            assigned = re.fullmatch(r"(\w+)=(\S+)", command[0])
            if assigned and len(command) == 1:
                variables[f"${assigned[1]}"] = assigned[2]
            elif not end:
                commands.append(command)
    plain = all(
        command[0] == "cubepath"
        and command[1] not in ENDLESS
        and not re.search(r"[$|<>&()`\\]", "".join(command))
        for command in commands
    )
    return commands if plain else None


def _content(stream: io.TextIOWrapper) -> str:
    stream.flush()
    found = stream.buffer
    assert isinstance(found, io.BytesIO)
    return found.getvalue().decode()


def timeless(text: str) -> str:
    """Return a text without what differs from run to run."""
    for pattern, shown in TIMES:
        text = re.sub(pattern, shown, text)
    return text


def same_text(found: str, wanted: str) -> bool:
    """Tell whether an output is what a page shows, where ``...`` is any text."""
    pattern = re.escape(timeless(wanted).rstrip("\n")).replace(re.escape("..."), ".*")
    return re.fullmatch(pattern, timeless(found).rstrip("\n"), re.DOTALL) is not None
