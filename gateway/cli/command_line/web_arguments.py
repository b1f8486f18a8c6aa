"""Arguments of `ta2 web`."""

from __future__ import annotations

from typing import Any

from gateway.cli.command_line.adding import add_command, add_target
from gateway.cli.command_line.numbers import integer, udp_port
from gateway.cli.command_line.video_arguments import PORT

__all__ = ["WEB_PORT", "add_web"]

WEB_PORT = 8700


def _port(text: str) -> int:
    return integer(text, 1, 65535, "a TCP port")


def add_web(commands: Any) -> None:  # noqa: ANN401  argparse's private class
    """Add `web`."""
    web = add_command(
        commands,
        "web",
        "serve a page with state, stop and control, and an HTTP API, on this host alone, until Ctrl-C",
        "Prints the address to open. From another computer: ssh -L 8700:127.0.0.1:8700 HOST, and open it there.",
    )
    add_target(web)
    web.add_argument(
        "--port", type=_port, default=WEB_PORT, metavar="N", help="TCP port on 127.0.0.1 (default %(default)s)"
    )
    web.add_argument("--video", action="store_true", help="show the robot's cameras to those who ask (extra `video`)")
    web.add_argument(
        "--video-port", type=udp_port, default=PORT, metavar="N", help="UDP port of the pictures (default %(default)s)"
    )
    web.add_argument("--metrics", action="store_true", help="let anybody on this host read /metrics (Prometheus)")
    web.add_argument("--json", action="store_true", help="print address and secret as JSON")
