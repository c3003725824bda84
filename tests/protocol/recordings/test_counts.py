"""The kinds of batches on record: those of the wire, part by part."""

from typing import get_args, get_type_hints

import pytest

from cubepath.protocol.recordings.description import BATCHES
from cubepath.protocol.wire import free_messages, messages

STRUCTS = {
    str(each.__struct_config__.tag): each
    for room in (messages, free_messages)
    for each in vars(room).values()
    if isinstance(each, type) and hasattr(each, "__struct_config__")
}


@pytest.mark.parametrize("batch", [each for each in BATCHES if each != "tile"])
def test_a_batch_has_the_parts_that_it_may_have_on_the_wire(batch: str) -> None:
    """So that messages of every kind of part are found on record; what is shown has no kind."""
    (parts,) = get_args(get_type_hints(STRUCTS[batch])["parts"])
    held = {str(each.__struct_config__.tag) for each in get_args(parts) or (parts,)}
    assert BATCHES[batch] == held
