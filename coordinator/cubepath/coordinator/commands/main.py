"""The command line: ``cubepath run | shorten | verify | log info | ...``.

Standard output carries the answer, standard error everything else. Exit codes: 0 done, 1 a check
failed, memory or a disk was full, or the answer could not be written, 2 bad input or usage, 130
interrupted with the recording closed, 141 the reader of the answer closed the pipe.
"""

import argparse
import errno
import logging
import resource
import sys
from collections.abc import Callable, Mapping, Sequence

from cubepath.coordinator.commands import console
from cubepath.coordinator.commands.usage import Parser
from cubepath.coordinator.plugins import COMMANDS, GROUPS, add_options_of
from cubepath.protocol.core.errors import CubepathError, InputError, OptionError


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command; return its exit code."""
    # Silence the warning about where matplotlib keeps its caches if the home folder is read-only.
    logging.getLogger("matplotlib").setLevel(logging.ERROR)
    with console.Interrupts() as interrupts:
        code = _guarded(arguments, interrupts)
    if interrupts.came and code != console.INTERRUPTED:
        console.complain("interrupted")
        return console.INTERRUPTED
    return code


def _guarded(arguments: Sequence[str] | None, interrupts: console.Interrupts) -> int:
    """Carry out the command; turn an error into one line and an exit code."""
    options = argparse.Namespace(smaller="a smaller input", interrupts=interrupts)
    try:
        console.prepare_streams()
        given = sys.argv[1:] if arguments is None else arguments
        _parser(*given[:2]).parse_args(given, options)
        command: Callable[[argparse.Namespace], int] = options.command
        return command(options)
    except InputError as error:
        console.complain(f"--{error}" if isinstance(error, OptionError) else error)
        return console.BAD_INPUT
    except BrokenPipeError:
        return console.CLOSED_PIPE
    except (CubepathError, OSError, MemoryError) as error:
        console.complain(_reason(error, options.smaller))
        return console.FAILED
    except KeyboardInterrupt:
        console.complain("interrupted")
        return console.INTERRUPTED
    except Exception:
        # An interrupt during compilation may surface as another exception.
        if interrupts.came:
            return console.FAILED
        raise


def _reason(error: Exception, smaller: str) -> object:
    """Return what to say of an error; the system's own words are short of what helps."""
    if isinstance(error, MemoryError):
        return f"out of memory: expected more of it, or {smaller}"
    if isinstance(error, OSError) and error.errno == errno.EMFILE:
        most = resource.getrlimit(resource.RLIMIT_NOFILE)[0]
        return f"too few open files are allowed: {most}, expected more (ulimit -n)"
    return error


def _parser(first: str = "", second: str = "") -> argparse.ArgumentParser:
    """Return a parser of the command line, in which only the called command has its options."""
    parser = Parser(
        prog="cubepath",
        description="Modules of a metamorphic robot reconfigure by messages over zenoh; their path"
        " is shortened to the fastest parallel schedule in its homotopy class.",
    )
    parser.add_argument(
        "--version", action=_Version, nargs=0, help="show program's version number and exit"
    )
    parsers = _add_names(
        parser,
        {
            name.partition(" ")[0]: GROUPS.get(name.partition(" ")[0], summary)
            for name, (_, summary) in COMMANDS.items()
        },
    )
    called = first
    if first in GROUPS:
        inside = {
            name.partition(" ")[2]: summary
            for name, (_, summary) in COMMANDS.items()
            if name.startswith(f"{first} ")
        }
        called = f"{first} {second}"
        parsers = {
            f"{first} {name}": each for name, each in _add_names(parsers[first], inside).items()
        }
    if called in COMMANDS:
        parsers[called].add_argument(
            "--json", action="store_true", help="answer with one JSON document"
        )
        add_options_of(called)(parsers[called])
    return parser


def _add_names(
    parser: argparse.ArgumentParser, summaries: Mapping[str, str]
) -> dict[str, argparse.ArgumentParser]:
    """Add commands by their names alone; without any of them the command is to list them."""

    def list_them(_options: argparse.Namespace) -> int:
        parser.print_help()
        return console.DONE

    parser.set_defaults(command=list_them)
    commands = parser.add_subparsers(metavar="COMMAND")
    return {
        name: commands.add_parser(name, help=summary, description=summary)
        for name, summary in summaries.items()
    }


class _Version(argparse.Action):
    """Prints the version, which takes time to look up."""

    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> None:
        from importlib.metadata import version  # noqa: PLC0415

        console.say(f"cubepath {version('cubepath')}")
        parser.exit()
