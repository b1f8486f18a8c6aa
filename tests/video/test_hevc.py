"""Rules of `gateway.sim.camera.hevc`, decoded with PyAV: every picture comes out, and the stream has the shape asked for."""

from __future__ import annotations

import builtins
from typing import Any

import numpy as np
import pytest

from gateway.sim.camera.annexb import is_irap, nal_type, nal_units
from gateway.sim.camera.composite import Size
from gateway.sim.camera.hevc import Coding, EncoderMissing, Hevc, KeyFrames
from gateway.sim.camera.picture import Planes, TestCamera, stitch
from tests.video.code_reader import read_composite

av = pytest.importorskip("av")

SMALL = Size(160, 340)
GOP = 4
PICTURES = 10


def pictures(count: int = PICTURES) -> list[Planes]:
    """Return the first small composites."""
    cameras = [TestCamera(channel, SMALL) for channel in range(4)]
    return [stitch([camera.shoot(counter) for camera in cameras]) for counter in range(count)]


def small(**settings: Any) -> Coding:
    """Return the coding of small pictures."""
    return Coding(**{"width": 160, "height": 340, "gop": GOP, "bit_rate_bps": 2_000_000, **settings})


def encoded(**settings: Any) -> list[bytes]:
    """Return the access units of the first pictures."""
    encoder = Hevc(small(**settings))
    units = [unit for picture in pictures() for unit in encoder.encode(picture)]
    return units + encoder.finish()


def decoded(units: list[bytes]) -> list[np.ndarray]:
    """Return the luma of every picture that a decoder makes of it."""
    decoder = av.CodecContext.create("hevc", "r")
    decoder.thread_type = "SLICE"
    frames = [frame for unit in units for frame in decoder.decode(av.Packet(unit))] + decoder.decode(None)
    return [frame.to_ndarray()[: SMALL.height] for frame in frames]


def key_frames(units: list[bytes]) -> list[int]:
    """Return at which pictures decoding can begin."""
    return [number for number, unit in enumerate(units) if is_irap(nal_units(unit))]


def with_headers(units: list[bytes]) -> list[int]:
    """Return which pictures have VPS, SPS and PPS."""
    return [number for number, unit in enumerate(units) if {32, 33, 34} <= set(map(nal_type, nal_units(unit)))]


@pytest.mark.parametrize(
    "settings",
    [
        {},
        {"slices": 3},
        {"is_wavefront": True},
        *({"key_frames": kind} for kind in KeyFrames),
        {"repeats_headers": False},
    ],
    ids=str,
)
def test_every_picture_can_be_decoded_and_read(settings: dict[str, Any]) -> None:
    """One access unit each, in order; the codes survive the bit rate."""
    units = encoded(**settings)
    assert len(units) == PICTURES
    assert [read_composite(luma) for luma in decoded(units)] == list(range(PICTURES))


def test_an_idr_with_parameter_sets_begins_each_group() -> None:
    """Unless told otherwise."""
    units = encoded()
    assert key_frames(units) == with_headers(units) == [0, 4, 8]


def test_an_open_group_begins_with_a_cra() -> None:
    """The first of all with an IDR."""
    kinds = [
        {nal_type(unit) for unit in nal_units(units)} - {32, 33, 34} for units in encoded(key_frames=KeyFrames.CRA)
    ]
    assert [kind for kind in kinds if kind != {1}] == [{20}, {21}, {21}]


@pytest.mark.parametrize("kind", [KeyFrames.ONCE, KeyFrames.REFRESH])
def test_a_stream_may_have_no_key_frame_but_the_first(kind: KeyFrames) -> None:
    """Whoever comes late waits for ever, or for the intra column."""
    assert key_frames(encoded(key_frames=kind)) == [0]


def test_parameter_sets_may_come_only_once() -> None:
    """The IDRs stay."""
    units = encoded(repeats_headers=False)
    assert with_headers(units) == [0]
    assert key_frames(units) == [0, 4, 8]


def test_a_picture_has_the_slices_asked_for() -> None:
    """Each a NAL unit of its own."""
    counts = [sum(nal_type(unit) < 32 for unit in nal_units(picture)) for picture in encoded(slices=3)]
    assert counts == [3] * PICTURES


def test_the_bit_rate_is_about_the_one_asked_for() -> None:
    """The pattern leaves the encoder work: flat pictures would give an unreal one."""
    rate_bps = sum(map(len, encoded(gop=100)[1:])) * 8 * 45 / (PICTURES - 1)
    assert 1_000_000 < rate_bps < 4_000_000


def test_a_picture_of_another_size_is_refused() -> None:
    """With both sizes."""
    with pytest.raises(ValueError, match="160x340 pixels for an encoder of 320x680"):
        Hevc(small(width=320, height=680)).encode(pictures(1)[0])


@pytest.mark.parametrize(("name", "value"), [("rate_hz", 0), ("gop", 0), ("bit_rate_bps", 1), ("slices", 33)])
def test_settings_out_of_range_are_refused(name: str, value: int) -> None:
    """With the bounds."""
    with pytest.raises(ValueError, match=rf"{name} {value} is outside \["):
        small(**{name: value})


def test_without_pyav_the_remedy_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    """It is an extra: only who wants video needs it."""
    original = builtins.__import__

    def without_av(name: str, *rest: Any, **more: Any) -> Any:
        if name == "av":
            raise ImportError(name)
        return original(name, *rest, **more)

    monkeypatch.setattr(builtins, "__import__", without_av)
    with pytest.raises(EncoderMissing, match=r"teleavatar-gateway\[video\]"):
        Hevc(small())


def test_pyav_without_x265_is_told_as_well(monkeypatch: pytest.MonkeyPatch) -> None:
    """A distribution's own build may lack it."""

    class NoCodec:
        @staticmethod
        def create(name: str, mode: str) -> None:
            raise ValueError(name)

    monkeypatch.setattr(av, "CodecContext", NoCodec)
    with pytest.raises(EncoderMissing, match="without x265"):
        Hevc(small())
