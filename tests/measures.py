"""How heavy the project is: lines, files, names, commands, what commands import, words, tests.

    python tests/measures.py [--json]

Lines are those of files as they stand, comments and blank lines included. The core is all but
`theory` and `tools` of the coordinator. Commands and options are those of the parsers that
``--help`` shows; what a command imports is what is loaded in its own process when it ends.
"""

import argparse
import ast
import contextlib
import importlib
import json
import re
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Iterable, Sequence
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any
from unittest import mock

from cubepath.protocol import Action, PathMove, write_moves
from faces import FACES, LARGE, ROOT

SOURCES = [ROOT / large / "cubepath" for large in LARGE]
BESIDE_THE_CORE = ("cubepath/coordinator/theory/", "cubepath/coordinator/tools/")
_RUN = """
import sys
from importlib.metadata import entry_points
main = next(iter(entry_points(group="console_scripts", name="cubepath"))).load()
out, sys.argv[1:] = sys.argv[1], sys.argv[2:]
code = main()
files = [getattr(module, "__file__", None) for module in list(sys.modules.values())]
open(out, "w").write("\\n".join(filter(None, files)))
sys.exit(code)
"""


def lines(paths: Iterable[Path]) -> int:
    """Return how many lines files have together."""
    return sum(path.read_bytes().count(b"\n") for path in paths)


def source(*suffixes: str) -> list[Path]:
    """Return the source files with these endings."""
    found = [path for root in SOURCES for path in root.rglob("*") if path.suffix in suffixes]
    return sorted(path for path in found if "__pycache__" not in path.parts)


def public_classes() -> Counter[str]:
    """Return how often each name of a public class is defined at the top of a module."""
    return Counter(
        statement.name
        for path in source(".py")
        for statement in ast.parse(path.read_bytes()).body
        if isinstance(statement, ast.ClassDef) and not statement.name.startswith("_")
    )


def parser_of(words: Sequence[str]) -> argparse.ArgumentParser:
    """Return the parser that shows the help of a command."""
    shown: list[argparse.ArgumentParser] = []

    def note(parser: argparse.ArgumentParser, _file: Any = None) -> None:
        shown.append(parser)

    main = next(iter(entry_points(group="console_scripts", name="cubepath"))).load()
    with (
        mock.patch.object(argparse.ArgumentParser, "print_help", note),
        contextlib.suppress(SystemExit),
    ):
        main([*words, "--help"])
    return shown[0]


def commands(words: tuple[str, ...] = ()) -> tuple[list[tuple[str, ...]], set[str]]:
    """Return the leaves below a command, and the distinct options of all of them."""
    leaves, options = list[tuple[str, ...]](), set[str]()
    inside: list[str] = []
    for action in parser_of(words)._actions:
        options |= {name for name in action.option_strings if name.startswith("--")}
        if isinstance(action, argparse._SubParsersAction):
            inside = list(action.choices)
    for name in inside:
        below, others = commands((*words, name))
        leaves, options = leaves + below, options | others
    return (leaves if inside else [words]), options - {"--help", "--version"}


def imported(*arguments: str) -> int:
    """Return how many of our lines the process of a command has loaded when it ends."""
    with tempfile.TemporaryDirectory() as folder:
        moves, out = Path(folder, "moves.jsonl"), Path(folder, "loaded")
        step = Action([1, 2], [1, 2], [1], [2])
        write_moves(moves, [PathMove(step, "a", frozenset([1]))])
        command = [sys.executable, "-c", _RUN, str(out), *arguments]
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
        if done.returncode:
            sys.exit(done.stderr)
        loaded = {Path(line) for line in out.read_text("utf-8").splitlines()}
    return lines(path for path in loaded if any(root in path.parents for root in SOURCES))


def spine() -> list[Path]:
    """Return the files that the section on the spine in CONTRIBUTING.md names, in their order."""
    text = (ROOT / "CONTRIBUTING.md").read_text("utf-8")
    found = re.search(
        r"^#+ [^\n]*\bspine\b.*?(?=^#+ |\Z)", text, re.DOTALL | re.MULTILINE | re.IGNORECASE
    )
    names = re.findall(r"[\w/]+\.py\b", found[0]) if found else []
    files = source(".py")
    return [
        next(path for path in files if path.as_posix().endswith(f"/{name}"))
        for name in dict.fromkeys(names)
    ]


def words(paths: Iterable[Path]) -> int:
    """Return how many words files have together, as ``wc -w`` counts them."""
    return sum(len(path.read_text("utf-8").split()) for path in paths)


def measured() -> dict[str, float | None]:
    """Return each measure by its name; None if there is nothing to measure."""
    code = source(".py", ".pyi", ".template")
    classes = [count for count in public_classes().values() if count > 1]
    names = [set(importlib.import_module(face).__all__) for face in FACES[:3]]
    leaves, options = commands()
    pages, vertebrae = sorted((ROOT / "docs").glob("**/*.md")), spine()
    pages = [page for page in pages if "examples" not in page.parts]
    return {
        "lines of source": lines(code),
        "source files": len(source(".py", ".pyi")),
        "lines of protocol, agents and the coordinator's core": lines(
            path for path in code if not any(each in path.as_posix() for each in BESIDE_THE_CORE)
        ),
        "public names of the three faces": sum(map(len, names)),
        "public names for tests": sum(
            len(importlib.import_module(face).__all__) for face in FACES[3:]
        ),
        "public class names that stand more than once": len(classes),
        "public classes of these names": sum(classes),
        "commands at the top": len({leaf[0] for leaf in leaves}),
        "commands with those inside others": len(leaves),
        "distinct options": len(options),
        "our lines imported by shorten": imported("shorten", "moves.jsonl"),
        "our lines imported by run": imported("run", "hex:n=3", "--log", "run.mcap"),
        "words of README": words([ROOT / "README.md"]),
        "words of docs": words(pages),
        "pages of docs": len(pages),
        "lines of tests": lines((ROOT / "tests").rglob("*.py")),
        "files of the spine": len(vertebrae) or None,
        "lines of the spine": lines(vertebrae) or None,
        "mean lines of a file of the spine": lines(vertebrae) / len(vertebrae)
        if vertebrae
        else None,
    }


def main() -> None:
    """Print the measures as a table or as one JSON document."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--json", action="store_true", help="print one JSON document")
    found = measured() if (asked := parser.parse_args()) else {}
    if asked.json:
        print(json.dumps(found, indent=2))
        return
    for name, value in found.items():
        print(f"{name:54}{'-' if value is None else f'{value:,.0f}':>8}")


if __name__ == "__main__":
    main()
