"""What clients may ask for: frozen values, not yet checked against anything.

Every request but the leases' own, `stop`, `estop` and `recover` carries the epoch of the lease under which it is made.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from typing import TypeAlias

from gateway.values import Side, Vector

__all__ = [
    "Abandon",
    "Acquire",
    "Cancel",
    "CloseStream",
    "Disable",
    "Enable",
    "Estop",
    "Hold",
    "Move",
    "OnLimit",
    "OnLoss",
    "OpenStream",
    "Recover",
    "Release",
    "Request",
    "Stop",
    "Take",
]


class OnLoss(str, Enum):
    """What happens when the owner vanishes: keep holding, or pause the robot at once."""

    HOLD = "hold"
    PAUSE = "pause"


class OnLimit(str, Enum):
    """What happens to a target outside the limits: refused, or clipped and reported."""

    REJECT = "reject"
    CLIP = "clip"


@dataclass(frozen=True, slots=True, kw_only=True)
class Acquire:
    """Ask for the lease when it is free. `pid` and `name` are shown to others."""

    name: str
    pid: int
    on_loss: OnLoss = OnLoss.HOLD


@dataclass(frozen=True, slots=True, kw_only=True)
class Take:
    """Take the lease from its owner, for people; brakes first."""

    name: str
    pid: int
    reason: str
    on_loss: OnLoss = OnLoss.HOLD


@dataclass(frozen=True, slots=True, kw_only=True)
class Release:
    """Give the lease back: brake, rest, heartbeat 0.0."""

    epoch: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Abandon:
    """Leave as if the client had vanished: brake and hold, the clocks run."""

    epoch: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Enable:
    """Bring the FSM to READY; the outcome is seen in the snapshot."""

    epoch: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Disable:
    """Brake to rest, then heartbeat 0.0; the lease stays."""

    epoch: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Move:
    """Point to point, all joints of all named arms ending together.

    Attributes:
        epoch: Lease epoch.
        targets_rad: Per side seven joints [rad]; offsets from the reference when `relative`.
        relative: Whether the targets are offsets.
        speed: Factor on velocity, 0 < speed <= 1.
        tolerance_rad: Settling tolerance [rad]; None for the configured one.
        on_limit: Reject or clip.
    """

    epoch: int
    targets_rad: Mapping[Side, Vector]
    relative: bool = False
    speed: float = 1.0
    tolerance_rad: float | None = None
    on_limit: OnLimit = OnLimit.REJECT


@dataclass(frozen=True, slots=True, kw_only=True)
class OpenStream:
    """Open a stream of joint targets for one arm; it starts at the present reference."""

    epoch: int
    side: Side
    speed: float = 1.0
    on_limit: OnLimit = OnLimit.REJECT
    expiry_ns: int | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class CloseStream:
    """End a stream: brake to rest and hold."""

    epoch: int
    stream_id: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Hold:
    """Brake the named arms and hold; ends their motions as cancelled."""

    epoch: int
    sides: tuple[Side, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Cancel:
    """Brake and end one motion."""

    epoch: int
    motion_id: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Stop:
    """Stop everything. Anybody may; latches unless the owner asks."""

    reason: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Estop:
    """Stop everything and pause the FSM. Anybody may; always latches; the grip is lost."""

    reason: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Recover:
    """Clear all latches, or none when a cause persists. Never moves, never enables."""


Request: TypeAlias = (
    Acquire
    | Take
    | Release
    | Abandon
    | Enable
    | Disable
    | Move
    | OpenStream
    | CloseStream
    | Hold
    | Cancel
    | Stop
    | Estop
    | Recover
)
