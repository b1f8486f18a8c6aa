"""ROS package `std_msgs`: the header and the plain values. What the values mean is the topic's business."""

from dataclasses import dataclass, field
from typing import Annotated

from pycdr2 import IdlStruct
from pycdr2.types import float32, float64, int32, sequence, uint32

from cdr_types.messages.builtin_interfaces import Time

__all__ = [
    "Float32",
    "Float32MultiArray",
    "Float64",
    "Header",
    "Int32",
    "MultiArrayDimension",
    "MultiArrayLayout",
    "String",
]


@dataclass
class Header(IdlStruct, typename="std_msgs.msg.dds_.Header_"):
    """When and in which frame.

    Attributes:
        stamp: Time of the sender's clock.
        frame_id: Name of the frame.
    """

    stamp: Time = field(default_factory=Time)
    frame_id: str = ""


@dataclass
class Float32(IdlStruct, typename="std_msgs.msg.dds_.Float32_"):
    """One number, single precision: encoding rounds to the nearest one."""

    data: float32 = 0.0


@dataclass
class Float64(IdlStruct, typename="std_msgs.msg.dds_.Float64_"):
    """One number, double precision."""

    data: float64 = 0.0


@dataclass
class Int32(IdlStruct, typename="std_msgs.msg.dds_.Int32_"):
    """One signed integer of 32 bits."""

    data: int32 = 0


@dataclass
class String(IdlStruct, typename="std_msgs.msg.dds_.String_"):
    """One text."""

    data: str = ""


@dataclass
class MultiArrayDimension(IdlStruct, typename="std_msgs.msg.dds_.MultiArrayDimension_"):
    """One dimension of a `MultiArrayLayout`.

    Attributes:
        label: Name of the dimension.
        size: Number of elements along it.
        stride: Number of elements that one step along it skips, times its size.
    """

    label: str = ""
    size: uint32 = 0
    stride: uint32 = 0


@dataclass
class MultiArrayLayout(IdlStruct, typename="std_msgs.msg.dds_.MultiArrayLayout_"):
    """How the flat data of an array is to be read. The robot's topics leave it empty.

    Attributes:
        dim: Dimensions, outermost first.
        data_offset: Elements to skip at the front.
    """

    dim: Annotated[list[MultiArrayDimension], sequence(MultiArrayDimension)] = field(default_factory=list)
    data_offset: uint32 = 0


@dataclass
class Float32MultiArray(IdlStruct, typename="std_msgs.msg.dds_.Float32MultiArray_"):
    """Numbers in single precision.

    Attributes:
        layout: How to read `data`.
        data: The numbers, any count.
    """

    layout: MultiArrayLayout = field(default_factory=MultiArrayLayout)
    data: Annotated[list[float], sequence(float32)] = field(default_factory=list)
