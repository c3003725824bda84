"""The commands that begin a distribution: ``cubepath rule new`` and ``cubepath system new``.

They write the files in ``templates``, with the name filled in.
"""

import argparse
import keyword
import os
import re
import shutil
import sys
from importlib.resources import files
from importlib.util import find_spec
from pathlib import Path
from string import Template
from tempfile import mkdtemp

from cubepath.coordinator.commands.console import DONE, answer
from cubepath.coordinator.commands.files import add_out
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.formatting import visible
from cubepath.protocol.core.output_files import unwritable, written_whole

_TEMPLATES = files("cubepath.coordinator.commands") / "templates"
_NAME = re.compile(r"[A-Za-z](?:[A-Za-z0-9_]*[A-Za-z0-9])?")
"""An identifier of Python that is also the name of a distribution, with "-" for "_"."""


def add_rule_new(parser: argparse.ArgumentParser) -> None:
    """Add the options of ``rule new``."""
    _add_new(parser, "rule")


def add_system_new(parser: argparse.ArgumentParser) -> None:
    """Add the options of ``system new``."""
    _add_new(parser, "system")


def _add_new(new: argparse.ArgumentParser, kind: str) -> None:
    new.set_defaults(command=_new, kind=kind)
    page = ", or NAME.toml for a system on a page" if kind == "system" else ""
    new.add_argument("name", metavar="NAME", help=f"its name, an identifier of Python{page}")
    add_out(new, "DIR", "the new folder (default: NAME)", folder=True)


def _new(options: argparse.Namespace) -> int:
    if options.kind == "system" and options.name.endswith(".toml"):
        return _new_page(options)
    folder = options.out or Path(options.name)
    written = new_distribution(options.kind, options.name, folder)
    document = {"kind": options.kind, "name": options.name, "folder": str(folder), "files": written}
    where = visible(str(folder))
    text = "\n".join(
        [f"{where}/{name}" for name in written]
        + [f"install and test it: cd {where} && pip install -e '.[test]' && python -m pytest"]
    )
    answer(options, document, text)
    return DONE


def _new_page(options: argparse.Namespace) -> int:
    """Write a page that runs, to begin with."""
    path = Path(options.name)
    if options.out is not None:
        raise InputError("--out: is the folder of a distribution, expected none with a page")
    if os.path.lexists(path):
        raise InputError(f"{path}: exists already, expected a new file")
    text = (_TEMPLATES / "system_page.template").read_text("utf-8")
    with written_whole(path) as file:
        file.write(text.encode())
    where = visible(str(path))
    lines = [where, f"try it: cubepath system check {where} && cubepath run {where}"]
    document = {"kind": "page", "name": path.stem, "folder": str(path.parent), "files": [path.name]}
    answer(options, document, "\n".join(lines))
    return DONE


def new_distribution(kind: str, name: str, folder: Path) -> list[str]:
    """Write a distribution with a rule or a system into a new folder; return its files.

    All of it is written, or nothing. InputError if the name cannot be one, if there is such a rule,
    system or module already, or if the folder exists or cannot be made.
    """
    _check_name(kind, name)
    if os.path.lexists(folder):
        raise InputError(f"{folder}: exists already, expected a new folder")
    texts = _texts(kind, name)
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        made = Path(mkdtemp(prefix=f".{folder.name}.", dir=folder.parent))
        try:
            for path, text in texts.items():
                (made / path).parent.mkdir(exist_ok=True)
                (made / path).write_text(text, "utf-8")
            made.chmod(0o755)  # as any folder, and not that of one user
            made.rename(folder)
        except BaseException:
            shutil.rmtree(made, ignore_errors=True)
            raise
    except OSError as error:
        raise unwritable(folder, error) from None
    return sorted(texts)


def _check_name(kind: str, name: str) -> None:
    if keyword.iskeyword(name):
        raise InputError(f"{name!r} is a keyword of Python, expected another name")
    if not _NAME.fullmatch(name):
        raise InputError(
            f"{name!r}: expected an identifier of Python as a name, such as my_{kind}, of letters,"
            " digits and _ between them"
        )
    if _is_known(kind, name):
        raise InputError(f"{kind} {name!r} exists already, expected another name")
    if name in sys.stdlib_module_names or find_spec(name) is not None:
        raise InputError(f"{name!r} is a module of Python already, expected another name")


def _is_known(kind: str, name: str) -> bool:
    if kind == "system":
        from cubepath.protocol.scenes.registry import all_families  # noqa: PLC0415 - loads numpy

        return name in all_families()
    from cubepath.agents.rules.registry import rules  # noqa: PLC0415 - loads all rules

    return name in rules()


def _texts(kind: str, name: str) -> dict[str, str]:
    """Return the files by their paths in the folder."""
    filled = {
        "kind": kind,
        "what": f"The {kind} {name}",
        "name": name,
        "constant": name.upper(),
        "distribution": name.lower().replace("_", "-"),
    }
    sources = {
        "pyproject.toml": "pyproject.toml",
        "README.md": f"{kind}_readme",
        f"{name}.py": f"{kind}_module",
        f"tests/test_{name}.py": f"{kind}_tests",
    }
    return {
        path: Template((_TEMPLATES / f"{source}.template").read_text("utf-8")).substitute(filled)
        for path, source in sources.items()
    }
