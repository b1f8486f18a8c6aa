"""The local API, all that a client must know: keys, messages, encodings, sizes and where the daemon is.

```
key                                   what                                  who sends        message
ta2/1/command                         query, exactly one reply              client           Command -> Reply
ta2/1/info                            query                                 client           (empty) -> Info
ta2/1/routes                          query                                 client           (empty) -> Routes
ta2/1/snapshot                        query: the newest one                 client           (empty) -> Snapshot
ta2/1/snapshot                        put at 50 Hz while somebody listens   daemon           Snapshot, seq attached
ta2/1/event                           put                                   daemon           Notice
ta2/1/target/<client>/<stream>        put, the newest wins                  client           Target
ta2/1/keepalive/<client>              put every 50 ms by the owner          client           (empty)
ta2/1/alive/daemon/<id>               liveliness token                      daemon
ta2/1/alive/client/<client>           liveliness token                      client
```

Rules
    * The number in the keys is the version. Tokens of another version tell a client that the releases do not match.
    * msgpack (`application/msgpack`) or JSON (`application/json`), as the zenoh encoding of the query says; the reply
      uses the same. Puts of the daemon are msgpack. No encoding means msgpack.
    * A payload above `MAX_PAYLOAD_BYTES` is refused before it is looked at.

This module and what it imports are all that `gateway.client` knows of the daemon: msgspec, the standard library and
`gateway.errors`. It opens nothing and sends nothing.
"""

from __future__ import annotations

from gateway.api.address import Address, AddressRefused, default_socket, find_socket, parse_address
from gateway.api.encoding import (
    Malformed,
    decode_command,
    decode_info,
    decode_notice,
    decode_reply,
    decode_routes,
    decode_snapshot,
    decode_target,
    encode,
    prepare,
    refusal_of,
)
from gateway.api.keys import (
    ARM_DOF,
    CLIENT_TOKENS,
    COMMAND_KEY,
    DAEMON_TOKENS,
    EVENT_KEY,
    FSM_NAMES,
    INFO_KEY,
    JSON,
    KEEPALIVE_KEYS,
    KEEPALIVE_PERIOD_NS,
    MAX_PAYLOAD_BYTES,
    MSGPACK,
    PROTOCOL_VERSION,
    REPLY_WITHIN_NS,
    ROOT,
    ROUTES_KEY,
    SNAPSHOT_KEY,
    TARGET_KEYS,
    client_token,
    daemon_token,
    keepalive_key,
    target_key,
    token_id,
    token_version,
)
from gateway.api.structs import (
    Abandon,
    Acquire,
    Cancel,
    CloseStream,
    Command,
    Disable,
    Enable,
    Estop,
    Hold,
    Info,
    Move,
    Notice,
    OnLimitName,
    OnLossName,
    OpenStream,
    Recover,
    RefusalMessage,
    Release,
    Reply,
    Request,
    Routes,
    SideName,
    Stop,
    Take,
    Target,
)
from gateway.api.views import (
    ArmView,
    EnableView,
    LeaseView,
    LinkView,
    LoopView,
    ModeView,
    MotionView,
    MotorView,
    Snapshot,
    StreamView,
    TargetView,
    TopicView,
)

__all__ = [
    "ARM_DOF",
    "CLIENT_TOKENS",
    "COMMAND_KEY",
    "DAEMON_TOKENS",
    "EVENT_KEY",
    "FSM_NAMES",
    "INFO_KEY",
    "JSON",
    "KEEPALIVE_KEYS",
    "KEEPALIVE_PERIOD_NS",
    "MAX_PAYLOAD_BYTES",
    "MSGPACK",
    "PROTOCOL_VERSION",
    "REPLY_WITHIN_NS",
    "ROOT",
    "ROUTES_KEY",
    "SNAPSHOT_KEY",
    "TARGET_KEYS",
    "Abandon",
    "Acquire",
    "Address",
    "AddressRefused",
    "ArmView",
    "Cancel",
    "CloseStream",
    "Command",
    "Disable",
    "Enable",
    "EnableView",
    "Estop",
    "Hold",
    "Info",
    "LeaseView",
    "LinkView",
    "LoopView",
    "Malformed",
    "ModeView",
    "MotionView",
    "MotorView",
    "Move",
    "Notice",
    "OnLimitName",
    "OnLossName",
    "OpenStream",
    "Recover",
    "RefusalMessage",
    "Release",
    "Reply",
    "Request",
    "Routes",
    "SideName",
    "Snapshot",
    "Stop",
    "StreamView",
    "Take",
    "Target",
    "TargetView",
    "TopicView",
    "client_token",
    "daemon_token",
    "decode_command",
    "decode_info",
    "decode_notice",
    "decode_reply",
    "decode_routes",
    "decode_snapshot",
    "decode_target",
    "default_socket",
    "encode",
    "find_socket",
    "keepalive_key",
    "parse_address",
    "prepare",
    "refusal_of",
    "target_key",
    "token_id",
    "token_version",
]
