"""Our bytes against three codecs that are not ours: pycdr2, rosbags with Humble's definitions, CycloneDDS's serializer.

And against what DDS makes of them on the way: RTPS fills every payload up to a multiple of four bytes.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.interop.bridge_process import demand

demand(bridge=False, module=True)

from cdr_types import decode, encode
from cdr_types.messages import std_msgs
from cdr_types.registry import MESSAGE_TYPES, message_type, type_name
from tests.cdr_types.oracle import messages, ros_decode, ros_encode
from tests.interop.dds_messages import DDS_TYPES, from_dds, to_dds
from tests.interop.dds_node import DdsNode, loopback

pytestmark = pytest.mark.interop

ANY_MESSAGE = st.sampled_from(MESSAGE_TYPES).flatmap(messages)
TRAVELLERS = (
    "sensor_msgs/msg/JointState",
    "std_msgs/msg/String",
    "std_msgs/msg/Float32MultiArray",
    "geometry_msgs/msg/Pose",
)


@given(ANY_MESSAGE)
def test_four_writers_write_the_same_bytes(message: Any) -> None:
    """Ours, pycdr2's, rosbags' and CycloneDDS's, to the last byte and with the same header."""
    data = encode(message)
    assert data == message.serialize() == ros_encode(message)
    assert data == to_dds(message).serialize(use_version_2=False)


@given(ANY_MESSAGE, st.binary(max_size=3))
def test_every_reader_reads_what_we_write_and_we_read_it_with_any_padding(message: Any, padding: bytes) -> None:
    """The message comes back from all four; up to three bytes behind it, whatever they are, change nothing for us."""
    data, kind = encode(message), type(message)
    assert decode(data + padding, kind) == message
    assert kind.deserialize(data) == message and ros_decode(data, kind) == message
    assert from_dds(DDS_TYPES[type_name(kind)].deserialize(data)) == message


@given(ANY_MESSAGE)
def test_padded_as_rtps_pads_a_payload_has_the_length_that_arrives(message: Any) -> None:
    """Filled up with zeros to a multiple of four, as both DDS implementations do: read by us and by CycloneDDS alike."""
    data, kind = encode(message), type(message)
    padded = data + bytes(-len(data) % 4)
    assert decode(padded, kind) == from_dds(DDS_TYPES[type_name(kind)].deserialize(padded)) == message


class Way:
    """A way through DDS: a node that writes and one that reads, a topic for every travelling type."""

    def __init__(self) -> None:
        topics = {topic_of(name): name for name in TRAVELLERS}
        self._reader = DdsNode("reader", publishes={}, subscribes=topics, domain=30)
        self._writer = DdsNode("writer", publishes=topics, subscribes={}, domain=30)
        self._until(lambda: self._heard("there?"), "the nodes to meet", lambda: self._say("are you there?"))
        self._say("all said")
        self._until(lambda: self._heard("all said"), "the end of what was said")

    def _say(self, text: str) -> None:
        self._writer.write("/String", std_msgs.String(data=text))

    def _heard(self, text: str) -> bool:
        return any(text.encode() in (arrival.payload or b"") for arrival in list(self._reader.arrivals))

    def _until(self, is_so: Callable[[], bool], what: str, meanwhile: Callable[[], None] = lambda: None) -> None:
        deadline = time.monotonic() + 20.0
        while not is_so():
            assert time.monotonic() < deadline, f"waited in vain for {what}"
            meanwhile()
            time.sleep(0.001)

    def travel(self, message: Any) -> bytes:
        """Let a message travel and return the bytes that arrive."""
        self._reader.arrivals.clear()
        self._writer.write(topic_of(type_name(type(message))), message)
        self._until(lambda: bool(self._reader.arrivals), "the message")
        (arrival,) = self._reader.arrivals
        assert arrival.payload is not None
        return arrival.payload

    def close(self) -> None:
        """End both nodes."""
        self._writer.close()
        self._reader.close()


def topic_of(name: str) -> str:
    """Return the topic of a type."""
    return f"/{name.rpartition('/')[2]}"


@pytest.fixture(scope="module")
def way() -> Iterator[Way]:
    """A way through DDS for all tests."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("CYCLONEDDS_URI", loopback(f"bytes-{os.getpid()}"))
        made = Way()
    yield made
    made.close()


def check(way: Way, message: Any) -> None:
    """Judge what arrives of a message."""
    payload = way.travel(message)
    assert len(payload) % 4 == 0 and payload[:4] == b"\x00\x01\x00\x00"
    assert payload.startswith(encode(message))
    assert decode(payload, type(message)) == message
    assert DdsNode.read(type_name(type(message)), payload) == message


@given(message=st.sampled_from(TRAVELLERS).flatmap(lambda name: messages(message_type(name))))
def test_what_travelled_through_dds_is_read_by_us(way: Way, message: Any) -> None:
    """Written by CycloneDDS, sent as RTPS, taken as bytes: our decoder gives the message that went in."""
    check(way, message)


@pytest.mark.parametrize("length", range(9))
def test_a_text_of_every_length_travels(way: Way, length: int) -> None:
    """The only type whose length is no multiple of four by itself: the robot's mode, and names of frames."""
    check(way, std_msgs.String(data="x" * length))
