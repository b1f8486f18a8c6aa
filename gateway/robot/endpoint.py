"""One spelling for an endpoint: what tells one robot from another must not hang on how somebody wrote its address.

`TCP/Robot.lab.:09000#iface=eth0` is `tcp/robot.lab:9000`; `localhost` and `[::1]` are `127.0.0.1`. A name and its number stay
two addresses: nobody is asked here. Pure.
"""

from __future__ import annotations

import ipaddress
import re

__all__ = ["canonical", "robot_name"]


def canonical(endpoint: str) -> str:
    """Return an endpoint in its one spelling: lower case, without options, an address in its shortest form.

    Args:
        endpoint: Of zenoh, e.g. `tcp/192.168.1.20:9000`.
    """
    plain = re.split("[?#]", endpoint.strip().lower())[0]
    protocol, _, address = plain.rpartition("/")
    host, _, port = address.rpartition(":")
    if not (protocol and host and port.isdecimal()):
        return plain
    return f"{protocol}/{_host(host)}:{int(port)}"


def robot_name(endpoint: str, namespace: str) -> str:
    """Return what tells one robot from another: its router's endpoint and the namespace of its bridge.

    Args:
        endpoint: Of the robot's router, however spelt.
        namespace: Of its bridge: two robots may stand behind one router.
    """
    return f"{canonical(endpoint)}/{namespace.strip('/')}".rstrip("/")


def _host(text: str) -> str:
    bare, percent, zone = text.strip("[]").partition("%")
    if bare.rstrip(".") == "localhost":
        return "127.0.0.1"
    try:
        address = ipaddress.ip_address(bare)
    except ValueError:  # a name
        return text.rstrip(".")
    if isinstance(address, ipaddress.IPv6Address):
        if address.is_loopback:
            return "127.0.0.1"
        if address.ipv4_mapped is None:
            return f"[{address.compressed}{percent}{zone}]"
        address = address.ipv4_mapped
    return str(address)
