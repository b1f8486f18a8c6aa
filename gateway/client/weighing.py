"""Weighing what a hand holds, without waiting: a procedure of both clients, of small slow motions and what is felt in them.

Rules
    * Friction holds an arm at rest wherever it likes: so each joint is swung slowly up and down through each posture, and only
      what pulls it while it moves at its speed counts. Nothing is accelerated then, and friction is once for, once against.
    * Three postures: where the arm stands, and the hand tilted twice by its wrist. Every motion is one like any other: limits,
      what arms must not hit and stops are those of `move_to`. What ends one ends the weighing, the arm held where it is.
    * While it is weighed nothing is counted on; what was found is told last. The daemon works it out, for it knows the body.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Literal

from gateway.api import protocol
from gateway.client.asking.ownership import Ownership
from gateway.client.asking.procedures import AT_REST, Procedure, get_info, request, result
from gateway.client.asking.requests import chosen, number
from gateway.client.asking.results import Payload, Rows
from gateway.client.asking.waits import Seen
from gateway.client.connection.session import Sighting
from gateway.client.state.contact import Contact
from gateway.errors import Code, failure

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

__all__ = ["payload"]

SWING_RAD, SWING_RADPS = 0.05, 0.15
"""To both sides of a posture, and how fast: beyond play and what sticks, slowly enough to accelerate nothing."""
TILT_RAD, TILT_RADPS = 0.3, 0.4
TILTS = ((), (5,), (4, 6))
"""Which joints, from 0, are tilted in each posture: axes of the wrist that cross."""
NEAR_RAD = 0.05
"""The empty hand is weighed in the same postures within this [rad]."""
STEADY = 0.5
"""A joint moves at its speed while it is faster than this part of it ..."""
SLOWEST_RADPS = 0.02
"""... and than this: slower, its friction is not that of a motion."""
LEAST_SAMPLES = 5
MEMORY_NS = 60_000_000
"""What is felt remembers twice 30 ms: samples nearer than this say the same [ns]."""
MOTION_NS, KNOWN_NS = 30_000_000_000, 2_000_000_000
KEPT = ("q_rad", "up_nm", "down_nm", "noise_nm")
"""What is measured in each posture, and kept in a `Payload`."""


def payload(
    own: Ownership, name: protocol.SideName, known: Payload | Literal["weigh"] | None, empty: Payload | None
) -> Procedure[Payload]:
    """Weigh what a hand holds, or take what is known, and say so; see `ArmControl.payload`."""
    side = chosen(protocol.Side, "side", name)
    if known == "weigh":
        return (yield from _weighed(own, side, empty))
    return (yield from _tell(own, side, known or Payload(mass=0.0)))


def _tell(own: Ownership, side: protocol.Side, load: Payload) -> Procedure[Payload]:
    """Say what a hand holds."""
    mass_kg = number("mass", load.mass)
    com_m = () if load.com is None else tuple(number("com", value) for value in load.com)
    yield from request(own._session, protocol.SetPayload(epoch=own.epoch, side=side, mass_kg=mass_kg, com_m=com_m))
    return load


def _weighed(own: Ownership, side: protocol.Side, empty: Payload | None) -> Procedure[Payload]:
    import numpy as np

    session, name = own._session, f"{side.value}_arm"
    info = yield from get_info(session)
    yield from _tell(own, side, Payload(mass=0.0))

    def known(sighting: Sighting) -> protocol.ArmView | None:
        arm = sighting.view.arms[side.value]
        if arm.contact is None or arm.contact.code == "NOT_CONVERGED":
            return None
        _felt(arm, name)
        return arm

    arm: protocol.ArmView = yield Seen(session, known, KNOWN_NS, f"an estimate of what pulls at {name}")
    speed = max(map(abs, arm.dq_ref_radps), default=0.0)
    if speed > AT_REST:
        message = f"{name} moves at {speed:.3g} rad/s, and must be at rest to be weighed"
        raise failure(Code.CANNOT_WEIGH, message, field=name, value=f"{speed:.3g}", bound=f"{AT_REST:g}", unit="rad/s")
    start = np.array(arm.q_ref_rad or _felt(arm, name).q_rad)
    centres = _postures(start, *(np.array(bounds[side.value]) for bounds in (info.lower_rad, info.upper_rad)))
    before = None if empty is None else _before(empty, centres, name)
    rows = []
    for centre in centres if before is None else before[0]:
        yield from _move(own, side, centre - SWING_RAD, TILT_RADPS / info.v_radps)
        samples: list[protocol.ArmView] = []
        for goal in (centre + SWING_RAD, centre - SWING_RAD):
            yield from _move(own, side, goal, SWING_RADPS / info.v_radps, samples)
        rows.append((centre, *_swung(samples, name)))
    yield from _move(own, side, start, TILT_RADPS / info.v_radps)
    measured = np.array(rows).swapaxes(0, 1)
    beside = measured.copy()
    if before is not None:
        beside[1:3] -= before[1:3]
        beside[3] = np.hypot(beside[3], before[3])
    asked = protocol.Weigh(epoch=own.epoch, side=side, **_rows(beside), beside_empty=before is not None)
    reply = yield from request(session, asked)
    facts = reply.facts
    found = Payload(
        mass=facts["mass_kg"],
        mass_sd=facts["mass_sd_kg"],
        com=facts["com_m"] and tuple(facts["com_m"]),
        com_sd=facts["com_sd_m"] and tuple(facts["com_sd_m"]),
        frame=f"{side.value}_ee",
        condition=facts["condition"],
        **_rows(measured),
    )
    if found.com is not None:
        yield from _tell(own, side, found)
    return found


def _postures(start: Array, lower: Array, upper: Array) -> Array:
    """Return the middles of the swings, within limits, shape (3, 7): each tilt towards the farther one."""
    import numpy as np

    middle = np.clip(start, lower + SWING_RAD, upper - SWING_RAD)
    away = np.where(middle < 0.5 * (lower + upper), TILT_RAD, -TILT_RAD)
    return np.array([middle + away * np.isin(np.arange(len(start)), joints) for joints in TILTS])


def _before(empty: Payload, centres: Array, name: str) -> Array:
    """Return what was measured of the empty hand, shape (4, 3, 7); raise where that was in other postures than these."""
    import numpy as np

    rows = [getattr(empty, kept) for kept in KEPT]
    is_whole = all(tuple(map(len, row)) == (centres.shape[1],) * len(centres) for row in rows)
    off_rad = float(np.abs(centres - np.array(rows[0])).max()) if is_whole else np.inf
    if not off_rad <= NEAR_RAD:
        raise failure(
            Code.CANNOT_WEIGH,
            f"{name} stands {off_rad:.2f} rad from where its empty hand was weighed, {NEAR_RAD:g} rad is the bound",
            field=name,
            value=f"{off_rad:.3g}",
            bound=f"{NEAR_RAD:g}",
            unit="rad",
            hint="move it to empty.q_rad[0] first",
        )
    return np.array(rows)


def _move(
    own: Ownership, side: protocol.Side, goal: Array, speed: float, samples: list[protocol.ArmView] | None = None
) -> Procedure[None]:
    """Move an arm somewhere; keep what is felt on the way where it is wanted."""
    session, _, motion, _ = yield from own._move({side.value: goal}, False, min(1.0, speed), None, "reject", None)

    def collect(sighting: Sighting) -> bool | None:
        arm = sighting.view.arms[side.value]
        at_ns = _felt(arm, f"{side.value}_arm").stamp_ns
        if samples is not None and (not samples or at_ns != _felt(samples[-1], "").stamp_ns):
            samples.append(arm)
        return motion.ended or None

    if samples is not None:
        yield Seen(session, collect, MOTION_NS, "the end of a swing", after_seq=motion.after_seq)
    yield from result(session, motion, MOTION_NS)


def _felt(arm: protocol.ArmView, name: str) -> protocol.MotorView:
    """Return the joints of an arm that feels; raise why it does not."""
    contact, measured = arm.contact, arm.measured
    if contact is None or measured is None or contact.state != "known":
        reason = "no joints were measured" if contact is None else Contact(name, contact, 0).reason
        raise failure(Code.CANNOT_WEIGH, f"what pulls at {name} is unknown: {reason}", field=name)
    return measured


def _swung(samples: Sequence[protocol.ArmView], name: str) -> tuple[Array, Array, Array]:
    """Return what pulled each joint on its way up and down [N·m], and how noisy the mean of both is, shape (7,) each."""
    import numpy as np

    joints = [_felt(arm, name) for arm in samples]
    pulls = np.array([arm.contact.torque_nm for arm in samples if arm.contact is not None])
    dq, ref = np.array([one.dq_radps for one in joints]), np.array([arm.dq_ref_radps for arm in samples])
    apart_ns = float(np.median(np.diff([one.stamp_ns for one in joints])))
    steady = np.maximum(STEADY * np.abs(ref).max(axis=0), SLOWEST_RADPS)
    means, variance = [], np.zeros(dq.shape[1])
    for moves in (dq > steady, dq < -steady):
        counts = moves.sum(axis=0)
        if counts.min() < LEAST_SAMPLES:
            joint = int(counts.argmin()) + 1
            message = f"joint {joint} of {name} did not follow a swing of {SWING_RAD:g} rad up and down"
            raise failure(Code.CANNOT_WEIGH, message, field=f"{name}[{joint - 1}]")
        mean = np.where(moves, pulls, 0.0).sum(axis=0) / counts
        means.append(mean)
        spread = np.where(moves, np.square(pulls - mean), 0.0).sum(axis=0) / counts
        variance += spread / np.maximum(1.0, counts * apart_ns / MEMORY_NS)
    return means[0], means[1], 0.5 * np.sqrt(variance)


def _rows(values: Array) -> dict[str, Rows]:
    return {name: tuple(map(tuple, rows)) for name, rows in zip(KEPT, values.tolist(), strict=True)}
