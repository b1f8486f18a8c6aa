"""The robot's video stream: received, decoded, cut into its six views, recorded (§3.1.2, 5.1-5.3).

Knows nothing of the daemon: the robot sends its pictures straight to this host, as RTP/H.265 on udp/8890.

```
from gateway.video import Video

with Video(source="192.168.1.100") as video:
    for frame in video.frames(max_rate=10):
        use(frame["head_left_eye"], frame["left_wrist_left_eye"], frame.age, frame.clean)
```

What needs PyAV is loaded when it is asked for: the parts that do not, and the client, work without it. Read first: `video.py`.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from gateway.video.aio import AsyncVideo
    from gateway.video.compat import RTPH265VideoInterface
    from gateway.video.decoding.frame import Frame
    from gateway.video.decoding.views import COMPOSITE, VIEWS
    from gateway.video.errors import VideoCode, VideoError, VideoTimeout
    from gateway.video.receiving.health import Health
    from gateway.video.receiving.receiver import Receiver, ReceiverSettings
    from gateway.video.recording.recorder import Recorder
    from gateway.video.video import Video

__all__ = [
    "COMPOSITE",
    "VIEWS",
    "AsyncVideo",
    "Frame",
    "Health",
    "RTPH265VideoInterface",
    "Receiver",
    "ReceiverSettings",
    "Recorder",
    "Video",
    "VideoCode",
    "VideoError",
    "VideoTimeout",
]

PLACES = {
    "AsyncVideo": "aio",
    "COMPOSITE": "decoding.views",
    "Frame": "decoding.frame",
    "Health": "receiving.health",
    "RTPH265VideoInterface": "compat",
    "Receiver": "receiving.receiver",
    "ReceiverSettings": "receiving.receiver",
    "Recorder": "recording.recorder",
    "VIEWS": "decoding.views",
    "Video": "video",
    "VideoCode": "errors",
    "VideoError": "errors",
    "VideoTimeout": "errors",
}
"""Module of each name."""


def __getattr__(name: str) -> object:
    """Load what is asked for."""
    if name not in PLACES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{PLACES[name]}"), name)
