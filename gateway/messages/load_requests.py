"""What an owner may ask about what its hands hold. Part of the requests; import the names from `requests.py`."""

from __future__ import annotations

from typing import Annotated

from msgspec import Meta

from gateway.messages.incoming import Count, Incoming, Joints
from gateway.values import Side

__all__ = ["SetPayload", "Weigh"]

Swings = Annotated[tuple[Joints, ...], Meta(max_length=64)]


class SetPayload(Incoming, frozen=True, kw_only=True):
    """Say what a hand holds: what pulls at its arm is estimated without it from then on. Moves nothing.

    Attributes:
        epoch: Lease epoch.
        side: Which hand.
        mass_kg: Its mass [kg]; 0 for an empty hand.
        com_m: Its centre of mass in the frame of the end effector, x, y, z [m].
    """

    epoch: Count
    side: Side
    mass_kg: float = 0.0
    com_m: Joints = (0.0, 0.0, 0.0)


class Weigh(Incoming, frozen=True, kw_only=True):
    """Work out what a hand holds from what pulled its joints, in postures that they swung slowly about; sets nothing.

    Reply: `mass_kg`, `mass_sd_kg`, `com_m`, `com_sd_m` (None while it may be nothing), `condition`.

    Attributes:
        epoch: Lease epoch.
        side: Which hand.
        q_rad: Middles of the swings, 1 to 8 times seven joints [rad].
        up_nm: For each, mean external torques while the joints moved towards larger positions [N·m] ...
        down_nm: ... and back.
        noise_nm: Standard deviations of their means [N·m].
        beside_empty: Whether what pulled with the empty hand was taken away from them.
    """

    epoch: Count
    side: Side
    q_rad: Swings
    up_nm: Swings
    down_nm: Swings
    noise_nm: Swings
    beside_empty: bool = False
