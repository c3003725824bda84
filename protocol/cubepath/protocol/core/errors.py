"""Errors: one small family; each message says what was found, where, and what was expected."""

from collections.abc import Generator
from contextlib import contextmanager

_MESSAGE_MAX = 2000
_BEGIN, _END = 1400, 500
"""Characters of a longer message that are kept: its end says what was expected."""


def bounded(message: str) -> str:
    """Return a message without its middle if it quotes more of an input than anybody reads.

    >>> bounded("generator 'slide': found 7"), len(bounded("x" * 50_000_000))
    ("generator 'slide': found 7", 1927)
    """
    if len(message) <= _MESSAGE_MAX:
        return message
    left_out = len(message) - _BEGIN - _END
    return f"{message[:_BEGIN]}...({left_out} characters)...{message[-_END:]}"


class CubepathError(Exception):
    """Base of all errors raised on purpose; the message is one line for the user.

    >>> try:
    ...     scene_from_spec("hex:n=none")
    ... except CubepathError as error:
    ...     print(type(error).__name__, error)
    InputError n=none: expected a whole number of at least 1, at most 100000
    """

    def __init__(self, message: str = "") -> None:
        """Take the message; the middle of a very long one is left out."""
        super().__init__(bounded(message))


class InputError(CubepathError):
    """Input or usage that cannot be accepted (exit code 2).

    >>> try:
    ...     scene_from_spec("hex:n=0")
    ... except InputError as error:
    ...     print(error)
    n=0: expected a whole number of at least 1, at most 100000
    """


@contextmanager
def errors_at(where: str) -> Generator[None]:
    """Put where it is before the message of an InputError that the block raises.

    >>> with errors_at("plan.json"):
    ...     raise InputError("found no move, expected some")
    Traceback (most recent call last):
        ...
    cubepath.protocol.core.errors.InputError: plan.json: found no move, expected some
    """
    try:
        yield
    except InputError as error:
        raise InputError(f"{where}: {error}") from None


class OptionError(InputError):
    """An option that cannot be accepted; the message begins with its name.

    The name has hyphens as on the command line, which puts two more in front of it.
    """


class ExcludedError(InputError):
    """The generator is known, but there is no such action at that place.

    An obstacle is in the way, the workspace ends, or there is no such edge or move.

    >>> scene_from_spec("agv:graph=C4,n=1").system.action("edge", (0, 2))
    Traceback (most recent call last):
        ...
    cubepath.protocol.core.errors.ExcludedError: generator edge: [0, 2] is no edge of the graph
    """


class RuleError(CubepathError):
    """A rule did what no rule may do, or failed; the message names it and its module.

    >>> def leap(observation, action_mask):
    ...     return 99
    >>> play("hex:n=3", policy_rule("leap", leap))
    Traceback (most recent call last):
        ...
    cubepath.protocol.core.errors.RuleError: rule 'leap', module_0: chose action 99, legal were ...
    """


class CheckError(CubepathError):
    """A check on something that was read or run did not hold (exit code 1).

    >>> with start("hex:n=3", log="logs/short.mcap", processes=0, max_rounds=2) as run:
    ...     run.until(lambda run: run.goal_reached)
    Traceback (most recent call last):
        ...
    cubepath.protocol.core.errors.CheckError: the run ended before that: max-rounds (...)
    """
