"""What a rule from elsewhere follows from: its files, and what it has learned."""

from __future__ import annotations

import inspect
import sys
from collections.abc import Iterator
from contextlib import suppress
from functools import cache, partial
from hashlib import sha256
from pathlib import Path

from cubepath.agents.rules.registry import BUILT_IN, find_rule
from cubepath.agents.rules.rule import RuleType
from cubepath.agents.rules.rule_files import RULE_MODULE, is_in_file
from cubepath.protocol.core.errors import InputError

_DIGITS = 16


def source_hash(rule: str) -> str:
    """Return a hash of all that a rule from elsewhere follows from; "" for built-in ones.

    That is its `content`, which has the file of FILE.py:NAME, and the files in which the functions
    and the policy are that it is made of; it is of what was loaded, whatever is there now.
    InputError if there is no such rule.
    """
    if rule in BUILT_IN:
        return ""
    found = find_rule(rule)
    if found is None:
        raise InputError(f"unknown rule {rule!r}")
    own = Path(rule.rpartition(":")[0]).resolve() if is_in_file(rule) else None
    others = {_file_hash(path) for path in _files(found) if path != own}
    told = " ".join([found.content, *sorted(others)])
    return sha256(told.encode()).hexdigest()[:_DIGITS]


@cache
def _file_hash(path: Path) -> str:
    """Return the hash of a file when it was first asked for; modules are loaded once, too."""
    return sha256(path.read_bytes()).hexdigest()


def _files(rule: RuleType) -> set[Path]:
    """Return the files of code that a rule is made of, but for those that it imports."""
    parts: list[object] = [rule.make, rule.fits, rule.note_length, rule.vectorised]
    if rule.free is not None:
        parts += [rule.free.make, rule.free.note_length]
    found: set[Path] = set()
    for part in parts:
        while isinstance(part, partial):
            part = part.func  # noqa: PLW2901
        found |= {path.resolve() for path in _files_of(part) if path.is_file()}
    return found


def _files_of(part: object) -> Iterator[Path]:
    """Yield the file in which a function, or the class of an object, is, and that of its module.

    They differ for a policy: it has its own module, and what makes a rule of it its own file.
    """
    if part is None:
        return
    code = inspect.unwrap(part) if callable(part) else part
    for held in (code, type(code)):
        with suppress(TypeError, OSError):
            yield Path(inspect.getsourcefile(held) or "")  # type: ignore[arg-type]
            break
    name = getattr(part, "__module__", None) or ""
    file = getattr(sys.modules.get(name), "__file__", None)
    # Modules of files of rules are told apart by their files, which `content` has.
    if file and not name.startswith(RULE_MODULE):
        yield Path(file)
