"""Messages: bytes that are none are refused in one line, whatever they are."""

import pytest

from cubepath.protocol.core.errors import InputError
from cubepath.protocol.wire.messages import decode

CLAIM = b'{"kind":"claim","round":1,"module":0,"site":1,"generator":%s,"at":%s}'
BAD = {
    "no UTF-8 in a text": CLAIM % (b'"a\xff"', b"1"),
    "no UTF-8 in a site": CLAIM % (b'"a"', b'["a\xff"]'),
    "nested deep": CLAIM % (b'"a"', b"[" * 50_000 + b"]" * 50_000),
    "nested deep in what is not read": CLAIM % (b'"a"', b'1,"more":' + b"[" * 50_000),
    "objects nested deep": CLAIM % (b'"a"', b'{"a":' * 50_000),
}


@pytest.mark.parametrize("name", BAD)
def test_bytes_that_are_no_message(name: str) -> None:
    """Neither a decoding error nor a recursion error comes through."""
    with pytest.raises(InputError, match="not a cubepath message") as error:
        decode(BAD[name])
    assert "\n" not in str(error.value)
