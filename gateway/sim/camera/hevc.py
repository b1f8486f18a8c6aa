"""Pictures to H.265, with what a real encoder may do differently: key frames, parameter sets, slices.

No scene cuts, no pictures that wait for later ones: one goes in, its access unit comes out. With several slices x265 is
one picture behind.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from enum import Enum
from fractions import Fraction
from typing import Final

from gateway.sim.camera.annexb import without_parameter_sets
from gateway.sim.camera.composite import FULL
from gateway.sim.camera.picture import Planes

__all__ = ["REMEDY", "Coding", "EncoderMissing", "Hevc", "KeyFrames"]

REMEDY: Final = "pip install 'teleavatar-gateway[video]'"
"""What to do where PyAV is missing."""


class EncoderMissing(RuntimeError):
    """What encodes is not installed."""


class KeyFrames(Enum):
    """How a stream lets receivers begin."""

    IDR = "idr"
    """An IDR begins every group of pictures."""
    CRA = "cra"
    """The first is an IDR, those of later groups are CRA pictures (open GOP)."""
    ONCE = "once"
    """Only the first picture is an IDR."""
    REFRESH = "refresh"
    """Only the first picture is an IDR; a moving column of intra blocks renews the others."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Coding:
    """How pictures are encoded.

    Attributes:
        width: Of the composite [pixels].
        height: Of the composite [pixels].
        rate_hz: Pictures per second.
        gop: Pictures from one key frame to the next.
        bit_rate_bps: Mean bit rate [bit/s].
        key_frames: Which there are.
        repeats_headers: Whether VPS, SPS and PPS come before each key frame; else only before the first.
        slices: Per picture; a small picture may have fewer.
        is_wavefront: Whether rows of blocks can be decoded in parallel (WPP); x265 makes several slices only so.

    Raises:
        ValueError: If a number is out of range.
    """

    width: int = FULL.width
    height: int = FULL.height
    rate_hz: int = 45
    gop: int = 45
    bit_rate_bps: int = 20_000_000
    key_frames: KeyFrames = KeyFrames.IDR
    repeats_headers: bool = True
    slices: int = 1
    is_wavefront: bool = False

    def __post_init__(self) -> None:
        """Refuse what no encoder takes."""
        bounds = {"rate_hz": (1, 240), "gop": (1, 100_000), "bit_rate_bps": (50_000, 200_000_000), "slices": (1, 32)}
        for name, (least, most) in bounds.items():
            if not least <= getattr(self, name) <= most:
                raise ValueError(f"{name} {getattr(self, name)} is outside [{least}, {most}]")

    def words(self) -> dict[str, int | str]:
        """Return all settings by name, as plain values."""
        return {**asdict(self), "key_frames": self.key_frames.value}


class Hevc:
    """An encoder.

    Raises:
        EncoderMissing: If PyAV, or x265 in it, is not installed.
    """

    def __init__(self, coding: Coding) -> None:
        try:
            import av
        except ImportError:
            raise EncoderMissing(f"the simulated camera encodes with PyAV, which is not here: {REMEDY}") from None
        try:
            codec = av.CodecContext.create("libx265", "w")
        except ValueError:
            raise EncoderMissing(f"PyAV {av.__version__} was built without x265: {REMEDY}") from None
        assert isinstance(codec, av.VideoCodecContext)
        codec.width, codec.height, codec.pix_fmt = coding.width, coding.height, "yuv420p"
        codec.time_base, codec.framerate = Fraction(1, coding.rate_hz), Fraction(coding.rate_hz)
        codec.bit_rate = coding.bit_rate_bps
        codec.options = {"preset": "ultrafast", "tune": "zerolatency", "x265-params": _parameters(coding)}
        self._coding, self._codec = coding, codec
        self._frame_of = av.VideoFrame.from_ndarray
        self._taken = self._given = 0

    def encode(self, picture: Planes) -> list[bytes]:
        """Take a picture; return what is done, in order: annex B byte streams, one for each picture.

        Raises:
            ValueError: If it has another size.
        """
        height, width = picture.y.shape
        if (width, height) != (self._coding.width, self._coding.height):
            wanted = f"{self._coding.width}x{self._coding.height}"
            raise ValueError(f"a picture of {width}x{height} pixels for an encoder of {wanted}")
        frame = self._frame_of(picture.yuv420p(), format="yuv420p")
        frame.pts = self._taken
        frame.time_base = Fraction(1, self._coding.rate_hz)
        self._taken += 1
        return [self._done(bytes(packet)) for packet in self._codec.encode(frame)]

    def finish(self) -> list[bytes]:
        """End the encoder; return what it had kept back."""
        return [self._done(bytes(packet)) for packet in self._codec.encode(None)]

    def _done(self, stream: bytes) -> bytes:
        self._given += 1
        return stream if self._coding.repeats_headers or self._given == 1 else without_parameter_sets(stream)


def _parameters(coding: Coding) -> str:
    """Return x265's own parameters."""
    is_once = coding.key_frames in (KeyFrames.ONCE, KeyFrames.REFRESH)
    values = {
        "keyint": -1 if coding.key_frames is KeyFrames.ONCE else coding.gop,
        "min-keyint": 1 if is_once else coding.gop,
        "open-gop": int(coding.key_frames is KeyFrames.CRA),
        "intra-refresh": int(coding.key_frames is KeyFrames.REFRESH),
        "scenecut": 0,
        "repeat-headers": 1,
        "vbv-maxrate": coding.bit_rate_bps // 1000,
        "vbv-bufsize": coding.bit_rate_bps // 4000,  # a quarter of a second
        "slices": coding.slices,
        "wpp": int(coding.is_wavefront or coding.slices > 1),
        "info": 0,
        "log-level": 0,
    }
    return ":".join(f"{name}={value}" for name, value in values.items())
