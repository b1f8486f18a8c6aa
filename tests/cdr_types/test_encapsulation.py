from __future__ import annotations

import pytest

from cdr_types.codec import encode
from cdr_types.encapsulation import as_bytes, byte_order, check_end, peek_stamp
from cdr_types.errors import NotBytes, TrailingBytes, Truncated, WrongEncapsulation
from cdr_types.messages.builtin_interfaces import Time
from cdr_types.messages.std_msgs import Header
from tests.cdr_types.oracle import arm_state, ros_encode


def test_both_byte_orders_of_plain_cdr_are_spoken():
    """`00 01` is little endian, `00 00` big endian; the option bytes say nothing about either."""
    assert byte_order(b"\x00\x01\x00\x00") == "<"
    assert byte_order(b"\x00\x00\x00\x00") == ">"
    assert byte_order(b"\x00\x01\xff\x03") == "<"


@pytest.mark.parametrize(
    "kind", [b"\x00\x02", b"\x00\x03", b"\x00\x06", b"\x00\x07", b"\x01\x00", b"\x01\x01", b"\xff\xff"]
)
def test_every_other_representation_is_refused(kind):
    """Parameter lists, XCDR2 and garbage are not guessed at."""
    with pytest.raises(WrongEncapsulation) as caught:
        byte_order(kind + b"\x00\x00\x00\x00\x80\x3f")
    assert caught.value.value == kind.hex(" ")


@pytest.mark.parametrize("size", range(4))
def test_a_payload_without_room_for_a_header_is_truncated(size):
    """Zero to three bytes are no message, whatever they are."""
    with pytest.raises(Truncated) as caught:
        byte_order(b"\x00\x01\x00\x00"[:size])
    assert (caught.value.value, caught.value.bound) == (size, 4)
    assert (
        str(caught.value)
        == f"encapsulation header: the payload ends too early: {size} bytes left, 4 needed (at byte 0)"
    )


@pytest.mark.parametrize("padding", range(4))
def test_up_to_three_bytes_may_follow(padding):
    """RTPS pads to a multiple of 4 and the bridge does not cut it off."""
    check_end(bytes(8 + padding), 8)


@pytest.mark.parametrize("rest", [4, 5, 1000])
def test_more_than_padding_is_refused(rest):
    """A message of another type that happens to begin like this one is noticed by its length."""
    with pytest.raises(TrailingBytes) as caught:
        check_end(bytes(8 + rest), 8)
    assert (caught.value.value, caught.value.bound, caught.value.offset) == (rest, 3, 8)


@pytest.mark.parametrize("data", [b"ab", bytearray(b"ab"), memoryview(b"ab"), memoryview(b"a.b.")[::2]])
def test_bytes_come_in_three_kinds(data):
    """What zenoh or a file hands out is taken as it is."""
    assert as_bytes(data) == b"ab"


@pytest.mark.parametrize("data", ["ab", 5, None, [0, 1]])
def test_anything_else_is_no_payload(data):
    """`bytes(5)` would be five zeros: nothing is converted by accident."""
    with pytest.raises(NotBytes):
        as_bytes(data)


@pytest.mark.parametrize("little_endian", [True, False])
@pytest.mark.parametrize(("sec", "nanosec"), [(0, 0), (1_700_000_000, 999_999_999), (-1, 5), (2**31 - 1, 2**32 - 1)])
def test_the_stamp_is_read_without_decoding(little_endian, sec, nanosec):
    """Duplicates are told by their stamp before the cost of decoding is paid."""
    message = arm_state()
    message.header.stamp = Time(sec=sec, nanosec=nanosec)
    assert peek_stamp(ros_encode(message, little_endian=little_endian)) == sec * 10**9 + nanosec


def test_the_stamp_is_found_in_every_kind_of_bytes():
    """A memoryview needs no copy by the caller."""
    data = encode(Header(stamp=Time(sec=2, nanosec=3)))
    assert peek_stamp(memoryview(data)) == peek_stamp(bytearray(data)) == 2_000_000_003


def test_a_payload_that_ends_before_the_stamp_is_truncated():
    """Never a default stamp: two broken samples would look like copies of each other."""
    data = encode(arm_state())
    assert peek_stamp(data[:12]) == peek_stamp(data)
    for size in range(12):
        with pytest.raises(Truncated) as caught:
            peek_stamp(data[:size])
        assert caught.value.offset in (0, 4) and caught.value.field in ("encapsulation header", "header.stamp")


def test_the_stamp_of_another_representation_is_not_read():
    """The header decides, as in decoding."""
    with pytest.raises(WrongEncapsulation):
        peek_stamp(b"\x00\x07" + bytes(20))
    with pytest.raises(NotBytes):
        peek_stamp("no bytes")
