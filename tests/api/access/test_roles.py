"""Tests of roles: each on every key and request, over TLS with certificates, and by user and password."""

from __future__ import annotations

import json
import time
from pathlib import Path

import pytest
import zenoh

from gateway.api import protocol
from gateway.api.access.roles import MAX_USERS, Asker, not_permitted, read_roles
from gateway.cli.main import main
from gateway.client import Credentials, connect
from gateway.core.messages.outputs import Reply
from gateway.errors import Code, ConfigError, NotPermitted, Rejected
from gateway.messages.requests import Request
from gateway.values import Role
from tests.api.daemon import Daemon, eventually
from tests.api.samples import POSE, REQUESTS, Q, command
from tests.api.stand_in import ScriptedEngine
from tests.api.test_service import ask, session_to
from tests.e2e.system import free_port

NAMES = {"vera": Role.VIEWER, "olaf": Role.OPERATOR, "anna": Role.ADMIN}
ALL = {type(each): each for each in REQUESTS} | {
    protocol.MovePose: protocol.MovePose(epoch=3, targets={"left": POSE}, frames={"left": "left_shoulder_base"}),
    protocol.RegisterEndpoint: protocol.RegisterEndpoint(name="button", timeout_ns=10**9),
    protocol.LeaveEndpoint: protocol.LeaveEndpoint(),
}
FREE = {protocol.Stop, protocol.Estop, protocol.RegisterEndpoint, protocol.LeaveEndpoint}


class Noting(ScriptedEngine):
    """An engine that says yes to everything and remembers which role asked for what."""

    def _reply(self, event):
        self.requests.append((event.role, event.request))
        return Reply(client_id=event.client_id, request_id=event.request_id)


class Lab:
    """A daemon with a port, and keys for it."""

    def __init__(self, folder: Path, **local):
        self.keys = folder / "keys"
        self.port = free_port()
        self.daemon = Daemon(folder, tcp=f"127.0.0.1:{self.port}", **local)
        self.daemon.engine = Noting(self.daemon.plane, time.monotonic_ns)

    def tls(self, name, keys=None, **how):
        """Return a zenoh session as whom the certificate says."""
        at = (keys or self.keys) / name
        tls = {
            "root_ca_certificate": str(self.keys / "ca" / "certificate.pem"),
            "enable_mtls": True,
            "connect_certificate": str(at / "certificate.pem"),
            "connect_private_key": str(at / "key.pem"),
        }
        return session_to(f"tls/127.0.0.1:{self.port}", **{"transport/link/tls": tls, "connect/timeout_ms": 5000} | how)


def keys(folder, *words):
    """Make keys as a person does."""
    assert main(["keys", *words, "--dir", str(folder)]) == 0


@pytest.fixture(scope="module")
def lab_keys(tmp_path_factory):
    """Keys of a lab: an authority, a server, one client of each role, and one whose role was taken away."""
    folder = tmp_path_factory.mktemp("lab")
    at = folder / "keys"
    keys(at, "init")
    keys(at, "server", "127.0.0.1")
    for name, role in NAMES.items():
        keys(at, "client", name, "--role", role.value)
    keys(at, "client", "norma", "--role", "admin")
    roles = at / "server" / "roles"
    roles.write_text("".join(line for line in roles.read_text().splitlines(True) if "norma" not in line))
    return folder


@pytest.fixture
def lab(lab_keys, tmp_path):
    """A daemon that knows clients by their certificates."""
    server = lab_keys / "keys" / "server"
    lab = Lab(
        tmp_path,
        tls_certificate=str(server / "certificate.pem"),
        tls_private_key=str(server / "key.pem"),
        tls_root_ca=str(server / "ca.pem"),
        roles_file=str(server / "roles"),
        audit_log=str(tmp_path / "audit.jsonl"),
    )
    lab.keys = lab_keys / "keys"
    with lab.daemon:
        yield lab


def answers(session, key, request, number):
    """Return the codes of all answers to a request under a key: OK when it was taken."""
    payload = protocol.encode(command(request, number, client_id=f"c{number}"))
    replies = [protocol.decode_reply(reply) for reply in ask(session, key, payload, timeout=5.0)]
    return ["OK" if reply.refusal is None else reply.refusal.code for reply in replies]


