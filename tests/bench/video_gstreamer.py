"""The video benchmark's receiver of GStreamer: the elements of the manual's receiver (§6.9), with a software decoder.

Runs on the distribution's Python, which alone has GStreamer's bindings. It does less than the manual's: no lock, no crops,
no counting of packets, and the picture is not copied once more.
"""

from __future__ import annotations

import sys
import threading
from typing import Any

MISSING = 3
"""Exit status when something is not installed; the line on standard error says what."""
ELEMENTS = ("udpsrc", "rtph265depay", "h265parse", "avdec_h265", "videoconvert", "appsink")
PIPELINE = (
    'udpsrc port={port} buffer-size=20000000 caps="application/x-rtp,media=video,clock-rate=90000,encoding-name=H265,'
    'payload=96" ! rtph265depay ! h265parse config-interval=-1 ! avdec_h265 ! videoconvert n-threads=4 '
    "! video/x-raw,format=RGB ! appsink name=sink emit-signals=true max-buffers=1 drop=true sync=false"
)


def main() -> int:
    """Receive and measure; return MISSING where that cannot be done."""
    try:
        import gi
        import numpy as np

        gi.require_version("Gst", "1.0")
        from gi.repository import Gst
    except (ImportError, ValueError) as error:
        print(error, file=sys.stderr)
        return MISSING
    from tests.bench.watching import Watch

    Gst.init(None)
    absent = [name for name in ELEMENTS if Gst.ElementFactory.find(name) is None]
    if absent:
        print(f"no element {', '.join(absent)}", file=sys.stderr)
        return MISSING
    if "--look" in sys.argv:
        return 0
    watch, end = Watch("video_gstreamer"), threading.Event()
    pipeline: Any = Gst.parse_launch(PIPELINE.format(port=watch.port))

    def take(sink: Any) -> Any:
        sample = sink.emit("pull-sample")
        form = sample.get_caps().get_structure(0)
        width, height = form.get_value("width"), form.get_value("height")
        _, held = sample.get_buffer().map(Gst.MapFlags.READ)
        try:
            composite = np.frombuffer(held.data, np.uint8)[: height * width * 3].reshape(height, width, 3)
            if not end.is_set() and not watch.see(composite):
                watch.tell()
                end.set()
        finally:
            sample.get_buffer().unmap(held)
        return Gst.FlowReturn.OK

    pipeline.get_by_name("sink").connect("new-sample", take)
    pipeline.set_state(Gst.State.PLAYING)
    try:
        return 0 if end.wait(120.0) else 1
    finally:
        pipeline.set_state(Gst.State.NULL)


if __name__ == "__main__":
    sys.exit(main())
