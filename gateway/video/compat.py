"""The receiver of the manual's §6.9 for programs that use it: the same class, arguments and methods, without GStreamer.

`ta2 video shim DIR` puts a module `rtp_video_interface` beside such a program, which then runs as it is.

What is different: a damaged picture is shown as there, but counted; a missing GPU is no error, software decodes; a port that is
taken raises an error in `start`. New programs are better off with `Video`, which copies nothing and tells when a frame comes.
"""

from __future__ import annotations

import contextlib
import logging
import threading
import time

import numpy as np
import numpy.typing as npt

from gateway.video.decoding.decoder import DecoderChoice
from gateway.video.decoding.frame import Frame
from gateway.video.decoding.views import BOXES, COMPOSITE
from gateway.video.errors import VideoError
from gateway.video.receiving.udp import PORT
from gateway.video.video import Video

__all__ = ["TELEAVATAR_SPLIT_REGIONS", "RTPH265VideoInterface"]

Image = npt.NDArray[np.uint8]

TELEAVATAR_SPLIT_REGIONS = tuple(BOXES.items())
"""Name and normalised box (x0, y0, x1, y1) of each view (§6.9)."""

SOFTWARE = ("avdec_h265", "libde265dec")
"""GStreamer's decoders that need no hardware."""


class RTPH265VideoInterface:
    """Keeps the newest composite picture and its six views (§5.2); safe to use from several threads.

    Args:
        camera_name: Key of the composite.
        port: UDP port.
        payload: RTP payload type.
        udp_buffer_size: Receive buffer to ask for [bytes].
        decoder: A GStreamer decoder as in the manual: one of NVIDIA's is taken where it works; `avdec_h265` is software.
        log_interval_s: Time between two lines of statistics in the log [s].
        source: Not in the manual: the robot's address; pictures from elsewhere are then refused, as §2.6.3 advises.

    Raises:
        ValueError: An argument is out of its bounds.
    """

    def __init__(
        self,
        *,
        camera_name: str = COMPOSITE,
        port: int = PORT,
        payload: int = 96,
        udp_buffer_size: int = 20_000_000,
        decoder: str = "nvh265dec max-display-delay=0",
        log_interval_s: float = 2.0,
        source: str | None = None,
    ) -> None:
        self.camera_name = camera_name
        self.port = port
        self.payload = payload
        self.udp_buffer_size = udp_buffer_size
        self.decoder = decoder
        self.log_interval_s = log_interval_s
        self.split_regions = TELEAVATAR_SPLIT_REGIONS
        self.split_image_names = tuple(name for name, _ in self.split_regions)
        self.logger = logging.getLogger(type(self).__name__)
        self.lock = threading.Lock()
        self.video = Video(
            source,
            port=port,
            payload_type=payload,
            decoder=_choice_of(decoder),
            receive_buffer_bytes=udp_buffer_size,
        )
        self._shown: tuple[Frame, float] | None = None
        self._first_frame = threading.Event()
        self._ended = threading.Event()
        self._listening = contextlib.ExitStack()
        self._log = _IntervalLog(self.logger, camera_name, log_interval_s)

    def start(self) -> None:
        """Begin to receive in the background; nothing when it does already.

        Raises:
            VideoError: PORT_BUSY: something else listens there.
        """
        if self.video.is_running:
            return
        self._first_frame.clear()
        self._ended.clear()
        self._log.begin()
        self._listening.enter_context(self.video.newest.listening(self._on_change))
        try:
            self.video.start()
        except BaseException:
            self._listening.close()
            raise
        self.logger.info(
            "Receiving RTP/H.265 on udp/%d, payload type %d; %r stands for %s here",
            self.video.port,
            self.payload,
            self.decoder,
            self.video.health.decoder,
        )

    def stop(self) -> None:
        """Stop receiving; the newest images remain."""
        self.video.stop()
        self._listening.close()
        self.logger.info("Stopped after %d frames", self._log.frames)

    def wait_for_initial_data(self, timeout: float = 10.0) -> bool:
        """Wait for the first frame, so long [s] at most; return whether it came. If not, the log says why."""
        self.logger.info("Waiting for the initial video frame")
        if self._first_frame.wait(timeout):
            self.logger.info("Initial video frame received")
            return True
        counts = self.video.counts
        self.logger.error(
            "No video frame in %.1f s: rtp_packets=%d h265_buffers=%d", timeout, counts.packets, counts.pictures
        )
        for finding in self.video.why():
            self.logger.error("%s: %s -> %s", finding.code, finding.message, finding.hint)
        return False

    def has_initial_frame(self) -> bool:
        """Return whether a frame came since the start."""
        return self._first_frame.is_set()

    def wait(self, timeout: float | None = None) -> bool:
        """Wait for the end of receiving by an error, so long [s] at most; return whether it came."""
        return self._ended.wait(timeout)

    def get_observation(self) -> dict[str, dict[str, Image]] | None:
        """Return `{"images": ...}`, all images as copies; None before the first frame."""
        images = self.get_latest_images()
        return {"images": images} if images else None

    def get_latest_image(self) -> Image | None:
        """Return a copy of the composite, RGB, shape (2720, 1280, 3), uint8; None before the first frame."""
        shown = self._shown
        return None if shown is None else shown[0].rgb.copy()

    def get_latest_images(self) -> dict[str, Image]:
        """Return copies of the composite and the six views; empty before the first frame."""
        return self.get_latest_images_with_timestamps()[0]

    def get_latest_images_with_timestamps(self) -> tuple[dict[str, Image], dict[str, float]]:
        """Return copies of all images, all of the same frame, and when each was decoded, as `time.time()` [s]."""
        shown = self._shown
        if shown is None:
            return {}, {}
        images = {name: view.copy() for name, view in self._views(shown[0]).items()}
        return images, dict.fromkeys(images, shown[1])

    @property
    def latest_images(self) -> dict[str, Image]:
        """The newest images without copies: not writable, and never overwritten."""
        shown = self._shown
        return {} if shown is None else self._views(shown[0])

    @property
    def image_timestamps(self) -> dict[str, float]:
        """When each of the newest images was decoded, as `time.time()` [s]."""
        shown = self._shown
        return {} if shown is None else dict.fromkeys((self.camera_name, *self.split_image_names), shown[1])

    def _views(self, frame: Frame) -> dict[str, Image]:
        return {self.camera_name: frame.rgb, **frame.views}

    def _on_change(self) -> None:
        """Take in a new frame, or the end; called by the thread that decodes."""
        newest = self.video.newest
        try:
            frame = newest.peek(-1 if self._shown is None else self._shown[0].seq)
        except VideoError as error:
            self.logger.error("%s", error)
            self._ended.set()
            return
        if frame is not None:
            self._shown = frame, time.time()  # wall clock, as in the manual's class
            self._first_frame.set()
            self._log.frame(frame, self.video)


