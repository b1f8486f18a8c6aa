"""Arguments of `ta2 view` and `ta2 web`: what shows the robot in another program's window."""

from __future__ import annotations

import argparse
from functools import partial
from pathlib import Path
from typing import Any

from gateway.cli.command_line.adding import add_client_command, add_command, add_target
from gateway.cli.command_line.numbers import above_zero, integer, seconds, udp_port
from gateway.cli.command_line.video_arguments import PORT

__all__ = ["add_view", "add_web"]

RATE_HZ = 20.0
MOST_HZ = 200.0
SUFFIX = ".rrd"
_rate = partial(above_zero, most=MOST_HZ, what="rate [Hz]")
_port = partial(integer, least=1, most=65535, what="TCP port")


def add_view(commands: Any) -> None:  # noqa: ANN401  argparse's private class
    """Add `view`."""
    view = add_client_command(
        commands,
        "view",
        "show the robot in three dimensions, its joints over time and what is told, in a window of Rerun",
        "It only looks. Ends with Ctrl-C, and when the window is closed.",
        shows_json=False,
    )
    view.add_argument("--bag", type=Path, metavar="DIR", help="show a recording instead; needs no gateway")
    view.add_argument("--save", type=_rrd, metavar="FILE", help=f"write a file (*{SUFFIX}) instead of opening a window")
    view.add_argument("--seconds", type=seconds, metavar="S", help="how long [s] (default: until Ctrl-C)")
    view.add_argument(
        "--rate", type=_rate, default=RATE_HZ, metavar="HZ", help="moments per second, at most (default %(default)g)"
    )
    view.add_argument("--video", action="store_true", help="show the cameras, too")
    view.add_argument(
        "--video-port", type=udp_port, default=PORT, metavar="N", help=f"UDP port of the pictures (default {PORT})"
    )
    view.add_argument("--config", metavar="FILE", help="the gateway's settings, for the numbers of this robot's body")


def _rrd(text: str) -> Path:
    if not text.endswith(SUFFIX):
        raise argparse.ArgumentTypeError(f"{text!r} does not end with {SUFFIX}")
    return Path(text)


WEB_PORT = 8700


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
    web.add_argument("--recordings", type=Path, metavar="DIR", help="list the recordings of this folder on the page")
    web.add_argument("--config", metavar="FILE", help="the gateway's settings, for the numbers of this robot's body")
    web.add_argument("--json", action="store_true", help="print address and secret as JSON")
