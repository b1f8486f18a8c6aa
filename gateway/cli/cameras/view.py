"""`ta2 video view`: the six views live in a window, or as one file where there is no display."""

from __future__ import annotations

import sys
from collections.abc import Callable
from datetime import datetime
from pathlib import Path

from gateway.cli.terminal.ending import ExitStatus, Interrupted
from gateway.video.decoding.frame import Frame
from gateway.video.sheet import Sheet, write_sheet
from gateway.video.video import Video
from gateway.video.window import Window, open_window

__all__ = ["title_of", "view"]

WINDOW_WIDTH = 1280
"""A window is no wider than this [pixels]; pixels are left out until it fits."""
SILENCE_S = 5.0
"""After so long without a picture a window closes, and it is said why [s]."""


def view(
    video: Video,
    *,
    sheet: Path | None,
    rate_hz: float,
    timeout_s: float,
    open_one: Callable[[str], Window | str] = open_window,
) -> ExitStatus:
    """Show the pictures until q or Ctrl-C, or write one sheet of them.

    Args:
        video: Whose; it is started and stopped here.
        sheet: A file to write and end; None for a window where there can be one.
        rate_hz: Pictures shown per second, at most [Hz].
        timeout_s: Longest wait for the first one [s].
        open_one: Opens a window, or says why it cannot.

    Raises:
        VideoError: No picture came, with the cause; or the file cannot be written.
    """
    with video:
        frame = video.wait_frame(timeout=timeout_s)
        if frame is None:
            raise video.silence(timeout_s)
        window = "a file was asked for" if sheet is not None else open_one("TeleAvatar 2")
        if isinstance(window, str):
            if sheet is None:
                print(f"no window: {window}", file=sys.stderr)
                sheet = Path(f"ta2-video-{datetime.now().astimezone():%Y%m%d-%H%M%S}.jpg")
            write_sheet(frame, sheet, title_of(video, frame))
            print(sheet)
            return ExitStatus.OK
        try:
            _show(video, window, rate_hz)
        except Interrupted:
            raise
        except KeyboardInterrupt:
            pass
        finally:
            window.close()
    return ExitStatus.OK


def _show(video: Video, window: Window, rate_hz: float) -> None:
    sheet: Sheet | None = None
    for frame in video.frames(max_rate=rate_hz, timeout=SILENCE_S):
        height, width = frame.rgb.shape[:2]
        if sheet is None or sheet.size != (width, height):
            sheet = Sheet(width, height, step=max(1, -(-2 * width // WINDOW_WIDTH)))
        if not window.show(sheet.compose(frame, title_of(video, frame))):
            return


def title_of(video: Video, frame: Frame) -> str:
    """Return what is to be known of a frame, in a line."""
    reading, height, width = video.health.reading, *frame.rgb.shape[:2]
    state = "clean" if frame.clean else f"DAMAGED: {sum(last - first + 1 for first, last in frame.lost)} packets lost"
    return f"frame {frame.seq}  {width} x {height}  {reading.fps:.1f} fps  {reading.latency_ms:.0f} ms  {state}"
