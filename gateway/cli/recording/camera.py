"""The cameras beside a recording: their pictures as they come, in the bag's folder, on the same clock.

Pictures that do not come end no recording: what the robot says is recorded all the same, and the loss is told.
"""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path
from typing import Final

from gateway.cli.terminal.progress import Teller
from gateway.recording.bag_writer import needed

__all__ = ["Camera"]

VIDEO: Final = "video.mkv"
STALL_S: Final = 3.0
"""When no picture comes for so long, it is said [s]."""


class Camera:
    """Records the cameras from `with` to its end.

    Pictures from elsewhere than the robot's endpoint are refused.

    Raises:
        Rejected: BAD_REQUEST, a package for video is missing, or the file cannot be written.
    """

    def __init__(self, folder: Path, endpoint: str, port: int) -> None:
        needed("av", "video")
        from gateway.video.receiving.receiver import Receiver, ReceiverSettings
        from gateway.video.receiving.source import robot_address
        from gateway.video.recording.recorder import Recorder

        address = robot_address(endpoint, None)
        self._receiver = Receiver(ReceiverSettings(source=address, port=port))
        self._recorder = Recorder(folder / VIDEO, address or "")
        self._stack = ExitStack()
        self._newest_s, self._seen, self._is_told = 0.0, 0, False

    def __enter__(self) -> Camera:
        """Begin.

        Raises:
            VideoError: The port is taken.
        """
        with ExitStack() as stack:
            stack.callback(self._recorder.stop)
            stack.enter_context(self._receiver)
            stack.enter_context(self._recorder.taking(self._receiver))
            self._stack = stack.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    def look(self, tell: Teller, now_s: float) -> None:
        """Tell when pictures stay away, once, and when they are back."""
        seen = self._recorder.counts.pictures
        if seen != self._seen or not self._newest_s:
            if self._is_told:
                tell.say("the cameras: pictures come again")
            self._seen, self._newest_s, self._is_told = seen, now_s, False
        elif now_s - self._newest_s > STALL_S and not self._is_told:
            why = (
                self._recorder.error or "is the robot's video stream on, and sent to this host? `ta2 video check` tells"
            )
            tell.say(f"the cameras: no picture for {STALL_S:g} s; the recording goes on -> {why}")
            self._is_told = True

    @property
    def line(self) -> str:
        """How many pictures there are, and of these how many are damaged."""
        counts = self._recorder.counts
        damaged = f", {counts.damaged} damaged" if counts.damaged else ""
        dropped = f", {counts.dropped} DROPPED" if counts.dropped else ""
        return f"{counts.pictures} pictures{damaged}{dropped}"

    @property
    def facts(self) -> dict[str, int | str]:
        """What came of it, for JSON."""
        counts = self._recorder.counts
        return {
            "pictures": counts.pictures,
            "damaged": counts.damaged,
            "dropped": counts.dropped,
            "error": self._recorder.error,
        }
