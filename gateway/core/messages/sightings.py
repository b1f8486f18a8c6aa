"""What the robot plane sees of others on the robot: writers of our command keys, data on them, other gateways.

Frozen values, no behaviour. Who is there is always told whole (all writers, all gateways), so that nothing depends on the
order in which arrivals and losses of a link are heard. `others.py` remembers, `rivalry.py` decides.
"""

from __future__ import annotations

from enum import Enum
from typing import TypeAlias

from msgspec import Struct

__all__ = [
    "Befriended",
    "ClaimShown",
    "ForeignData",
    "ForeignTokens",
    "Gateway",
    "GatewayTokens",
    "Means",
    "Sighting",
    "Writer",
]


class Means(str, Enum):
    """How somebody announces that he publishes: by the token of a ROS bridge, or by a publisher declared on zenoh."""

    TOKEN = "token"
    PUBLISHER = "publisher"


class Writer(Struct, frozen=True, kw_only=True):
    """Somebody who announces to publish on a command key.

    Attributes:
        topic: ROS name of the command topic.
        zid: Zenoh id of the session, for a ROS node that of its bridge.
        means: How it is known.
        link: Address of the session, as the robot's router sees it; empty when unknown.
    """

    topic: str
    zid: str
    means: Means
    link: str = ""


class ForeignTokens(Struct, frozen=True, kw_only=True):
    """All who announce to publish on our command keys now, ourselves left out where that is known.

    Attributes:
        writers: Each topic of each of them.
        at_ns: When it was seen [ns].
    """

    writers: tuple[Writer, ...]
    at_ns: int


class ForeignData(Struct, frozen=True, kw_only=True):
    """Samples on one of our command keys that this session did not send.

    Attributes:
        topic: ROS name of the command topic.
        zid: Zenoh id of who stamped them; empty when only the robot's router did, so that nobody is named.
        at_ns: When they were found [ns]; they came since the last look.
        count: How many since the last such event.
        link: Address of that session; empty when unknown.
    """

    topic: str
    zid: str
    at_ns: int
    count: int = 1
    link: str = ""


class Gateway(Struct, frozen=True, kw_only=True):
    """A gateway on the robot's router.

    Attributes:
        zid: Zenoh id of its session.
        is_armed: Whether it says that it commands the robot, or is about to.
        link: Address of the session; empty when unknown.
    """

    zid: str
    is_armed: bool
    link: str = ""


class GatewayTokens(Struct, frozen=True, kw_only=True):
    """All other gateways that are there now.

    Attributes:
        gateways: One each.
        at_ns: When it was seen [ns].
    """

    gateways: tuple[Gateway, ...]
    at_ns: int


class ClaimShown(Struct, frozen=True, kw_only=True):
    """Our own `armed` token is out.

    Attributes:
        claim: Number of the claim that it was put out for.
        at_ns: When it was handed to the robot's router [ns].
    """

    claim: int
    at_ns: int


class Befriended(Struct, frozen=True, kw_only=True):
    """A session is ours: this daemon's own, or its guard's. What it says and sends is not foreign.

    Attributes:
        zid: Its zenoh id.
        at_ns: When it was said [ns].
    """

    zid: str
    at_ns: int


Sighting: TypeAlias = ForeignTokens | ForeignData | GatewayTokens | ClaimShown | Befriended
