"""The chassis: an owner's velocity at 20 Hz on a slope that the robot can follow, then zeros for a second (manual §4.5).

The robot keeps the last velocity for up to 1 s when nothing comes, so that every use ends with zeros for longer than that.
A stop sends them at once, and the robot brakes as it can; a velocity that expires, or that is zero, is ramped down to.
"""

from __future__ import annotations

from gateway.codes import Code
from gateway.core.motion.joints.slope import Slope
from gateway.core.streams.ground import GroundStream
from gateway.robot.topics import CHASSIS_VELOCITY
from gateway.settings.settings import ChassisSettings
from gateway.values import Vector

__all__ = ["ChassisStream"]

ZEROS: Vector = (0.0, 0.0, 0.0)


class ChassisStream(GroundStream):
    """Velocities of the chassis: vx, vy [m/s], wz [rad/s]."""

    def __init__(self, settings: ChassisSettings) -> None:
        super().__init__(CHASSIS_VELOCITY)
        self.wanted: Vector = ZEROS
        """What the owner asked for last."""
        self._slope = Slope(
            len(ZEROS),
            up=settings.up_mps2,
            down=settings.down_mps2,
            jerk=settings.j_mps3,
            period_s=1.0 / self._spec.rate_hz,
        )

    @property
    def commanded(self) -> Vector:
        """The velocity that was sent last."""
        return self._slope.velocity

    def drive(self, wanted: Vector, *, epoch: int, expires_ns: int, now_ns: int, drive_id: int = 0) -> Code | None:
        """Ramp to a velocity; see `GroundStream.renew`.

        `wanted` is vx, vy [m/s], wz [rad/s], finite and inside the limits; drive and expiry are as for `renew`.
        """
        code = self.renew(epoch, expires_ns, now_ns, drive_id)
        if code is None:
            self.wanted = wanted
        return code

    def _run_out(self) -> bool:
        was_wanted, self.wanted = self.wanted, ZEROS
        return any(was_wanted)

    def _driven(self) -> Vector | None:
        velocity = self._slope.step(self.wanted)
        if not self._slope.is_at_rest or any(self.wanted):
            return velocity
        self._rest()
        return None

    def _rest(self) -> None:
        super()._rest()
        self.wanted = ZEROS
        self._slope.halt()
