"""Tests of how the local plane may listen."""

from __future__ import annotations

import os
from pathlib import Path
from types import SimpleNamespace

import pytest
import zenoh

from gateway.api import protocol
from gateway.api.listener import access_rules, network_configuration, unix_configuration
from gateway.errors import Code, ConfigError
from gateway.settings.settings import LocalSettings
from gateway.values import Role


def files(tmp_path, *names):
    """Return the names with paths of files that exist, for their owner alone."""
    for name in names:
        (tmp_path / name).write_text("x")
        (tmp_path / name).chmod(0o600)
    return {name: str(tmp_path / name) for name in names}


def test_nothing_listens_on_the_network_unless_configured(tmp_path):
    """The default is the unix socket alone."""
    assert network_configuration(LocalSettings()) is None
    assert unix_configuration(tmp_path / "gw.sock")["listen/endpoints"] == [f"unixsock-stream/{tmp_path}/gw.sock"]


OPEN = {"tcp_open_to_every_user_of_this_host": True}


@pytest.mark.parametrize("host", ["127.0.0.1", "[::1]", "localhost", "127.3.2.1"])
def test_on_this_host_nobody_connects_unknown_but_in_words(host, tmp_path):
    """Loopback lets in every user of the host: users, certificates of clients, or a setting that says so."""
    tls = files(tmp_path, "tls_certificate", "tls_private_key")
    for local in (LocalSettings(tcp=f"{host}:7448"), LocalSettings(tcp=f"{host}:7448", **tls)):
        with pytest.raises(ConfigError, match="every user of this host") as caught:
            network_configuration(local)
        assert "tcp_open_to_every_user_of_this_host = true" in caught.value.hint and caught.value.bound
    users, ca = files(tmp_path, "users_file"), files(tmp_path, "tls_root_ca")
    for known in (OPEN, users, tls | ca):
        configuration = network_configuration(LocalSettings(tcp=f"{host}:7448", **known))
        assert configuration["listen/endpoints"] == [f"{'tls' if known == tls | ca else 'tcp'}/{host}:7448"]


def test_the_word_for_everybody_is_for_loopback_and_stands_beside_no_users(tmp_path):
    """What contradicts itself is refused, not guessed."""
    users = files(tmp_path, "users_file")
    for local in (LocalSettings(tcp="0.0.0.0:7448", **OPEN), LocalSettings(tcp="127.0.0.1:7448", **users, **OPEN)):
        with pytest.raises(ConfigError, match="tcp_open_to_every_user_of_this_host"):
            network_configuration(local)
    assert network_configuration(LocalSettings(**OPEN)) is None


@pytest.mark.parametrize("host", ["0.0.0.0", "[::]", "192.168.1.5", "robot.lab", "127.0.0.1.evil.org"])
def test_beyond_this_host_nobody_connects_unknown(host, tmp_path):
    """Without users or certificates of clients the daemon refuses to listen; encryption alone is not enough."""
    tls = files(tmp_path, "tls_certificate", "tls_private_key")
    for local in (LocalSettings(tcp=f"{host}:7448"), LocalSettings(tcp=f"{host}:7448", **tls)):
        with pytest.raises(ConfigError) as caught:
            network_configuration(local)
        assert caught.value.code is Code.BAD_CONFIG and host in str(caught.value)


@pytest.mark.parametrize("host", ["0.0.0.0", "[::]", "192.168.1.5", "robot.lab"])
def test_beyond_this_host_users_need_tls(host, tmp_path):
    """Without it the password is no proof of who sends what comes behind it."""
    users = files(tmp_path, "users_file")
    with pytest.raises(ConfigError, match="need TLS") as caught:
        network_configuration(LocalSettings(tcp=f"{host}:7448", **users))
    assert caught.value.field == "local.users_file" and "tls_certificate" in caught.value.hint


def test_users_or_certificates_open_the_network(tmp_path):
    """With TLS, and a file of users or certificates of clients, it listens."""
    users = files(tmp_path, "users_file", "tls_certificate", "tls_private_key")
    configuration = network_configuration(LocalSettings(tcp="0.0.0.0:7448", **users))
    assert configuration["transport/auth/usrpwd"] == {"dictionary_file": users["users_file"]}
    assert configuration["listen/endpoints"] == ["tls/0.0.0.0:7448"]
    tls = files(tmp_path, "tls_certificate", "tls_private_key", "tls_root_ca")
    configuration = network_configuration(LocalSettings(tcp="0.0.0.0:7448", **tls))
    assert configuration["listen/endpoints"] == ["tls/0.0.0.0:7448"]
    assert configuration["transport/link/tls"]["enable_mtls"] is True


