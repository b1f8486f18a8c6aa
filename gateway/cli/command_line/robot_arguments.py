"""Arguments that say which robot is meant, and where it is."""

from __future__ import annotations

import argparse
import re

__all__ = ["MODELS", "MODES", "PARTS", "ROBOT_PORT", "SIM_ENDPOINT", "add_robot", "endpoint", "namespace"]

ROBOT_PORT = 9000
"""Where the robot's router listens (manual §2.4)."""

SIM_ENDPOINT = f"tcp/127.0.0.1:{ROBOT_PORT}"
"""Where the simulated robot listens, and where the gateway looks for a robot, unless told otherwise."""

MODELS = ("lite", "standard", "lift")
"""Keys of `topics.VARIANTS`, written out: to show a help text, nothing needs to be imported."""
PARTS, MODES = ("left_arm", "right_arm", "chassis", "lift_servo"), ("joint", "pose")
"""Parts that can be switched off, and control modes of an arm (manual §2.3)."""


def endpoint(text: str) -> str:
    """Return the zenoh endpoint of a robot from what a person typed: `tcp/HOST:PORT`, `HOST:PORT` or `HOST`.

    Raises:
        ArgumentTypeError: It is a number, which names no host.
    """
    if text.isdigit():
        raise argparse.ArgumentTypeError(f"{text!r} names no host: tcp/HOST:PORT, HOST:PORT or HOST is needed")
    if "/" in text:
        return text
    if text.count(":") > 1 and not text.startswith("["):
        text = f"[{text}]"  # a bare IPv6 address
    has_port = ":" in text.rpartition("]")[2]
    return f"tcp/{text}" if has_port else f"tcp/{text}:{ROBOT_PORT}"


def namespace(text: str) -> str:
    """Return a ROS namespace.

    Raises:
        ArgumentTypeError: It is none.
    """
    if text and re.fullmatch(r"/?[A-Za-z0-9_]+(/[A-Za-z0-9_]+)*", text) is None:
        raise argparse.ArgumentTypeError(f"{text!r} is not made of words of letters, digits and _, joined by /")
    return text


def add_robot(sub: argparse.ArgumentParser, verb: str, otherwise: str) -> None:
    """Add `--robot`, `--config`, `--namespace` and `--model`."""
    sub.add_argument("--robot", type=endpoint, metavar="ROBOT", help=f"{verb} this robot's router without a gateway")
    sub.add_argument("--config", metavar="FILE", help="the same with the gateway's settings")
    sub.add_argument(
        "--namespace", type=namespace, metavar="NAME", help=f"of the robot's bridge (default: {otherwise})"
    )
    sub.add_argument("--model", choices=MODELS, help="of the robot (default: as configured, standard)")
