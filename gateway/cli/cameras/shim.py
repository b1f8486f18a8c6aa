"""`ta2 video shim`: puts the manual's module `rtp_video_interface` (§5.2, §6.9) beside a program that imports it.

The module is one line that leads here, so a program of the manual runs as it is, without GStreamer.
"""

from __future__ import annotations

from pathlib import Path

from gateway.cli.terminal.ending import ExitStatus
from gateway.video.errors import VideoCode, VideoError

__all__ = ["MODULE", "write_shim"]

MODULE = "rtp_video_interface.py"
"""The name that programs of the manual import."""
TEXT = '''"""The receiver of the manual's §6.9, without GStreamer. Written by `ta2 video shim`."""

from gateway.video.compat import TELEAVATAR_SPLIT_REGIONS, RTPH265VideoInterface

__all__ = ["TELEAVATAR_SPLIT_REGIONS", "RTPH265VideoInterface"]
'''


def write_shim(folder: Path) -> ExitStatus:
    """Write the module into a folder and say where; one that is there already is left as it is.

    Raises:
        VideoError: CANNOT_WRITE, another module of that name is there, or the folder cannot be written to.
    """
    path = folder / MODULE
    try:
        if path.exists():
            if path.read_text(encoding="utf-8") != TEXT:
                raise VideoError(
                    VideoCode.CANNOT_WRITE,
                    f"{path} is there already and is not ours, perhaps the manual's own",
                    "move it away, or name another folder and put that on PYTHONPATH",
                )
        else:
            path.write_text(TEXT, encoding="utf-8")
    except (OSError, UnicodeError) as error:
        raise VideoError(
            VideoCode.CANNOT_WRITE, f"{path} cannot be written: {error}", "name a folder that can be written to"
        ) from None
    print(path)
    return ExitStatus.OK