pytestmark = pytest.mark.e2e


@pytest.mark.parametrize("name", [*NAMES, "norma"])
def test_each_role_on_every_request_and_key(lab, name):
    """Zenoh lets nobody ask on another's key, nor put what a role may not; the daemon refuses what a viewer may not ask."""
    role = NAMES.get(name, Role.VIEWER)
    heard = lab.daemon.engine.requests
    with lab.tls(f"clients/{name}") as session:
        own = protocol.command_key(name if name in NAMES else "")
        for number, (kind, request) in enumerate(ALL.items()):
            may = role is not Role.VIEWER or kind in FREE
            assert answers(session, own, request, number) == ["OK" if may else Code.NOT_PERMITTED], kind
            if may:
                assert heard[-1][0] is role, kind
        taken = len(heard)
        for number, kind in enumerate((protocol.Enable, protocol.Take, protocol.Recover), 100):
            # The key of whoever has no name: a viewer's, whoever asks on it.
            assert answers(session, protocol.COMMAND_KEY, ALL[kind], number) == [Code.NOT_PERMITTED]
        others = [protocol.command_key(other) for other in (*NAMES, "norma") if protocol.command_key(other) != own]
        for key in (*others, f"{protocol.COMMAND_KEY}/*", f"{protocol.ROOT}/**", "ta2/**"):
            assert ask(session, key, protocol.encode(command(ALL[protocol.Acquire])), timeout=0.2) == []
        assert len(heard) == taken, "what is on nobody's own key reaches nobody"
        for key in (protocol.INFO_KEY, protocol.ROUTES_KEY, protocol.SNAPSHOT_KEY, protocol.PING_KEY):
            eventually(lambda key=key: len(ask(session, key)) == 1, 20.0)  # of pings zenoh lets some a second pass
        for key in (protocol.STOP_KEY, protocol.ESTOP_KEY):
            assert len(ask(session, key, b"help")) == 1, key
            before = len(heard)
            session.put(key, b"")
            eventually(lambda before=before: len(heard) > before)


@pytest.mark.parametrize("name", NAMES)
def test_only_who_may_command_puts_targets_and_keepalives(lab, name):
    """By zenoh's own list, even on keys whose secret was given away; a check-in is for everybody."""
    plane = lab.daemon.plane
    lab.daemon.engine.show(lease=lab.daemon.engine.snapshot.lease)
    with session_to(f"unixsock-stream/{lab.daemon.socket}") as owner, lab.tls(f"clients/{name}") as session:
        envelope = protocol.Command(
            version=protocol.PROTOCOL_VERSION, client_id="own", secret="s3", request_id=1, request=ALL[protocol.Acquire]
        )
        assert ask(owner, protocol.COMMAND_KEY, protocol.encode(envelope))
        plane.heed(frozenset({"own"}))
        lab.daemon.engine.tick = lambda: None  # nobody else heeds or polls
        seen, inbox = [], plane._inbox
        inbox.put_target = lambda key, *_: seen.append("target")
        inbox.put_keepalive = lambda key, *_: seen.append("keepalive")
        inbox.put_check_in = lambda key, *_: seen.append("check-in")
        eventually(lambda: len(plane._planes[1]._lanes) == 1)
        target = protocol.encode(protocol.Target(epoch=1, seq=1, values=Q))
        session.put(protocol.target_key("own", 1, "s3"), target)
        session.put(protocol.keepalive_key("own", "s3"), b"")
        session.put(protocol.check_in_key("own", "s3"), b"")
        eventually(lambda: "check-in" in seen)
        moving = [] if NAMES[name] is Role.VIEWER else ["target", "keepalive"]
        assert seen == [*moving, "check-in"]


