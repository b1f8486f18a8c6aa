"""How the local plane listens: zenoh configurations, and what they may not be.

Rules
    * Two sessions, never one with the robot's: router mode, explicit listeners only, no scouting, no admin space, no
      shared memory (it leaves files behind when a client is killed).
    * The unix socket and the network have a session each, since zenoh asks users and passwords of both or of neither:
      who may open the socket is decided by its permission bits.
    * A port has no permission bits: even on loopback every user of this host reaches it. So nobody gets in unknown: users
      with passwords, or TLS with certificates of clients, are demanded, unless the configuration says in words that all
      users of this host may drive the robot. TLS that only encrypts would let in anybody who reaches the port.
    * Beyond this host there is TLS: without it a password, and every command behind it, can be read and used by others.
    * What clients may do is listed, flow by flow; everything else is dropped before it reaches us. A list with both
      flows in one rule would let a viewer inject snapshots.
    * Secrets are nobody else's to read, and what says who gets in, or who may what, is nobody else's to write. As elsewhere,
      a group may read what is root's, or another user's: so a service's user reads a key that he cannot change.

Pure: texts to dictionaries; only looks whether the named files exist, and for whom.
"""

from __future__ import annotations

import ipaddress
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from gateway.api import protocol
from gateway.api.access.roles import access_control, allow
from gateway.errors import Code, GatewayError, failure
from gateway.settings.settings import LocalSettings
from gateway.values import Role

__all__ = ["access_rules", "is_loopback", "network_configuration", "refused_setting", "unix_configuration"]

MAX_MESSAGE_BYTES = 256 * 1024
"""A larger message ends the connection of its sender; larger than `MAX_PAYLOAD_BYTES`, so that that is answered."""

CLIENT_STALL_US = 50_000
"""A client that does not read for so long while what must reach it waits, and 200 kB before it, loses its connection [us].
Answers are none of that: zenoh would wait for room to say that they are complete, and keep Python's lock meanwhile."""

HANDSHAKES = 100
"""So many may be about to say who they are: zenoh turns to each of them before it reads what others have sent."""
HERE_MS, BEYOND_MS = 1000, 5000
"""How long that may take on this host's socket, and over a network [ms]."""

BATCH_BYTES = 1024
"""What is read of a connection at once, in both directions. zenoh turns to the next connection after 64 of them at most: with
its own 64 kB, one flood kept all other connections waiting for half a second."""

BATCHES = 16
"""May wait in the queue to a client: two snapshots. zenoh takes no more."""

VIEW_STALL_US = 5_000
"""A snapshot or an answer that does not fit there within this time is not sent to this client [us]."""

PINGS_HZ = 5.0
"""More of one connection end in zenoh. The guard asks once a second."""

NO_SECRET = "$*!$*"
"""What no secret is, for none has that mark; a wildcard for secrets may stand for it, be it `*`, `**` or `7$*`. Those are
dropped: one of them that were heard told how a secret begins."""

FILES = {"users_file": 0o077, "tls_certificate": 0, "tls_private_key": 0o077, "tls_root_ca": 0o022, "roles_file": 0o022}
"""Permission bits that the named files must not have."""

LEASE_MS = 2000
"""Silence after which a client's connection counts as lost over the network [ms]; the keepalive is what decides."""


def unix_configuration(path: Path) -> dict[str, Any]:
    """Return the zenoh configuration of the session that listens on a unix socket."""
    return _router(f"unixsock-stream/{path}", HERE_MS)


