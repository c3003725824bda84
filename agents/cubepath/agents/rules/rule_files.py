"""Rules from files of the user: ``FILE.py:NAME``, where NAME is a `RuleType`."""

from __future__ import annotations

import sys
from collections.abc import Collection
from dataclasses import replace
from functools import cache
from hashlib import sha256
from importlib.machinery import SourceFileLoader
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path, PurePath
from types import CodeType

from cubepath.agents.rules.rule import RuleType
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.suggestions import did_you_mean

RULE_MODULE = "cubepath_rule_"
"""How the names of the modules begin that such files become."""
_SUFFIX = ".py"


class _AsRead(SourceFileLoader):
    """Runs a file as it was read; what Python compiled of it before may be of another text."""

    def __init__(self, name: str, path: Path, text: bytes) -> None:
        super().__init__(name, str(path))
        self._text = text

    def get_code(self, fullname: str) -> CodeType:  # noqa: ARG002 - there is one
        """Return the code of what was read."""
        return self.source_to_code(self._text, self.path)


def is_in_file(name: str) -> bool:
    """Return whether a rule's name is of the form FILE.py:NAME."""
    return name.rpartition(":")[0].endswith(_SUFFIX)


def permitted_rule(named: str, given: Collection[str] = ()) -> str:
    """Return the name under which to load a rule that an input names.

    An input can name any file, so a file runs only if you gave it: one of `given` is FILE.py:NAME
    with the same last part of the path, and stands for what the input names. InputError if none is.
    """
    if not is_in_file(named):
        return named
    for own in given:
        if stands_for(own, named):
            return own
    raise InputError(
        f"rule {named!r} is in a file, which does not run because an input names it, expected also"
        " --rule FILE.py:NAME"
    )


def stands_for(given: str, named: str) -> bool:
    """Return whether a rule that you give, FILE.py:NAME, is the one that an input names."""
    return is_in_file(named) and _without_folder(given) == _without_folder(named)


def check_rule_file(name: str) -> None:
    """Raise InputError unless a name is of the form FILE.py:NAME and that file is there."""
    file = Path(name.rpartition(":")[0])
    if not is_in_file(name):
        raise InputError(f"rule {name!r}: expected FILE.py:NAME of a rule in a file")
    if not file.is_file():
        raise InputError(f"{file}: no such file, expected FILE.py:NAME of a rule")


def _without_folder(name: str) -> tuple[str, str]:
    file, _, own = name.rpartition(":")
    return PurePath(file).name, own


@cache
def rule_in_file(name: str) -> RuleType:
    """Return the rule FILE.py:NAME; InputError if there is none.

    The file is run once in a process, as a module of its own, until `forget_rule_files`; it is not
    put on the search path. The `content` of the rule is that of the file, and its own.
    """
    file, _, wanted = name.rpartition(":")
    path = Path(file).resolve()
    try:
        text = path.read_bytes()
    except FileNotFoundError:
        raise InputError(f"{file}: no such file, expected FILE.py:NAME of a rule") from None
    except OSError as error:
        why = "is a folder" if path.is_dir() else f"cannot be read: {error.strerror or error}"
        raise InputError(f"{file}: {why}, expected FILE.py:NAME of a rule") from None
    title = f"{RULE_MODULE}{path.stem}"
    spec = spec_from_file_location(title, path, loader=_AsRead(title, path, text))
    if spec is None or spec.loader is None:
        raise InputError(f"{file}: no such file, expected FILE.py:NAME of a rule")
    module = module_from_spec(spec)
    sys.modules[spec.name] = module  # dataclasses and pickles look there
    try:
        spec.loader.exec_module(module)
    except (Exception, SystemExit) as error:
        why = " ".join(str(error).split())
        raise InputError(f"{file}: {type(error).__name__}: {why}") from error
    names = {key for key, value in vars(module).items() if isinstance(value, RuleType)}
    if wanted not in names:
        near = did_you_mean(wanted, sorted(names))
        held = ", ".join(sorted(names)) or "none"
        raise InputError(f"{file}: no rule {wanted!r}{near}, expected a RuleType, found {held}")
    rule: RuleType = getattr(module, wanted)
    return replace(rule, content=f"{sha256(text).hexdigest()} {rule.content}")


def forget_rule_files() -> None:
    """Run files of rules anew when they are asked for again: they may have been changed."""
    rule_in_file.cache_clear()
