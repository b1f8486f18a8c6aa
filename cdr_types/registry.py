"""Which message types exist here, and their ROS names in both directions.

A type is known when it stands in `MESSAGE_TYPES`; its ROS name (`sensor_msgs/msg/JointState`) follows from the DDS
name that its class carries. Nothing is registered at run time: the set is closed, so tables can be built on import.
"""

from __future__ import annotations

from pycdr2 import IdlStruct

from cdr_types.errors import UnknownType
from cdr_types.messages import builtin_interfaces, geometry_msgs, sensor_msgs, std_msgs

__all__ = ["KNOWN_NAMES", "MESSAGE_TYPES", "message_type", "type_name"]

MESSAGE_TYPES: tuple[type[IdlStruct], ...] = (
    builtin_interfaces.Time,
    geometry_msgs.Point,
    geometry_msgs.Pose,
    geometry_msgs.Quaternion,
    sensor_msgs.JointState,
    std_msgs.Float32,
    std_msgs.Float32MultiArray,
    std_msgs.Float64,
    std_msgs.Header,
    std_msgs.Int32,
    std_msgs.MultiArrayDimension,
    std_msgs.MultiArrayLayout,
    std_msgs.String,
)
"""Every message class of `cdr_types.messages`."""


def _ros_name(cls: type[IdlStruct]) -> str:
    package, kind, _, name = cls.__idl_typename__.split(".")
    return f"{package}/{kind}/{name.removesuffix('_')}"


_NAMES = {cls: _ros_name(cls) for cls in MESSAGE_TYPES}
_TYPES = {name: cls for cls, name in _NAMES.items()}

KNOWN_NAMES = ", ".join(_TYPES)
"""For messages: what could have been asked for."""


def type_name(message_type: type[IdlStruct]) -> str:
    """Return the ROS name of a message class, e.g. `sensor_msgs/msg/JointState`.

    Raises:
        UnknownType: If the class is none of `MESSAGE_TYPES`.
    """
    try:
        return _NAMES[message_type]
    except (KeyError, TypeError):  # TypeError: not even hashable
        raise UnknownType(message_type, KNOWN_NAMES) from None


def message_type(type_name: str) -> type[IdlStruct]:
    """Return the message class of a ROS type name.

    Raises:
        UnknownType: If no class here has this name.
    """
    try:
        return _TYPES[type_name]
    except (KeyError, TypeError):  # TypeError: not even hashable
        raise UnknownType(type_name, KNOWN_NAMES) from None
