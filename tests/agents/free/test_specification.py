"""The page of the free clock says what the code says: kinds, parts and their fields."""

import re
from pathlib import Path
from typing import Any

import pytest

from cubepath.protocol.wire.free_messages import FREE_KINDS
from cubepath.protocol.wire.on_record import schema_of

PAGE = (Path(__file__).parents[3] / "docs" / "free-clock.md").read_text()
ROWS = {
    name: text
    for names, text in re.findall(
        r"^\| (`\w+`(?:, `\w+`)*) \| (.*) \|$", PAGE.partition("## Specification")[2], re.MULTILINE
    )
    for name in re.findall(r"\w+", names)
}


def parts(schema: dict[str, Any]) -> dict[str, dict[str, Any]]:
    """Return the parts of messages among the definitions of a schema, by their kinds."""
    found = {}
    for name, definition in schema.get("$defs", {}).items():
        (tag,) = definition.get("properties", {}).get("kind", {}).get("enum", [name.lower()])
        found[tag] = definition
    return found


PARTS = {kind: each for message in FREE_KINDS for kind, each in parts(schema_of(message)).items()}


@pytest.mark.parametrize("kind", sorted({*FREE_KINDS, *PARTS} - {"commit", "occupant"}))
def test_the_page_has_all_fields(kind: str) -> None:
    """Each message and each part has a row that names all of them."""
    schema = schema_of(kind) if kind in FREE_KINDS else PARTS[kind]
    told = set(re.findall(r"`(\w+)`", ROWS[kind]))
    assert schema["properties"].keys() - {"kind"} <= told


def test_the_page_has_the_fields_of_commits_and_occupants() -> None:
    """Both are parts of others too."""
    for kind, row in (("commit", "commit"), ("occupant", "entered")):
        told = set(re.findall(r"`(\w+)`", ROWS[row]))
        assert PARTS[kind]["properties"].keys() - {"kind"} <= told, kind


def test_the_page_names_no_other_kind() -> None:
    """Every row is one of a message or a part."""
    assert ROWS.keys() <= {*FREE_KINDS, *PARTS}, ROWS.keys() - {*FREE_KINDS, *PARTS}
