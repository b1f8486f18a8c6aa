"""Arguments of `ta2 video` and its verbs."""

from __future__ import annotations

import argparse
from functools import partial
from pathlib import Path
from typing import Any

from gateway.cli.command_line.adding import add_command
from gateway.cli.command_line.numbers import above_zero, integer, seconds, udp_port

__all__ = ["PORT", "add_video"]

PORT = 8890
"""Where the robot sends its pictures to (manual §2.6.3)."""
PAYLOAD_TYPE = 96
"""RTP payload type of the robot's stream (manual §5.1)."""
FIRST_FRAME_S = 10.0
"""Time within which the first picture must come (manual §2.7.2) [s]."""
CHECK_S = 10.0
"""Packets and pictures are watched for so long (manual §2.7.2) [s]."""
DECODERS = ("auto", "software", "nvdec")
CODECS = ("h264", "h265")
_payload_type = partial(integer, least=0, most=127, what="RTP payload type")
_rate = partial(above_zero, most=240.0, what="rate [Hz]")


def add_video(commands: Any) -> None:  # noqa: ANN401  argparse's private class
    """Add `video` and its verbs; `options.verb` says which verb it is."""
    video = add_command(
        commands,
        "video",
        "look at the robot's video stream",
        "Without a gateway: the robot sends its pictures straight to this host.",
    )
    verbs = video.add_subparsers(title="what to do", dest="verb", metavar="VERB", required=True)
    _add_viewing(verbs)
    _add_recording(verbs)
    more = (
        "Writes a module rtp_video_interface.py of one import, which such programs find beside them or on PYTHONPATH."
    )
    shim = add_command(verbs, "shim", "let programs of the manual's chapter 6 run on this receiver, unchanged", more)
    shim.add_argument("folder", nargs="?", type=Path, default=Path(), metavar="DIR", help="where to (default: here)")


def _add_viewing(verbs: Any) -> None:  # noqa: ANN401  argparse's private class
    more = "q or Ctrl-C ends it. Without a display, or with --sheet, one JPEG file is written instead."
    view = add_command(verbs, "view", "show the six views in a window, or write a sheet that names each", more)
    _add_stream(view)
    _add_decoding(view)
    view.add_argument("--sheet", type=Path, metavar="FILE", help="write a sheet (JPEG) and end")
    view.add_argument(
        "--rate",
        type=_rate,
        default=15.0,
        metavar="HZ",
        help="pictures shown per second, at most (default %(default)g)",
    )


def _add_recording(verbs: Any) -> None:  # noqa: ANN401  argparse's private class
    more = "Nothing is encoded again: it takes about a hundredth of a core. Ends well with Ctrl-C."
    sub = add_command(verbs, "record", "record the robot's pictures as they come", more)
    _add_stream(sub)
    sub.add_argument("--seconds", type=seconds, metavar="S", help="how long [s] (default: until Ctrl-C)")
    sub.add_argument("--out", metavar="FILE", help=".mkv, or .mp4 (default: ta2-DATE-TIME.mkv here)")
    sub.add_argument("--split", action="store_true", help="split the six views off as well, into a folder beside it")
    _add_json(sub)
    sub = add_command(verbs, "split", "split a recording into the six views (manual §5.2), with its exact times")
    sub.add_argument("file", metavar="FILE", help="of `ta2 video record`; one that still grows is followed")
    sub.add_argument("--codec", choices=CODECS, default=CODECS[0], help="default: %(default)s")
    sub.add_argument(
        "--all-intra", action="store_true", help="each picture stands alone: larger, and quick to search in"
    )
    sub.add_argument("--views", nargs="+", metavar="NAME", help="only these (default: all six)")
    sub.add_argument("--out", metavar="DIR", help="folder (default: FILE without its ending)")
    _add_json(sub)
    sub = add_command(verbs, "info", "say what a recording holds: duration, rate, jitter, damaged stretches")
    sub.add_argument("file", metavar="FILE")
    _add_json(sub)
    more = "First picture, packets and pictures rising, six views, measured rate; each point that fails says why."
    sub = add_command(verbs, "check", "check the stream point by point (manual §2.7.2)", more)
    _add_stream(sub)
    _add_decoding(sub)
    sub.add_argument("--seconds", type=seconds, default=CHECK_S, metavar="S", help="how long [s] (default %(default)g)")
    sub.add_argument("--out", metavar="DIR", help="folder to keep recording and views in (default: none is kept)")
    _add_json(sub)


def _add_json(sub: argparse.ArgumentParser) -> None:
    sub.add_argument("--json", action="store_true", help="print JSON")


def _add_stream(sub: argparse.ArgumentParser) -> None:
    """Add which stream it is: for every verb that receives."""
    sub.add_argument("--port", type=udp_port, default=PORT, metavar="N", help="UDP port (default %(default)s)")
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
        type=seconds,
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