def network_configuration(local: LocalSettings, roles: Mapping[str, Role] | None = None) -> dict[str, Any] | None:
    """Return the zenoh configuration of the session that listens on the network; None when none is asked for.

    Args:
        local: Its settings.
        roles: Who has which; None where whoever gets in may ask for everything.

    Raises:
        ConfigError: BAD_CONFIG. No host and port, a file is missing or open to others, it would listen without knowing who
            connects, or beyond this host without TLS.
    """
    if local.roles_file and not (local.tcp and (local.users_file or local.tls_root_ca)):
        message = "roles are for users or certificates of local.tcp: who may open the socket is an admin"
        raise refused_setting("roles_file", local.roles_file, message, "tcp with users_file or tls_root_ca")
    if not local.tcp:
        return None
    host, port = _host_and_port(local.tcp)
    if bool(local.tls_certificate) != bool(local.tls_private_key):
        raise refused_setting("tls_certificate", local.tls_certificate, "certificate and private key belong together")
    if local.tls_root_ca and not local.tls_certificate:
        raise refused_setting(
            "tls_root_ca", local.tls_root_ca, "certificates of clients need TLS with a certificate and key"
        )
    for name, closed in FILES.items():
        if path := getattr(local, name):
            _demand_closed(name, path, closed)
    _demand_known(local, is_loopback=is_loopback(host))
    configuration = _router(f"{'tls' if local.tls_certificate else 'tcp'}/{host}:{port}", BEYOND_MS)
    if roles is not None:  # of somebody with both, the name counts for which he has a password
        kind = "usernames" if local.users_file else "cert_common_names"
        configuration["access_control"] = access_rules(roles, kind)
    if local.users_file:
        configuration["transport/auth/usrpwd"] = {"dictionary_file": local.users_file}
    if local.tls_certificate:
        configuration["transport/link/tls"] = {
            "listen_certificate": local.tls_certificate,
            "listen_private_key": local.tls_private_key,
            **({"root_ca_certificate": local.tls_root_ca, "enable_mtls": True} if local.tls_root_ca else {}),
        }
    return configuration


def _demand_closed(name: str, path: str, closed: int) -> None:
    """Refuse a file that cannot be read, or that has permission bits which must be closed.

    Raises:
        ConfigError: BAD_CONFIG.
    """
    if not os.access(path, os.R_OK):
        raise refused_setting(name, path, "there is no readable file of this name")
    status = os.stat(path)
    is_lent = status.st_uid == 0 or status.st_uid != os.geteuid()  # outside a container root may be anybody
    if status.st_mode & closed & (~0o040 if is_lent else ~0):
        what, mode = ("use", "640" if is_lent else "600") if closed & 0o044 else ("change", "go-w")
        message = f"others than its owner may {what} it (mode {status.st_mode & 0o777:o})"
        raise refused_setting(name, path, message, hint=f"chmod {mode} {path}")


def _demand_known(local: LocalSettings, *, is_loopback: bool) -> None:
    """Refuse a port at which strangers would be let in.

    Raises:
        ConfigError: BAD_CONFIG.
    """
    is_known = bool(local.users_file or local.tls_root_ca)
    if local.tcp_open_to_every_user_of_this_host and (is_known or not is_loopback):
        raise refused_setting(
            "tcp_open_to_every_user_of_this_host",
            "true",
            "opens a port on loopback to people without a name: not one beyond this host, nor beside users or certificates",
            bound="false, or tcp on 127.0.0.1 or [::1] without users_file and tls_root_ca",
            hint=f"set it to false, or local.tcp = {local.tcp!r} to a port on loopback that asks nobody",
        )
    if not (is_known or is_loopback):
        raise refused_setting(
            "tcp",
            local.tcp,
            "beyond this host nobody may connect unknown: TLS with users_file or with tls_root_ca is needed",
            bound="127.0.0.1 or [::1]",
            hint="set tls_certificate, tls_private_key and users_file or tls_root_ca, or listen on loopback",
        )
    if not (is_loopback or local.tls_certificate):
        raise refused_setting(
            "users_file",
            local.users_file,
            f"at {local.tcp}, beyond this host, users need TLS: anybody on the way could use their connections",
            bound="tcp on 127.0.0.1 or [::1] without TLS",
            hint="set tls_certificate and tls_private_key, or listen on loopback",
        )
    if not (is_known or local.tcp_open_to_every_user_of_this_host):
        raise refused_setting(
            "tcp",
            local.tcp,
            "every user of this host could drive the robot there: users_file or tls_root_ca is needed",
            bound="a port that knows who connects",
            hint="set users_file, use the unix socket, or write tcp_open_to_every_user_of_this_host = true",
        )