@pytest.mark.parametrize(
    "settings",
    [
        {"tcp": "7448"},
        {"tcp": "127.0.0.1:"},
        {"tcp": "127.0.0.1:0"},
        {"tcp": "127.0.0.1:99999"},
        {"tcp": "127.0.0.1:1#a=b"},
        {"tcp": "127.0.0.1:1", "users_file": "/nowhere/users"},
        {"tcp": "127.0.0.1:1", "tls_certificate": "/etc/hostname"},
        {"tcp": "127.0.0.1:1", "tls_root_ca": "/etc/hostname"},
    ],
)
def test_half_a_configuration_is_refused(settings):
    """Ports, files and pairs of files that are not there are named before anything listens."""
    with pytest.raises(ConfigError):
        network_configuration(LocalSettings(**settings))


def owned(status, owner):
    """Return what is said of a file as if it were somebody's."""
    return os.stat_result((*status[:4], owner, *status[5:10]))


@pytest.mark.parametrize(
    ("name", "mode", "owner", "hint"),
    [
        ("users_file", 0o604, 0, "chmod 640"),
        ("users_file", 0o620, 1000, "chmod 600"),
        ("users_file", 0o640, 1000, "chmod 600"),
        ("users_file", 0o640, 0, ""),
        ("users_file", 0o640, 65534, ""),
        ("tls_private_key", 0o644, 0, "chmod 640"),
        ("tls_private_key", 0o440, 0, ""),
        ("tls_root_ca", 0o664, 1000, "chmod go-w"),
        ("tls_root_ca", 0o444, 1000, ""),
        ("roles_file", 0o646, 1000, "chmod go-w"),
        ("roles_file", 0o644, 1000, ""),
        ("tls_certificate", 0o666, 1000, ""),
    ],
)
def test_secrets_are_nobody_elses_to_read_nor_roles_to_write(name, mode, owner, hint, tmp_path, monkeypatch):
    """A group may read what is root's, or another user's, as keys of services are kept; the refusal says what to do."""
    named = files(tmp_path, "users_file", "tls_certificate", "tls_private_key", "tls_root_ca", "roles_file")
    Path(named[name]).chmod(mode)
    told = SimpleNamespace(
        access=os.access, R_OK=os.R_OK, geteuid=lambda: 1000, stat=lambda path: owned(os.stat(path), owner)
    )
    monkeypatch.setattr("gateway.api.listener.os", told)
    local = LocalSettings(tcp="0.0.0.0:7448", **named)
    if not hint:
        assert network_configuration(local)
        return
    with pytest.raises(ConfigError, match=f"{mode:o}") as caught:
        network_configuration(local)
    assert caught.value.field == f"local.{name}" and caught.value.hint == f"{hint} {named[name]}"


@pytest.mark.parametrize(
    "configuration", [unix_configuration("/x"), network_configuration(LocalSettings(tcp="[::1]:1", **OPEN))]
)
def test_the_plane_is_closed_but_for_its_listener(configuration):
    """No scouting, no admin space, no shared memory, no connection outwards, and a list of what is allowed."""
    assert configuration["mode"] == "router" and configuration["connect/endpoints"] == []
    for key in ("scouting/multicast", "scouting/gossip", "adminspace", "transport/shared_memory"):
        assert configuration[f"{key}/enabled"] is False
    assert configuration["access_control"]["default_permission"] == "deny"


