"""ROS package `builtin_interfaces`: the time stamp. It does not know which clock the numbers come from."""

from dataclasses import dataclass

from pycdr2 import IdlStruct
from pycdr2.types import int32, uint32

__all__ = ["Time"]


@dataclass
class Time(IdlStruct, typename="builtin_interfaces.msg.dds_.Time_"):
    """A point in time of the sender's clock.

    Attributes:
        sec: Whole seconds [s].
        nanosec: Rest [ns], 0 to 999,999,999 by convention; not enforced.
    """

    sec: int32 = 0
    nanosec: uint32 = 0
