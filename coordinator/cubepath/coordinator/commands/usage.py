"""Parsing the command line: help and usage errors.

Every usage error is one line that says where to find help, and ends the command with exit code 2.
"""

import argparse
import contextlib
import math
import re
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, NoReturn

from cubepath.coordinator.commands.console import BAD_INPUT, complain, say
from cubepath.protocol.core.formatting import did_you_mean
from cubepath.protocol.core.options import OptionField, option_fields


class Parser(argparse.ArgumentParser):
    """A parser whose errors are one line with a suggestion, and whose help is an answer.

    Options cannot be abbreviated: a unique abbreviation today may be ambiguous tomorrow.
    """

    def __init__(self, **keywords: Any) -> None:
        super().__init__(**keywords, allow_abbrev=False)

    # The declared type is a set of overloads, which add nothing here.
    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:  # pyright: ignore[reportIncompatibleMethodOverride]
        """Read the words of a command; an unknown word is an error."""
        words: list[str] = list(sys.argv[1:] if args is None else args)
        self._check_options(words)
        found, others = super().parse_known_args(words, namespace)
        if others:
            unknown = next((word for word in others if word.startswith("-")), None)
            if unknown is not None:
                self._unknown_option(unknown)
            self.error(f"unexpected argument {others[0]!r}")
        return found, others

    def _check_options(self, words: Sequence[str]) -> None:
        """Look for unknown options first, since the words after one could be misread."""
        for word in words:
            if word == "--" or (self._subparsers is not None and not word.startswith("-")):
                return  # what follows is not an option, or one of a command
            name = word.partition("=")[0]
            if name.startswith("--") and name not in self._option_string_actions:
                self._unknown_option(name)

    def _unknown_option(self, word: str) -> NoReturn:
        name = word.partition("=")[0]
        self.error(f"unknown option {name}{did_you_mean(name, self._option_string_actions)}")

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        if action.choices is not None and value not in action.choices:
            what = "command" if action.dest is argparse.SUPPRESS else "value"
            names = list(map(str, action.choices))
            where = f"{'/'.join(action.option_strings)}: " if action.option_strings else ""
            message = f"{where}unknown {what} {value!r}{did_you_mean(str(value), names)}"
            self.error(f"{message}, expected one of {', '.join(names)}")

    def error(self, message: str) -> NoReturn:
        """Write the error in one line, and exit with code 2."""
        line = " ".join(message.split()).removeprefix("argument ")
        complain(f"{line}; see '{self.prog} --help'")
        self.exit(BAD_INPUT)

    def _print_message(self, message: str, file: Any = None) -> None:
        if file is sys.stdout:
            say(message, end="")
        else:
            super()._print_message(message, file)


def more_options(parser: argparse.ArgumentParser) -> Any:
    """Return the group of the options of a command that few need, which the help lists last."""
    return parser.add_argument_group("more options")


def add_fields(
    parser: Any, struct: type, *names: str, types: Mapping[str, Callable[[str], Any]] | None = None
) -> None:
    """Add options for fields of a dataclass; what is not given stays None.

    `types` has what reads the values of fields that are paths. A field whose `extra` has an
    `option` is called that on the command line.
    """
    for name in names:
        field = option_fields(struct)[name]
        about: dict[str, Any] = {"help": field.meta.description, **(field.meta.extra or {})}
        if field.kind is bool:
            about |= {"action": "store_const", "const": True}
        elif field.choices:
            about["choices"] = field.choices
        elif field.kind in {int, float}:
            about["type"] = _number_of(field)
        else:
            about["type"] = (types or {}).get(name, field.kind)
        parser.add_argument(f"--{about.pop('option', field.key)}", dest=name, **about)


def given(options: argparse.Namespace, names: Iterable[str]) -> dict[str, Any]:
    """Return which of these options were given, with their values."""
    found = {name: getattr(options, name) for name in names}
    return {name: value for name, value in found.items() if value is not None}


def _number_of(field: OptionField) -> Callable[[str], float]:
    """Return the type of an option whose value is a number within the bounds of a field."""
    whole_number = field.kind is int
    expected = f"a {'whole ' if whole_number else ''}number, {field.expected}"

    def read(text: str) -> float:
        with contextlib.suppress(ValueError):
            if not whole_number or _WHOLE.fullmatch(text):
                found = int(text) if whole_number else float(text)
                if field.fits(found):
                    return found
        raise argparse.ArgumentTypeError(f"expected {expected}, found {text!r}")

    return read


_WHOLE = re.compile(r"[+-]?\d{1,18}", re.ASCII)


def whole(least: int) -> Callable[[str], int]:
    """Return the type of an option whose value is an integer, `least` or more."""

    def read(text: str) -> int:
        # Python's own reading takes digits of every script, and underscores between them.
        found = int(text) if _WHOLE.fullmatch(text) else least - 1
        if found < least:
            raise argparse.ArgumentTypeError(
                f"expected a whole number of at least {least}, found {text!r}"
            )
        return found

    return read


def number(expected: str, fits: Callable[[float], bool]) -> Callable[[str], float]:
    """Return the type of an option whose value is a finite number for which `fits` is true."""

    def read(text: str) -> float:
        try:
            found = float(text)
        except ValueError:
            found = math.nan
        if not (math.isfinite(found) and fits(found)):
            raise argparse.ArgumentTypeError(f"expected {expected}, found {text!r}")
        return found

    return read


above_0 = number("a number above 0", lambda found: found > 0)


def add_topics(parser: Any, default: str = "all") -> None:
    """Add ``--topics`` and ``--exclude``, which say which messages are taken."""
    for name, what in (("topics", "take only"), ("exclude", "leave out")):
        more = f" (default: {default})" if name == "topics" else ""
        parser.add_argument(
            f"--{name}",
            action="append",
            default=[],
            metavar="GLOB",
            help=f"{what} messages whose topic KIND/SENDER, or whose kind, this matches, as"
            f" 'report*' or '*/process_3'; may be given again{more}",
        )


_MODULES = re.compile(r"\d{1,9}(-\d{1,9})?(,\d{1,9}(-\d{1,9})?)*", re.ASCII)
_MODULES_MAX = 1_000_000


def module_numbers(text: str) -> tuple[int, ...]:
    """Return the modules that an option names, in increasing order."""
    found: list[int] = []
    if _MODULES.fullmatch(text):
        for part in text.split(","):
            first, _, last = part.partition("-")
            count = int(last or first) - int(first) + 1
            if count < 1 or len(found) + count > _MODULES_MAX:
                break
            found += range(int(first), int(first) + count)
        else:
            if len(set(found)) == len(found):
                return tuple(sorted(found))
    raise argparse.ArgumentTypeError(f"expected numbers as 0-7,9, each once, found {text!r}")
