"""What goes over zenoh: messages, keys, session settings, nodes and the shells that carry them.

Room: protocol. The bytes of a message are the same on the wire and on record. It imports `core`,
and `path_files` for the certificate that a recording carries. Modules send these messages,
recordings hold them, and runs and verification read them; code about states and paths alone does
not use them.
"""

from typing import TYPE_CHECKING

from cubepath.protocol.faces import lazy_face

if TYPE_CHECKING:
    from cubepath.protocol.wire.access import PROCESSES_MAX
    from cubepath.protocol.wire.authority import make_certificates
    from cubepath.protocol.wire.credentials import (
        COORDINATOR,
        GUEST,
        ROUTER,
        Credentials,
        certificate_files,
        process_name,
    )
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
        Count,
        Cube,
        Edges,
        Executed,
        Go,
        Here,
        Message,
        Name,
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
    from cubepath.protocol.wire.router import Router, check_secure, without_tls
    from cubepath.protocol.wire.sessions import (
        check_descriptors,
        check_endpoint,
        open_client,
        put,
        routers_of,
        subscribe,
        wait_for_subscriber,
        watch,
    )
    from cubepath.protocol.wire.shell import Shell
    from cubepath.protocol.wire.sockets import discard
else:
    __getattr__, __dir__ = lazy_face(
        __name__,
        {
            "access": "PROCESSES_MAX",
            "authority": "make_certificates",
            "credentials": "COORDINATOR GUEST ROUTER Credentials certificate_files process_name",
            "keys": (
                "addressees belongs everything key_of to_region topic_in_key topic_key topic_of"
            ),
            "messages": (
                "MESSAGE_BYTES_MAX NoMessageError Act Acts Again Certified Claim Count Cube Edges "
                "Executed Go Here Message Name Note Observations Observed Part Ready Reason "
                "Refused Report Reports Reset Said Stopped Summary Verdict Waiting decode encode "
                "kind_of parts_of schema_of"
            ),
            "nodes": "Effect End Ignore Keep Listen Node Put Timer",
            "router": "Router check_secure without_tls",
            "sessions": (
                "check_descriptors check_endpoint open_client put routers_of subscribe"
                " wait_for_subscriber watch"
            ),
            "shell": "Shell",
            "sockets": "discard",
        },
    )

__all__ = [
    "COORDINATOR",
    "GUEST",
    "MESSAGE_BYTES_MAX",
    "PROCESSES_MAX",
    "ROUTER",
    "Act",
    "Acts",
    "Again",
    "Certified",
    "Claim",
    "Count",
    "Credentials",
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
    "Name",
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
    "certificate_files",
    "check_descriptors",
    "check_endpoint",
    "check_secure",
    "decode",
    "discard",
    "encode",
    "everything",
    "key_of",
    "kind_of",
    "make_certificates",
    "open_client",
    "parts_of",
    "process_name",
    "put",
    "routers_of",
    "schema_of",
    "subscribe",
    "to_region",
    "topic_in_key",
    "topic_key",
    "topic_of",
    "wait_for_subscriber",
    "watch",
    "without_tls",
]
