"""Somebody else on the robot's router, for tests: sends commands, announces them as a ROS bridge does, poses as a gateway."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Sequence

import zenoh

from cdr_types.keys import Qos, Reliability, Token, TokenKind, format_token, topic_to_key
from gateway.link.codec import encode_frame
from gateway.link.others.gateway_token import format_gateway_token
from gateway.robot.topics import TOPICS

__all__ = ["Stranger"]


class Stranger:
    """One zenoh session of a program that knows nothing of us.

    Args:
        endpoint: Of the robot's router.
        stamps: Whether its samples carry its zenoh id, as those of a ROS bridge do; a plain zenoh program's do not.
        zid: Zenoh id; empty for a random one.
    """

    def __init__(self, endpoint: str, *, stamps: bool = False, zid: str = "") -> None:
        config: dict[str, object] = {
            "mode": "client",
            "connect": {"endpoints": [endpoint]},
            "scouting": {"multicast": {"enabled": False}, "gossip": {"enabled": False}},
            "timestamping": {"enabled": stamps},
        }
        if zid:
            config["id"] = zid
        self._session = zenoh.open(zenoh.Config.from_json5(json.dumps(config)))
        self.zid = str(self._session.zid())
        self._publishers: dict[str, zenoh.Publisher] = {}
        self._tokens: dict[str, zenoh.LivelinessToken] = {}

    def declare(self, topic: str) -> None:
        """Declare a publisher on a command topic, and send nothing."""
        self._publishers[topic] = self._session.declare_publisher(topic_to_key(topic))

    def undeclare(self, topic: str) -> None:
        """Take it back."""
        self._publishers.pop(topic).undeclare()

    def declare_without_pause(self, is_over: Callable[[], bool]) -> int:
        """Declare and undeclare subscriptions of no matter what until it is over; return how many."""
        count = 0
        while not is_over():
            self.listen(f"churn/{count % 50}").undeclare()
            count += 1
        return count

    def ask(self, selector: str) -> dict[str, bytes]:
        """Ask everybody; return the answers by key."""
        replies = self._session.get(selector, timeout=3.0)
        return {str(reply.ok.key_expr): reply.ok.payload.to_bytes() for reply in replies if reply.ok is not None}

    def put(self, topic: str, values: Sequence[float], key: str = "") -> None:
        """Send one command, without a declared publisher; on its own key, or on another that matches it."""
        self._session.put(key or topic_to_key(topic), encode_frame(topic, tuple(values), time.time_ns()))

    def delete(self, topic: str) -> None:
        """Send a DELETE, which a bridge writes as an empty sample."""
        self._session.delete(topic_to_key(topic))

    def listen(self, key: str) -> zenoh.Subscriber:
        """Only look, as a viewer does."""
        return self._session.declare_subscriber(key, lambda sample: None)

    def announce(self, topic: str) -> None:
        """Announce a ROS publisher of a command topic, as a bridge in front of it does."""
        token = Token(
            zid=self.zid,
            kind=TokenKind.MP,
            topic=topic,
            type_name=TOPICS[topic].type_name,
            qos=Qos(reliability=Reliability.RELIABLE),
        )
        self._hold(format_token(token))

    def retract(self, topic: str) -> None:
        """The ROS publisher has ended."""
        key = next(key for key in self._tokens if f"/MP/{topic[1:].replace('/', '§')}/" in key)
        self._tokens.pop(key).undeclare()

    def pose_as_gateway(self, *, is_armed: bool) -> None:
        """Show the tokens of a gateway."""
        self._hold(format_gateway_token(self.zid, "", is_armed=False))
        if is_armed:
            self._hold(format_gateway_token(self.zid, "", is_armed=True))

    def disarm(self) -> None:
        """Take the armed token in."""
        self._tokens.pop(format_gateway_token(self.zid, "", is_armed=True)).undeclare()

    def _hold(self, key: str) -> None:
        self._tokens[key] = self._session.liveliness().declare_token(key)

    def close(self) -> None:
        """Leave."""
        self._session.close()
