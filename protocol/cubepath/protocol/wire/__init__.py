"""What goes over zenoh: messages, key expressions and session settings.

Room: protocol. The bytes of a message are the same on the wire and on record. It imports `core`,
and `path_files` for the certificate that a recording carries. Modules send these messages,
recordings hold them, and runs and verification read them; code about states and paths alone does
not use them.
"""

from typing import TYPE_CHECKING

from cubepath.protocol.faces import lazy_face

if TYPE_CHECKING:
    from cubepath.protocol.wire.keys import (
        everything,
        heard_at,
        key_of,
        topic_in,
        topic_key,
        topic_of,
    )
    from cubepath.protocol.wire.messages import (
        Act,
        Certified,
        Claim,
        Cube,
        Edges,
        Executed,
        Go,
        Heard,
        Here,
        Message,
        Note,
        Observed,
        Ready,
        Report,
        Reset,
        Stopped,
        Summary,
        Verdict,
        decode,
        encode,
        kind_of,
        schema_of,
    )
    from cubepath.protocol.wire.sessions import (
        check_descriptors,
        open_client,
        open_router,
        put,
        subscribe,
        wait_for_subscriber,
    )
else:
    __getattr__, __dir__ = lazy_face(
        __name__,
        {
            "keys": "everything heard_at key_of topic_in topic_key topic_of",
            "messages": (
                "Act Certified Claim Cube Edges Executed Go Heard Here Message Note Observed Ready "
                "Report Reset Stopped Summary Verdict decode encode kind_of schema_of"
            ),
            "sessions": (
                "check_descriptors open_client open_router put subscribe wait_for_subscriber"
            ),
        },
    )

__all__ = [
    "Act",
    "Certified",
    "Claim",
    "Cube",
    "Edges",
    "Executed",
    "Go",
    "Heard",
    "Here",
    "Message",
    "Note",
    "Observed",
    "Ready",
    "Report",
    "Reset",
    "Stopped",
    "Summary",
    "Verdict",
    "check_descriptors",
    "decode",
    "encode",
    "everything",
    "heard_at",
    "key_of",
    "kind_of",
    "open_client",
    "open_router",
    "put",
    "schema_of",
    "subscribe",
    "topic_in",
    "topic_key",
    "topic_of",
    "wait_for_subscriber",
]
