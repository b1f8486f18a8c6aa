"""The second opinion: rosbags with its ROS 2 Humble typestore, and messages to ask it about.

rosbags shares no code with pycdr2 or with us: it brings its own definitions of the Humble interfaces and generates its
own readers and writers. It is slow and lenient, so it judges bytes that are meant to be right, never hostile ones.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from hypothesis import strategies as st
from pycdr2 import IdlStruct
from rosbags.typesys import Stores, get_typestore

from cdr_types.layout import Kind, Number, Sequence, Struct, Text, layout_of
from cdr_types.messages.builtin_interfaces import Time
from cdr_types.messages.sensor_msgs import JointState
from cdr_types.messages.std_msgs import Header
from cdr_types.registry import type_name

HUMBLE = get_typestore(Stores.ROS2_HUMBLE)

# Keeps NaN out of the way of comparisons by ==; what NaN does has tests of its own.
FLOATS = {"float32": st.floats(width=32, allow_nan=False), "float64": st.floats(allow_nan=False)}
TEXT = st.text(st.characters(exclude_characters="\x00", exclude_categories=["Cs"]), max_size=12)


def ros_encode(message: IdlStruct, *, little_endian: bool = True) -> bytes:
    """Return what rosbags writes for a message."""
    return bytes(HUMBLE.serialize_cdr(_to_ros(message), type_name(type(message)), little_endian=little_endian))


def ros_decode(data: bytes, message_type: type[IdlStruct]) -> Any:
    """Return what rosbags reads in a payload without padding, as one of our messages."""
    return _from_ros(HUMBLE.deserialize_cdr(data, type_name(message_type)), layout_of(message_type))


def _to_ros(message: Any) -> Any:
    fields = {}
    for name, kind in layout_of(type(message)).fields:
        value = getattr(message, name)
        if isinstance(kind, Struct):
            value = _to_ros(value)
        elif isinstance(kind, Sequence) and isinstance(kind.element, Number):
            value = np.array(value, dtype=kind.element.name)
        elif isinstance(kind, Sequence) and isinstance(kind.element, Struct):
            value = [_to_ros(element) for element in value]
        fields[name] = value
    return HUMBLE.types[type_name(type(message))](**fields)


def _from_ros(value: Any, kind: Kind) -> Any:
    if isinstance(kind, Struct):
        return kind.message_type(*(_from_ros(getattr(value, name), field) for name, field in kind.fields))
    if isinstance(kind, Sequence):
        items = value.tolist() if isinstance(value, np.ndarray) else value
        return [_from_ros(item, kind.element) for item in items]
    return value


def messages(kind: Kind | type[IdlStruct]) -> st.SearchStrategy[Any]:
    """Return a strategy for any message of a class (or any value of a kind)."""
    if isinstance(kind, type):
        kind = layout_of(kind)
    if isinstance(kind, Struct):
        return st.builds(kind.message_type, **{name: messages(field) for name, field in kind.fields})
    if isinstance(kind, Sequence):
        return st.lists(messages(kind.element), max_size=9)
    if isinstance(kind, Text):
        return TEXT
    if kind.name in FLOATS:
        return FLOATS[kind.name]
    bits = 8 * kind.size
    low = 0 if kind.name.startswith("u") else -(2 ** (bits - 1))
    return st.integers(low, low + 2**bits - 1)


def arm_state(frame_id: str = "left_arm", side: str = "l") -> JointState:
    """Return a joint state as the robot publishes it for an arm (manual §4.8): 7 joints, all arrays filled."""
    return JointState(
        header=Header(stamp=Time(sec=1_700_000_000, nanosec=123_456_789), frame_id=frame_id),
        name=[f"{side}_joint{number}" for number in range(1, 8)],
        position=[0.1 * number for number in range(7)],
        velocity=[-0.2 * number for number in range(7)],
        effort=[0.3 * number for number in range(7)],
    )
