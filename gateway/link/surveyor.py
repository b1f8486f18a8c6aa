"""A look at the wire without a gateway: a session of its own that listens for some seconds and sends nothing.

It is the gateway's own link, told only to look (`RobotLink(is_reader=True)`): what it reports was learnt as a gateway would
learn it. Whoever looks is no gateway to others, declares no token and can publish on no key. Where no namespace was asked
for, the one of the only robot that is there is looked at; of several none is.
"""

from __future__ import annotations

import re
import socket
import time
from collections.abc import Callable

from msgspec.structs import replace

from gateway.api.protocol import Wire
from gateway.link.robot_link import RobotLink
from gateway.settings.settings import LinkSettings

__all__ = ["LISTEN_S", "look"]

LISTEN_S = 3.5
"""How long it listens: some samples of the slowest topic, one a second."""
CONNECT_S = 3.0
"""Longest wait for the router."""
ANNOUNCE_S = 1.5
"""Longest wait for the tokens of a robot; those that are there come in milliseconds."""
PERIOD_S = 0.01
PROBE_S = 2.0

TCP = re.compile(r"(?:tcp|tls)/(?P<host>\[[^]]+\]|[^:/]+):(?P<port>\d+)(?:[#?].*)?")


def look(settings: LinkSettings, *, is_named: bool, listen_s: float = LISTEN_S) -> Wire:
    """Look for some seconds; return what was seen. Without a transport the reason is in `trouble`.

    Where the namespace was not asked for, that of the only robot is taken.

    Raises:
        SettingsRefused: zenoh cannot read the endpoint.
    """
    wire, is_there = _listen(settings, lambda wire: settings.namespace.strip("/") in wire.robots, ANNOUNCE_S, listen_s)
    if not wire.is_up:
        return replace(wire, trouble=_why_not(settings.endpoint))
    if is_there or is_named or len(wire.robots) != 1:
        return wire
    wire, _ = _listen(replace(settings, namespace=wire.robots[0]), lambda wire: bool(wire.robots), ANNOUNCE_S, listen_s)
    return wire


def _listen(
    settings: LinkSettings, is_there: Callable[[Wire], bool], wait_s: float, listen_s: float
) -> tuple[Wire, bool]:
    """Open a link, wait for a robot, listen to it; return what was seen, and whether the robot was there. No link: at once."""
    link = RobotLink(settings, is_reader=True)
    link.open()
    try:
        if not _poll(link, lambda: link.is_up, CONNECT_S):
            return link.wire(), False
        found = _poll(link, lambda: is_there(link.wire()), wait_s)
        if found or not link.wire().robots:  # who else is connected is worth a look in any case
            _poll(link, lambda: False, listen_s)
        return link.wire(), found
    finally:
        link.close()


def _poll(link: RobotLink, is_so: Callable[[], bool], longest_s: float) -> bool:
    """Take what comes, until something is so or the time is over."""
    end_s = time.monotonic() + longest_s
    while True:
        link.poll()
        if is_so():
            return True
        if time.monotonic() >= end_s:
            return False
        time.sleep(PERIOD_S)


def _why_not(endpoint: str) -> str:
    """Return why nobody could be reached, in words: the address itself is tried once, without zenoh."""
    found = TCP.fullmatch(endpoint)
    if found is None:
        return f"no zenoh router answers at {endpoint}"
    host, port = found["host"].strip("[]"), int(found["port"])
    try:
        socket.create_connection((host, port), timeout=PROBE_S).close()
    except socket.gaierror:
        return f"nobody knows a host named {host}"
    except ConnectionRefusedError:
        return f"{host} is there, and nothing listens on its port {port}: is the robot's bridge running?"
    except TimeoutError:
        return f"{host} does not answer on port {port} within {PROBE_S:g} s: is it on, and in this network?"
    except OSError as error:
        return f"{host} cannot be reached: {error.strerror}"
    return f"something listens on port {port} of {host}, and it does not answer as a zenoh router does"
