"""How a command of `ta2` connects: under its own name, and never longer than it takes to notice that nobody is there."""

from __future__ import annotations

import os
from argparse import Namespace
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import gateway.client
from gateway.client import Robot
from gateway.client.connection.over_zenoh import Credentials
from gateway.errors import Disconnected

if TYPE_CHECKING:
    from gateway.settings.settings import LinkSettings

__all__ = ["CREDENTIALS_VARIABLE", "connected", "link_of"]

CREDENTIALS_VARIABLE = "TA2_CREDENTIALS"
"""Environment variable that names the file with user, password and certificates."""

GREETING_S = 5.0
"""Longest wait for the gateway, also of commands that wait longer for the robot [s]."""


def connected(command: str, target: str | None, timeout_s: float, *, greet: bool = True) -> Robot:
    """Return a connected robot, to be used in a `with` block.

    Args:
        command: Which command asks; others see `ta2 COMMAND` as the client's name.
        target: Where the gateway is; None finds its socket.
        timeout_s: Longest wait of the command [s].
        greet: Whether to wait for a first state; a stop does not.

    Raises:
        Disconnected: No gateway answers there.
    """
    how: dict[str, Any] = {"name": f"ta2 {command}", "timeout_s": min(timeout_s, GREETING_S), "greet": greet}
    path = os.environ.get(CREDENTIALS_VARIABLE, "")
    if path and target and target.startswith(("tcp/", "tls/")):
        how["credentials"] = Credentials.from_file(path)
    return gateway.client.connect(target, **how)


def link_of(options: Namespace) -> LinkSettings:
    """Return where the robot is, for a command that listens by itself: as its options say, or as the gateway says.

    Raises:
        ConfigError: The settings are wrong.
        Disconnected: No gateway says it, and nobody else does.
    """
    from gateway.settings import toml_file
    from gateway.settings.settings import LinkSettings

    if options.robot is not None or options.config is not None:
        return toml_file.overridden(
            toml_file.load(options.config), robot=options.robot, namespace=options.namespace, model=options.model
        ).link
    try:
        with connected(options.command, options.target, options.timeout_s) as robot:
            info = robot.info
    except Disconnected as error:
        hint = f"start the gateway with `ta2 run`, or name the robot with --robot: no gateway is needed to {options.command}"
        raise Disconnected(replace(error.refusal, hint=hint)) from None
    return LinkSettings(
        endpoint=info.robot,
        namespace=options.namespace if options.namespace is not None else info.namespace,
        model=options.model or info.model,
    )
