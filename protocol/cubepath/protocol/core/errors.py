"""Errors: one small family; each message says what was found, where, and what was expected."""


class CubepathError(Exception):
    """Base of all errors that are raised on purpose; its text is one line for a person."""


class InputError(CubepathError):
    """Input or usage that cannot be accepted (exit code 2)."""


class ExcludedError(InputError):
    """The generator is known, but there is no such action at that place.

    An obstacle is in the way, or the workspace ends, or no such edge or move is there.
    """


class RuleError(CubepathError):
    """A rule did what a rule may not do, or failed itself; the text names it and its module."""


class CheckError(CubepathError):
    """A check on something that was read or run did not hold (exit code 1)."""
