"""The four simulated cameras under one trigger, and the composites that their synchronisation lets through (§5.5)."""

from __future__ import annotations

import random
from collections.abc import Sequence
from typing import Protocol

from gateway.sim.camera.composite import CHANNELS, FULL, Size
from gateway.sim.camera.mailbox import Mailboxes, Shot
from gateway.sim.camera.picture import Planes, TestCamera, stitch

__all__ = ["Camera", "Rig"]


class Camera(Protocol):
    """One capture channel."""

    def shoot(self, counter: int) -> Planes:
        """Return the channel's picture at a trigger."""


class Rig:
    """Four cameras, triggered together; they deliver in a random order.

    Args:
        size: Of the composite [pixels].
        rate_hz: Of the trigger.
        seed: Of patterns, order and misses.
        miss_p: Probability that a camera misses a trigger.
        cameras: One for each channel; None for test cameras.

    Attributes:
        mailboxes: With the counters of the synchronisation.

    Raises:
        ValueError: If the composite cannot be cut, or its crops have no room for the code.
    """

    def __init__(
        self,
        size: Size = FULL,
        rate_hz: int = 45,
        seed: int = 0,
        miss_p: float = 0.0,
        cameras: Sequence[Camera] | None = None,
    ) -> None:
        self.mailboxes: Mailboxes[Planes] = Mailboxes(len(CHANNELS))
        self._cameras = cameras or [TestCamera(channel, size, seed) for channel in range(len(CHANNELS))]
        self._rate_hz, self._miss_p = rate_hz, miss_p
        self._chance = random.Random(seed)

    def shoot(self, counter: int) -> Planes | None:
        """Trigger all cameras; return the composite, or None when a camera has missed it.

        Args:
            counter: Of the trigger; it is in the pixels of every crop.
        """
        trig_ms = counter * 1000 // self._rate_hz
        channels = list(range(len(CHANNELS)))
        self._chance.shuffle(channels)
        composite = None
        for channel in channels:
            if self._miss_p and self._chance.random() < self._miss_p:
                continue
            self.mailboxes.put(channel, Shot(trig_ms, self._cameras[channel].shoot(counter)))
            shots = self.mailboxes.take()
            if shots is not None:
                composite = stitch([shot.picture for shot in shots])
        return composite
