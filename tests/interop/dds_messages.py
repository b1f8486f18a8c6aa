"""ROS 2 messages for CycloneDDS, typed from the interface definitions of Humble, and the way to ours and back.

They share nothing with `cdr_types` but the names of their fields: CycloneDDS brings its own serializer. Names are
mangled as the ROS middleware mangles them: `sensor_msgs/msg/JointState` is `sensor_msgs::msg::dds_::JointState_`.
"""

# No postponed annotations: CycloneDDS reads them when a class is made.
from dataclasses import dataclass, fields
from typing import Any

from cyclonedds.idl import IdlStruct
from cyclonedds.idl.types import array, float32, float64, int32, sequence, uint8, uint32
from pycdr2 import IdlStruct as OurStruct

from cdr_types.registry import MESSAGE_TYPES, type_name

__all__ = ["DDS_TYPES", "Gid", "NodeEntitiesInfo", "ParticipantEntitiesInfo", "from_dds", "to_dds"]


@dataclass
class Time(IdlStruct, typename="builtin_interfaces.msg.dds_.Time_"):
    sec: int32
    nanosec: uint32


@dataclass
class Header(IdlStruct, typename="std_msgs.msg.dds_.Header_"):
    stamp: Time
    frame_id: str


@dataclass
class Float32(IdlStruct, typename="std_msgs.msg.dds_.Float32_"):
    data: float32


@dataclass
class Float64(IdlStruct, typename="std_msgs.msg.dds_.Float64_"):
    data: float64


@dataclass
class Int32(IdlStruct, typename="std_msgs.msg.dds_.Int32_"):
    data: int32


@dataclass
class String(IdlStruct, typename="std_msgs.msg.dds_.String_"):
    data: str


@dataclass
class MultiArrayDimension(IdlStruct, typename="std_msgs.msg.dds_.MultiArrayDimension_"):
    label: str
    size: uint32
    stride: uint32


@dataclass
class MultiArrayLayout(IdlStruct, typename="std_msgs.msg.dds_.MultiArrayLayout_"):
    dim: sequence[MultiArrayDimension]
    data_offset: uint32


@dataclass
class Float32MultiArray(IdlStruct, typename="std_msgs.msg.dds_.Float32MultiArray_"):
    layout: MultiArrayLayout
    data: sequence[float32]


@dataclass
class Point(IdlStruct, typename="geometry_msgs.msg.dds_.Point_"):
    x: float64
    y: float64
    z: float64


@dataclass
class Quaternion(IdlStruct, typename="geometry_msgs.msg.dds_.Quaternion_"):
    x: float64
    y: float64
    z: float64
    w: float64


@dataclass
class Pose(IdlStruct, typename="geometry_msgs.msg.dds_.Pose_"):
    position: Point
    orientation: Quaternion


@dataclass
class JointState(IdlStruct, typename="sensor_msgs.msg.dds_.JointState_"):
    header: Header
    name: sequence[str]
    position: sequence[float64]
    velocity: sequence[float64]
    effort: sequence[float64]


# What a node of ROS 2 Humble tells about itself on `ros_discovery_info`.


@dataclass
class Gid(IdlStruct, typename="rmw_dds_common.msg.dds_.Gid_"):
    """16 bytes of the entity's GUID and eight zeros, as Humble has it."""

    data: array[uint8, 24]


@dataclass
class NodeEntitiesInfo(IdlStruct, typename="rmw_dds_common.msg.dds_.NodeEntitiesInfo_"):
    node_namespace: str
    node_name: str
    reader_gid_seq: sequence[Gid]
    writer_gid_seq: sequence[Gid]


@dataclass
class ParticipantEntitiesInfo(IdlStruct, typename="rmw_dds_common.msg.dds_.ParticipantEntitiesInfo_"):
    gid: Gid
    node_entities_info_seq: sequence[NodeEntitiesInfo]


_OF_ROS = (
    *(Time, Header, Float32, Float64, Int32, String, MultiArrayDimension, MultiArrayLayout, Float32MultiArray),
    *(Point, Quaternion, Pose, JointState),
)
_BY_TYPENAME = {cls.__idl_typename__: cls for cls in _OF_ROS}

_DDS_OF: dict[type, type[IdlStruct]] = {ours: _BY_TYPENAME[ours.__idl_typename__] for ours in MESSAGE_TYPES}
_OURS_OF: dict[type, type[OurStruct]] = {dds: ours for ours, dds in _DDS_OF.items()}
_NAMES = {cls: tuple(field.name for field in fields(cls)) for cls in _DDS_OF.values()}

DDS_TYPES: dict[str, type[IdlStruct]] = {type_name(ours): dds for ours, dds in _DDS_OF.items()}
"""ROS type name -> class for CycloneDDS."""


def to_dds(message: OurStruct) -> IdlStruct:
    """Return the same message for CycloneDDS."""
    return _converted(message, _DDS_OF)


def from_dds(sample: IdlStruct) -> OurStruct:
    """Return the same message as one of ours."""
    return _converted(sample, _OURS_OF)


def _converted(value: Any, classes: dict[type, Any]) -> Any:
    kind = classes.get(type(value))
    if kind is not None:
        names = _NAMES[kind] if kind in _NAMES else _NAMES[type(value)]
        return kind(*(_converted(getattr(value, name), classes) for name in names))
    if isinstance(value, list) and value and type(value[0]) in classes:
        return [_converted(item, classes) for item in value]
    return value