class _IntervalLog:
    """A line of statistics now and then."""

    def __init__(self, logger: logging.Logger, camera_name: str, interval_s: float) -> None:
        self._logger = logger
        self._camera_name = camera_name
        self._interval_ns = round(interval_s * 1e9)
        self.begin()

    def begin(self) -> None:
        self.frames = 0
        self._began_ns = self._told_ns = 0

    def frame(self, frame: Frame, video: Video) -> None:
        self.frames += 1
        now_ns = frame.published_ns
        if self.frames == 1:
            self._began_ns = self._told_ns = now_ns
        if now_ns - self._told_ns < self._interval_ns or self.frames == 1:
            return
        self._told_ns = now_ns
        reading, counts = video.health.reading, video.counts
        self._logger.info(
            "camera=%s frames=%d damaged=%d rtp_packets=%d lost=%d h265_buffers=%d shape=%s fps=%.2f overall_fps=%.2f "
            "latency=%.1f ms",
            self._camera_name,
            self.frames,
            reading.damaged,
            counts.packets,
            counts.lost,
            counts.pictures,
            frame.rgb.shape,
            reading.fps,
            (self.frames - 1) / (now_ns - self._began_ns) * 1e9,
            reading.latency_ms,
        )


def _choice_of(decoder: str) -> DecoderChoice:
    """Return what stands for a decoder of GStreamer's here."""
    return "software" if decoder.split(maxsplit=1)[:1] in ([name] for name in SOFTWARE) else "auto"
