from __future__ import annotations

import inspect

import pytest
from pycdr2 import IdlStruct

from cdr_types import messages
from cdr_types.errors import UnknownType
from cdr_types.messages import builtin_interfaces, geometry_msgs, sensor_msgs, std_msgs
from cdr_types.registry import KNOWN_NAMES, MESSAGE_TYPES, message_type, type_name
from tests.cdr_types.oracle import HUMBLE


def test_ros_names_follow_package_and_class():
    """`pkg/msg/Type`, as liveliness tokens and MCAP schemas spell it."""
    assert type_name(sensor_msgs.JointState) == "sensor_msgs/msg/JointState"
    assert type_name(geometry_msgs.Pose) == "geometry_msgs/msg/Pose"
    assert type_name(std_msgs.Float32MultiArray) == "std_msgs/msg/Float32MultiArray"
    assert type_name(builtin_interfaces.Time) == "builtin_interfaces/msg/Time"


@pytest.mark.parametrize("cls", MESSAGE_TYPES)
def test_names_lead_back_to_their_class(cls):
    """The two directions are inverse, and ROS 2 Humble knows each name."""
    assert message_type(type_name(cls)) is cls
    assert type_name(cls) in HUMBLE.types
    assert type_name(cls) in KNOWN_NAMES


def test_every_message_class_is_registered():
    """A class that somebody adds to `messages` and forgets in the registry is found here."""
    modules = [getattr(messages, name) for name in messages.__all__]
    defined = {
        cls
        for module in modules
        for _, cls in inspect.getmembers(module, inspect.isclass)
        if issubclass(cls, IdlStruct) and cls.__module__ == module.__name__
    }
    assert defined == set(MESSAGE_TYPES)


@pytest.mark.parametrize("wrong", ["std_msgs/msg/Float16", "Float32", "", None, ["std_msgs/msg/Float32"]])
def test_unknown_names_are_refused(wrong):
    """The error shows what was asked for and what there is."""
    with pytest.raises(UnknownType, match="std_msgs/msg/Float32") as caught:
        message_type(wrong)
    assert caught.value.value == wrong


@pytest.mark.parametrize("wrong", [dict, IdlStruct, None, []])
def test_unknown_classes_are_refused(wrong):
    """Not everything that can be asked for is hashable, and none of it is a message."""
    with pytest.raises(UnknownType):
        type_name(wrong)
