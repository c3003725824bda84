"""Rules from files of the user: ``FILE.py:NAME``, where NAME is a `RuleType`.

Room: agents.
"""

from __future__ import annotations

import sys
from functools import cache
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path

from cubepath.agents.rules.rule import RuleType
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.suggestions import did_you_mean

_SUFFIX = ".py"


def is_in_file(name: str) -> bool:
    """Return whether a rule's name is of the form FILE.py:NAME."""
    return name.rpartition(":")[0].endswith(_SUFFIX)


@cache
def rule_in_file(name: str) -> RuleType:
    """Return the rule FILE.py:NAME; InputError if there is none.

    The file is run once in a process, as a module of its own; it is not put on the search path.
    """
    file, _, wanted = name.rpartition(":")
    path = Path(file).resolve()
    spec = spec_from_file_location(f"cubepath_rule_{path.stem}", path)
    if spec is None or spec.loader is None or not path.is_file():
        raise InputError(f"{file}: no such file, expected FILE.py:NAME of a rule")
    module = module_from_spec(spec)
    sys.modules[spec.name] = module  # dataclasses and pickles look there
    try:
        spec.loader.exec_module(module)
    except (Exception, SystemExit) as error:
        text = " ".join(str(error).split())
        raise InputError(f"{file}: {type(error).__name__}: {text}") from error
    names = {key for key, value in vars(module).items() if isinstance(value, RuleType)}
    if wanted not in names:
        near = did_you_mean(wanted, sorted(names))
        held = ", ".join(sorted(names)) or "none"
        raise InputError(f"{file}: no rule {wanted!r}{near}, expected a RuleType, found {held}")
    rule: RuleType = getattr(module, wanted)
    return rule
