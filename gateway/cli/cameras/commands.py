"""`ta2 video ...`: who carries out which verb.

Imports nothing but the standard library before a verb is carried out, so that `ta2 --help` is there at once.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from gateway.cli.terminal.ending import ExitStatus

if TYPE_CHECKING:
    from gateway.video.errors import VideoError
    from gateway.video.receiving.receiver import ReceiverSettings
    from gateway.video.video import Video

__all__ = ["VERBS", "carry_out"]


def carry_out(options: argparse.Namespace) -> ExitStatus:
    """Carry out `ta2 video VERB`; return the exit status.

    Raises:
        ConfigError: BAD_CONFIG, the settings are wrong, or the robot's name is unknown.
    """
    from gateway.video.errors import VideoError

    try:
        return VERBS[options.verb](options)
    except VideoError as error:
        return _report(error, as_json=getattr(options, "json", False))


def _report(error: VideoError, *, as_json: bool) -> ExitStatus:
    """Tell what went wrong, on standard error, and for scripts as JSON on standard output; return the exit status."""
    from gateway.video.errors import VideoCode, VideoTimeout

    status = ExitStatus.REFUSED
    if isinstance(error, VideoTimeout):
        status = ExitStatus.NO_GATEWAY
    elif error.code in (VideoCode.PORT_BUSY, VideoCode.BAD_ADDRESS, VideoCode.NOT_INSTALLED, VideoCode.NO_DECODER):
        status = ExitStatus.USAGE
    elif error.code in (VideoCode.RECEIVER_FAILED, VideoCode.DECODER_FAILED, VideoCode.TAKER_FAILED):
        status = ExitStatus.BROKEN
    print(error, file=sys.stderr)
    if as_json:
        failure = {"code": error.code.value, "message": error.message, "hint": error.hint}
        print(json.dumps({"ok": False, "error": failure, "exit_status": int(status)}, ensure_ascii=False))
    return status


def _source(options: argparse.Namespace) -> str | None:
    """Return whose packets are taken: the robot's, unless anybody's are asked for."""
    from gateway.video.receiving.source import robot_address

    if options.any_source:
        return None
    return robot_address(options.robot, options.config)


def _settings(options: argparse.Namespace) -> ReceiverSettings:
    from gateway.video.receiving.receiver import ReceiverSettings

    return ReceiverSettings(source=_source(options), port=options.port, payload_type=options.payload_type)


def _record(options: argparse.Namespace) -> ExitStatus:
    from gateway.cli.cameras.record import default_path, record

    return record(
        _settings(options),
        default_path() if options.out is None else Path(options.out),
        seconds=options.seconds,
        first_s=options.timeout_s,
        is_split=options.split,
        as_json=options.json,
    )


def _split(options: argparse.Namespace) -> ExitStatus:
    from gateway.cli.cameras.splitting import show_split
    from gateway.video.decoding.views import VIEWS
    from gateway.video.recording.coding import Coding

    return show_split(
        Path(options.file),
        None if options.out is None else Path(options.out),
        options.views or VIEWS,
        Coding(codec=options.codec, is_all_intra=options.all_intra),
        as_json=options.json,
    )


def _info(options: argparse.Namespace) -> ExitStatus:
    from gateway.cli.cameras.info import show_info

    return show_info(Path(options.file), as_json=options.json)


def _video(options: argparse.Namespace) -> Video:
    from gateway.video.video import Video

    return Video(
        _source(options),
        port=options.port,
        payload_type=options.payload_type,
        strict=options.strict,
        decoder=options.decoder,
    )


def _view(options: argparse.Namespace) -> ExitStatus:
    from gateway.cli.cameras.view import view

    return view(_video(options), sheet=options.sheet, rate_hz=options.rate, timeout_s=options.timeout_s)


def _shim(options: argparse.Namespace) -> ExitStatus:
    from gateway.cli.cameras.shim import write_shim

    return write_shim(options.folder)


def _check(options: argparse.Namespace) -> ExitStatus:
    from gateway.cli.cameras.check import check

    video = _video(options)
    folder = None if options.out is None else Path(options.out)
    return check(video, seconds=options.seconds, first_s=options.timeout_s, folder=folder, as_json=options.json)


VERBS: Mapping[str, Callable[[argparse.Namespace], ExitStatus]] = {
    "view": _view,
    "record": _record,
    "split": _split,
    "info": _info,
    "check": _check,
    "shim": _shim,
}
"""Who carries out which verb."""
