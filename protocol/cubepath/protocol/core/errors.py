"""Errors: one small family; each message says what was found, where, and what was expected."""


class CubepathError(Exception):
    """Base of all errors raised on purpose; the message is one line for the user."""


class InputError(CubepathError):
    """Input or usage that cannot be accepted (exit code 2)."""


class ExcludedError(InputError):
    """The generator is known, but there is no such action at that place.

    An obstacle is in the way, the workspace ends, or there is no such edge or move.
    """


class RuleError(CubepathError):
    """A rule did what no rule may do, or failed; the message names it and its module."""


class CheckError(CubepathError):
    """A check on something that was read or run did not hold (exit code 1)."""
