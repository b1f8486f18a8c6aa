"""ROS package `sensor_msgs`: the joint state. Order, length and units of its arrays are said by the topic."""

from dataclasses import dataclass, field
from typing import Annotated

from pycdr2 import IdlStruct
from pycdr2.types import float64, sequence

from cdr_types.messages.std_msgs import Header

__all__ = ["JointState"]


@dataclass
class JointState(IdlStruct, typename="sensor_msgs.msg.dds_.JointState_"):
    """State or target of a group of joints; each array may have its own length, and be empty.

    Attributes:
        header: Time and frame.
        name: Joint names.
        position: [rad] or [m].
        velocity: [rad/s] or [m/s].
        effort: [N·m] or [N].
    """

    header: Header = field(default_factory=Header)
    name: Annotated[list[str], sequence(str)] = field(default_factory=list)
    position: Annotated[list[float], sequence(float64)] = field(default_factory=list)
    velocity: Annotated[list[float], sequence(float64)] = field(default_factory=list)
    effort: Annotated[list[float], sequence(float64)] = field(default_factory=list)
