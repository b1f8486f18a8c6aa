"""What can be wrong with the video, with stable codes: for errors, for findings, and for scripts that read them."""

from __future__ import annotations

from enum import Enum

__all__ = ["VideoCode", "VideoError", "VideoTimeout"]


class VideoCode(str, Enum):
    """Stable codes; the value is the name."""

    # nothing comes, or not what is wanted
    NO_PACKETS = "NO_PACKETS"
    STREAM_STOPPED = "STREAM_STOPPED"
    WRONG_SOURCE = "WRONG_SOURCE"
    WRONG_PAYLOAD_TYPE = "WRONG_PAYLOAD_TYPE"
    NOT_RTP = "NOT_RTP"
    SECOND_SENDER = "SECOND_SENDER"
    # it comes, and cannot be shown, or not well
    UNSUPPORTED_PAYLOAD = "UNSUPPORTED_PAYLOAD"
    NO_PARAMETER_SETS = "NO_PARAMETER_SETS"
    NO_KEYFRAME = "NO_KEYFRAME"
    NO_PERIODIC_IDR = "NO_PERIODIC_IDR"
    NO_MARKER = "NO_MARKER"
    LOSS = "LOSS"
    LATE_PACKETS = "LATE_PACKETS"
    CUT_SHORT = "CUT_SHORT"
    SENDER_RESTARTED = "SENDER_RESTARTED"
    # this host
    PORT_BUSY = "PORT_BUSY"
    BAD_ADDRESS = "BAD_ADDRESS"
    RECEIVE_BUFFER_CAPPED = "RECEIVE_BUFFER_CAPPED"
    RECEIVE_BUFFER_FULL = "RECEIVE_BUFFER_FULL"
    DECODER_SLOW = "DECODER_SLOW"
    UNDECODABLE = "UNDECODABLE"
    RECORDER_SLOW = "RECORDER_SLOW"
    RECEIVER_FAILED = "RECEIVER_FAILED"
    TAKER_FAILED = "TAKER_FAILED"
    DECODER_FAILED = "DECODER_FAILED"
    NO_DECODER = "NO_DECODER"
    NOT_INSTALLED = "NOT_INSTALLED"
    CANNOT_WRITE = "CANNOT_WRITE"

    def __str__(self) -> str:
        """Return the bare code."""
        return self.value


class VideoError(Exception):
    """The video cannot be received, decoded or recorded.

    Args:
        code: Stable code.
        message: One sentence with the values.
        hint: What to do next.
    """

    def __init__(self, code: VideoCode, message: str, hint: str) -> None:
        super().__init__(code, message, hint)
        self.code = code
        self.message = message
        self.hint = hint

    def __str__(self) -> str:
        """Return `CODE: message -> hint`."""
        return f"{self.code}: {self.message} -> {self.hint}"


class VideoTimeout(VideoError, TimeoutError):
    """No picture came in time; the code is that of the worst finding, or NO_PACKETS."""
