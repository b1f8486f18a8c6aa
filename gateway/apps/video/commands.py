"""`ta2 video ...`: its verbs as data, and who carries out which.

Imports nothing but the standard library before a verb is carried out, so that `ta2 --help` is there at once.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping
from typing import Any, Protocol

from gateway.apps.ending import ExitStatus

__all__ = ["VERBS", "add_video", "carry_out"]

PORT = 8890
"""Where the robot sends its pictures to (manual §2.6.3)."""
PAYLOAD_TYPE = 96
"""RTP payload type of the robot's stream (manual §5.1)."""
FIRST_FRAME_S = 10.0
"""Time within which the first picture must come (manual §2.7.2) [s]."""
DECODERS = ("auto", "software", "nvdec")


class AddCommand(Protocol):
    """Adds a command."""

    def __call__(self, commands: Any, name: str, text: str, more: str = "") -> argparse.ArgumentParser:  # noqa: ANN401  argparse's private class
        """Return its parser."""
        ...


def add_video(commands: Any, add: AddCommand) -> None:  # noqa: ANN401  argparse's private class
    """Add `video` and its verbs; `options.verb` says which verb it is."""
    video = add(
        commands,
        "video",
        "look at the robot's video stream",
        "Without a gateway: the robot sends its pictures straight to this host.",
    )
    verbs = video.add_subparsers(title="what to do", dest="verb", metavar="VERB", required=True)
    del verbs  # each verb comes with what carries it out


def _add_stream(sub: argparse.ArgumentParser) -> None:
    """Add which stream it is: for every verb that receives."""
    sub.add_argument("--port", type=_port, default=PORT, metavar="N", help="UDP port (default %(default)s)")
    sub.add_argument(
        "--payload-type",
        type=_payload_type,
        default=PAYLOAD_TYPE,
        metavar="N",
        help="RTP payload type (default %(default)s)",
    )
    sender = sub.add_mutually_exclusive_group()
    sender.add_argument(
        "--robot", metavar="ROBOT", help="whose pictures: HOST, or as for `ta2 run` (default: as configured)"
    )
    sender.add_argument("--config", metavar="FILE", help="the gateway's settings, for the robot's address")
    sender.add_argument("--any-source", action="store_true", help="take pictures from whoever sends them")
    sub.add_argument(
        "--timeout",
        dest="timeout_s",
        type=_seconds,
        default=FIRST_FRAME_S,
        metavar="S",
        help="longest wait for the first picture [s] (default %(default)g)",
    )


def _add_decoding(sub: argparse.ArgumentParser) -> None:
    """Add how it is decoded: for every verb that needs pixels."""
    sub.add_argument(
        "--decoder", choices=DECODERS, default="auto", help="auto takes the GPU where it works (default %(default)s)"
    )
    sub.add_argument("--strict", action="store_true", help="leave out damaged pictures instead of marking them")


def _port(text: str) -> int:
    return _integer(text, 1, 65_535, "UDP port")


def _payload_type(text: str) -> int:
    return _integer(text, 0, 127, "RTP payload type")


def _integer(text: str, least: int, most: int, what: str) -> int:
    try:
        value = int(text)
    except ValueError:
        value = least - 1
    if not least <= value <= most:
        raise argparse.ArgumentTypeError(f"{text.strip()!r} is no {what} from {least} to {most}")
    return value


def _seconds(text: str) -> float:
    return _number(text, 86_400.0, "time [s]")


def _rate(text: str) -> float:
    return _number(text, 240.0, "rate [Hz]")


def _number(text: str, most: float, what: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = float("nan")
    if not 0.0 < value <= most:  # NaN compares false
        raise argparse.ArgumentTypeError(f"{text.strip()!r} is not a {what} above 0 and up to {most:g}")
    return value


# ------------------------------------------------------------------------------------------------------------ carry out


def carry_out(options: argparse.Namespace) -> ExitStatus:
    """Carry out `ta2 video VERB`; return the exit status.

    Raises:
        ConfigError: A library is missing, a port is taken, an address is none.
        GatewayTimeout: No picture came; the hint says why, as far as it can be known.
    """
    return VERBS[options.verb](options)


def _source(options: argparse.Namespace) -> str | None:
    """Return whose packets are taken: the robot's, unless anybody's are asked for."""
    from gateway.apps.video.source import robot_address

    if options.any_source:
        return None
    return robot_address(options.robot, options.config)


VERBS: Mapping[str, Callable[[argparse.Namespace], ExitStatus]] = {}
"""Who carries out which verb."""
