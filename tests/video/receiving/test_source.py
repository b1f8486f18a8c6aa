"""Tests of whose packets are taken: the robot's address as people and settings name it."""

from __future__ import annotations

import pytest

from gateway.errors import Code, ConfigError
from gateway.video.receiving.source import host_of, robot_address


@pytest.mark.parametrize(
    ("typed", "host"),
    [
        ("192.168.1.20", "192.168.1.20"),
        ("192.168.1.20:9000", "192.168.1.20"),
        ("tcp/192.168.1.20:9000", "192.168.1.20"),
        ("tls/robot.local:9000#so_sndbuf=65000", "robot.local"),
        ("[fe80::1%eth0]:9000", "fe80::1%eth0"),
        ("::1", "::1"),
    ],
)
def test_a_robot_is_named_as_for_the_gateway(typed, host):
    """Host, host and port, or the whole endpoint of `ta2 run --robot`: only the host matters for video."""
    assert host_of(typed) == host


def test_without_a_name_the_settings_say_whose_pictures(tmp_path):
    """The address that the gateway connects to is the one that pictures come from."""
    assert robot_address(None, None) == "127.0.0.1"
    settings = tmp_path / "settings.toml"
    settings.write_text('[robot]\nendpoint = "tcp/127.0.0.7:9000"\n')
    assert robot_address(None, str(settings)) == "127.0.0.7"
    assert robot_address("tcp/127.0.0.8:9000", str(settings)) == "127.0.0.8"


def test_a_name_that_nobody_knows_is_a_clear_error():
    """It names the host and what to type."""
    with pytest.raises(ConfigError) as caught:
        robot_address("no such host", None)
    assert (
        caught.value.code is Code.BAD_CONFIG and "no such host" in str(caught.value) and "--robot" in str(caught.value)
    )
