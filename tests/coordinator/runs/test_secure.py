"""Secure runs: real sessions over TLS, each with the certificate of who speaks."""

import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest
import zenoh

from cubepath.coordinator.runs.plan import Plan
from cubepath.coordinator.runs.run import run
from cubepath.protocol.core.errors import CubepathError, InputError
from cubepath.protocol.wire.authority import make_certificates
from cubepath.protocol.wire.credentials import COORDINATOR, GUEST, Credentials
from cubepath.protocol.wire.router import Router
from cubepath.protocol.wire.sessions import open_client
from processes.ears import Ear
from processes.elsewhere import Commands, Running

pytestmark = pytest.mark.slow

RUN = "cubepath/0123456789ab"
KEYS = [
    f"{RUN}/{topic}"
    for topic in (
        "ready/process_0",
        "reports/process_0",
        "to/0,0/process_0",
        "ready/process_1",
        "to/0,0/process_1",
        "go/coordinator",
        "go/process_0",
        "actions/process_0",
    )
]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder of certificates."""
    found = tmp_path_factory.mktemp("certificates") / "fleet"
    make_certificates(found, processes=3)
    return found


@pytest.fixture(scope="module")
def router(folder: Path) -> Iterator[Router]:
    """Return a router with its certificate."""
    with Router("tls/localhost:0", secure=folder) as found:
        yield found


def test_the_router_is_found_at_the_name_in_its_certificate(router: Router) -> None:
    """And at the port that the system chose."""
    assert router.endpoint.startswith("tls/localhost:")
    assert not router.endpoint.endswith(":0")


def test_nobody_gets_in_without_a_certificate(router: Router, folder: Path) -> None:
    """Neither with none, nor over plain TCP, nor with the authority's certificate alone."""
    with pytest.raises(InputError, match=r"expected a folder of certificates \(--secure DIR\)"):
        open_client(router.endpoint)
    with pytest.raises(CubepathError, match="no zenoh router at tcp/"):
        open_client(router.endpoint.replace("tls", "tcp"))
    config = zenoh.Config()
    for key, value in {
        "mode": "client",
        "scouting/multicast/enabled": False,
        "connect/endpoints": [router.endpoint],
        "transport/link/tls/root_ca_certificate": str(folder / "authority.crt"),
    }.items():
        config.insert_json5(key, json.dumps(value))
    with pytest.raises(zenoh.ZError):
        zenoh.open(config)


@pytest.mark.parametrize("of_the_other", ["own", "router's"])
def test_a_certificate_of_another_authority_is_refused(
    router: Router, folder: Path, tmp_path: Path, of_the_other: str
) -> None:
    """Also if it trusts the router all the same."""
    other = tmp_path / "other"
    make_certificates(other, processes=1)
    if of_the_other == "own":
        (other / "authority.crt").write_bytes((folder / "authority.crt").read_bytes())
    with pytest.raises(CubepathError, match="or coordinator and its certificate are not known"):
        open_client(router.endpoint, credentials=Credentials(COORDINATOR, "", str(other)))


def test_a_client_is_not_taken_for_the_router(folder: Path, tmp_path: Path) -> None:
    """Whoever has a certificate of the fleet cannot listen in the router's place."""
    fake = tmp_path / "fake"
    fake.mkdir()
    (fake / "authority.crt").write_bytes((folder / "authority.crt").read_bytes())
    for suffix in ("crt", "key"):
        (fake / f"router.{suffix}").write_bytes((folder / f"guest.{suffix}").read_bytes())
    with (
        Router("tls/127.0.0.1:0", secure=fake) as found,
        pytest.raises(CubepathError, match="no zenoh router"),
    ):
        open_client(found.endpoint, credentials=Credentials("process_0", "", str(folder)))


@pytest.mark.few(2)
@pytest.mark.parametrize(
    ("name", "heard"),
    [("guest", []), ("process_0", KEYS[:3]), ("process_1", KEYS[3:5]), (COORDINATOR, KEYS)],
)
def test_with_the_certificate_of_another_there_is_no_voice(
    router: Router, folder: Path, name: str, heard: list[str]
) -> None:
    """process_1 cannot speak for process_0, no process can say go, a guest says nothing."""

    def session(name: str) -> zenoh.Session:
        return open_client(router.endpoint, credentials=Credentials(name, "", str(folder)))

    with session("guest") as listener, session(name) as speaker:
        assert Ear(listener).hears(speaker, KEYS, len(heard)) == heard


