"""How a move is named outside a process: by its generator and where that is placed.

Messages, files and schedules use this form. `at` is a site as decoded from JSON, in which lists
stand for tuples; `cubepath.protocol.core.sites.site_from_json` makes it a site.
"""

from __future__ import annotations

from typing import Any, TypeAlias

import msgspec

Json: TypeAlias = Any
"""A site as decoded from JSON; `site_from_json` makes it a site again."""


class GeneratorPlacement(msgspec.Struct, frozen=True):
    """An action by the name of its generator and where it is placed."""

    generator: str
    at: Json


def schema_with_definitions(kind: type[msgspec.Struct]) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return the JSON Schema (2020-12) of an object, and by name the schemas that it refers to."""
    schema = msgspec.json.schema(kind)
    definitions: dict[str, Any] = schema.pop("$defs", {})
    name = str(schema.pop("$ref", "")).rpartition("/")[2]
    return definitions.pop(name, schema), definitions
