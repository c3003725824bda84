"""Messages of any zenoh program in a recording: their topics, encodings and how they were put.

The topic of a message is its key. What has no place in a message of MCAP stands on a topic of its
own: an attachment, right before its message, on ``KEY?attachment``, and a deletion, without bytes,
on ``KEY?delete``. No key has a question mark. How a message was put is the metadata of its channel,
so one key can have several channels.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

ATTACHMENT, DELETE = "?attachment", "?delete"
_DEFAULT_ENCODING = "zenoh/bytes"
_MCAP_ENCODINGS = {
    "application/json": "json",
    "text/json": "json",
    "application/cbor": "cbor",
    "application/cdr": "cdr",
    "application/protobuf": "protobuf",
}
"""Names that MCAP gives to encodings; the others keep the name that zenoh has for them."""
PRIORITIES = (
    "real_time",
    "interactive_high",
    "interactive_low",
    "data_high",
    "data",
    "data_low",
    "background",
)
CONGESTION_CONTROLS = ("drop", "block", "block_first")


class PutSettings(NamedTuple):
    """How a message was put: what zenoh's ``put`` takes beside key, bytes and attachment.

    >>> PutSettings("application/json;Pose").schema
    'Pose'
    """

    encoding: str = _DEFAULT_ENCODING
    """As zenoh writes it: a type, and after a semicolon the name of a schema."""
    priority: str = "data"
    congestion_control: str = "drop"
    express: bool = False

    @property
    def schema(self) -> str:
        """Return the name of the schema that the encoding states; empty if it states none."""
        return self.encoding.partition(";")[2]

    @property
    def mcap_encoding(self) -> str:
        """Return how tools for MCAP call the encoding; empty for bytes without one."""
        name = self.encoding.partition(";")[0]
        return "" if name == _DEFAULT_ENCODING else _MCAP_ENCODINGS.get(name, name)

    def to_metadata(self) -> dict[str, str]:
        """Return the metadata of a channel whose messages were put so."""
        return {**self._asdict(), "express": "true" if self.express else "false"}


def settings_in(metadata: Mapping[str, str]) -> PutSettings | None:
    """Return what the metadata of a channel states; None if it is a channel of a run.

    Where it states what zenoh does not know, zenoh's default stands.
    """
    if "encoding" not in metadata:
        return None
    priority, congestion = metadata.get("priority", ""), metadata.get("congestion_control", "")
    usual = PutSettings(metadata["encoding"], express=metadata.get("express") == "true")
    return usual._replace(
        priority=priority if priority in PRIORITIES else usual.priority,
        congestion_control=congestion if congestion in CONGESTION_CONTROLS else usual[2],
    )


def key_in(topic: str) -> str:
    """Return the key that a topic is about.

    >>> key_in("robot/arm?attachment")
    'robot/arm'
    """
    return topic.partition("?")[0]