def test_nobody_tells_another_what_the_daemon_tells(lab):
    """No role publishes snapshots or events, answers for the daemon, or says who somebody is."""
    heard = []
    with lab.tls("clients/vera") as viewer, lab.tls("clients/anna") as admin:
        for key in (protocol.EVENT_KEY, f"{protocol.ROOT}/snapshot"):
            viewer.declare_subscriber(key, lambda sample: heard.append(sample.payload.to_bytes()))
        names = []
        viewer.liveliness().declare_subscriber(
            protocol.USER_TOKENS, lambda sample: names.append(str(sample.key_expr)), history=True
        )
        eventually(lambda: names and heard)
        forged = [
            admin.liveliness().declare_token(protocol.user_token("olaf")),
            admin.declare_queryable(protocol.INFO_KEY, lambda query: query.reply(query.key_expr, b"forged")),
        ]
        admin.put(protocol.SNAPSHOT_KEY, b"forged")
        admin.put(protocol.EVENT_KEY, b"forged")
        number = len(heard)
        eventually(lambda: len(heard) > number + 5)
        assert b"forged" not in heard and b"forged" not in ask(viewer, protocol.INFO_KEY)
        assert names == [protocol.user_token("vera")] and len(forged) == 2


def test_our_client_knows_its_own_name(lab):
    """It asks on its own key without being told which; who is refused is told as what."""
    at = f"tls/127.0.0.1:{lab.port}"
    folder = lab.keys / "clients"
    with connect(at, credentials=Credentials.from_file(folder / "vera" / "credentials.json"), timeout_s=20) as robot:
        with pytest.raises(NotPermitted, match="vera is a viewer") as caught:
            robot.recover()
        assert caught.value.code is Code.NOT_PERMITTED and caught.value.hint
        robot.stop(reason="a hand")
        robot.estop()
    with connect(at, credentials=Credentials.from_file(folder / "anna" / "credentials.json"), timeout_s=20) as robot:
        robot.recover()
    assert lab.daemon.engine.requests[-1][0] is Role.ADMIN
    path = Path(lab.daemon.settings.local.audit_log)
    lines = eventually(lambda: [json.loads(line) for line in path.read_text().splitlines()] if path.exists() else [])
    recovers = eventually(
        lambda: (
            [line for line in map(json.loads, path.read_text().splitlines()) if line["request"] == "Recover"][1:]
            and [line for line in map(json.loads, path.read_text().splitlines()) if line["request"] == "Recover"]
        )
    )
    assert lines and [(line["user"], line["role"], line["answer"]) for line in recovers] == [
        ("vera", "viewer", "NOT_PERMITTED"),
        ("anna", "admin", "ok"),
    ]


def refused(lab, name, keys=None):
    """Whether nobody gets in with this certificate."""
    try:
        lab.tls(name, keys, **{"connect/timeout_ms": 1000}).close()
    except zenoh.ZError:
        return True
    return False


def test_certificates_that_are_foreign_have_ended_or_are_no_clients_are_refused(lab, tmp_path):
    """By zenoh, before anything is read of them."""
    from cryptography import x509
    from cryptography.hazmat.primitives import hashes, serialization

    assert not refused(lab, "clients/vera")
    assert refused(lab, "server"), "the gateway's certificate is no client's"
    foreign = tmp_path / "foreign"
    keys(foreign, "init")
    keys(foreign, "server", "127.0.0.1")
    keys(foreign, "client", "anna", "--role", "admin")
    assert refused(lab, "clients/anna", foreign)
    ended = tmp_path / "ended" / "clients" / "anna"
    ended.mkdir(parents=True)
    good = x509.load_pem_x509_certificate((lab.keys / "clients/anna/certificate.pem").read_bytes())
    authority = serialization.load_pem_private_key((lab.keys / "ca/key.pem").read_bytes(), None)
    builder = x509.CertificateBuilder(
        issuer_name=good.issuer,
        subject_name=good.subject,
        public_key=good.public_key(),
        serial_number=7,
        not_valid_before=good.not_valid_before_utc.replace(year=2001),
        not_valid_after=good.not_valid_before_utc.replace(year=2002),
        extensions=list(good.extensions),
    )
    pem = builder.sign(authority, hashes.SHA256()).public_bytes(serialization.Encoding.PEM)
    (ended / "certificate.pem").write_bytes(pem)
    (ended / "key.pem").write_bytes((lab.keys / "clients/anna/key.pem").read_bytes())
    assert refused(lab, "clients/anna", tmp_path / "ended")
    with pytest.raises(zenoh.ZError):
        session_to(f"tls/127.0.0.1:{lab.port}", **{"connect/timeout_ms": 500})


