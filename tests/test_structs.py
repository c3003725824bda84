"""Every struct that becomes JSON: no field is lost, or read by a name that it does not have."""

import json
from typing import Any

import msgspec
import pytest

from cubepath.protocol.core.sites import site_hook
from cubepath.protocol.recordings.description import BATCHES
from cubepath.protocol.wire.free_messages import FREE_KINDS
from cubepath.protocol.wire.messages import KINDS
from cubepath.protocol.wire.on_record import parts_in, schema_of
from filled import TEXT, all_structs, filled

IN_MEMORY = {
    *("Status of asking", "TappedMessage of listeners"),
    *(f"{effect} of nodes" for effect in ("End", "Ignore", "Keep", "Listen", "Put", "Timer")),
}
"""What never leaves its process, and may hold what is no JSON."""
ALL = {f"{each.__name__} of {each.__module__.rpartition('.')[2]}": each for each in all_structs()}
OPEN = {
    *("messages", "free_messages", "membership", "asking"),
    "GeneratorPlacement of catalogue",
    *("PlayerStatus of machine", "Position of machine", "Refusal of machine"),
    *("KindCount of description", "_Part of description", "_Batch of description"),
    *("cgshop2021", "cgshop2026", "_Other of certificates"),
    *(f"{name} of pathfinder" for name in ("_Move", "_MoveFile", "_Module", "_Configuration")),
    *(
        "_FreeHead of losses",
        "Head of losses",
        "_Rounded of stored_messages",
        "_Numbered of timeline",
    ),
}
"""What takes fields that are not known, by module or name.

That is what is said over the network, where other versions may say more; the counts at the end of a
recording; plans by other programs; and what is read of something in part.
"""
CHECKED = {"Generator of catalogue", "_LatticeTable of lattice"}
"""Structs whose fields must fit one another; scenes read them again, with other values in each."""
WRITTEN = sorted(ALL.keys() - IN_MEMORY)
MESSAGES: dict[str, type[msgspec.Struct]] = {**KINDS, **FREE_KINDS}
READ_IN_PART: dict[str, dict[str, str]] = {
    "Head of losses": {
        "bundle": "round phase region number process",
        "ready": "round phase sent process",
        "reports": "round process",
    },
    "_FreeHead of losses": dict.fromkeys(
        ("requests", "forwards", "replies", "tile", "turns", "halted", "commits"),
        "incarnation sequence",
    ),
    "_Rounded of stored_messages": dict.fromkeys(KINDS, "round"),
    "_Numbered of timeline": {**dict.fromkeys(KINDS, "round"), "commit": "level"},
}
"""Structs that take some fields out of messages: from which kinds, and which fields."""


def keys_in(value: Any) -> set[str]:
    """Return the keys of objects in a JSON value, but for those that are data themselves."""
    if isinstance(value, dict):
        own = {key for key in value if not key.startswith(TEXT)}
        return own.union(*map(keys_in, value.values()))
    return set[str]().union(*map(keys_in, value)) if isinstance(value, list) else set()


def properties_in(schema: Any) -> set[str]:
    """Return the names of all properties in a JSON Schema."""
    inner = schema.values() if isinstance(schema, dict) else schema
    own = schema.get("properties", ()) if isinstance(schema, dict) else ()
    return {*own}.union(*(properties_in(each) for each in inner if isinstance(each, dict | list)))


@pytest.mark.parametrize("name", sorted({*WRITTEN} - CHECKED))
def test_a_struct_is_the_same_when_it_is_read_again(name: str) -> None:
    """With a value other than the default in each field, and each field by its name."""
    struct = ALL[name]
    given = filled(struct)
    data = msgspec.json.encode(given)
    assert msgspec.json.decode(data, type=struct, dec_hook=site_hook) == given
    if not struct.__struct_config__.array_like:
        names = {field.encode_name for field in msgspec.structs.fields(struct)}
        assert json.loads(data).keys() - {struct.__struct_config__.tag_field} == names


@pytest.mark.parametrize("name", WRITTEN)
def test_a_field_that_is_not_known_is_refused(name: str) -> None:
    """A misspelt key in a file, or one under another name in orders, is no silent default."""
    is_open = not OPEN.isdisjoint({name, name.rpartition(" ")[2]})
    assert ALL[name].__struct_config__.forbid_unknown_fields is not is_open


@pytest.mark.parametrize("kind", MESSAGES)
def test_a_schema_on_record_has_the_keys_of_its_message(kind: str) -> None:
    """And of all that may be in it, and no others."""
    data = msgspec.json.encode(filled(MESSAGES[kind]))
    assert keys_in(json.loads(data)) == properties_in(schema_of(kind))


def test_the_parts_of_a_batch_are_counted_by_their_kinds() -> None:
    """By what is read in part, as by all that is in the message."""
    whole: dict[str, set[str]] = {}
    counted: dict[str, set[str]] = {}
    for kind in BATCHES:
        data = msgspec.json.encode(filled(MESSAGES[kind]))
        whole[kind] = {topic.partition("/")[0] for topic, _ in parts_in(kind, data)}
        batch: Any = msgspec.json.decode(data, type=ALL["_Batch of description"])
        counted[kind] = {part.kind for part in batch.parts}
    assert whole == counted == BATCHES


@pytest.mark.parametrize(
    ("name", "kind"), [(name, kind) for name, kinds in READ_IN_PART.items() for kind in kinds]
)
def test_what_is_read_in_part_has_the_names_of_the_whole(name: str, kind: str) -> None:
    """Fields with defaults would otherwise be left at these, without a word."""
    message = filled(MESSAGES[kind])
    found = msgspec.json.decode(msgspec.json.encode(message), type=ALL[name])
    for field in READ_IN_PART[name][kind].split():
        assert getattr(found, field) == getattr(message, field), field
