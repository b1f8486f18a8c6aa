"""Arguments of `ta2 view` and `ta2 web`, which show the robot in another program's window, and of `ta2 incident`."""

from __future__ import annotations

import argparse
from functools import partial
from pathlib import Path
from typing import Any

from gateway.cli.command_line.adding import add_client_command, add_command, add_target
from gateway.cli.command_line.numbers import above_zero, integer, seconds, udp_port
from gateway.cli.command_line.video_arguments import PORT

__all__ = ["add_incident", "add_view", "add_web"]

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
        "serve a page with state, stop and control, and an HTTP API, until Ctrl-C",
        "Prints the address to open. On this host alone, unless there are TLS and users: --host with --certificate, --key and "
        "--users. From another computer otherwise: ssh -L 8700:127.0.0.1:8700 HOST, and open it there.",
    )
    add_target(web)
    web.add_argument("--port", type=_port, default=WEB_PORT, metavar="N", help="TCP port (default %(default)s)")
    web.add_argument(
        "--host", default="127.0.0.1", metavar="ADDR", help="IP address to listen on (default %(default)s)"
    )
    web.add_argument(
        "--name", action="append", default=[], metavar="NAME", help="what browsers call this host; may be repeated"
    )
    web.add_argument("--certificate", type=Path, metavar="FILE", help="of this host, for TLS (PEM, with its chain)")
    web.add_argument("--key", type=Path, metavar="FILE", help="of the certificate (PEM)")
    web.add_argument("--users", type=Path, metavar="FILE", help="who may log in, in place of the printed secret")
    web.add_argument("--add-user", metavar="NAME", help="ask for a password, write it (hashed) to --users, and end")
    web.add_argument("--video", action="store_true", help="show the robot's cameras to those who ask (extra `video`)")
    web.add_argument(
        "--video-port", type=udp_port, default=PORT, metavar="N", help="UDP port of the pictures (default %(default)s)"
    )
    web.add_argument("--metrics", action="store_true", help="let anybody who gets here read /metrics (Prometheus)")
    web.add_argument("--recordings", type=Path, metavar="DIR", help="list the recordings of this folder on the page")
    web.add_argument("--config", metavar="FILE", help="the gateway's settings, for the numbers of this robot's body")
    web.add_argument("--json", action="store_true", help="print address and secret as JSON")


def add_incident(commands: Any) -> None:  # noqa: ANN401  argparse's private class
    """Add `incident` with its verbs; `options.verb` says which one it is."""
    incident = add_command(
        commands,
        "incident",
        "look at what the black box kept of latches, takeovers and aborts, and run the engine on it again",
        "Reads files of gateways of this user, or a service, and needs none that runs.",
    )
    verbs = incident.add_subparsers(title="what to do", dest="verb", metavar="VERB", required=True)
    for verb, text in (
        ("list", "list what is kept, the oldest first"),
        ("show", "print what happened, when, and what it was kept for"),
        ("replay", "run the engine on it in virtual time: status 0 when every frame is the same, bit by bit"),
    ):
        sub = add_command(verbs, verb, text)
        if verb != "list":
            sub.add_argument(
                "name", nargs="?", default="", metavar="INCIDENT", help="name or folder (default: the newest)"
            )
        if verb == "show":
            sub.add_argument("--html", type=Path, metavar="FILE", help="write a page for a browser, too")
        sub.add_argument(
            "--dir", type=Path, metavar="DIR", help="where they are kept (default: this user's, and a service's)"
        )
        sub.add_argument("--json", action="store_true", help="print JSON on standard output")
