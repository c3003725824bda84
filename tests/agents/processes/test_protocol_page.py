"""The page of the protocol says what the code says: kinds, fields, values, reasons, the number."""

import re
from pathlib import Path
from typing import Any

import pytest

from cubepath.agents.processes.config import ProcessConfig
from cubepath.agents.processes.membership import PROTOCOL
from cubepath.protocol.wire.messages import KINDS
from cubepath.protocol.wire.on_record import schema_of

PAGE = (Path(__file__).parents[3] / "docs" / "protocol.md").read_text()
SPECIFICATION = PAGE.partition("## Specification")[2]
ROWS = re.findall(r"^\| (`[^|]*) \| (.*) \|$", SPECIFICATION, re.MULTILINE)
RECORDED = {"refused", "edges", "cube", "certificate", "summary"}
"""Kinds that are only on record."""
PARTS = {"presence", "note", "claim", "verdict", "report", "observation", "action"}


def names(text: str) -> set[str]:
    """Return what stands in backquotes."""
    return set(re.findall(r"`([\w ]+)`", text))


def row(first: str) -> str:
    """Return what the specification says of a name in the first column of a table."""
    found = [text for key, text in ROWS if first in names(key)]
    assert found, first
    return " ".join(found)


def values(schema: dict[str, Any]) -> set[str]:
    """Return the strings that a property may be, if they are listed."""
    return {each for each in schema.get("enum", ()) if isinstance(each, str)}


@pytest.mark.parametrize("kind", sorted(KINDS.keys() - RECORDED))
def test_the_page_has_all_fields_of_a_kind(kind: str) -> None:
    """And all values of those that have few."""
    found = schema_of(kind)["properties"]
    told = names(row(kind)) | ({"round", "module"} if kind in PARTS else set())
    assert found.keys() - {"kind"} <= told
    for field, schema in found.items():
        if field != "kind" and not (field == "phase" and kind == "retransmit"):
            assert values(schema) <= told, field


def test_the_page_has_all_orders() -> None:
    """Each field of the configuration has a row."""
    assert all(row(field) for field in ProcessConfig.__struct_fields__)


def test_the_page_has_the_reasons_of_refusals() -> None:
    """All of them, and no others."""
    table = SPECIFICATION.partition("### What is refused")[2].partition("###")[0]
    told = re.findall(r"^\| `([\w ]+)` \|", table, re.MULTILINE)
    assert sorted(told) == sorted(schema_of("refused")["properties"]["reason"]["enum"])


def test_the_page_has_the_number_of_the_protocol() -> None:
    """In the text, and in what is asked and answered."""
    assert f"This is protocol {PROTOCOL}." in SPECIFICATION
    assert re.findall(r'"protocol": (\d+)', SPECIFICATION) == [str(PROTOCOL)] * 2
