"""Coded pictures for tests, without a network: the simulated cameras' small ones, as access units with a counter each."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any

from gateway.sim.camera.annexb import is_irap, nal_type, nal_units
from gateway.sim.camera.composite import CHANNELS, Size
from gateway.sim.camera.hevc import Coding, Hevc
from gateway.sim.camera.picture import TestCamera, stitch
from gateway.video.hevc.access_unit import AccessUnit

__all__ = ["SMALL", "STEP", "broken", "coded", "units"]

SMALL = Size(160, 340)
STEP = 2000
"""RTP ticks from picture to picture at 45 Hz."""


@cache
def coded(count: int, size: Size = SMALL, **options: Any) -> tuple[bytes, ...]:
    """Return so many access units; picture n has the counter n in its pixels. Options are those of `Coding`."""
    encoder = Hevc(
        Coding(**{"width": size.width, "height": size.height, "gop": 10, "bit_rate_bps": 2_000_000, **options})
    )
    cameras = [TestCamera(channel, size) for channel in range(len(CHANNELS))]
    done: list[bytes] = []
    for counter in range(count):
        done += encoder.encode(stitch([camera.shoot(counter) for camera in cameras]))
    return (*done, *encoder.finish())


def units(streams: tuple[bytes, ...], *, life: int = 0) -> list[AccessUnit]:
    """Return access units as they come over a network that loses nothing."""
    return [_unit(data, n, life) for n, data in enumerate(streams)]


def _unit(data: bytes, n: int, life: int) -> AccessUnit:
    nals = nal_units(data)
    kinds = [nal_type(nal) for nal in nals]
    return AccessUnit(
        data=data,
        seq=n,
        rtp_time=STEP * n,
        first_packet_ns=n * 22_222_222,
        complete_ns=n * 22_222_222 + 5_000_000,
        is_intact=True,
        is_irap=is_irap(nals),
        has_parameter_sets={32, 33, 34} <= set(kinds),
        lost=(),
        ssrc=1 + life,
        life=life,
        slice_type=next(kind for kind in kinds if kind < 32),
    )


def broken(unit: AccessUnit, lost: tuple[int, int] = (7, 8)) -> AccessUnit:
    """Return it as it is when packets from its middle are lost."""
    return replace(unit, data=unit.data[: len(unit.data) // 2], is_intact=False, lost=(lost,))
