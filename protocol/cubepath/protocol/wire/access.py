"""Who may publish on which keys: the access list of a router.

It restricts publishing, not listening: every client that is let in may subscribe to everything. The
coordinator may publish anything, a process may publish on its own keys, and nobody else may
publish. Everybody may ask for the status and the description of a run, control a replay, and ask
recorders for a snapshot. The sender of a denied message is not notified. The names are those of
`credentials`.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal

from cubepath.protocol.core.output_files import new_file
from cubepath.protocol.wire.credentials import (
    COORDINATOR,
    ROUTER,
    certificate_files,
    keeper_name,
    process_name,
)

PROCESSES_MAX = 1024
"""Processes that a router with certificates knows, which has to list them beforehand."""

_OWN_KINDS = ("ready", "reports", "observations", "waiting", "retransmit", "turns", "halted")
_OWN_KEYS = ("to/*", "requests/*")
"""Of a module process: what it says to a region, and what it asks of a keeper."""
_KEEPER_KEYS = ("forwards/*", "replies/*", "tile/*", "commit", "commits")
"""Of a keeper, in runs without rounds."""
_ASKABLE = ("state", "about", "path", "player/*")
"""What everyone may ask."""
_LISTENING = ("declare_subscriber", "declare_liveliness_subscriber", "liveliness_query")
_ASKED = ("query", "reply", "declare_queryable")
_TOLD = ("put", "delete", "query", "reply", "declare_queryable", "liveliness_token")


def access_list(
    processes: int, by: Literal["usernames", "cert_common_names"], keepers: int = 0
) -> Mapping[str, Any]:
    """Return zenoh's `access_control` for this many processes, known by password or certificate."""
    rules = [
        _rule("listen", _LISTENING, ("ingress", "egress"), ["**"]),
        _rule("hear", _TOLD, ("egress",), ["**"]),
        _rule("ask", ("query",), ("ingress",), [f"cubepath/*/{what}" for what in _ASKABLE]),
        _rule("recorders", _ASKED, ("ingress",), ["cubepath/*/recorder/**"]),
        _rule("lead", _TOLD, ("ingress",), ["cubepath/**"]),
    ]
    subjects: list[dict[str, Any]] = [{"id": "all"}, {"id": COORDINATOR, by: [COORDINATOR]}]
    policies = [
        {"rules": ["listen", "hear", "ask", "recorders"], "subjects": ["all"]},
        {"rules": ["lead"], "subjects": [COORDINATOR]},
    ]
    for process in range(processes):
        name = process_name(process)
        own = [f"cubepath/*/{kind}/{name}" for kind in _OWN_KINDS]
        own += [f"cubepath/*/{key}/{name}" for key in _OWN_KEYS]
        rules += [
            _rule(f"{name} says", ("put",), ("ingress",), own),
            _rule(
                f"{name} lives", ("liveliness_token",), ("ingress",), [f"cubepath/*/alive/{name}"]
            ),
            _rule(f"{name} asks", ("query",), ("ingress",), [f"cubepath/*/orders/{name}"]),
        ]
        subjects.append({"id": name, by: [name]})
        policies.append(
            {"rules": [f"{name} {does}" for does in ("says", "lives", "asks")], "subjects": [name]}
        )
    for keeper in range(keepers):
        name = keeper_name(keeper)
        own = [f"cubepath/*/{key}/{name}" for key in _KEEPER_KEYS]
        rules.append(_rule(f"{name} says", ("put",), ("ingress",), own))
        subjects.append({"id": name, by: [name]})
        policies.append({"rules": [f"{name} says"], "subjects": [name]})
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

    InputError if its own certificate or key is missing.
    """
    authority, own, key = certificate_files(folder, ROUTER)
    return {
        "transport/link/tls/root_ca_certificate": str(authority),
        "transport/link/tls/listen_certificate": str(own),
        "transport/link/tls/listen_private_key": str(key),
        "transport/link/tls/enable_mtls": True,
        "access_control": access_list(PROCESSES_MAX, "cert_common_names"),
    }
