"""What comes from the robot's router, as it comes: a session that subscribes, and may do nothing else.

Its access control lets no put leave, so whatever becomes of the process it commands nothing. It announces its subscriptions as
the gateway does: without that, a gateway that leaves would end them for good (the bridge forgets its reader with the last
subscriber it knows). Its lease is the gateway's: a recorder that stands still is hung up on by the robot's router before the
robot's own buffers are full.

Callbacks stamp and store.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import zenoh

from cdr_types.keys import Token, TokenKind, format_token
from gateway.link.connecting import connect
from gateway.link.robot_session import STATE_QOS
from gateway.link.session_config import session_config
from gateway.process.callbacks import direct
from gateway.recording.topics import RecordedTopic
from gateway.settings.settings import LinkSettings

__all__ = ["Tap"]

Take = Callable[[int, int, bytes], None]
"""Takes a message: number of its topic, monotonic arrival [ns], payload."""


class Tap:
    """Listens, once there is somebody to listen to.

    Args:
        settings: Where the robot is.
        topics: What to listen to; those without a key are somebody else's.
        take: Called in zenoh's threads with each message; must not wait.
    """

    def __init__(self, settings: LinkSettings, topics: Sequence[RecordedTopic], take: Take) -> None:
        self._settings = settings
        self._topics = topics
        self._take = take
        self._session: zenoh.Session | None = None
        self._kept: list[Any] = []  # Any: whatever zenoh declares
        self._is_closing = threading.Event()

    @property
    def is_open(self) -> bool:
        """Whether the robot's router was reached."""
        return self._session is not None

    def open(self) -> None:
        """Connect and listen; returns when both are done, or when `close` was called.

        Raises:
            SettingsRefused: zenoh cannot read the endpoint.
        """
        config = partial(session_config, self._settings, is_reader=True, is_heard=True)
        session = connect(config, self._settings.endpoint, lambda seconds: not self._is_closing.wait(seconds))
        if session is None:
            return
        zid = str(session.zid())
        for topic in self._topics:
            if topic.is_state:
                token = Token(zid=zid, kind=TokenKind.MS, topic=topic.name, type_name=topic.type_name, qos=STATE_QOS)
                self._kept.append(session.liveliness().declare_token(format_token(token)))
        for number, topic in enumerate(self._topics):
            if topic.key:
                self._kept.append(session.declare_subscriber(topic.key, direct(self._taker(number))))
        self._session = session

    def _taker(self, number: int) -> Callable[[zenoh.Sample], None]:
        take, clock = self._take, time.monotonic_ns

        def receive(sample: zenoh.Sample) -> None:
            take(number, clock(), sample.payload.to_bytes())

        return receive

    def close(self) -> None:
        """Listen no more. May be called again."""
        self._is_closing.set()
        session, self._session = self._session, None
        self._kept.clear()
        if session is not None:
            session.close()  # type: ignore[no-untyped-call]  # zenoh's stub gives no types here
