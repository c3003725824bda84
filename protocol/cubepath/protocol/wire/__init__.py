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
    from cubepath.protocol.wire.free_messages import (
        Asks,
        Attempt,
        Decision,
        Enter,
        Entered,
        Fetch,
        FreeMessage,
        Inquiry,
        Look,
        Moved,
        Occupant,
        Passed,
        Passes,
        Register,
        Settled,
        Shown,
        Shows,
        Tail,
        Tells,
        Turn,
        Turns,
        decode_free,
        free_key,
        free_kind,
        free_topic,
        heard_by_keeper,
        heard_by_process,
        heard_of_tile,
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
    )
    from cubepath.protocol.wire.nodes import Effect, End, Ignore, Keep, Listen, Node, Put, Timer
    from cubepath.protocol.wire.on_record import SHOWN, parts_said, schema_of, topic_said
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
    from cubepath.protocol.wire.tiles import Tiles
else:
    __getattr__, __dir__ = lazy_face(
        __name__,
        {
            "access": "PROCESSES_MAX",
            "authority": "make_certificates",
            "credentials": "COORDINATOR GUEST ROUTER Credentials certificate_files process_name",
            "free_messages": (
                "Asks Attempt Decision Enter Entered Fetch FreeMessage Inquiry Look "
                "Moved Occupant Passed Passes Register Settled Shown Shows Tail Tells Turn Turns "
                "decode_free free_key free_kind free_topic heard_by_keeper "
                "heard_by_process heard_of_tile"
            ),
            "keys": (
                "addressees belongs everything key_of to_region topic_in_key topic_key topic_of"
            ),
            "messages": (
                "MESSAGE_BYTES_MAX NoMessageError Act Acts Again Certified Claim Count Cube Edges "
                "Executed Go Here Message Name Note Observations Observed Part Ready Reason "
                "Refused Report Reports Reset Said Stopped Summary Verdict Waiting decode encode "
                "kind_of parts_of"
            ),
            "nodes": "Effect End Ignore Keep Listen Node Put Timer",
            "on_record": "SHOWN parts_said schema_of topic_said",
            "router": "Router check_secure without_tls",
            "sessions": (
                "check_descriptors check_endpoint open_client put routers_of subscribe "
                "wait_for_subscriber watch"
            ),
            "shell": "Shell",
            "sockets": "discard",
            "tiles": "Tiles",
        },
    )

__all__ = [
    "COORDINATOR",
    "GUEST",
    "MESSAGE_BYTES_MAX",
    "PROCESSES_MAX",
    "ROUTER",
    "SHOWN",
    "Act",
    "Acts",
    "Again",
    "Asks",
    "Attempt",
    "Certified",
    "Claim",
    "Count",
    "Credentials",
    "Cube",
    "Decision",
    "Edges",
    "Effect",
    "End",
    "Enter",
    "Entered",
    "Executed",
    "Fetch",
    "FreeMessage",
    "Go",
    "Here",
    "Ignore",
    "Inquiry",
    "Keep",
    "Listen",
    "Look",
    "Message",
    "Moved",
    "Name",
    "NoMessageError",
    "Node",
    "Note",
    "Observations",
    "Observed",
    "Occupant",
    "Part",
    "Passed",
    "Passes",
    "Put",
    "Ready",
    "Reason",
    "Refused",
    "Register",
    "Report",
    "Reports",
    "Reset",
    "Router",
    "Said",
    "Settled",
    "Shell",
    "Shown",
    "Shows",
    "Stopped",
    "Summary",
    "Tail",
    "Tells",
    "Tiles",
    "Timer",
    "Turn",
    "Turns",
    "Verdict",
    "Waiting",
    "addressees",
    "belongs",
    "certificate_files",
    "check_descriptors",
    "check_endpoint",
    "check_secure",
    "decode",
    "decode_free",
    "discard",
    "encode",
    "everything",
    "free_key",
    "free_kind",
    "free_topic",
    "heard_by_keeper",
    "heard_by_process",
    "heard_of_tile",
    "key_of",
    "kind_of",
    "make_certificates",
    "open_client",
    "parts_of",
    "parts_said",
    "process_name",
    "put",
    "routers_of",
    "schema_of",
    "subscribe",
    "to_region",
    "topic_in_key",
    "topic_key",
    "topic_of",
    "topic_said",
    "wait_for_subscriber",
    "watch",
    "without_tls",
]