def test_users_with_passwords_have_roles_too(tmp_path):
    """The same by name; who is in no role is a viewer; the socket stays an admin's."""
    (tmp_path / "users").write_text("vera:v\nolaf:o\nnorma:n\n")
    (tmp_path / "roles").write_text("# ours\n\nvera: viewer\nolaf:operator\n")
    for name in ("users", "roles"):
        (tmp_path / name).chmod(0o600)
    lab = Lab(tmp_path, users_file=str(tmp_path / "users"), roles_file=str(tmp_path / "roles"))
    with lab.daemon:
        for name, role in (("vera", Role.VIEWER), ("olaf", Role.OPERATOR), ("norma", Role.VIEWER)):
            credentials = Credentials(user=name, password=name[0])
            with connect(f"tcp/127.0.0.1:{lab.port}", credentials=credentials, timeout_s=20) as robot:
                if role is Role.VIEWER:
                    with pytest.raises(NotPermitted):
                        robot.recover()
                else:
                    robot.recover()
                    assert lab.daemon.engine.requests[-1][0] is role
                robot.stop()
        with connect(str(lab.daemon.socket), timeout_s=20) as robot:
            robot.recover()
        assert lab.daemon.engine.requests[-1][0] is Role.ADMIN


def test_without_roles_everybody_is_what_he_was(tmp_path):
    """A port with users and no roles: all of them may ask for everything, on the key that they know."""
    (tmp_path / "users").write_text("norma:n\n")
    (tmp_path / "users").chmod(0o600)
    lab = Lab(tmp_path, users_file=str(tmp_path / "users"))
    with lab.daemon:
        login = {"transport/auth/usrpwd": {"user": "norma", "password": "n"}}
        with session_to(f"tcp/127.0.0.1:{lab.port}", **login) as session:
            for number, request in enumerate(ALL.values()):
                assert answers(session, protocol.COMMAND_KEY, request, number) == ["OK"]
        assert {role for role, _ in lab.daemon.engine.requests} == {Role.ADMIN}


# ------------------------------------------------------------------------------------------------------------ pure


@pytest.mark.parametrize("role", Role)
@pytest.mark.parametrize("kind", Request.__args__)
def test_a_viewer_asks_for_stops_only(role, kind):
    """The daemon's own list, request by request; every request there is stands in this table."""
    assert kind in ALL
    refusal = not_permitted(Asker(user="vera", role=role), ALL[kind])
    assert (refusal is None) is (role is not Role.VIEWER or kind in FREE)
    if refusal is not None:
        assert refusal.code is Code.NOT_PERMITTED and kind.__name__ in refusal.message and refusal.bound == "operator"


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("ann", "no role"),
        ("ann:boss", "'boss' is no role: viewer, operator, admin"),
        ("*:admin", "no name"),
        ("a/b:admin", "no name"),
        ("$x:admin", "no name"),
        ("@x:admin", "no name"),
        ("ann:admin\nann:viewer", "line 2: 'ann' has a role already"),
        ("".join(f"n{number}:viewer\n" for number in range(MAX_USERS + 1)), f"{MAX_USERS} are the most"),
        (b"\xff:admin", "cannot be read"),
    ],
)
def test_a_file_of_roles_is_right_or_refused(tmp_path, text, said):
    """With its line: half a list would give somebody what he must not have."""
    path = tmp_path / "roles"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    with pytest.raises(ConfigError) as caught:
        read_roles(str(path))
    assert said in str(caught.value) and caught.value.field == "local.roles_file"


def test_roles_that_are_not_there_are_refused(tmp_path):
    """A file that does not exist is no empty list."""
    with pytest.raises(ConfigError, match="cannot be read"):
        read_roles(str(tmp_path / "none"))


def test_credentials_are_read_or_refused(tmp_path):
    """From a file whose names of files are relative to it."""
    path = tmp_path / "me.json"
    path.write_text('{"user": "ann", "password": "x", "root_ca": "ca.pem"}')
    assert Credentials.from_file(path) == Credentials(user="ann", password="x", root_ca=str(tmp_path / "ca.pem"))
    for wrong in ('{"users": "ann"}', "[]", "x"):
        path.write_text(wrong)
        with pytest.raises(Rejected, match=r"me\.json"):
            Credentials.from_file(path)
    with pytest.raises(Rejected):
        Credentials.from_file(tmp_path / "none.json")
