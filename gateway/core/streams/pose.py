"""One arm's stream of end-effector setpoints (manual §4.2): 70 Hz on its own grid, so that the robot's IK keeps up."""

from __future__ import annotations

from gateway.core.motion.gap import Gap
from gateway.core.motion.motion import PoseReference
from gateway.core.streams.setpoints import SetpointStream
from gateway.robot.topics import pose_command
from gateway.settings.settings import PoseSettings
from gateway.values import Side, Space

__all__ = ["PoseStream"]


class PoseStream(SetpointStream):
    """Poses of one end effector in its arm's shoulder frame: x, y, z [m], qx, qy, qz, qw."""

    reference: PoseReference

    def __init__(self, side: Side, settings: PoseSettings) -> None:
        reference = PoseReference(settings, 1.0 / settings.rate_hz)
        tracking = Gap(settings.tracking_rad, settings.tracking_m)
        super().__init__(pose_command(side), Space.POSE, reference, settings.rate_hz, tracking)
