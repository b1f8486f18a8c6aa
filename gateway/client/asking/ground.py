"""Grippers, chassis and lift without waiting: what their controls do, as procedures of both clients.

A drive has a number. Whoever keeps one alive names it, so that a stop, whoever asked for it, is not undone: the next
velocity is refused with what ended the drive.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial

from gateway.api import protocol
from gateway.client.asking.procedures import Procedure, get_info, request
from gateway.client.asking.requests import number
from gateway.client.asking.waits import Seen
from gateway.client.asking.watching import pause
from gateway.client.connection.session import Lease, Session, Sighting
from gateway.errors import Code, failure

__all__ = [
    "closing",
    "drive_chassis",
    "drive_chassis_for",
    "drive_lift",
    "drive_lift_for",
    "opening",
    "rest_chassis",
    "set_gripper",
]

RENEW_NS = 100_000_000
"""A drive is kept alive at least this often [ns]: three times within the default expiry, or within a shorter one."""
REST_NS = 10_000_000_000
"""Longest wait for the commanded velocity to come to rest [ns]; from the greatest one it takes about 2 s."""


def closing(force: float) -> float:
    """Return the gripper's input that closes with a part of its greatest torque, 0 to 1 (manual §4.4).

    Raises:
        Rejected: NOT_FINITE or OUT_OF_RANGE.
    """
    from gateway.robot.limits import GRIPPER_CLOSE_NM, gripper_raw

    return gripper_raw(-_part(force) * GRIPPER_CLOSE_NM)


def opening(force: float) -> float:
    """Return the gripper's input that opens with a part of its greatest torque, 0 to 1 (manual §4.4).

    Raises:
        Rejected: NOT_FINITE or OUT_OF_RANGE.
    """
    from gateway.robot.limits import GRIPPER_OPEN_NM, gripper_raw

    return gripper_raw(_part(force) * GRIPPER_OPEN_NM)


def _part(given: float) -> float:
    force = number("force", given)
    if math.isfinite(force) and 0.0 <= force <= 1.0:
        return force
    raise failure(
        Code.OUT_OF_RANGE if math.isfinite(force) else Code.NOT_FINITE,
        f"force is {force:g}, a part of the greatest torque from 0 to 1 is needed (manual §4.4)",
        field="force",
        value=f"{force:g}",
        bound="[0, 1]",
        hint="give 1 for the greatest torque, 0 for none",
    )


def set_gripper(session: Session, lease: Lease, side: protocol.SideName, raw: float) -> Procedure[None]:
    """Send a gripper another input.

    Raises:
        NotReady: Its arm is not enabled, or the robot not in a state for it.
        Rejected: The input is none.
    """
    yield from request(
        session, protocol.SetGripper(epoch=lease.epoch, side=protocol.Side(side), raw=number("raw", raw))
    )


def drive_chassis(
    session: Session, lease: Lease, velocity: tuple[float, float, float], expiry_ns: int | None, drive_id: int = 0
) -> Procedure[int]:
    """Drive at a velocity until it expires; returns the number of the drive."""
    vx, vy, wz = (number(name, value) for name, value in zip(("vx", "vy", "wz"), velocity, strict=True))
    command = protocol.DriveChassis(
        epoch=lease.epoch, vx_mps=vx, vy_mps=vy, wz_radps=wz, expiry_ns=expiry_ns, drive_id=drive_id
    )
    reply = yield from request(session, command)
    return int(reply.facts.get("drive_id", 0))


def drive_lift(
    session: Session, lease: Lease, velocity: float, expiry_ns: int | None, drive_id: int = 0
) -> Procedure[int]:
    """Drive at a velocity until it expires; returns the number of the drive."""
    command = protocol.DriveLift(
        epoch=lease.epoch, velocity=number("velocity", velocity), expiry_ns=expiry_ns, drive_id=drive_id
    )
    reply = yield from request(session, command)
    return int(reply.facts.get("drive_id", 0))


def drive_chassis_for(
    session: Session, lease: Lease, velocity: tuple[float, float, float], duration_ns: int
) -> Procedure[None]:
    """Keep a velocity alive for a time, then ramp down; ends when the commanded velocity is at rest.

    Raises:
        Aborted: Something stopped the drive; the code says what. Nothing is driven on.
    """
    drive = partial(drive_chassis, session, lease, velocity, None)
    drive_id = yield from _kept_alive(session, drive, duration_ns, lambda info: info.chassis_expiry_ns)
    yield from rest_chassis(session, lease, drive_id)


def _kept_alive(
    session: Session, drive: Callable[[int], Procedure[int]], duration_ns: int, expiry: Callable[[protocol.Info], int]
) -> Procedure[int]:
    until_ns = session.transport.now_ns() + duration_ns
    info = yield from get_info(session)
    drive_id = yield from drive(0)
    while (now_ns := session.transport.now_ns()) < until_ns:
        yield from pause(min(until_ns, now_ns + min(RENEW_NS, expiry(info) // 3)))
        if session.transport.now_ns() < until_ns:
            yield from drive(drive_id)
    return drive_id


def rest_chassis(session: Session, lease: Lease, drive_id: int) -> Procedure[None]:
    """Let a drive ramp down; ends when the commanded velocity is at rest.

    Raises:
        Aborted: Something else has ended the drive; the code says what.
    """
    reply = yield from request(
        session,
        protocol.DriveChassis(epoch=lease.epoch, vx_mps=0.0, vy_mps=0.0, wz_radps=0.0, drive_id=drive_id),
    )

    def rests(sighting: Sighting) -> bool | None:
        drive = sighting.view.drive
        return True if drive.drive_id != drive_id or not drive.driven else None

    yield Seen(session, rests, REST_NS, "the end of the drive", after_seq=reply.after_seq)


def drive_lift_for(session: Session, lease: Lease, velocity: float, duration_ns: int) -> Procedure[None]:
    """Keep a velocity of the lift alive for a time, then stop it.

    Raises:
        Aborted: Something stopped the drive; the code says what. Nothing is driven on.
    """
    drive = partial(drive_lift, session, lease, velocity, None)
    yield from _kept_alive(session, drive, duration_ns, lambda info: info.lift_expiry_ns)
    yield from request(session, protocol.StopLift(epoch=lease.epoch))
