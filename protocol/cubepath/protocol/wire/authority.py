"""Your own certificate authority for runs on several hosts, and the certificates it issues.

A router's certificate names the hosts where it listens, and links it with others. The others name
the sender and are for clients only, so no client can pose as a router. Keys are P-256.
"""

from __future__ import annotations

import ipaddress
import shutil
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime, timedelta
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

import msgspec

from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.output_files import new_file
from cubepath.protocol.wire.access import KEEPERS_MAX, PROCESSES_MAX, ROUTERS
from cubepath.protocol.wire.credentials import (
    AUTHORITY,
    COORDINATOR,
    GUEST,
    ROUTER,
    keeper_name,
    process_name,
)

if TYPE_CHECKING:
    from cryptography import x509
    from cryptography.hazmat.primitives.asymmetric.ec import EllipticCurvePrivateKey

HOSTS = ("localhost", "127.0.0.1", "::1")
"""Where the router is found in any case: on its own machine."""
DAYS_MAX = 36_500
_EARLIER = timedelta(hours=1)
"""Clocks of other hosts may be late by this much."""


def make_certificates(
    folder: Path,
    *,
    processes: int = 4,
    keepers: int = 4,
    hosts: Sequence[str] = (),
    days: int = 365,
) -> list[str]:
    """Write the certificates of a fleet to a new folder; return their names.

    A ``.crt`` and a ``.key`` file each for the authority, the router at these hosts (names or IP
    addresses) and at `HOSTS`, the coordinator, this many processes and keepers, and a guest. A host
    ``HOST=NAME,NAME`` has a router of its own, which may forward the messages of these names alone;
    what is for that host is in the folder HOST in this folder too. Keys have mode 0600, folders
    0700. InputError if the folder exists and is not empty, if an argument is out of its bounds, or
    if the library `cryptography` is not installed.
    """
    if find_spec("cryptography") is None:
        raise InputError(
            "certificates take the library cryptography: pip install 'cubepath[secure]'"
        )
    for name, number, most in (
        ("processes", processes, PROCESSES_MAX),
        ("keepers", keepers, KEEPERS_MAX),
    ):
        if not 0 <= number <= most:
            raise InputError(f"{name}={number}: expected 0 to {most}")
    if not 1 <= days <= DAYS_MAX:
        raise InputError(f"days={days}: expected 1 to {DAYS_MAX}")
    names = [COORDINATOR, *map(process_name, range(processes)), *map(keeper_name, range(keepers))]
    own = _routers([host for host in hosts if "=" in host], names)
    found = {host: _host(host) for host in (*HOSTS, *own, *(h for h in hosts if "=" not in h))}
    _make_folder(folder)
    until = datetime.now(UTC) + timedelta(days=days)
    authority = _Authority(folder, until)
    shared = [each for host, each in found.items() if host in HOSTS or host not in own]
    authority.certify(ROUTER, shared)
    names.append(GUEST.name)
    for name in names:
        authority.certify(name, [])
    routers = {f"{ROUTER}_{number}": host for number, host in enumerate(own, 1)}
    for router, host in routers.items():
        authority.certify(router, [found[each] for each in (*HOSTS, host)])
        _copy(folder, folder / host, {router: ROUTER} | {name: name for name in own[host]})
    if routers:
        forwarded = msgspec.json.encode({router: own[host] for router, host in routers.items()})
        for each in (folder, *(folder / host for host in own)):
            (each / ROUTERS).write_bytes(forwarded)
    return [AUTHORITY, ROUTER, *names, *routers]


def _copy(folder: Path, to: Path, names: Mapping[str, str]) -> None:
    """Copy what a host needs to a new folder: the certificates of these, by their names there."""
    _make_folder(to)
    shutil.copy(folder / f"{AUTHORITY}.crt", to)
    for name, there in {**names, GUEST.name: GUEST.name}.items():
        for suffix in ("crt", "key"):
            shutil.copy(folder / f"{name}.{suffix}", to / f"{there}.{suffix}")


