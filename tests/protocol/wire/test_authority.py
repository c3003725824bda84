"""Certificates of a fleet: what is in them, and who may read them."""

import ipaddress
import json
import stat
import subprocess
import sys
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
from cryptography import x509
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

from cubepath.protocol.core.errors import InputError
from cubepath.protocol.wire.access import guarded_by_certificates
from cubepath.protocol.wire.authority import make_certificates

HOSTS = ["robot-1.lan", "192.0.2.7"]
NAMES = ["authority", "router", "coordinator", "process_0", "process_1", "keeper_0", "guest"]


def certificate(folder: Path, name: str) -> x509.Certificate:
    """Return a certificate."""
    return x509.load_pem_x509_certificate((folder / f"{name}.crt").read_bytes())


def test_everyone_has_a_certificate_and_a_key_that_nobody_else_reads(tmp_path: Path) -> None:
    """By one authority; only the router's is for a server, at its hosts."""
    folder = tmp_path / "new" / "folder"
    assert make_certificates(folder, processes=2, keepers=1, hosts=HOSTS) == NAMES
    assert stat.S_IMODE(folder.stat().st_mode) == 0o700
    assert sorted(each.name for each in folder.iterdir()) == sorted(
        f"{name}.{suffix}" for name in NAMES for suffix in ("crt", "key")
    )
    authority = certificate(folder, "authority")
    for name in NAMES:
        assert stat.S_IMODE((folder / f"{name}.key").stat().st_mode) == 0o600
        found = certificate(folder, name)
        found.verify_directly_issued_by(authority)
        if name == "authority":
            continue
        (common,) = found.subject.get_attributes_for_oid(NameOID.COMMON_NAME)
        assert common.value == name
        uses = {*found.extensions.get_extension_for_class(x509.ExtendedKeyUsage).value}
        server = {ExtendedKeyUsageOID.SERVER_AUTH} if name == "router" else set()
        assert uses == {ExtendedKeyUsageOID.CLIENT_AUTH} | server
    router = certificate(folder, "router")
    assert names_of_hosts(router) == ["localhost", "robot-1.lan"]
    alternatives = router.extensions.get_extension_for_class(x509.SubjectAlternativeName)
    assert alternatives.value.get_values_for_type(x509.IPAddress) == [
        ipaddress.ip_address(each) for each in ("127.0.0.1", "::1", "192.0.2.7")
    ]


def test_a_host_with_a_router_of_its_own_has_a_folder_of_its_own(tmp_path: Path) -> None:
    """With what speaks there, and what each router may forward; the other hosts share a router."""
    hosts = ["hub.lan", "a.lan=process_0,keeper_0", "b.lan=process_1"]
    found = make_certificates(tmp_path / "fleet", processes=2, keepers=1, hosts=hosts)
    assert found == [*NAMES, "router_1", "router_2"]
    listed = {"router_1": ["process_0", "keeper_0"], "router_2": ["process_1"]}
    for host, number in (("a.lan", 1), ("b.lan", 2)):
        folder = tmp_path / "fleet" / host
        names = {"router", "guest", *listed[f"router_{number}"]}
        assert {each.name for each in folder.iterdir()} == {
            *("authority.crt", "routers.json"),
            *(f"{name}.{suffix}" for name in names for suffix in ("crt", "key")),
        }
        assert {stat.S_IMODE(each.stat().st_mode) for each in folder.glob("*.key")} == {0o600}
        router = certificate(folder, "router")
        (common,) = router.subject.get_attributes_for_oid(NameOID.COMMON_NAME)
        assert common.value == f"router_{number}"
        assert names_of_hosts(router) == ["localhost", host]
        assert json.loads((folder / "routers.json").read_text()) == listed
    assert names_of_hosts(certificate(tmp_path / "fleet", "router")) == ["localhost", "hub.lan"]


@pytest.mark.parametrize("text", ["{", '{"router_1": 3}', '{"router_1": ["process_1024"]}'])
def test_a_list_that_is_none_is_refused_when_the_router_starts(tmp_path: Path, text: str) -> None:
    """In one line, before anybody is let in."""
    make_certificates(tmp_path / "fleet", processes=1, keepers=0, hosts=["a.lan=process_0"])
    (tmp_path / "fleet" / "routers.json").write_text(text)
    line = r"routers.json: .*, expected what 'cubepath host certificates' writes"
    with pytest.raises(InputError, match=line):
        guarded_by_certificates(tmp_path / "fleet")


def names_of_hosts(router: x509.Certificate) -> list[str]:
    """Return the names of hosts in a certificate."""
    kind = x509.SubjectAlternativeName
    return router.extensions.get_extension_for_class(kind).value.get_values_for_type(x509.DNSName)


def test_they_end_when_they_are_told_to(tmp_path: Path) -> None:
    """After so many days; an hour ago they held already, for clocks that are late."""
    make_certificates(tmp_path / "a", processes=0, days=3)
    found = certificate(tmp_path / "a", "guest")
    now = datetime.now(UTC)
    assert now - timedelta(hours=2) < found.not_valid_before_utc < now
    assert timedelta(days=2) < found.not_valid_after_utc - now <= timedelta(days=3)


def test_a_folder_that_has_something_is_left_alone(tmp_path: Path) -> None:
    """No key is ever written over."""
    (tmp_path / "mine").write_text("precious")
    with pytest.raises(InputError, match="not empty, expected a new folder"):
        make_certificates(tmp_path)
    with pytest.raises(InputError, match=r"mine: File exists, expected a new folder"):
        make_certificates(tmp_path / "mine")
    assert [each.name for each in tmp_path.iterdir()] == ["mine"]


@pytest.mark.slow
def test_a_missing_library_is_one_line_that_says_how_to_get_it(tmp_path: Path) -> None:
    """Nothing else needs it."""
    code = (
        "import sys\n"
        "sys.modules['cryptography'] = None\n"
        "import importlib.util as util\n"
        "find = util.find_spec\n"
        "util.find_spec = lambda name: None if name == 'cryptography' else find(name)\n"
        "from cubepath.coordinator.commands.main import main\n"
        "sys.exit(main(sys.argv[1:]))\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, "host", "certificates", str(tmp_path / "new")],
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr == (
        "cubepath: certificates take the library cryptography: pip install 'cubepath[secure]'\n"
    )
