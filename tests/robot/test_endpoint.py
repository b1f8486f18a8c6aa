"""One spelling for each endpoint."""

from __future__ import annotations

import pytest

from gateway.robot.endpoint import canonical, robot_name

HOME, LAB = "tcp/127.0.0.1:9000", "tcp/[2001:db8::1]:9000"


@pytest.mark.parametrize(
    ("endpoint", "one"),
    [
        (HOME, HOME),
        (" TCP/LocalHost:9000 ", HOME),
        ("tcp/[::1]:9000", HOME),
        ("tcp/[0:0:0:0:0:0:0:1]:09000", HOME),
        ("tcp/[::ffff:127.0.0.1]:9000", HOME),
        ("tcp/127.0.0.1:9000?rel=1", HOME),
        ("tcp/127.0.0.1:9000#iface=lo;so_sndbuf=1", HOME),
        ("tcp/localhost.:9000", HOME),
        ("tcp/[2001:0DB8:0::1]:9000", LAB),
        ("tcp/Robot.Lab.:9000", "tcp/robot.lab:9000"),
        ("tcp/[fe80::1%eth0]:9000", "tcp/[fe80::1%eth0]:9000"),
        ("tcp/127.0.0.2:9000", "tcp/127.0.0.2:9000"),
        ("udp/127.0.0.1:9000", "udp/127.0.0.1:9000"),
        ("tcp/127.0.0.1:9001", "tcp/127.0.0.1:9001"),
        ("no endpoint", "no endpoint"),
    ],
)
def test_an_address_has_one_spelling(endpoint: str, one: str) -> None:
    """Case, options, zeros and names of this host do not make another robot; protocol, port and address do."""
    assert canonical(endpoint) == one
    assert canonical(one) == one


def test_two_robots_behind_one_router_have_two_names() -> None:
    """By namespace, which is told by its case."""
    names = {robot_name(HOME, namespace) for namespace in ("", "/lab/", "lab", "Lab", "lab/two")}
    assert names == {HOME, f"{HOME}/lab", f"{HOME}/Lab", f"{HOME}/lab/two"}
