"""A document of numbers and texts as one text that any page may hold, and back.

A document is JSON whose arrays of numbers stand aside: in their place is ``{"array": type, "at":
bytes, "length": numbers}``, and what they hold lies behind the JSON, little-endian. All of it is
deflated and written in base64, which has no character with a meaning in HTML: whatever names a
system's file has, they cannot end the element that they stand in.
"""

from __future__ import annotations

import json
import zlib
from base64 import b64decode, b64encode
from typing import Any

import numpy as np

_TYPES = ("u1", "u2", "u4", "i4", "f4")
_ALIGNED = 8


def pack(document: dict[str, Any]) -> str:
    """Return the text of a document: dicts, lists, texts, numbers, and numpy arrays.

    Arrays are of shape (n,), and keep their numbers: integers in the least of the types that have
    room for them, others as 32-bit floats.

    >>> unpack(pack({"name": "</script>", "steps": np.array([1, 2, 300])}))
    {'name': '</script>', 'steps': [1, 2, 300]}
    """
    parts: list[bytes] = []
    size = 0

    def aside(value: Any) -> Any:
        nonlocal size
        if not isinstance(value, np.ndarray):
            raise TypeError(f"{type(value).__name__} in a document: expected JSON or an array")
        kind = _type_of(value)
        data = value.astype(f"<{kind}").tobytes()
        data += bytes(-len(data) % _ALIGNED)
        found = {"array": kind, "at": size, "length": len(value)}
        parts.append(data)
        size += len(data)
        return found

    head = json.dumps(document, default=aside, ensure_ascii=True, separators=(",", ":")).encode()
    head += b" " * (-len(head) % _ALIGNED)
    whole = len(head).to_bytes(_ALIGNED, "little") + head + b"".join(parts)
    return b64encode(zlib.compress(whole, 9)).decode("ascii")


def unpack(text: str) -> Any:
    """Return the document of a text of `pack`, with its arrays as lists."""
    whole = zlib.decompress(b64decode(text))
    length = int.from_bytes(whole[:_ALIGNED], "little")
    body = whole[_ALIGNED + length :]

    def back(found: dict[str, Any]) -> Any:
        if found.keys() != {"array", "at", "length"}:
            return found
        kind = np.dtype(f"<{found['array']}")
        return np.frombuffer(body, kind, count=found["length"], offset=found["at"]).tolist()

    return json.loads(whole[_ALIGNED : _ALIGNED + length], object_hook=back)


def _type_of(value: np.ndarray[Any, Any]) -> str:
    if value.dtype.kind == "f":
        return "f4"
    least, most = (int(value.min()), int(value.max())) if len(value) else (0, 0)
    for kind in _TYPES[:-1]:
        found = np.iinfo(kind)
        if found.min <= least and most <= found.max:
            return kind
    raise ValueError(f"numbers from {least} to {most}: expected 32 bits")