@pytest.mark.parametrize("secret", ["s", "-", "_" * 64])
def test_what_is_dropped_for_everybody_meets_no_clients_own_keys(secret):
    """Keys for everybody meet the dropped ones; a client's own keys, whatever its secret, do not."""
    dropping, pings = unix_configuration("/x")["downsampling"]
    assert pings["flows"] == ["ingress"] and pings["messages"] == ["query"]
    assert [rule["key_expr"] for rule in pings["rules"]] == [protocol.PING_KEY], "no stop is ever one too many"
    assert dropping["flows"] == ["ingress"] and dropping["messages"] == ["put"]
    dropped = [zenoh.KeyExpr(rule["key_expr"]) for rule in dropping["rules"] if rule["freq"] == 0.0]
    own = [zenoh.KeyExpr(key) for key in protocol.lane_keys("ann", secret)]
    assert len(dropped) == len(own) == 3
    for here, lane in zip(dropped, own, strict=True):
        assert not any(each.intersects(lane) for each in dropped)
        what = str(lane).split("/")[2]
        ours = f"{what}/ann/1" if what == "target" else f"{what}/ann"
        guesses = [f"{ours}/{part}" for part in ("*", "s$*", "$*s", "s$*s", "$*s$*s$*", "$*-$*")]
        for wild in (
            "**",
            f"{what}/**",
            f"{what}/ann/**",
            f"{what}/*/**",
            f"{what}/a$*/**",
            *guesses,
            f"**/{guesses[1][-3:]}",
        ):
            assert here.intersects(zenoh.KeyExpr(f"{protocol.ROOT}/{wild}"))


def test_no_rule_has_both_directions():
    """A rule with both flows would let a viewer inject what it may only see."""
    rules = access_rules()["rules"]
    assert all(len(rule["flows"]) == 1 for rule in rules)
    inward = {
        (m, key)
        for rule in rules
        if rule["flows"] == ["ingress"]
        for m in rule["messages"]
        for key in rule["key_exprs"]
    }
    assert ("put", protocol.SNAPSHOT_KEY) not in inward and ("put", protocol.EVENT_KEY) not in inward
    assert not any(message == "declare_queryable" for message, _ in inward)
    assert set(access_rules()["policies"][0]["rules"]) == {rule["id"] for rule in rules}


ROLES = {"vera": Role.VIEWER, "olaf": Role.OPERATOR, "anna": Role.ADMIN}


def test_roles_need_names(tmp_path):
    """Of users or certificates, at a port: a list for nobody would only look like a protection."""
    roles = files(tmp_path, "roles_file")
    for local in (LocalSettings(**roles), LocalSettings(tcp="127.0.0.1:7448", **OPEN, **roles)):
        with pytest.raises(ConfigError, match="who may open the socket is an admin") as caught:
            network_configuration(local, ROLES)
        assert caught.value.field == "local.roles_file"


@pytest.mark.parametrize("by", ["usernames", "cert_common_names"])
def test_each_user_has_a_key_that_nobody_else_may_use(tmp_path, by):
    """By password where there is one, else by certificate; only who may command puts targets; nobody loses his stop."""
    tls = files(tmp_path, "tls_certificate", "tls_private_key", "tls_root_ca", "roles_file")
    users = files(tmp_path, "users_file") if by == "usernames" else {}
    control = network_configuration(LocalSettings(tcp="0.0.0.0:1", **tls, **users), ROLES)["access_control"]
    rules = {rule["id"]: rule for rule in control["rules"]}
    subjects = {
        subject["id"]: {key: value for key, value in subject.items() if key != "id"} for subject in control["subjects"]
    }
    assert all(rule["permission"] == "allow" and len(rule["flows"]) == 1 for rule in rules.values())
    may = {
        tuple(next(iter(subjects[who].values()), ())): [
            (message, key)
            for name in policy["rules"]
            for message in rules[name]["messages"]
            for key in rules[name]["key_exprs"]
            if rules[name]["flows"] == ["ingress"]
        ]
        for policy in control["policies"]
        for who in policy["subjects"]
    }
    assert all(subject == {} or set(subject) == {by} for subject in subjects.values())
    assert set(may) == {(), ("vera",), ("olaf",), ("anna",)}
    for name, role in ROLES.items():
        own = [("query", protocol.command_key(name))]
        moving = [("put", protocol.TARGET_KEYS), ("put", protocol.KEEPALIVE_KEYS)]
        assert may[(name,)] == own + ([] if role is Role.VIEWER else moving)
    assert ("put", protocol.STOP_KEY) in may[()] and ("query", protocol.ESTOP_KEY) in may[()]
    assert not [
        key for message, key in may[()] if message == "put" and key in (protocol.TARGET_KEYS, protocol.KEEPALIVE_KEYS)
    ]


def test_without_roles_nothing_has_changed():
    """Everybody is one subject, who may put targets, too."""
    control = access_rules()
    assert [subject["id"] for subject in control["subjects"]] == ["everybody"] and len(control["policies"]) == 1
    assert protocol.TARGET_KEYS in [key for rule in control["rules"] for key in rule["key_exprs"]]
