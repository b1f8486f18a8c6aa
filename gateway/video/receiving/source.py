"""Whose packets are taken: the robot's address, as a person or the gateway's settings name it.

The receiver compares the address of each packet with it, so that nobody else on the network can put pictures before a
policy (§2.6.3 asks for the same in the firewall).
"""

from __future__ import annotations

import socket

from gateway.errors import Code, failure
from gateway.settings import toml_file

__all__ = ["host_of", "robot_address"]


def host_of(robot: str) -> str:
    """Return the host in what names a robot: `tcp/HOST:PORT`, `HOST:PORT`, `[HOST]:PORT` or `HOST`."""
    place = robot.rpartition("/")[2].partition("?")[0].partition("#")[0]
    if place.startswith("["):
        return place[1:].partition("]")[0]
    return place if place.count(":") > 1 else place.partition(":")[0]


def robot_address(robot: str | None, file: str | None) -> str:
    """Return the robot's IPv4 address.

    Args:
        robot: What names it, see `host_of`; None takes the settings.
        file: Of the gateway's settings; None takes the defaults.

    Raises:
        ConfigError: BAD_CONFIG, the settings are wrong, or nobody knows the name.
    """
    host = host_of(toml_file.load(file).link.endpoint if robot is None else robot)
    try:
        found = socket.getaddrinfo(host, None, socket.AF_INET, socket.SOCK_DGRAM)
    except (OSError, UnicodeError) as error:
        raise failure(
            Code.BAD_CONFIG,
            f"the robot's address {host!r} cannot be found: {error}",
            field="robot",
            value=host,
            hint="name the robot by its IP address: --robot 192.168.1.20",
        ) from None
    return str(found[0][4][0])
