from __future__ import annotations

import pytest
from rosbags.typesys import get_types_from_msg

from cdr_types.errors import UnknownType
from cdr_types.registry import MESSAGE_TYPES, type_name
from cdr_types.schemas import ENCODING, definition, text
from tests.cdr_types.oracle import HUMBLE

NAMES = [type_name(cls) for cls in MESSAGE_TYPES]
LINE = "=" * 80


def test_the_text_of_a_type_lists_its_fields():
    """One line each: ROS type, name."""
    assert text("sensor_msgs/msg/JointState") == (
        "std_msgs/Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort\n"
    )
    assert text("std_msgs/msg/Int32") == "int32 data\n"
    assert text("std_msgs/msg/MultiArrayDimension") == "string label\nuint32 size\nuint32 stride\n"


def test_a_definition_stands_alone():
    """Every type that is used follows once, behind 80 `=` and its name (MCAP `ros2msg`)."""
    assert ENCODING == "ros2msg"
    assert definition("sensor_msgs/msg/JointState") == (
        f"{text('sensor_msgs/msg/JointState')}"
        f"{LINE}\nMSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n"
        f"{LINE}\nMSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n"
    )
    assert definition("std_msgs/msg/Float32MultiArray") == (
        "std_msgs/MultiArrayLayout layout\nfloat32[] data\n"
        f"{LINE}\nMSG: std_msgs/MultiArrayLayout\nstd_msgs/MultiArrayDimension[] dim\nuint32 data_offset\n"
        f"{LINE}\nMSG: std_msgs/MultiArrayDimension\nstring label\nuint32 size\nuint32 stride\n"
    )
    assert definition("geometry_msgs/msg/Point") == "float64 x\nfloat64 y\nfloat64 z\n"


@pytest.mark.parametrize("name", NAMES)
def test_the_definition_is_the_one_of_rosbags(name):
    """Rosbags writes the same from its own copy of the Humble interfaces."""
    theirs, _ = HUMBLE.generate_msgdef(name, ros_version=2)
    assert definition(name) == theirs


@pytest.mark.parametrize("name", NAMES)
def test_a_parser_of_msg_text_finds_the_types_of_humble(name):
    """Read back, the text means what ROS 2 Humble means by this name."""
    parsed = get_types_from_msg(text(name), name)
    assert parsed[name][1] == HUMBLE.fielddefs[name][1]


def test_unknown_types_have_no_text():
    """The error is that of the registry."""
    with pytest.raises(UnknownType):
        text("std_msgs/msg/Nothing")
    with pytest.raises(UnknownType):
        definition("std_msgs/msg/Nothing")