@pytest.mark.thorough
def test_a_secure_run_with_a_process_elsewhere_takes_the_same_path(
    folder: Path, tmp_path: Path
) -> None:
    """From three commands, with the folder as each host would have it."""
    plan = Plan("hex:n=6", "random", seed=2, max_rounds=30, processes=0, log=tmp_path / "a.mcap")
    digest = run(plan).path_digest
    expected = "expected what 'cubepath host certificates' writes"
    hosts = {"one": ["coordinator", "router", "process_1", "process_2"], "other": ["process_0"]}
    for host, names in hosts.items():
        (tmp_path / host).mkdir()
        for file in ["authority.crt", *(f"{n}.{s}" for n in names for s in ("crt", "key"))]:
            (tmp_path / host / file).write_bytes((folder / file).read_bytes())
    with Commands(tmp_path) as commands:
        begun = commands.start(
            *("run", "hex:n=6", "--rule=random", "--seed=2", "--max-rounds=30", "--json"),
            *("--secure=one", "--listen=tls/127.0.0.1:0", "--wait-for=1", "--processes=2"),
        )
        endpoint = begun.says(r"endpoint (tls/127.0.0.1:\d+)")[1]
        arguments = ("join", f"--connect={endpoint}", "--modules=1-3", "--secure=other")
        code, _, errors = commands.start(*arguments).end()
        assert (code, errors) == (
            2,
            ["cubepath: secure: expected also --as, the name of its certificate"],
        )
        code, _, errors = commands.start(*arguments, "--as=process_1").end()
        assert (code, errors) == (
            2,
            [f"cubepath: other/process_1.crt: No such file or directory, {expected}"],
        )
        joined = commands.start(*arguments, "--as=process_0")
        code, answer, _ = begun.end()
        assert (code, json.loads(answer)["path_digest"]) == (0, digest)
        assert json.loads(answer)["processes"] == 3
        assert joined.end()[0] == 0


@pytest.mark.thorough
@pytest.mark.parametrize("clock", ["lockstep", "free"])
def test_a_run_spans_routers_that_forward_for_their_own_alone(tmp_path: Path, clock: str) -> None:
    """Each host with its folder; a process whose router is not listed for it is not heard."""
    hosts = ["a.lan=process_0,keeper_0", "b.lan=process_1"]
    make_certificates(tmp_path / "fleet", processes=3, keepers=2, hosts=hosts)
    where = ("--listen=tls/127.0.0.1:0",)
    with Commands(tmp_path) as commands:

        def router(folder: str, *links: str) -> str:
            started = commands.start("host", "router", *where, f"--secure={folder}", *links)
            return started.says(r"listening on (\S+)")[1]

        hub = router("fleet")
        a, b = (router(f"fleet/{host}.lan", f"--connect={hub}") for host in "ab")
        run = commands.start(
            *("run", "hex:n=6", f"--clock={clock}", "--secure=fleet", f"--connect={hub}", "--json"),
            *("--processes=1", *(("--keepers=2",) if clock == "free" else ())),
            f"--wait-for={3 if clock == 'free' else 2}",
        )
        run.says("waiting for")
        joins = [(a, "a", "process_0", "--modules=0-1"), (b, "b", "process_1", "--modules=2-3")]
        joins += [(a, "a", "keeper_0", "")] * (clock == "free")
        # It has the certificate, and its router lets it speak; the next one does not forward it.
        (tmp_path / "fleet" / "b.lan" / "process_0.crt").symlink_to("../process_0.crt")
        (tmp_path / "fleet" / "b.lan" / "process_0.key").symlink_to("../process_0.key")
        wrong = (b, "b", "process_0", "--modules=0-1")
        unheard = join(commands, *wrong)
        unheard.says("waiting for run")
        started = [join(commands, *each) for each in joins]
        code, answer, errors = run.end()
        assert (code, json.loads(answer)["goal_reached"]) == (0, True), errors
        assert [each.end()[0] for each in started] == [0] * len(joins)
        assert unheard.end()[0] == 1


def join(commands: Commands, where: str, host: str, name: str, *more: str) -> Running:
    """Start a process that joins from a host."""
    secure = (f"--connect={where}", f"--secure=fleet/{host}.lan", f"--as={name}")
    return commands.start("join", *secure, *filter(None, more))


@pytest.mark.thorough
def test_a_secure_run_alone_is_over_tls_too(folder: Path, tmp_path: Path) -> None:
    """On a free loopback port; its own processes have their certificates."""
    told: list[str] = []
    plan = Plan("hex:n=4", "random", seed=2, max_rounds=5, processes=2, log=tmp_path / "a.mcap")
    alone = run(plan)
    outcome = run(replace(plan, secure=folder, log=tmp_path / "b.mcap"), say=told.append)
    assert (outcome.error, outcome.path_digest) == (None, alone.path_digest)
    assert [line.split(":")[0] for line in told] == ["endpoint tls/127.0.0.1"]
    assert GUEST.folder == ""
