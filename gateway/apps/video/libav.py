"""PyAV, or a clear word about how to get it: whoever needs `av` takes it from here."""

from __future__ import annotations

from gateway.errors import Code, ConfigError, Refusal

__all__ = ["Colorspace", "Flags", "HWAccel", "VideoReformatter", "av"]

try:
    import av
    from av.codec.context import Flags
    from av.codec.hwaccel import HWAccel
    from av.video.reformatter import Colorspace, VideoReformatter
except ImportError as error:
    raise ConfigError(
        Refusal(
            code=Code.BAD_CONFIG,
            message=f"video needs PyAV, which cannot be loaded: {error}",
            field="av",
            hint="install it with: pip install 'teleavatar-gateway[video]'",
        )
    ) from error
