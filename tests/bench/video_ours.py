"""The video benchmark's receiver of ours: `Video`, decoding in software, a consumer that takes every frame."""

from __future__ import annotations

from gateway.video.video import Video
from tests.bench.watching import Watch


def main() -> None:
    """Receive and measure."""
    watch = Watch("video_ours")
    with Video("127.0.0.1", port=watch.port, decoder="software") as video:
        for frame in video.frames(timeout=20.0):
            if not watch.see(frame.rgb):
                break
        watch.tell()


if __name__ == "__main__":
    main()
