"""Requests for grippers, chassis and lift as structs. Import these names from `gateway.api.protocol`."""

from __future__ import annotations

from gateway.api.incoming import Count, Incoming, SideName

__all__ = ["DisableLift", "DriveChassis", "DriveLift", "SetGripper", "StopChassis", "StopLift"]


class SetGripper(Incoming, frozen=True):
    """Send a gripper another force input, until a later one. Reply: `raw`, `torque_nm`.

    Attributes:
        epoch: Lease epoch.
        side: Which gripper.
        raw: 0 (opens most) to 1 (closes most); 0.1 is no torque (manual §4.4).
    """

    epoch: Count
    side: SideName
    raw: float


class DriveChassis(Incoming, frozen=True):
    """Drive the chassis at a velocity until it expires; a later one replaces it. Reply: `drive_id`.

    Attributes:
        epoch: Lease epoch.
        vx_mps: Along x [m/s].
        vy_mps: Along y [m/s].
        wz_radps: Around z [rad/s].
        expiry_ns: How long without a successor [ns]; null for the configured time.
        drive_id: 0 begins a drive; the number of one goes on with it, and is refused when something has ended it.
    """

    epoch: Count
    vx_mps: float
    vy_mps: float
    wz_radps: float
    expiry_ns: Count | None = None
    drive_id: Count = 0


class StopChassis(Incoming, frozen=True):
    """Zeros for the chassis at once."""

    epoch: Count


class DriveLift(Incoming, frozen=True):
    """Drive the lift at a velocity until it expires; a later one replaces it. Reply: `drive_id`.

    Attributes:
        epoch: Lease epoch.
        velocity: Part of full speed, -1 (down) to 1 (up).
        expiry_ns: How long without a successor [ns]; null for the configured time.
        drive_id: 0 begins a drive; the number of one goes on with it, and is refused when something has ended it.
    """

    epoch: Count
    velocity: float
    expiry_ns: Count | None = None
    drive_id: Count = 0


class StopLift(Incoming, frozen=True):
    """Stop the lift at once; its servo stays on."""

    epoch: Count


class DisableLift(Incoming, frozen=True):
    """Stop the lift, then take its servo off."""

    epoch: Count
