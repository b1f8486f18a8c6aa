"""ROS package `geometry_msgs`: point, quaternion, pose. Frames are said by the topic, norms are checked by its user."""

from dataclasses import dataclass, field

from pycdr2 import IdlStruct
from pycdr2.types import float64

__all__ = ["Point", "Pose", "Quaternion"]


@dataclass
class Point(IdlStruct, typename="geometry_msgs.msg.dds_.Point_"):
    """A position, by convention in [m]."""

    x: float64 = 0.0
    y: float64 = 0.0
    z: float64 = 0.0


@dataclass
class Quaternion(IdlStruct, typename="geometry_msgs.msg.dds_.Quaternion_"):
    """An orientation, order x, y, z, w; the default is the identity."""

    x: float64 = 0.0
    y: float64 = 0.0
    z: float64 = 0.0
    w: float64 = 1.0


@dataclass
class Pose(IdlStruct, typename="geometry_msgs.msg.dds_.Pose_"):
    """Position and orientation of one frame in another.

    Attributes:
        position: Origin, [m].
        orientation: Rotation, xyzw.
    """

    position: Point = field(default_factory=Point)
    orientation: Quaternion = field(default_factory=Quaternion)