def _routers(hosts: Sequence[str], names: Sequence[str]) -> dict[str, list[str]]:
    """Return by host the names whose messages its router forwards; InputError if one is unknown."""
    found: dict[str, list[str]] = {}
    for text in hosts:
        host, _, forwarded = text.partition("=")
        found[host] = forwarded.split(",")
        for name in found[host]:
            if name not in names:
                raise InputError(
                    f"host={text}: no certificate is made for {name!r}, expected names of processes"
                    " and keepers, separated by commas"
                )
    return found


def _host(host: str) -> x509.GeneralName:
    from cryptography import x509  # noqa: PLC0415

    try:
        return x509.IPAddress(ipaddress.ip_address(host))
    except ValueError:
        pass
    labels = host.split(".")
    if len(host) > 253 or not all(
        0 < len(each) < 64 and each.isascii() and each.replace("-", "a").isalnum()
        for each in labels
    ):
        raise InputError(f"host={host}: expected the name of a host or an IP address")
    return x509.DNSName(host)


def _make_folder(folder: Path) -> None:
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        if any(folder.iterdir()):
            raise InputError(f"{folder}: not empty, expected a new folder")
        folder.chmod(0o700)
    except OSError as error:
        raise InputError(f"{folder}: {error.strerror or error}, expected a new folder") from None


class _Authority:
    """Signs certificates and writes them to a folder, its own first."""

    def __init__(self, folder: Path, until: datetime) -> None:
        from cryptography import x509  # noqa: PLC0415
        from cryptography.hazmat.primitives.asymmetric import ec  # noqa: PLC0415

        self._folder = folder
        self._until = until
        self._key = ec.generate_private_key(ec.SECP256R1())
        builder = self._builder("cubepath test authority", self._key)
        builder = builder.add_extension(
            x509.BasicConstraints(ca=True, path_length=0), critical=True
        )
        self._write(AUTHORITY, builder, self._key)

    def certify(self, name: str, hosts: list[x509.GeneralName]) -> None:
        """Make a key and a certificate for it: of a router at these hosts, or of a client."""
        from cryptography import x509  # noqa: PLC0415
        from cryptography.hazmat.primitives.asymmetric import ec  # noqa: PLC0415
        from cryptography.x509.oid import ExtendedKeyUsageOID  # noqa: PLC0415

        key = ec.generate_private_key(ec.SECP256R1())
        # A router is a client of the routers to which it is linked.
        uses = [ExtendedKeyUsageOID.CLIENT_AUTH]
        uses += [ExtendedKeyUsageOID.SERVER_AUTH] if hosts else []
        builder = self._builder(name, key)
        builder = builder.add_extension(
            x509.BasicConstraints(ca=False, path_length=None), critical=True
        )
        builder = builder.add_extension(x509.ExtendedKeyUsage(uses), critical=False)
        if hosts:
            builder = builder.add_extension(x509.SubjectAlternativeName(hosts), critical=False)
        self._write(name, builder, key)

    def _builder(self, name: str, key: EllipticCurvePrivateKey) -> x509.CertificateBuilder:
        from cryptography import x509  # noqa: PLC0415
        from cryptography.x509.oid import NameOID  # noqa: PLC0415

        def named(text: str) -> x509.Name:
            return x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, text)])

        return (
            x509.CertificateBuilder()
            .subject_name(named(name))
            .issuer_name(named("cubepath test authority"))
            .public_key(key.public_key())
            .serial_number(x509.random_serial_number())
            .not_valid_before(datetime.now(UTC) - _EARLIER)
            .not_valid_after(self._until)
        )

    def _write(
        self, name: str, builder: x509.CertificateBuilder, key: EllipticCurvePrivateKey
    ) -> None:
        from cryptography.hazmat.primitives import hashes  # noqa: PLC0415
        from cryptography.hazmat.primitives.serialization import (  # noqa: PLC0415
            Encoding,
            NoEncryption,
            PrivateFormat,
        )

        certificate = builder.sign(self._key, hashes.SHA256())
        secret = key.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, NoEncryption())
        with new_file(self._folder / f"{name}.crt", 0o644) as file:
            file.write(certificate.public_bytes(Encoding.PEM))
        with new_file(self._folder / f"{name}.key", 0o600) as file:
            file.write(secret)
