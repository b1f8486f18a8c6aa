"""The fast path for `sensor_msgs/JointState`, the type of 1,400 samples per second.

A stream of joint states repeats its frame, its names and its array lengths; only stamp and numbers change. So the
place of every number is known once one sample was seen: a *template* holds the constant bytes from the frame to the
count of the positions, and one `struct` that reads or writes stamp and numbers at once.

Rules:

* A template answers only for a little-endian payload of the same length whose constant bytes are equal, byte by byte,
  and whose two other counts are equal too: then nothing of the layout is left open. (Padding in front of numbers may
  differ: it carries nothing.)
* Writing: the key is the frame, the names and the three lengths themselves, not a hash of them.
* Whatever no template answers takes the generic path; a template is made only of what that path has accepted.
* At most `MAX_TEMPLATES` of each direction are kept, none for a payload over `MAX_TEMPLATE_SIZE`; a full cache
  forgets everything. Templates are immutable and swapped in by one assignment, so threads need no lock to read.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from struct import Struct
from typing import NamedTuple

from cdr_types.encapsulation import HEADER_LITTLE, LITTLE, byte_order
from cdr_types.generic import decode_generic, encode_generic
from cdr_types.layout import HEADER_SIZE, align
from cdr_types.messages.builtin_interfaces import Time
from cdr_types.messages.sensor_msgs import JointState
from cdr_types.messages.std_msgs import Header
from cdr_types.values import UNPACKABLE

__all__ = ["MAX_TEMPLATES", "MAX_TEMPLATE_SIZE", "decode_joint_state", "encode_joint_state"]

MAX_TEMPLATES = 64
"""Templates kept for each direction. The robot publishes five joint states and takes two."""

MAX_TEMPLATE_SIZE = 4096
"""Longest payload that gets a template [bytes]; an arm's has 332."""

_CONSTANT_AT = HEADER_SIZE + 8
"""Where the frame begins, behind the stamp."""

_LITTLE = int.from_bytes(HEADER_LITTLE[:2], "little")
_NOT_SURE = (AttributeError, *UNPACKABLE)


_Unpack = Callable[[bytes, int], tuple[float, ...]]


class _Reader(NamedTuple):
    """How to read payloads of one length, frame, names and array lengths."""

    constant: bytes
    head: Callable[[bytes], tuple[int, ...]]  # header, sec, nanosec, count of velocities, count of efforts
    frame_id: str
    name: list[str]
    velocities: int
    efforts: int
    position: _Unpack
    position_at: int
    velocity: _Unpack
    velocity_at: int
    effort: _Unpack
    effort_at: int


class _Writer(NamedTuple):
    """How to write joint states of one frame, names and array lengths."""

    constant: bytes
    values: Struct  # header, sec, nanosec, constant, positions, count, velocities, count, efforts


_readers: dict[int, tuple[_Reader, ...]] = {}
_writers: dict[tuple[object, ...], _Writer] = {}
_lock = threading.Lock()

_new = object.__new__


def decode_joint_state(data: bytes) -> JointState:
    """Return the JointState in a payload; errors as in `decode_generic`."""
    for reader in _readers.get(len(data), ()):
        if data.startswith(reader.constant, _CONSTANT_AT):
            _, head, frame_id, name, velocities, efforts, p, p_at, v, v_at, e, e_at = reader
            order, sec, nanosec, v_count, e_count = head(data)
            if order == _LITTLE and v_count == velocities and e_count == efforts:
                # The constructors only assign, and would take a quarter longer.
                message = _new(JointState)
                message.header = header = _new(Header)
                header.stamp = stamp = _new(Time)
                stamp.sec = sec
                stamp.nanosec = nanosec
                header.frame_id = frame_id
                message.name = name[:]
                message.position = [*p(data, p_at)]
                message.velocity = [*v(data, v_at)]
                message.effort = [*e(data, e_at)]
                return message
    message = decode_generic(data, JointState)
    if len(data) <= MAX_TEMPLATE_SIZE and byte_order(data) == LITTLE:
        _learn_to_read(data, message)
    return message


