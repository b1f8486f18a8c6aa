"""The liveliness tokens by which gateways see each other through the robot's router.

```
[namespace/]teleavatar_gateway/<zid>          a gateway is connected: its declared publishers command nothing yet
[namespace/]teleavatar_gateway/<zid>/armed    it commands the robot, or is about to
```

Robots of several namespaces behind one router are commanded apart, so the tokens carry the namespace.
"""

from __future__ import annotations

import re
from typing import NamedTuple

from cdr_types.keys import topic_to_key

__all__ = ["GatewayToken", "format_gateway_token", "gateway_tokens", "parse_gateway_token"]

ZID = re.compile(r"[0-9a-f]{1,32}")
ARMED = "armed"


class GatewayToken(NamedTuple):
    """What a token says.

    Attributes:
        zid: Zenoh id of the gateway's session.
        is_armed: Whether it is the second kind.
    """

    zid: str
    is_armed: bool


def gateway_tokens(namespace: str) -> str:
    """Return the key expression of all of them.

    Args:
        namespace: Of the robot's bridge; empty for none.
    """
    return f"{_start(namespace)}/**"


def format_gateway_token(zid: str, namespace: str, *, is_armed: bool) -> str:
    """Return the key of one.

    Args:
        zid: Zenoh id of the session, or `*`.
        namespace: Of the robot's bridge; empty for none.
        is_armed: Whether the gateway commands the robot.
    """
    key = f"{_start(namespace)}/{zid}"
    return f"{key}/{ARMED}" if is_armed else key


def parse_gateway_token(key: str, namespace: str) -> GatewayToken | None:
    """Return what a key says; None when it is none of them."""
    start, _, rest = key.partition(f"{_start(namespace)}/")
    zid, slash, state = rest.partition("/")
    if start or ZID.fullmatch(zid) is None or (slash and state != ARMED):
        return None
    return GatewayToken(zid, bool(slash))


def _start(namespace: str) -> str:
    return topic_to_key("/teleavatar_gateway", namespace)
