from __future__ import annotations

import math

import numpy as np
import pytest

from cdr_types.errors import UnencodableValue
from cdr_types.layout import layout_of
from cdr_types.messages.builtin_interfaces import Time
from cdr_types.messages.geometry_msgs import Point, Pose
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
from cdr_types.values import check_message
from tests.cdr_types.oracle import arm_state

LARGEST_FLOAT32 = 3.4028234663852886e38


def check(message):
    """Check a message against the layout of its class."""
    check_message(message, layout_of(type(message)))


@pytest.mark.parametrize(
    "message",
    [
        arm_state(),
        Pose(),
        String(data="关节 ☃"),
        JointState(name=("a", "b"), position=(1, 2.0)),
        Float32(data=np.float32(0.5)),
        Int32(data=np.int64(-5)),
        Float32(data=LARGEST_FLOAT32),
        Float32(data=-LARGEST_FLOAT32),
        Int32(data=-(2**31)),
        Int32(data=2**31 - 1),
        Float32MultiArray(layout=MultiArrayLayout(dim=[MultiArrayDimension(label="x", size=2**32 - 1)])),
    ],
)
def test_what_the_ros_type_can_hold_passes(message):
    """Numbers of Python and numpy up to the edge of their type, lists and tuples, any text."""
    check(message)


@pytest.mark.parametrize("number", [math.nan, math.inf, -math.inf])
def test_numbers_that_are_not_finite_are_legal_here(number):
    """The wire can carry them; refusing them is the business of whoever commands a robot."""
    check(Float32(data=number))
    check(Float64(data=number))
    check(JointState(position=[number]))


@pytest.mark.parametrize(
    ("message", "field"),
    [
        (Float32(data=1e39), "data"),  # would become infinity
        (Float32(data=-3.5e38), "data"),
        (Float32(data="1.0"), "data"),
        (Float32(data=None), "data"),
        (Float32(data=[1.0]), "data"),
        (Float64(data=10**400), "data"),
        (Float64(data=1j), "data"),
        (Int32(data=2**31), "data"),
        (Int32(data=-(2**31) - 1), "data"),
        (Int32(data=1.0), "data"),
        (Header(stamp=Time(sec=0, nanosec=-1)), "stamp.nanosec"),
        (Header(stamp=Time(sec=2**31, nanosec=0)), "stamp.sec"),
        (Float32MultiArray(data=[0.0, 1e39]), "data[1]"),
        (Float32MultiArray(layout=MultiArrayLayout(data_offset=2**32)), "layout.data_offset"),
        (JointState(position=[0.0, 1.0, None]), "position[2]"),
    ],
)
def test_a_number_that_does_not_fit_is_refused(message, field):
    """Out of range or no number at all: never rounded to infinity, never wrapped."""
    with pytest.raises(UnencodableValue, match="number that fits") as caught:
        check(message)
    assert caught.value.field == field


@pytest.mark.parametrize(
    ("message", "field", "reason"),
    [
        (String(data=b"bytes"), "data", "a str"),
        (String(data=None), "data", "a str"),
        (JointState(name=["a", 1]), "name[1]", "a str"),
        (JointState(name=["a\x00b"]), "name[0]", "NUL"),
        (Header(frame_id="\x00"), "frame_id", "NUL"),
        (String(data="\ud800"), "data", "surrogates"),
    ],
)
def test_text_that_the_wire_cannot_carry_is_refused(message, field, reason):
    """No text, text that a NUL would cut, and lone surrogates."""
    with pytest.raises(UnencodableValue, match=reason) as caught:
        check(message)
    assert caught.value.field == field and str(caught.value).startswith(f"{field}: ")
    name, _, index = field.partition("[")
    found = getattr(message, name)
    assert caught.value.value == (found[int(index[:-1])] if index else found)


@pytest.mark.parametrize("value", ["l_joint1", None, {"a": 1}, {"a"}, iter([]), np.zeros(7), 3])
def test_a_sequence_is_a_list_or_a_tuple(value):
    """A str is a sequence of letters, a generator is empty the second time: neither is meant."""
    for field in ("name", "position"):
        with pytest.raises(UnencodableValue) as caught:
            check(JointState(**{field: value}))
        assert (caught.value.field, caught.value.bound) == (field, "a list or tuple")
        assert caught.value.value is value


@pytest.mark.parametrize("value", [None, Time(), (0.0, 0.0, 0.0), type("Point", (Point,), {})()])
def test_a_nested_message_is_exactly_of_its_class(value):
    """Look-alikes and subclasses are refused: they may have other fields."""
    with pytest.raises(UnencodableValue, match="a Point") as caught:
        check(Pose(position=value))
    assert caught.value.field == "position" and caught.value.value is value


def test_the_elements_of_a_sequence_of_messages_are_checked():
    """The path leads to the element and its field."""
    with pytest.raises(UnencodableValue) as caught:
        check(MultiArrayLayout(dim=[MultiArrayDimension(), MultiArrayDimension(stride=-1)]))
    assert caught.value.field == "dim[1].stride"


def test_a_field_that_was_deleted_is_refused():
    """Dataclass instances are open: a missing field is an unencodable one, not an AttributeError."""
    message = JointState()
    del message.position
    with pytest.raises(UnencodableValue) as caught:
        check(message)
    assert caught.value.field == "position"
