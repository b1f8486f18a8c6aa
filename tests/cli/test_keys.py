"""`ta2 keys`: what it makes, for whom, and what it does not replace. Others prove that they open a gateway."""

from __future__ import annotations

import errno
import json
import shutil
import stat
import sys
from datetime import timedelta
from pathlib import Path

import pytest
from cryptography import x509
from cryptography.x509.oid import ExtendedKeyUsageOID

from gateway.api.access.roles import read_roles
from gateway.cli import keys as module
from gateway.cli.main import main
from gateway.cli.terminal.connection import CREDENTIALS_VARIABLE, connected
from gateway.client import Credentials
from gateway.settings import toml_file
from gateway.values import Role


@pytest.fixture
def lab(tmp_path, capsys):
    """A folder, and a way to run `ta2 keys` there: status, standard output, standard error."""

    def run(*words):
        status = main(["keys", *words, "--dir", str(tmp_path / "keys")])
        read = capsys.readouterr()
        return status, read.out, read.err

    run.folder = tmp_path / "keys"
    return run


def certificate(folder):
    """Read one."""
    return x509.load_pem_x509_certificate((folder / "certificate.pem").read_bytes())


def test_what_is_made_is_whole_and_for_its_user_alone(lab):
    """Each folder can be given away as it is; each certificate is for one end and no authority of its own."""
    for words in (("init",), ("server", "robot.lab", "192.168.1.5", "[::1]"), ("client", "ann", "--role", "operator")):
        assert lab(*words)[0] == 0
    for path in lab.folder.rglob("*"):
        assert stat.S_IMODE(path.stat().st_mode) & 0o077 == 0, path
    server, ann = certificate(lab.folder / "server"), certificate(lab.folder / "clients" / "ann")
    names = server.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    assert names.get_values_for_type(x509.DNSName) == ["robot.lab"]
    assert [str(ip) for ip in names.get_values_for_type(x509.IPAddress)] == ["192.168.1.5", "::1"]
    for made, purpose in ((server, ExtendedKeyUsageOID.SERVER_AUTH), (ann, ExtendedKeyUsageOID.CLIENT_AUTH)):
        assert list(made.extensions.get_extension_for_class(x509.ExtendedKeyUsage).value) == [purpose]
        made.verify_directly_issued_by(certificate(lab.folder / "ca"))
    assert ann.subject.rfc4514_string() == "CN=ann"
    credentials = Credentials.from_file(lab.folder / "clients" / "ann" / "credentials.json")
    for path in (credentials.root_ca, credentials.certificate, credentials.private_key):
        assert Path(path).parent == lab.folder / "clients" / "ann" and Path(path).exists()


def test_the_settings_that_are_printed_can_be_pasted(lab, tmp_path):
    """They are a file of settings, whose roles are those that were given."""
    lab("init")
    _, out, _ = lab("server", "localhost")
    lab("client", "ann", "--role", "operator")
    lab("client", "bob", "--role", "admin")
    lab("client", "ann", "--role", "viewer", "--replace")
    (tmp_path / "config.toml").write_text(out)
    local = toml_file.load(tmp_path / "config.toml").local
    assert read_roles(local.roles_file) == {"bob": Role.ADMIN, "ann": Role.VIEWER}
    assert local.tcp == "0.0.0.0:7448" and local.audit_log.endswith("audit.jsonl")


@pytest.mark.parametrize("words", [("init",), ("server", "localhost"), ("client", "ann", "--role", "viewer")])
def test_nothing_is_replaced_unless_asked(lab, words):
    """What was given out would be worth nothing from then on."""
    lab("init")
    lab("server", "localhost")
    lab("client", "ann", "--role", "admin")
    before = {path: path.read_bytes() for path in lab.folder.rglob("*") if path.is_file()}
    status, _, err = lab(*words)
    assert status == 1 and "--replace" in err
    assert before == {path: path.read_bytes() for path in lab.folder.rglob("*") if path.is_file()}
    assert lab(*words, "--replace")[0] == 0
    assert before != {path: path.read_bytes() for path in lab.folder.rglob("*") if path.is_file()}


def test_only_a_new_authority_ends_what_was_made_before(lab):
    """A certificate that was replaced opens the gateway on, until its own end: nobody is told otherwise."""
    for words in (("init",), ("server", "localhost"), ("client", "ann", "--role", "admin")):
        lab(*words)
        err = lab(*words)[2]
        assert ("what was made before ends" in err) == (words[0] == "init")
        assert ("stays good until it ends" in err) == (words[0] != "init")


def test_a_key_that_cannot_be_written_leaves_nothing_behind(lab, monkeypatch):
    """Not even in a file that nobody looks at."""
    lab("init")
    lab("server", "localhost")
    before = set(lab.folder.rglob("*"))

    def full(*_):
        raise OSError(errno.ENOSPC, "No space left on device")

    for name in ("fsync", "replace"):
        with monkeypatch.context() as broken:
            broken.setattr(module.os, name, full)
            status, _, err = lab("server", "localhost", "--replace")
        assert status == 1 and "cannot be written: No space left" in err and set(lab.folder.rglob("*")) == before


def test_a_new_server_keeps_the_roles(lab):
    """They are not made, they are given."""
    lab("init")
    lab("server", "localhost")
    lab("client", "ann", "--role", "admin")
    lab("server", "localhost", "--replace")
    assert read_roles(str(lab.folder / "server" / "roles")) == {"ann": Role.ADMIN}


