"""The robot's cameras as frames: receives, decodes and hands out the newest picture (§5.1, §5.2).

```
with Video(source="192.168.1.100") as video:
    for frame in video.frames(max_rate=10):
        policy(frame["head_left_eye"], frame["left_wrist_left_eye"], age=frame.age)
```

Two threads work for it: one empties the socket, one decodes. Readers never wait for each other nor hold anything up: who is
slow is given the newest frame next, never a backlog.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from dataclasses import replace

from gateway.process.threads import supervised
from gateway.video.decoding.decoder import Decoder, DecoderChoice
from gateway.video.decoding.decoding import Decoding
from gateway.video.decoding.frame import Frame
from gateway.video.decoding.newest import Newest, Pace
from gateway.video.decoding.rgb import Matrix, RgbConverter
from gateway.video.errors import VideoCode, VideoTimeout
from gateway.video.receiving.counters import Counts
from gateway.video.receiving.diagnosis import DecoderFacts, Finding, why
from gateway.video.receiving.health import Health, Meter
from gateway.video.receiving.receiver import Receiver, ReceiverSettings
from gateway.video.receiving.rtp import PAYLOAD_TYPE
from gateway.video.receiving.udp import PORT, RECEIVE_BUFFER_BYTES

__all__ = ["Video"]


class Video:
    """Receives from `start` to `stop`, or as a context; can be started again.

    Args:
        source: The robot's address or name: pictures from elsewhere are refused. None takes them from whoever sends, which
            is for networks that nobody else is on.
        port: UDP port, as in the robot's system configuration (§2.6.3); 0 takes a free one.
        payload_type: The robot's (§5.1).
        strict: Whether only pictures in which nothing is damaged are handed out. At 0.1 % loss that leaves few.
        decoder: `auto` takes a GPU that proves itself on the first key picture; `nvdec` warns where none does; `software`.
        matrix: Of the colours where the stream does not say.
        host: Local address to listen on; empty: all of IPv4.
        receive_buffer_bytes: Asked of the kernel.
        decoder_threads: Of the software decoder.

    Raises:
        ValueError: A setting is out of its bounds.
    """

    def __init__(
        self,
        source: str | None,
        *,
        port: int = PORT,
        payload_type: int = PAYLOAD_TYPE,
        strict: bool = False,
        decoder: DecoderChoice = "auto",
        matrix: Matrix = "bt601",
        host: str = "",
        receive_buffer_bytes: int = RECEIVE_BUFFER_BYTES,
        decoder_threads: int = 2,
    ) -> None:
        self.receiver = Receiver(
            ReceiverSettings(
                source=source,
                port=port,
                host=host,
                payload_type=payload_type,
                receive_buffer_bytes=receive_buffer_bytes,
            )
        )
        self._is_strict = strict
        self._choice: DecoderChoice = decoder
        self._matrix: Matrix = matrix
        self._decoder_threads = decoder_threads
        self.newest = Newest()
        """Where the newest frame is; for who wants to be told of each change."""
        self.newest.close()
        self._meter = Meter()
        self._decoder = Decoder(decoder, threads=decoder_threads)
        self._decoding: Decoding | None = None
        self._thread: threading.Thread | None = None

    def __enter__(self) -> Video:
        """Start it."""
        self.start()
        return self

    def __exit__(self, *_: object) -> None:
        """Stop it."""
        self.stop()

    def start(self) -> None:
        """Receive and decode; nothing when it does already.

        Raises:
            VideoError: PORT_BUSY or BAD_ADDRESS.
        """
        if self.is_running:
            return
        self.stop()  # what is left of one that failed
        self.receiver.start()
        self.newest.open()
        self._decoder = Decoder(self._choice, threads=self._decoder_threads)
        newest = self.newest.frame
        self._decoding = Decoding(
            self.receiver,
            self.newest,
            self._decoder,
            RgbConverter(self._matrix),
            is_strict=self._is_strict,
            first_seq=0 if newest is None else newest.seq + 1,
            meter=self._meter,
        )
        self._thread = supervised(self._decoding.run, "video-decoder")
        self._thread.start()

    def stop(self) -> None:
        """Stop; whoever waits for frames is told. The newest frame remains. Nothing when it is stopped already."""
        if self._thread is None or self._decoding is None:
            return
        self._decoding.end()
        self.receiver.stop()
        self._thread.join()
        self._thread = None

    # ------------------------------------------------------------------------------------------------------------ frames

    @property
    def latest(self) -> Frame | None:
        """The newest frame, however old it is; None before the first."""
        return self.newest.frame

    def wait_frame(self, after_seq: int = -1, timeout: float = 5.0) -> Frame | None:
        """Return the newest frame that is newer than another one.

        Args:
            after_seq: Of the other one; -1 takes any.
            timeout: Longest wait [s].

        Returns:
            The frame; None when none came in time, or this was stopped: `why` tells more.

        Raises:
            VideoError: DECODER_FAILED or RECEIVER_FAILED: one of its threads ended by an error.
        """
        return self.newest.wait(after_seq, timeout)

    def frames(self, max_rate: float | None = None, timeout: float = 5.0) -> Iterator[Frame]:
        """Yield each new frame, the newest when several came meanwhile, until this is stopped.

        It outlives the sender: when that begins anew within `timeout`, it goes on.

        Args:
            max_rate: At most so many a second [Hz]; None for as they come (about 45 Hz).
            timeout: Longest wait for the next one [s].

        Raises:
            VideoTimeout: None came in time; with the worst finding of `why`.
            VideoError: DECODER_FAILED or RECEIVER_FAILED: one of its threads ended by an error.
            ValueError: The rate is no positive number.
        """
        pace, seq = Pace(max_rate), -1
        while True:
            if rest_s := pace.rest_s(time.monotonic_ns()):
                self.newest.pause(rest_s)
            frame = self.wait_frame(seq, timeout)
            if frame is None:
                if not self.newest.is_open:
                    return
                raise self.silence(timeout)
            pace.taken(time.monotonic_ns())
            seq = frame.seq
            yield frame

    # ------------------------------------------------------------------------------------------------------------ health

    @property
    def is_running(self) -> bool:
        """Whether frames may come."""
        return self.newest.is_open

    @property
    def port(self) -> int:
        """The UDP port that it listens on."""
        return self.receiver.port

    @property
    def counts(self) -> Counts:
        """What came and what was lost."""
        return self.receiver.counts

    @property
    def health(self) -> Health:
        """Return rates, latencies and counters of now."""
        newest = self.newest.frame
        return Health(
            decoder=self._decoder.name,
            decoder_note=self._decoder.note,
            reading=self._meter.reading(time.monotonic_ns()),
            counts=self.receiver.counts,
            granted_bytes=self.receiver.granted_bytes,
            age_s=None if newest is None else newest.age,
        )

    def why(self) -> tuple[Finding, ...]:
        """Return what is wrong now, in words, the worst first; empty when nothing is."""
        facts = self.receiver.facts()
        reading = self._meter.reading(time.monotonic_ns())
        frames, errors = self._meter.since(facts.recent_since_ns)
        decoder = DecoderFacts(
            name=self._decoder.name,
            frames=reading.frames,
            recent_frames=frames,
            recent_errors=errors,
            decode_ms=reading.decode_ms,
        )
        return why(replace(facts, decoder=decoder), time.monotonic_ns())

    def silence(self, seconds: float) -> VideoTimeout:
        """Return the error that no frame came for so long [s], with the worst finding."""
        findings = self.why()
        if not findings:
            return VideoTimeout(
                VideoCode.NO_PACKETS, f"no picture came in {seconds:g} s", "see `ta2 video check`, and wait longer"
            )
        worst = findings[0]
        return VideoTimeout(worst.code, f"no picture came in {seconds:g} s: {worst.message}", worst.hint)