def encode_joint_state(message: JointState) -> bytes:
    """Return the payload of a JointState; errors as in `encode_generic`."""
    try:
        header, name = message.header, message.name
        position, velocity, effort = message.position, message.velocity, message.effort
        stamp = header.stamp
        if (
            header.__class__ is Header
            and stamp.__class__ is Time
            and name.__class__ is list
            and position.__class__ is list
            and velocity.__class__ is list
            and effort.__class__ is list
        ):
            velocities, efforts = len(velocity), len(effort)
            key = (header.frame_id, *name, len(position), velocities, efforts)
            writer = _writers.get(key)
            if writer is not None:
                return writer.values.pack(
                    HEADER_LITTLE,
                    stamp.sec,
                    stamp.nanosec,
                    writer.constant,
                    *position,
                    velocities,
                    *velocity,
                    efforts,
                    *effort,
                )
    except _NOT_SURE:
        pass
    data = encode_generic(message)
    if len(data) <= MAX_TEMPLATE_SIZE:
        _learn_to_write(data, message)
    return data


def _learn_to_read(data: bytes, message: JointState) -> None:
    """Keep a template of a payload that the generic path has decoded."""
    end = _constant_end(message)
    positions, velocities, efforts = len(message.position), len(message.velocity), len(message.effort)
    position_at = _first(end, positions)
    v_count_at = position_at + 8 * positions
    velocity_at = _first(v_count_at + 4, velocities)
    e_count_at = velocity_at + 8 * velocities
    reader = _Reader(
        constant=data[_CONSTANT_AT:end],
        head=Struct(f"<H2xiI{v_count_at - _CONSTANT_AT}xI{e_count_at - v_count_at - 4}xI").unpack_from,
        frame_id=message.header.frame_id,
        name=message.name[:],
        velocities=velocities,
        efforts=efforts,
        position=Struct(f"<{positions}d").unpack_from,
        position_at=position_at,
        velocity=Struct(f"<{velocities}d").unpack_from,
        velocity_at=velocity_at,
        effort=Struct(f"<{efforts}d").unpack_from,
        effort_at=_first(e_count_at + 4, efforts),
    )
    with _lock:
        if sum(map(len, _readers.values())) >= MAX_TEMPLATES:
            _readers.clear()
        _readers[len(data)] = (reader, *_readers.get(len(data), ()))


def _learn_to_write(data: bytes, message: JointState) -> None:
    """Keep a template of a message that the generic path has encoded."""
    end = _constant_end(message)
    lengths = (len(message.position), len(message.velocity), len(message.effort))
    constant = data[_CONSTANT_AT:end]
    writer = _Writer(constant, Struct(f"<4siI{len(constant)}s{_numbers(end, *lengths)}"))
    with _lock:
        if len(_writers) >= MAX_TEMPLATES:
            _writers.clear()
        _writers[(message.header.frame_id, *message.name, *lengths)] = writer


def _constant_end(message: JointState) -> int:
    """Return the offset behind the count of the positions: the frame, the names and two counts lie before it."""
    end = _CONSTANT_AT + _text_size(message.header.frame_id)
    end = align(end, 4) + 4
    for name in message.name:
        end = align(end, 4) + _text_size(name)
    return align(end, 4) + 4


def _text_size(text: str) -> int:
    """Return the bytes of a string: length, UTF-8, NUL."""
    return 4 + len(text.encode("utf-8")) + 1


def _first(offset: int, count: int) -> int:
    """Return where the doubles of an array begin whose count ends at `offset`: no alignment in front of none."""
    return align(offset, 8) if count else offset


def _numbers(offset: int, positions: int, velocities: int, efforts: int) -> str:
    """Return the `struct` format of three arrays of doubles, of which the first one's count ends at `offset`."""
    formats = []
    for count, follower in ((positions, "I"), (velocities, "I"), (efforts, "")):
        start = _first(offset, count)
        formats.append(f"{start - offset}x{count}d{follower}")
        offset = start + 8 * count + 4
    return "".join(formats)
