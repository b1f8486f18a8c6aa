"""PyAV, or a clear word about how to get it: whoever needs `av` takes it from here."""

from __future__ import annotations

from gateway.video.errors import VideoCode, VideoError

__all__ = ["Flags", "HWAccel", "VideoReformatter", "av"]

try:
    import av
    from av.codec.context import Flags
    from av.codec.hwaccel import HWAccel
    from av.video.reformatter import VideoReformatter
except ImportError as error:
    raise VideoError(
        VideoCode.NO_DECODER,
        f"video needs PyAV 16 or newer, which cannot be loaded: {error}",
        "install it: pip install 'teleavatar-gateway[video]'",
    ) from error
