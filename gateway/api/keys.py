"""Keys, sizes and rates of the local API. The number in the keys is the protocol's version.

Import these names from `gateway.api.protocol`, whose docstring has the table.
"""

from __future__ import annotations

from typing import Final

__all__ = [
    "ARM_DOF",
    "CHECK_IN_KEYS",
    "CLIENT_TOKENS",
    "COMMAND_KEY",
    "DAEMON_TOKENS",
    "ESTOP_KEY",
    "EVENT_KEY",
    "FLEET_ROOT",
    "FSM_NAMES",
    "HEARTBEAT_TOPIC",
    "INFO_KEY",
    "JSON",
    "KEEPALIVE_KEYS",
    "KEEPALIVE_PERIOD_NS",
    "MAX_PAYLOAD_BYTES",
    "MAX_REASON",
    "MEMBER_TOKENS",
    "MSGPACK",
    "PING_KEY",
    "PROTOCOL_VERSION",
    "REPLY_WITHIN_NS",
    "ROOT",
    "ROUTES_KEY",
    "SNAPSHOT_KEY",
    "STOP_KEY",
    "TARGET_KEYS",
    "USER_TOKENS",
    "check_in_key",
    "client_token",
    "command_key",
    "daemon_token",
    "keepalive_key",
    "lane_keys",
    "printable",
    "put_by",
    "target_key",
    "token_id",
    "token_version",
    "user_token",
]

PROTOCOL_VERSION: Final = 1
"""Rises when an older client or daemon could misunderstand a message."""

MSGPACK: Final = "application/msgpack"
JSON: Final = "application/json"

MAX_PAYLOAD_BYTES: Final = 64 * 1024
"""Largest request or target that is looked at: a chunk of 450 points with times for both arms fits, as msgpack; else they are
far below 4 KiB."""
MAX_REASON: Final = 256
"""Longest text of a client that is passed on or logged [characters]."""

KEEPALIVE_PERIOD_NS: Final = 50_000_000
"""How often an owner's client library shows that it lives [ns]; it counts as lost after 250 ms."""

REPLY_WITHIN_NS: Final = 2_000_000_000
"""The daemon answers every command within this time [ns], if only to say that its outcome is unknown."""

ARM_DOF: Final = 7
"""Joints per arm (manual §4.0.3)."""

FSM_NAMES: Final = {
    -1: "ERROR",
    0: "PAUSE",
    1: "SLOW_START",
    2: "READY",
    3: "LEFT_ARM_ONLY",
    4: "RIGHT_ARM_ONLY",
    5: "PLAY_READY",
    6: "PLAY",
}
"""Values of `/fsm_state` (manual §4.11.1)."""

HEARTBEAT_TOPIC: Final = "/api/fsm/enable"
"""Where the daemon sends the FSM heartbeat, as a snapshot's `streams` name it (manual §4.7)."""

ROOT: Final = f"ta2/{PROTOCOL_VERSION}"
STOP_KEY: Final = "ta2/stop"
"""Whatever arrives here, a put or a query with any payload or none, is a stop. The same in every version of the protocol."""
ESTOP_KEY: Final = "ta2/estop"
"""Whatever arrives here is an e-stop."""
PING_KEY: Final = "ta2/ping"
"""Whoever asks here is answered as one who stops is, with nothing, and nothing happens. The guard asks."""
COMMAND_KEY: Final = f"{ROOT}/command"
INFO_KEY: Final = f"{ROOT}/info"
ROUTES_KEY: Final = f"{ROOT}/routes"
SNAPSHOT_KEY: Final = f"{ROOT}/snapshot"
EVENT_KEY: Final = f"{ROOT}/event"
TARGET_KEYS: Final = f"{ROOT}/target/**"
KEEPALIVE_KEYS: Final = f"{ROOT}/keepalive/**"
CHECK_IN_KEYS: Final = f"{ROOT}/check_in/**"
CLIENT_TOKENS: Final = f"{ROOT}/alive/client/*"
DAEMON_TOKENS: Final = "ta2/*/alive/daemon/*"
"""Tokens of daemons of any version."""
USER_TOKENS: Final = f"{ROOT}/alive/user/*"
"""The token that tells a user of the network under which name the daemon knows him: he sees his own alone."""
FLEET_ROOT: Final = "fleet"
"""On a fleet's router a robot's keys are `fleet/NAME/ta2/...`: a session with namespace `fleet/NAME` sees them as its own."""
MEMBER_TOKENS: Final = f"{ROOT}/alive/member/*"
"""Tokens of those who are a robot in its fleet: two of one name are two gateways under one name."""


def target_key(client_id: str, stream_id: int, secret: str) -> str:
    """Return the key on which a client puts the targets of one of its streams. Nobody but the daemon sees it."""
    return f"{ROOT}/target/{client_id}/{stream_id}/{secret}"


def keepalive_key(client_id: str, secret: str) -> str:
    """Return the key on which a client shows that it lives. Nobody but the daemon sees it."""
    return f"{ROOT}/keepalive/{client_id}/{secret}"


def check_in_key(client_id: str, secret: str) -> str:
    """Return the key on which a stop endpoint shows that its user lives. Nobody but the daemon sees it."""
    return f"{ROOT}/check_in/{client_id}/{secret}"


def lane_keys(client_id: str, secret: str) -> tuple[str, str, str]:
    """Return the keys of a client's targets, keepalives and check-ins: who does not know its secret cannot write there."""
    return f"{ROOT}/target/{client_id}/*/{secret}", keepalive_key(client_id, secret), check_in_key(client_id, secret)


def put_by(key: str) -> tuple[str, str, str]:
    """Return client, stream and secret in the key of a target, a keepalive or a check-in; only a target has a stream."""
    _, _, what, client_id, *rest = [*key.split("/", 6), "", "", ""][:6]
    stream, secret = rest if what == "target" else ("", rest[0])
    return client_id, stream, secret


def command_key(user: str) -> str:
    """Return the key on which a user asks whom the daemon knows by name; an empty name stands for everybody else."""
    return f"{COMMAND_KEY}/{user}" if user else COMMAND_KEY


def user_token(user: str) -> str:
    """Return the liveliness token that tells a user his name."""
    return f"{ROOT}/alive/user/{user}"


def client_token(client_id: str) -> str:
    """Return the liveliness token of a client."""
    return f"{ROOT}/alive/client/{client_id}"


def daemon_token(daemon_id: str) -> str:
    """Return the liveliness token of a daemon."""
    return f"{ROOT}/alive/daemon/{daemon_id}"


def printable(text: str) -> str:
    """Return a text that can be shown in a terminal or a log: no control characters, at most `MAX_REASON` long."""
    return "".join(c if c.isprintable() else "?" for c in text[:MAX_REASON])


def token_id(key: str) -> str:
    """Return who a token (or a keepalive) belongs to: the last chunk of its key."""
    return key.rpartition("/")[2]


def token_version(key: str) -> str:
    """Return the protocol version in a key, as text: the second chunk."""
    return key.split("/", 2)[1]
