"""What goes over zenoh: messages, keys, session settings, nodes and the shells that carry them.

Room: protocol. The bytes of a message are the same on the wire and on record. It imports `core`,
and `path_files` for the certificate that a recording carries. Modules send these messages,
recordings hold them, and runs and verification read them; code about states and paths alone does
not use them.
"""

from typing import TYPE_CHECKING

from cubepath.protocol.faces import lazy_face

if TYPE_CHECKING:
    from cubepath.protocol.wire.keys import (
        addressees,
        belongs,
        everything,
        key_of,
        to_region,
        topic_in_key,
        topic_key,
        topic_of,
    )
    from cubepath.protocol.wire.messages import (
        MESSAGE_BYTES_MAX,
        Act,
        Acts,
        Again,
        Certified,
        Claim,
        Cube,
        Edges,
        Executed,
        Go,
        Here,
        Message,
        NoMessageError,
        Note,
        Observations,
        Observed,
        Part,
        Ready,
        Reason,
        Refused,
        Report,
        Reports,
        Reset,
        Said,
        Stopped,
        Summary,
        Verdict,
        Waiting,
        decode,
        encode,
        kind_of,
        parts_of,
        schema_of,
    )
    from cubepath.protocol.wire.nodes import Effect, End, Ignore, Keep, Listen, Node, Put, Timer
    from cubepath.protocol.wire.router import Router
    from cubepath.protocol.wire.sessions import (
        check_descriptors,
        open_client,
        put,
        subscribe,
        wait_for_subscriber,
    )
    from cubepath.protocol.wire.shell import Shell
else:
    __getattr__, __dir__ = lazy_face(
        __name__,
        {
            "keys": (
                "addressees belongs everything key_of to_region topic_in_key topic_key topic_of"
            ),
            "messages": (
                "MESSAGE_BYTES_MAX NoMessageError Act Acts Again Certified Claim Cube Edges "
                "Executed Go Here Message Note Observations Observed Part Ready Reason Refused "
                "Report Reports Reset Said Stopped Summary Verdict Waiting decode encode kind_of "
                "parts_of schema_of"
            ),
            "nodes": "Effect End Ignore Keep Listen Node Put Timer",
            "router": "Router",
            "sessions": "check_descriptors open_client put subscribe wait_for_subscriber",
            "shell": "Shell",
        },
    )

__all__ = [
    "MESSAGE_BYTES_MAX",
    "Act",
    "Acts",
    "Again",
    "Certified",
    "Claim",
    "Cube",
    "Edges",
    "Effect",
    "End",
    "Executed",
    "Go",
    "Here",
    "Ignore",
    "Keep",
    "Listen",
    "Message",
    "NoMessageError",
    "Node",
    "Note",
    "Observations",
    "Observed",
    "Part",
    "Put",
    "Ready",
    "Reason",
    "Refused",
    "Report",
    "Reports",
    "Reset",
    "Router",
    "Said",
    "Shell",
    "Stopped",
    "Summary",
    "Timer",
    "Verdict",
    "Waiting",
    "addressees",
    "belongs",
    "check_descriptors",
    "decode",
    "encode",
    "everything",
    "key_of",
    "kind_of",
    "open_client",
    "parts_of",
    "put",
    "schema_of",
    "subscribe",
    "to_region",
    "topic_in_key",
    "topic_key",
    "topic_of",
    "wait_for_subscriber",
]
