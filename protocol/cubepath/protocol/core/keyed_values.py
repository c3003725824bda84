"""Names with keys, `name:key=value,...`: how scenes and plan formats are written on one line."""

from __future__ import annotations

from collections.abc import Mapping

from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.suggestions import did_you_mean

Keys = Mapping[str, tuple[str, str]]
"""The keys that a name may have, each with its default and one line on it."""


def given_values(text: str, keys: Keys, where: str) -> dict[str, str]:
    """Return the values after the colon of a name, by key, in the order given.

    Raises InputError, beginning with `where`, for a part that is not KEY=VALUE with one of the
    keys, and for a key that stands twice.
    """
    given: dict[str, str] = {}
    for part in text.split(",") if text else []:
        key, equals, value = part.partition("=")
        if not equals or key not in keys:
            known = f"KEY=VALUE with a key of {', '.join(keys)}" if keys else "no keys"
            near = did_you_mean(key, keys) if equals else ""
            raise InputError(f"{where}: cannot read {part!r}{near}, expected {known}")
        if key in given:
            raise InputError(f"{where}: key {key!r} stands twice")
        given[key] = value
    return given


def all_values(given: Mapping[str, str], keys: Keys) -> dict[str, str]:
    """Return the values of all keys, in the order of `keys`: the given ones, or the defaults."""
    return {key: given.get(key, default) for key, (default, _) in keys.items()}
