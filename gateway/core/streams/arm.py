"""One arm's stream of joint setpoints (manual §4.3): 100 Hz."""

from __future__ import annotations

from gateway.core.motion.gap import Gap
from gateway.core.motion.motion import JointLimits, JointReference
from gateway.core.streams.setpoints import SetpointStream
from gateway.robot.topics import joint_command
from gateway.settings.settings import ArmSettings
from gateway.values import Side, Space

__all__ = ["ArmStream"]


class ArmStream(SetpointStream):
    """Joint setpoints of one arm, seven positions [rad]."""

    reference: JointReference

    def __init__(self, side: Side, settings: ArmSettings) -> None:
        limits = JointLimits(
            v_radps=settings.v_radps,
            a_radps2=settings.a_radps2,
            j_radps3=settings.j_radps3,
            lower_rad=tuple(settings.lower_rad[side]),
            upper_rad=tuple(settings.upper_rad[side]),
        )
        reference = JointReference(limits, 1.0 / settings.rate_hz)
        tracking = Gap(settings.tracking_rad)
        super().__init__(joint_command(side), Space.JOINT, reference, settings.rate_hz, tracking)
