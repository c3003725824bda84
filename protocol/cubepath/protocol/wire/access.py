"""The access list of a router: which process may publish on which keys.

It restricts publishing, not listening: every client that is let in may subscribe to everything. The
coordinator may publish anything, a process may publish on its own keys, and nobody else may
publish. Everybody may ask for the status and the description of a run, control a replay, and ask
recorders for a snapshot. The sender of a denied message is not notified. The names are those of
`credentials`.

Of a message that another router forwards, a router sees that router as its sender, not who put it.
So it lets routers forward everything, as each has let in no more than its own list allows. A router
with a certificate of its own may forward only the messages of those that `ROUTERS` lists for it.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

import msgspec

from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.output_files import new_file
from cubepath.protocol.wire.credentials import (
    COORDINATOR,
    ROUTER,
    certificate_files,
    keeper_name,
    process_name,
)

ROUTERS = "routers.json"
"""The file in a folder of certificates with the names whose messages each router may forward."""
PROCESSES_MAX, KEEPERS_MAX = 1024, 256
"""Those that a router with certificates knows, which has to list them beforehand."""

_OWN_KEYS = (
    *("ready", "reports", "observations", "waiting", "retransmit", "turns", "halted"),
    *("to/*", "requests/*"),
)
"""Of a module process: the last are what it says to a region, and what it asks of a keeper."""
_KEEPER_KEYS = ("forwards/*", "replies/*", "tile/*", "commit", "commits")
"""Of a keeper, in runs without rounds."""
_ASKABLE = ("state", "about", "path", "player/*")
"""What everyone may ask."""
_LISTENING = ("declare_subscriber", "declare_liveliness_subscriber", "liveliness_query")
_ASKED = ("query", "reply", "declare_queryable")
_TOLD = ("put", "delete", "query", "reply", "declare_queryable", "liveliness_token")


def access_list(
    processes: int,
    by: Literal["usernames", "cert_common_names"],
    keepers: int = 0,
    routers: Mapping[str, Sequence[str]] | None = None,
) -> Mapping[str, Any]:
    """Return zenoh's `access_control` for this many processes, known by password or certificate.

    Each of the `routers` may forward the messages of these names. KeyError for an unknown name.
    """
    rules = [
        _rule("listen", _LISTENING, ("ingress", "egress"), ["**"]),
        _rule("hear", _TOLD, ("egress",), ["**"]),
        _rule("ask", ("query",), ("ingress",), [f"cubepath/*/{what}" for what in _ASKABLE]),
        _rule("recorders", _ASKED, ("ingress",), ["cubepath/*/recorder/**"]),
        _rule("lead", _TOLD, ("ingress",), ["cubepath/**"]),
    ]
    subjects: list[dict[str, Any]] = [
        {"id": "all"},
        {"id": COORDINATOR, by: [COORDINATOR]},
        {"id": ROUTER, by: [ROUTER]},
    ]
    policies = [
        {"rules": ["listen", "hear", "ask", "recorders"], "subjects": ["all"]},
        {"rules": ["lead"], "subjects": [COORDINATOR, ROUTER]},
    ]
    own: dict[str, tuple[str, ...]] = {process_name(each): _OWN_KEYS for each in range(processes)}
    own |= {keeper_name(each): _KEEPER_KEYS for each in range(keepers)}
    rules_of = {COORDINATOR: ["lead"]}
    for name, keys in own.items():
        rules_of[name] = [f"{name} {does}" for does in ("says", "lives", "asks")]
        says = [f"cubepath/*/{key}/{name}" for key in keys]
        rules += [
            _rule(f"{name} says", ("put",), ("ingress",), says),
            _rule(
                f"{name} lives", ("liveliness_token",), ("ingress",), [f"cubepath/*/alive/{name}"]
            ),
            _rule(f"{name} asks", ("query",), ("ingress",), [f"cubepath/*/orders/{name}"]),
        ]
    for name, forwarded in (routers or {}).items():
        rules_of[name] = [rule for each in forwarded for rule in rules_of[each]]
    del rules_of[COORDINATOR]
    subjects += [{"id": name, by: [name]} for name in rules_of]
    policies += [{"rules": rules, "subjects": [name]} for name, rules in rules_of.items()]
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": rules,
        "subjects": subjects,
        "policies": policies,
    }


def _rule(
    name: str, messages: tuple[str, ...], flows: tuple[str, ...], keys: list[str]
) -> dict[str, Any]:
    return {
        "id": name,
        "messages": list(messages),
        "flows": list(flows),
        "permission": "allow",
        "key_exprs": keys,
    }


def guarded_by_passwords(passwords: Mapping[str, str], dictionary: Path) -> Mapping[str, Any]:
    """Return the settings of a router that knows these names, and write their passwords to a file.

    The router reads the file when it opens, and has no use for it after that.
    """
    with new_file(dictionary, 0o600) as file:
        file.write("".join(f"{name}:{word}\n" for name, word in passwords.items()).encode())
    processes = sum(name.startswith(process_name(0)[:-1]) for name in passwords)
    keepers = sum(name.startswith(keeper_name(0)[:-1]) for name in passwords)
    return {
        "transport/auth/usrpwd/dictionary_file": str(dictionary),
        "access_control": access_list(processes, "usernames", keepers),
    }


def guarded_by_certificates(folder: Path) -> Mapping[str, Any]:
    """Return the settings of a router that admits every client with a certificate of its authority.

    InputError if its own certificate or key is missing, or a list of what routers may forward is
    none.
    """
    authority, own, key = certificate_files(folder, ROUTER)
    return {
        "transport/link/tls/root_ca_certificate": str(authority),
        "transport/link/tls/listen_certificate": str(own),
        "transport/link/tls/listen_private_key": str(key),
        "transport/link/tls/connect_certificate": str(own),
        "transport/link/tls/connect_private_key": str(key),
        "transport/link/tls/enable_mtls": True,
        "access_control": _listed(folder / ROUTERS),
    }


def _listed(path: Path) -> Mapping[str, Any]:
    """Return the access list of a router with certificates; InputError if the file is no list."""
    try:
        routers = msgspec.json.decode(path.read_bytes(), type=dict[str, list[str]])
        return access_list(PROCESSES_MAX, "cert_common_names", KEEPERS_MAX, routers)
    except FileNotFoundError:
        return access_list(PROCESSES_MAX, "cert_common_names", KEEPERS_MAX)
    except (OSError, msgspec.MsgspecError, UnicodeDecodeError, KeyError) as error:
        raise InputError(
            f"{path}: {error}, expected what 'cubepath host certificates' writes"
        ) from None
