from __future__ import annotations

from dataclasses import fields

import pytest

from cdr_types.messages.builtin_interfaces import Time
from cdr_types.messages.geometry_msgs import Point, Pose, Quaternion
from cdr_types.messages.sensor_msgs import JointState
from cdr_types.messages.std_msgs import (
    Float32,
    Float32MultiArray,
    Float64,
    Header,
    Int32,
    MultiArrayDimension,
    MultiArrayLayout,
    String,
)
from cdr_types.registry import MESSAGE_TYPES, type_name
from tests.cdr_types.oracle import HUMBLE

FRESH = [
    (Time(), Time(sec=0, nanosec=0)),
    (Point(), Point(x=0.0, y=0.0, z=0.0)),
    (Quaternion(), Quaternion(x=0.0, y=0.0, z=0.0, w=1.0)),
    (Pose(), Pose(position=Point(), orientation=Quaternion())),
    (Header(), Header(stamp=Time(), frame_id="")),
    (Float32(), Float32(data=0.0)),
    (Float64(), Float64(data=0.0)),
    (Int32(), Int32(data=0)),
    (String(), String(data="")),
    (MultiArrayDimension(), MultiArrayDimension(label="", size=0, stride=0)),
    (MultiArrayLayout(), MultiArrayLayout(dim=[], data_offset=0)),
    (Float32MultiArray(), Float32MultiArray(layout=MultiArrayLayout(), data=[])),
    (JointState(), JointState(header=Header(), name=[], position=[], velocity=[], effort=[])),
]


@pytest.mark.parametrize(("fresh", "expected"), FRESH)
def test_a_fresh_message_holds_the_defaults_of_ros(fresh, expected):
    """Zeros, empty, and the identity for a quaternion."""
    assert fresh == expected


def test_the_defaults_of_every_class_are_pinned():
    """The table above leaves no class out."""
    assert {type(fresh) for fresh, _ in FRESH} == set(MESSAGE_TYPES)


def test_fresh_messages_share_nothing():
    """Filling one joint state does not fill the next."""
    first, second = JointState(), JointState()
    first.name.append("l_joint1")
    first.header.stamp.sec = 5
    assert second == JointState()


@pytest.mark.parametrize("cls", MESSAGE_TYPES)
def test_fields_are_those_of_humble_in_their_order(cls):
    """The order of the fields is the order on the wire."""
    humble = [name for name, _ in HUMBLE.get_msgdef(type_name(cls)).fields]
    assert [field.name for field in fields(cls)] == humble