@pytest.mark.parametrize("name", ["a/b", "..", "*", "", "@x", "a b", "x" * 65, "ann\n"])
def test_a_name_that_is_none_is_refused(lab, name):
    """It would be a file elsewhere, or no part of a key."""
    lab("init")
    status, _, err = lab("client", name, "--role", "viewer")
    assert status == 1 and "no name" in err and not (lab.folder / "clients").exists()


def test_without_an_authority_nothing_is_signed(lab):
    """And the remedy is told; so it is where it is broken, or cannot be written."""
    status, _, err = lab("server", "localhost")
    assert status == 1 and "ta2 keys init" in err
    lab("init")
    (lab.folder / "ca" / "certificate.pem").write_text("nonsense")
    status, _, err = lab("server", "localhost")
    assert status == 1 and "cannot be read" in err
    lab("init", "--replace")
    assert lab("server", "")[0] == 1
    (lab.folder / "ca" / "key.pem").write_text("nonsense")
    status, _, err = lab("server", "localhost")
    assert status == 1 and "files of the authority" in err
    lab("init", "--replace")
    (lab.folder / "clients").write_text("a file")
    status, _, err = lab("client", "ann", "--role", "viewer")
    assert status == 1 and "cannot be written" in err


def test_what_ends_soon_or_has_ended_is_told(lab, monkeypatch):
    """As a table and as JSON; none outlives its authority."""
    assert "begin with" in lab("list")[1]
    lab("init", "--days", "100")
    lab("server", "localhost", "--days", "20")
    lab("client", "ann", "--role", "operator", "--days", "300")
    shown = json.loads(lab("list", "--json")[1])["keys"]
    assert [(key["name"], key["role"], key["days_left"]) for key in shown] == [
        ("ca", "", 99),
        ("server", "", 19),
        ("ann", "operator", 99),
    ]
    table = lab("list")[1].splitlines()
    assert ["--replace" in line for line in table] == [False, True, False]

    class Later(module.datetime):
        @classmethod
        def now(cls, tz=None):
            return super().now(tz) + timedelta(days=150)

    monkeypatch.setattr(module, "datetime", Later)
    assert lab("list")[1].count("HAS ENDED") == 3
    status, _, err = lab("client", "bob", "--role", "viewer")
    assert status == 1 and "has ended" in err


def test_what_a_new_authority_ended_is_told(lab):
    """Whatever is left of its days; where the authority is kept elsewhere nobody can tell."""
    for words in (("init",), ("server", "localhost"), ("client", "ann", "--role", "admin"), ("init", "--replace")):
        assert lab(*words)[0] == 0
    assert lab("client", "bob", "--role", "viewer")[0] == 0
    earlier = {key["name"]: key["is_of_an_earlier_authority"] for key in json.loads(lab("list", "--json")[1])["keys"]}
    assert earlier == {"ca": False, "server": True, "ann": True, "bob": False}
    lines = lab("list")[1].splitlines()
    assert [line.endswith("OF AN EARLIER AUTHORITY  <- make it anew with --replace") for line in lines] == [
        *earlier.values()
    ]
    shutil.rmtree(lab.folder / "ca")
    assert "EARLIER" not in lab("list")[1]


def test_a_key_that_ends_with_its_authority_is_told_with_its_own_end_and_with_what_helps(lab):
    """Made anew with --replace it would end on the same day."""
    lab("init", "--days", "10")
    shown = {words[1]: lab(*words)[1] for words in (
        ("server", "localhost"),
        ("client", "ann", "--role", "operator", "--days", "365"),
        ("client", "bob", "--role", "viewer", "--days", "5"),
    )}  # fmt: skip
    for at, name in ((lab.folder / "server", "localhost"), (lab.folder / "clients" / "ann", "ann")):
        until = f"good until {certificate(at).not_valid_after_utc.date()}, when the authority ends"
        assert until in shown[name] and "365" not in shown[name]
    assert "when the authority ends" not in shown["bob"]
    for line in lab("list")[1].splitlines():
        assert ("ta2 keys init --replace" in line) is not line.startswith("bob") and "--replace" in line


def test_without_the_wheel_it_says_which_extra(lab, monkeypatch):
    """Only those who make keys need it."""
    monkeypatch.delitem(sys.modules, "gateway.cli.keys")
    monkeypatch.setitem(sys.modules, "cryptography", None)
    status, _, err = lab("init")
    assert status == 1 and "teleavatar-gateway[keys]" in err


def test_commands_take_their_credentials_from_the_environment(monkeypatch, tmp_path):
    """On the network only: the socket asks nobody."""
    asked = []
    monkeypatch.setattr("gateway.client.connect", lambda target, **how: asked.append(how.get("credentials")))
    path = tmp_path / "credentials.json"
    path.write_text('{"user": "ann", "password": "x"}')
    monkeypatch.setenv(CREDENTIALS_VARIABLE, str(path))
    for target in ("tls/robot.lab:7448", None, "/run/ta2/gateway.sock"):
        connected("status", target, 1.0)
    monkeypatch.delenv(CREDENTIALS_VARIABLE)
    connected("status", "tls/robot.lab:7448", 1.0)
    assert asked == [Credentials(user="ann", password="x"), None, None, None]


def test_days_are_bounded(lab, capsys):
    """A century is enough."""
    for days in ("0", "-1", "40000", "x"):
        with pytest.raises(SystemExit):
            lab("init", "--days", days)
    assert not lab.folder.exists()
