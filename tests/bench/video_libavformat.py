"""The video benchmark's receiver of libavformat: a session description in memory, with the settings that suit it best.

Its parser emits a picture when the next one begins: that costs a period, whatever is set. Reordering needs a queue, and
without a timeout opening waits for ever.
"""

from __future__ import annotations

import io

import av
import numpy as np

from tests.bench.watching import Watch

OPTIONS = {
    "protocol_whitelist": "rtp,udp",
    "reorder_queue_size": "32",
    "max_delay": "5000",
    "fflags": "nobuffer",
    "probesize": "32",
    "analyzeduration": "0",
    "buffer_size": str(8 << 20),
}


def main() -> None:
    """Receive and measure."""
    watch = Watch("video_libavformat")
    described = (
        f"v=0\r\no=- 0 0 IN IP4 127.0.0.1\r\ns=-\r\nc=IN IP4 127.0.0.1\r\nt=0 0\r\nm=video {watch.port} RTP/AVP 96\r\n"
    )
    described += "a=rtpmap:96 H265/90000\r\n"
    with av.open(io.BytesIO(described.encode()), format="sdp", options=OPTIONS, timeout=(20.0, 20.0)) as container:
        stream = container.streams.video[0]
        stream.thread_type = "SLICE"
        stream.codec_context.thread_count = 2
        stream.codec_context.flags |= av.codec.context.Flags.low_delay
        for picture in container.decode(stream):
            plane = picture.reformat(format="rgb24").planes[0]
            rows = np.frombuffer(plane, np.uint8).reshape(plane.height, plane.line_size)
            if not watch.see(rows[:, : plane.width * 3].reshape(plane.height, plane.width, 3)):
                break
        watch.tell()
        stream.codec_context.flush_buffers()


if __name__ == "__main__":
    main()
