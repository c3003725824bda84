"""Parameters of which a few are tried every time, and the others when there is time."""

from collections.abc import Container, Iterable
from typing import Any

import pytest


def some(values: Iterable[Any], few: Container[Any]) -> list[Any]:
    """Return parameters that are marked as thorough unless they are among the few."""
    return [
        each if each in few else pytest.param(each, marks=pytest.mark.thorough) for each in values
    ]


def all_but(values: Iterable[Any], nightly: Container[Any]) -> list[Any]:
    """Return parameters, of which some are marked as nightly."""
    marked = pytest.mark.nightly
    return [pytest.param(each, marks=marked) if each in nightly else each for each in values]
