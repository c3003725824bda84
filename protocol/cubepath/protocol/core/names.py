"""How a move is named from outside: by its generator and where that is placed.

So it stands in messages, in files and in schedules. `at` is a site as decoded from JSON, in which
lists stand for tuples; `cubepath.protocol.core.sites.site_from_json` makes it a site.
"""

from __future__ import annotations

from typing import Any, TypeAlias

import msgspec

Json: TypeAlias = Any
"""A site as decoded from JSON; `site_from_json` makes it a site again."""


class GeneratorPlacement(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """An action by the name of its generator and where it is placed."""

    generator: str
    at: Json