def _router(endpoint: str, handshake_ms: int) -> dict[str, Any]:
    return {
        "mode": "router",
        "listen/endpoints": [endpoint],
        "connect/endpoints": [],
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        "scouting/delay": 0,  # a router without scouting would still wait half a second before it opens
        "adminspace/enabled": False,
        "transport/shared_memory/enabled": False,
        "transport/link/rx/max_message_size": MAX_MESSAGE_BYTES,
        "transport/link/tx/lease": LEASE_MS,
        "transport/link/tx/batch_size": BATCH_BYTES,
        "transport/link/tx/queue/size/data": BATCHES,
        "transport/link/tx/queue/congestion_control/drop/wait_before_drop": VIEW_STALL_US,
        "transport/link/tx/queue/congestion_control/drop/max_wait_before_drop_fragments": VIEW_STALL_US,
        "transport/link/tx/queue/congestion_control/block/wait_before_close": CLIENT_STALL_US,
        "transport/unicast/accept_timeout": handshake_ms,
        "transport/unicast/accept_pending": HANDSHAKES,
        "access_control": access_rules(),
        # Answers have the QoS of their questions: nobody is waited for who asks and does not read.
        "qos/network": [
            {
                "id": "answers_wait_for_nobody",
                "flows": ["ingress"],
                "messages": ["query"],
                "overwrite": {"congestion_control": "drop"},
            }
        ],
        "downsampling": [
            {
                "id": "to_everybody",
                "flows": ["ingress"],
                "messages": ["put"],
                "rules": [{"key_expr": key, "freq": 0.0} for key in protocol.lane_keys("*", NO_SECRET)],
            },
            {
                "id": "pings",
                "flows": ["ingress"],
                "messages": ["query"],
                "rules": [{"key_expr": protocol.PING_KEY, "freq": PINGS_HZ}],
            },
        ],
    }


def access_rules(roles: Mapping[str, Role] | None = None, subject_kind: str = "usernames") -> dict[str, Any]:
    """Return what a client may do: stop, ask, put targets, keepalives and check-ins, show its token, listen. Nothing else.

    Args:
        roles: Who has which; None where everybody may do all of it.
        subject_kind: By what zenoh knows them: `usernames` or `cert_common_names`.
    """
    questions = [protocol.PING_KEY, protocol.COMMAND_KEY, protocol.INFO_KEY, protocol.ROUTES_KEY, protocol.SNAPSHOT_KEY]
    views = [protocol.SNAPSHOT_KEY, protocol.EVENT_KEY]
    stops = [protocol.STOP_KEY, protocol.ESTOP_KEY]
    rules = [
        allow("stop", "ingress", ["query", "put", "delete"], stops),
        allow("take_stop", "egress", ["reply", "declare_queryable", "declare_subscriber"], stops),
        allow("ask", "ingress", ["query"], questions),
        allow("answer", "egress", ["reply", "declare_queryable"], questions),
        allow("put", "ingress", ["put"], [protocol.CHECK_IN_KEYS]),
        allow("listen", "ingress", ["declare_subscriber"], views),
        allow("show", "egress", ["put"], views),
        allow("client_token", "ingress", ["liveliness_token"], [protocol.CLIENT_TOKENS]),
        allow(
            "watch_daemon",
            "ingress",
            ["liveliness_query", "declare_liveliness_subscriber"],
            [protocol.DAEMON_TOKENS, protocol.USER_TOKENS],
        ),
        allow("daemon_token", "egress", ["liveliness_token", "reply"], [protocol.DAEMON_TOKENS]),
    ]
    moving = allow("move", "ingress", ["put"], [protocol.TARGET_KEYS, protocol.KEEPALIVE_KEYS])
    return access_control(rules, moving, roles, subject_kind)


def _host_and_port(text: str) -> tuple[str, int]:
    host, colon, port = text.removeprefix("tcp/").removeprefix("tls/").rpartition(":")
    if not (colon and host and port.isdecimal() and 0 < int(port) < 65536) or any(mark in text for mark in "#?;"):
        raise refused_setting("tcp", text, "HOST:PORT with a port from 1 to 65535 is needed, e.g. 127.0.0.1:7448")
    return host, int(port)


def is_loopback(host: str) -> bool:
    """Whether a host is this one for sure."""
    try:
        return host == "localhost" or ipaddress.ip_address(host.strip("[]")).is_loopback
    except ValueError:  # a name: it may be any machine
        return False


def refused_setting(name: str, value: str, message: str, bound: str = "", hint: str = "") -> GatewayError:
    """Return the error of a setting of the local plane."""
    return failure(
        Code.BAD_CONFIG,
        f"local.{name} = {value!r}: {message}",
        field=f"local.{name}",
        value=value,
        bound=bound,
        hint=hint,
    )
